"""`btcore prove`: questions, answers, exit codes, and the files of counterexamples."""

import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from click.testing import Result

from btcore.logs import read_log
from btcore_proof import command
from btcore_recorder import Replay
from tests.btcore.cli.conftest import Cli

DRIVE = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Fallback> <Sequence> <PathFree/> <Drive/> </Sequence> <Stop/> </Fallback>
  </BehaviorTree>
  <TreeNodesModel> <Condition ID="PathFree"/> <Action ID="Drive"/> <Action ID="Stop"/> </TreeNodesModel>
</root>"""
LOOK = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main">
    <Sequence> <Look seen="{seen}"/> <ScriptCondition code="seen == wanted"/> </Sequence>
  </BehaviorTree>
  <TreeNodesModel>
    <Action ID="Look"> <output_port name="seen" type="std::string"/> </Action>
  </TreeNodesModel>
</root>"""
BIG = """
<root BTCPP_format="4">
  <BehaviorTree ID="Main"> <Parallel> {} </Parallel> </BehaviorTree>
  <TreeNodesModel> <Action ID="Work"/> </TreeNodesModel>
</root>""".format('<Delay delay_msec="10"><Work/></Delay>' * 5)


@pytest.fixture
def prove(cli: Cli, tmp_path: Path) -> Callable[..., Result]:
    """A function that proves a tree in a text; `declarations` is the text of the file beside it."""

    def run(xml: str, *words: str, declarations: str = "") -> Result:
        file = tmp_path / "tree.xml"
        file.write_text(xml, encoding="utf-8")
        file.with_suffix(".proof.toml").write_text(declarations, encoding="utf-8")
        return cli("prove", file, "--model", file, *words)

    return run


def test_exit_code_is_0_if_everything_is_proved(prove: Callable[..., Result]) -> None:
    result = prove(DRIVE, "--never", "Drive & Stop", "--ask", "PathFree is SUCCESS before Drive ticked")
    assert result.exit_code == 0, result.output
    assert "✔ never Drive & Stop  proved\n" in result.stdout
    assert "ticks run" in result.stdout


def test_refuted_question_is_drawn_and_gives_exit_code_1(prove: Callable[..., Result]) -> None:
    result = prove(DRIVE, "--never", "Drive & !PathFree ticked")
    assert result.exit_code == 1
    assert "1     0.0 s  PathFree SUCCESS, Drive RUNNING  → RUNNING\n" in result.stdout
    assert "2     0.1 s  Drive RUNNING  → RUNNING\n" in result.stdout
    assert "▪ Drive  ▶ RUNNING" in result.stdout


def test_cycle_is_marked(prove: Callable[..., Result]) -> None:
    result = prove(
        DRIVE,
        "--ask",
        "Drive leads to Drive is SUCCESS | Drive is FAILURE",
        declarations="[leaves.Drive]\nendless = true",
    )
    assert result.exit_code == 1
    assert "↻ the ticks from here repeat forever:" in result.stdout
    assert "↻ on to tick 2" in result.stdout


def test_json_holds_answers_and_counterexamples(prove: Callable[..., Result]) -> None:
    result = prove(DRIVE, "--never", "Stop", "--json")
    assert result.exit_code == 1
    questions = json.loads(result.stdout)["questions"]
    proved, refuted = questions[0], questions[-1]
    assert (proved["question"], proved["answer"]) == ("the tree ends", "proved")
    assert proved["counterexample"] == []
    assert (refuted["answer"], refuted["ticks"], refuted["cycle"]) == ("refuted", 1, None)
    assert proved["states"] == refuted["states"] > 2
    (tick,) = refuted["counterexample"]
    assert [(leaf["node"], leaf["result"]) for leaf in tick["leaves"]] == [
        ("PathFree::3", "SUCCESS"),
        ("Drive::4", "FAILURE"),
        ("Stop::5", "RUNNING"),
    ]


@pytest.mark.parametrize(
    ("words", "declarations", "message"),
    [
        (("--never", "Drive &"), "", "is missing at the end"),
        (("--never", "(" * 300), "", "a proposition has more than 200 words and signs"),
        (("--ask", "sometimes Drive"), "", "'sometimes Drive' is not a question: write 'never A'"),
        ((), "[leaves.Drive", "tree.proof.toml: "),
        ((), "[leaves.Drive]\nresult = ['SUCCESS']", "unknown key 'result'; did you mean 'results'?"),
        (("--save", "-", "--declarations", "missing.toml"), "", "missing.toml"),
    ],
    ids=["proposition", "long proposition", "question", "TOML", "key", "file"],
)
def test_errors_of_users_give_exit_code_2(
    prove: Callable[..., Result], words: tuple[str, ...], declarations: str, message: str
) -> None:
    result = prove(DRIVE, *words, declarations=declarations)
    assert result.exit_code == 2
    assert message in result.stderr


