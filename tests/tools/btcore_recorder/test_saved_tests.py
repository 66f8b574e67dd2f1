"""`btcore replay --save-test`: tests that fail as the recorded run did, until the tree is mended."""

import runpy
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from btcore import BtcoreError
from btcore.cli.main import main
from btcore_recorder import assert_does_not_fail

DOOR = """<root BTCPP_format="4"><BehaviorTree ID="Door"><Sequence>
    <Fallback><Sequence name="open"><Look name="look" angle="{angle}"/><Push name="push"/></Sequence>
              <ScriptCondition name="ajar" code="angle &gt; 30"/></Fallback>
    <Drive name="drive"/>
</Sequence></BehaviorTree></root>
"""
NODES = """
import btcore
from btcore import Clock, Put

@btcore.action
async def look(clock: Clock, angle: Put[int]) -> bool:
    for number in range(20):
        angle(number)
        await btcore.running()
    return True

@btcore.action
def push(clock: Clock) -> bool:
    return clock.now() < 1

@btcore.action
def drive() -> bool:
    raise OSError("no motor") from None
"""


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with a tree, its nodes, and the recording of a run that failed."""
    monkeypatch.chdir(tmp_path)
    Path("door.xml").write_text(DOOR, encoding="utf-8")
    Path("nodes.py").write_text(NODES, encoding="utf-8")
    arguments = ["run", "door.xml", "--plugin", "nodes.py", "--fast", "--record", "night.btrec.txt"]
    assert CliRunner().invoke(main, arguments).exit_code == 1
    return tmp_path


def replay(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["replay", *arguments], prog_name="btcore")


def run_pytest(*files: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@pytest.mark.usefixtures("project")
def test_incident_becomes_a_test_that_fails_until_the_tree_is_mended() -> None:
    Path("tests").mkdir()
    result = replay("night.btrec.txt", "--save-test", "tests/test_door.py", "--shrink")
    assert result.stdout.splitlines() == [
        "shrunk from 22 to 2 ticks and halts, and from 42 to 4 inputs",
        "wrote tests/test_door.py and tests/test_door.btrec.txt",
        "with door.xml, the test now fails: the tree fails in tick 21, because of 'ajar'",
    ], result.output
    assert replay("tests/test_door.btrec.txt", "--verify").exit_code == 0
    text = Path("tests/test_door.py").read_text(encoding="utf-8")
    assert 'tree=FOLDER / "../door.xml"' in text
    assert len(text.splitlines()) <= 21
    result = replay("night.btrec.txt", "--from", "0", "--to", "1.5", "--save-test", "tests/test_calm.py")
    assert result.stdout.splitlines()[-1] == "with door.xml, the test now passes", result.output
    found = run_pytest("tests")
    assert "AssertionError: the tree fails in tick 21, because of 'ajar'" in found.stdout
    assert "1 failed, 1 passed" in found.stdout
    # The mended tree ticks a new leaf where the run failed: its result is not recorded.
    Path("door.xml").write_text(DOOR.replace("</Fallback>", "<Ring/></Fallback>"), encoding="utf-8")
    with pytest.warns(UserWarning, match="no result is recorded for 'Ring::7': what follows is not tested"):
        runpy.run_path("tests/test_door.py")["test_door"]()


@pytest.mark.usefixtures("project")
def test_saved_test_of_a_tree_with_other_leaves_does_not_pass_by_accident() -> None:
    arguments = ["night.btrec.txt", "--tree", "door.xml", "--save-test"]
    assert replay(*arguments, "test_door.py").exit_code == 0
    Path("door.xml").write_text(DOOR.replace('"push"', '"shove"'), encoding="utf-8")
    with pytest.raises(AssertionError, match="for 'shove', and the tree has no 'push'"):
        assert_does_not_fail("test_door.btrec.txt", tree="door.xml")
    assert replay(*arguments, "test_match.py", "--match", "push=shove").stdout.endswith("because of 'ajar'\n")
    assert '    matches={"push": "shove"},' in Path("test_match.py").read_text(encoding="utf-8")


@pytest.mark.usefixtures("project")
def test_period_within_a_run_is_run_with_trees_of_the_same_nodes() -> None:
    assert replay("night.btrec.txt", "--from", "1.5", "--save-test", "test_end.py").exit_code == 0
    with pytest.warns(UserWarning, match="no result is recorded for 'drive'"):
        assert_does_not_fail("test_end.btrec.txt", tree=edited(DOOR.replace("30", "10")))
    with pytest.raises(BtcoreError, match="within a run: it has no start for a tree with other"):
        assert_does_not_fail(
            "test_end.btrec.txt", tree=edited(DOOR.replace("<Fallback>", "<Fallback><Stop/>"))
        )


def edited(text: str) -> str:
    Path("edited.xml").write_text(text, encoding="utf-8")
    return "edited.xml"


@pytest.mark.usefixtures("project")
def test_included_files_are_those_of_the_project() -> None:
    main_text = '<root BTCPP_format="4"><include path="door.xml"/></root>'
    Path("main.xml").write_text(main_text, encoding="utf-8")
    arguments = ["run", "main.xml", "--plugin", "nodes.py", "--fast", "--record", "run.btrec.txt"]
    assert CliRunner().invoke(main, arguments).exit_code == 1
    assert "fails: the tree fails in tick 21" in replay("run.btrec.txt", "--save-test", "test_a.py").stdout
    Path("door.xml").write_text(DOOR.replace("30", "10"), encoding="utf-8")
    assert "the test now passes" in replay("run.btrec.txt", "--save-test", "test_b.py").stdout


@pytest.mark.usefixtures("project")
@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--save-test", "door.py"], "pytest finds tests in files test_….py"),
        (["--save-test", "test_x.py", "--verify"], "--save-test and --verify exclude each other"),
        (
            ["--save-test", "test_x.py", "--tree", "door.xml", "--outcomes", "IsOpen=S"],
            "--save-test and --outcomes exclude each other",
        ),
        (["--shrink"], "--shrink needs --save-test"),
        (["--save-test", "test_old.py"], "test_old.py exists already"),
        (["--save-test", "test_x.py", "--from", "5"], "the ticks are at 0.000 s to 2.000 s"),
        (["--save-test", "test_x.py", "--to", "1", "--shrink"], "does not fail: only failures can be shrunk"),
        (["--save-test", "test_x.py", "--tree", "no.xml"], "no.xml: E003 no such file"),
    ],
)
def test_mistakes_are_explained(options: list[str], message: str) -> None:
    Path("test_old.py").touch()
    result = replay("night.btrec.txt", *options)
    assert result.exit_code == 2
    assert message in " ".join(result.stderr.split())
    assert not Path("test_x.py").exists()