def test_question_about_an_unknown_node_fails_alone(prove: Callable[..., Result]) -> None:
    result = prove(DRIVE, "--never", "Drve", "--never", "Drive & Stop")
    assert result.exit_code == 2
    assert (
        "? never Drve  unknown: 'Drve': the tree has no node 'Drve'; did you mean 'Drive'?" in result.stdout
    )
    assert "✔ never Drive & Stop  proved\n" in result.stdout


def test_strict_accepts_no_condition(prove: Callable[..., Result]) -> None:
    looped = DRIVE.replace("<Fallback>", '<RetryUntilSuccessful num_attempts="-1"><Fallback>').replace(
        "</Fallback>", "</Fallback></RetryUntilSuccessful>"
    )
    assert "proved: unless" in prove(looped).stdout
    assert [prove(looped, *words).exit_code for words in ((), ("--strict",))] == [0, 1]
    assert prove(DRIVE, "--strict").exit_code == 0


def test_time_limit_ends_the_search_with_the_answers_so_far(prove: Callable[..., Result]) -> None:
    result = prove(BIG, "--time", "0.001", "--never", "Parallel is SKIPPED")
    assert "unknown: the time limit of 0.001 s was reached" in result.stdout
    assert result.exit_code == 4


def test_init_writes_commented_declarations(cli: Cli, tmp_path: Path) -> None:
    file, target = tmp_path / "look.xml", tmp_path / "look.proof.toml"
    file.write_text(
        LOOK.replace("<ScriptCondition", '<Turn to="{goal}"/> <ScriptCondition'), encoding="utf-8"
    )
    models = tmp_path / "models.xml"
    models.write_text(
        '<root BTCPP_format="4"><TreeNodesModel> <Action ID="Look"><output_port name="seen"/></Action>'
        ' <Action ID="Turn"><input_port name="to"/></Action> </TreeNodesModel></root>',
        encoding="utf-8",
    )
    words = ("prove", file, "--model", models)
    assert cli(*words, "--init").exit_code == 0
    text = target.read_text(encoding="utf-8")
    assert all(not line or line.startswith("# ") for line in text.splitlines())
    again = cli(*words, "--init")
    assert again.exit_code == 2
    assert "exists already" in again.stderr
    before = json.loads(cli(*words, "--json").stdout)
    # Without the comments, the models are those that hold anyway; `given` is new, and there is a question.
    declared = [line.removeprefix("# ") for line in text.splitlines() if re.match(r"# (\[|\S+ = )", line)]
    target.write_text(
        "\n".join(declared).replace("seen = []", "seen = ['cup']\nwanted = ['cup']"), encoding="utf-8"
    )
    result = json.loads(cli(*words, "--json", "--given", "wanted").stdout)
    assert 'given = ["goal"]' in declared
    assert [each["answer"] for each in before["questions"]].count("refuted") >= 1
    assert result["questions"][-1]["question"] == "never Look is FAILURE"
    assert result["questions"][4]["answer"] == "proved"


def test_domain_may_have_the_name_in_a_calling_tree(prove: Callable[..., Result]) -> None:
    called = """<root BTCPP_format="4" main_tree_to_execute="Main">
      <BehaviorTree ID="Main"> <SubTree ID="Sub" found="{seen}"/> </BehaviorTree>
      <BehaviorTree ID="Sub">
        <Sequence> <Look seen="{found}"/> <ScriptCondition code="found == 'cup'"/> </Sequence>
      </BehaviorTree>
      <TreeNodesModel>
        <Action ID="Look"> <output_port name="seen" type="std::string"/> </Action>
      </TreeNodesModel>
    </root>"""
    codes = [
        prove(
            called, "--never", "{seen} == 'mug'", declarations=f"[entries]\n{name} = ['cup', 'box']"
        ).exit_code
        for name in ("found", "seen")
    ]
    assert codes == [0, 0]


def test_unknown_value_gives_exit_code_4(prove: Callable[..., Result], tmp_path: Path) -> None:
    result = prove(LOOK, "--given", "wanted")
    assert result.exit_code == 4
    assert "unknown: some of it depends on comparisons with values that are not known" in result.stdout
    assert "✔ the tree ends  proved: if scripts can compare the values of {wanted}" in result.stdout
    words = (
        "--given",
        "wanted",
        "--never",
        "ScriptCondition is FAILURE",
        "--json",
        "--save",
        tmp_path / "saved",
    )
    possible = prove(LOOK, *words)
    assert not (tmp_path / "saved").exists()
    (tick,) = json.loads(possible.stdout)["questions"][-1]["counterexample"]
    assert (possible.exit_code, tick["assumed"]) == (4, ["{seen} == {wanted} is false"])


def test_given_entries_have_all_values_of_their_domain(prove: Callable[..., Result]) -> None:
    entries = "[entries]\nseen = ['cup', 'box']\nwanted = ['box']"
    assert prove(LOOK, declarations=entries).exit_code == 1  # never written
    result = prove(LOOK, "--given", "wanted", "--never", "{wanted} == 'box'", declarations=entries)
    assert result.exit_code == 1
    assert "before the first tick  {wanted} = box" in result.stdout


def test_question_whose_premise_never_occurs_is_vacuous(prove: Callable[..., Result]) -> None:
    result = prove(DRIVE, "--ask", "PathFree is SKIPPED leads to Stop")
    assert "proved, vacuously: 'PathFree is SKIPPED' never occurs" in result.stdout


@pytest.mark.parametrize(
    ("words", "bound"),
    [
        (("--ticks", "2"), "runs of more than 2 ticks were not searched"),
        (("--memory", "100"), "the memory limit of 100 MB was reached"),
        (("--states", "2"), "more than 2 states were found"),
    ],
)
def test_bounds_are_reported_as_unknown(
    prove: Callable[..., Result], words: tuple[str, ...], bound: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("btcore_proof.search.memory_used", lambda: 200 << 20)
    result = prove(BIG, *words)
    assert result.exit_code == 4
    assert f"? no node raises an exception  unknown: {bound}" in result.stdout


def test_ctrl_c_prints_what_is_known(prove: Callable[..., Result], monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command._Progress, "__call__", interrupt)
    result = prove(BIG, "--never", "Parallel is SKIPPED")
    assert result.exit_code == 4, result.output
    assert "unknown: the search was interrupted" in result.stdout


# --- pictures of state graphs


def test_pictures_show_states_and_ticks(prove: Callable[..., Result], tmp_path: Path) -> None:
    dot = tmp_path / "states.dot"
    assert prove(DRIVE, "--dot", str(dot)).exit_code == 0
    lines = dot.read_text(encoding="utf-8").splitlines()
    assert '  "0" [label="start", fillcolor="#e8f0ff", color="#2b62c4"];' in lines
    assert '  "0" -> "2" [label="PathFree ✔\\nDrive ▶"];' in lines
    assert '  "2" -> "SUCCESS" [label="Drive ✔\\nor 1 other"];' in lines


def test_big_graphs_are_not_drawn(prove: Callable[..., Result], tmp_path: Path) -> None:
    tree = BIG.replace('<Delay delay_msec="10"><Work/></Delay>', "<Sequence><Work/><Work/></Sequence>")
    result = prove(tree, "--dot", str(tmp_path / "states.dot"))
    assert result.exit_code == 2
    assert "states; pictures show at most 100" in result.stderr
    assert "243 states" in result.stdout


# --- files of counterexamples


def run_test(file: Path) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", file.name],
        cwd=file.parent,
        capture_output=True,
        text=True,
        check=False,
    )


def test_saved_test_fails_until_the_tree_is_mended(prove: Callable[..., Result], tmp_path: Path) -> None:
    folder = tmp_path / "found" / "here"
    prove(DRIVE, "--never", "Drive & !PathFree ticked", "--save", str(folder))
    assert sorted(path.name for path in folder.iterdir()) == [
        "08-never-drive-pathfree-ticked.btrec.txt",
        "test_08_never_drive_pathfree_ticked.py",
    ]
    test = folder / "test_08_never_drive_pathfree_ticked.py"
    text = test.read_text(encoding="utf-8")
    assert 'FOLDER / "../../tree.xml"' in text
    outcome = run_test(test)
    assert "'Drive & !PathFree ticked' holds" in outcome.stdout
    mended = DRIVE.replace("Sequence>", "ReactiveSequence>").replace("Fallback>", "ReactiveFallback>")
    (tmp_path / "tree.xml").write_text(mended, encoding="utf-8")
    outcome = run_test(test)
    assert outcome.returncode == 0, outcome.stdout


def test_saved_recording_shows_the_counterexample(prove: Callable[..., Result], tmp_path: Path) -> None:
    prove(DRIVE, "--never", "Stop & !PathFree ticked", "--save", str(tmp_path))
    file = tmp_path / "08-never-stop-pathfree-ticked.btrec.txt"
    recording = read_log(file)
    last = {each.uid: each.status.name for each in recording.transitions}
    names = {node.name: last.get(uid) for uid, node in recording.nodes.items()}
    assert names["Stop"] == "RUNNING"
    assert Replay(file).verify() is None


ENDLESS = """
<root BTCPP_format="4"> <BehaviorTree ID="Main"> <ReactiveSequence>
  <Sleep msec="1000"/> <Action ID="Look"/>
</ReactiveSequence> </BehaviorTree> </root>"""
TIMED = """
<root BTCPP_format="4"> <BehaviorTree ID="Main"> <Parallel success_count="2">
  <Sequence> <Sleep msec="1001"/> <Action ID="Right"/> </Sequence>
  <Sequence> <Look seen="{seen}"/> <Sleep msec="1000"/> <Action ID="Left"/> </Sequence>
</Parallel> </BehaviorTree>
<TreeNodesModel>
  <Action ID="Look"> <output_port name="seen" type="int"/> </Action>
</TreeNodesModel> </root>"""
UPDATED = """
<root BTCPP_format="4"> <BehaviorTree ID="Main"> <Sequence>
  <Look seen="{seen}"/> <SkipUnlessUpdated entry="{seen}"> <Left seen="{seen}"/> </SkipUnlessUpdated>
</Sequence> </BehaviorTree>
<TreeNodesModel>
  <Action ID="Look"> <output_port name="seen"/> </Action>
  <Action ID="Left"> <input_port name="seen"/> </Action>
</TreeNodesModel> </root>"""


@pytest.mark.parametrize(
    ("tree", "words"),
    [
        (ENDLESS, ()),
        (TIMED, ("--never", "Right & !Left")),
        (UPDATED, ("--never", "Left is FAILURE", "--given", "seen")),
    ],
)
def test_recording_of_a_counterexample_is_what_happened(
    prove: Callable[..., Result], tmp_path: Path, tree: str, words: tuple[str, ...]
) -> None:
    result = prove(tree, *words, "--save", str(tmp_path))
    files = list(tmp_path.glob("*.btrec.txt"))
    assert files, result.output
    for file in files:
        assert Replay(file).verify() is None


def test_saved_tests_pass_ruff_and_name_what_tree_needs(prove: Callable[..., Result], tmp_path: Path) -> None:
    pytest.importorskip("ruff", reason="the compiled build is tested without ruff")
    (tmp_path / "spot.py").write_text(
        "from btcore import action\n\n\n@action\ndef wave() -> bool:\n    return True\n", encoding="utf-8"
    )
    tree = LOOK.replace("</Sequence>", "<Wave/> </Sequence>")
    entries = "[entries]\nseen = ['cup \"x\"', 'box']\nwanted = ['box']"
    words = ("--given", "wanted", "--never", "Wave is SUCCESS", "--plugin", str(tmp_path / "spot.py"))
    folder = tmp_path / "found"
    prove(tree, *words, "--save", str(folder), declarations=entries)
    test = folder / "test_08_never_wave_is_success.py"
    text = test.read_text(encoding="utf-8")
    assert 'nodes.add_plugin(FOLDER / "../spot.py")' in text
    recording = folder / "08-never-wave-is-success.btrec.txt"
    assert 'entry ["box", ' in recording.read_text(encoding="utf-8")
    for words in (("check",), ("format", "--check")):
        ruff = [sys.executable, "-m", "ruff", *words, "--isolated", str(folder)]
        checked = subprocess.run(ruff, capture_output=True, text=True, check=False)
        assert checked.returncode == 0, checked.stdout + checked.stderr
    assert "1 failed" in run_test(test).stdout


def test_run_that_outcomes_cannot_repeat_has_no_test(prove: Callable[..., Result], tmp_path: Path) -> None:
    tree = DRIVE.replace('"4"', '"3"').replace("Fallback>", "ManualSelector>")
    result = prove(tree, "--never", "Stop", "--save", str(tmp_path / "found"))
    assert (
        "warning: 'never Stop': no test was saved, because the leaves' outcomes do not repeat"
        in result.stderr
    )
    [file] = (tmp_path / "found").glob("*never*")
    assert Replay(file).verify() is None


def test_trees_from_stdin_cannot_be_saved(cli: Cli, tmp_path: Path) -> None:
    result = cli("prove", "-", "--save", tmp_path, input=DRIVE)
    assert result.exit_code == 2
    assert "--save needs a tree in a file" in result.stderr
