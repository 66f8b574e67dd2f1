"""`btcore stats` and `btcore diff`: statistics of a log, and the first difference between two logs."""

import json
import shutil
from pathlib import Path

import pytest

from btcore import SimClock, loads
from btcore.logs import open_log
from tests.btcore.cli.conftest import Cli, TreeFile

CAPTURES = Path(__file__).parents[2] / "btcore" / "logs" / "captures"
BTLOG, DB3, FBL = (CAPTURES / name for name in ("v4_sample.btlog", "v4_sample.db3", "v3_sample.fbl"))


@pytest.mark.parametrize("log", [BTLOG, DB3], ids=["btlog", "sqlite"])
def test_stats_counts_the_recorded_run(cli: Cli, log: Path) -> None:
    result = cli("stats", log, "--json")
    assert result.exit_code == 0, result.output
    data = json.loads(result.stdout)
    assert data["transitions"] == 57
    assert data["damage"] is None
    root = data["nodes"]["root_seq"]
    assert (root["success"], root["failure"], round(root["rate"], 3), root["runs"]) == (2, 1, 0.667, 3)
    assert data["nodes"]["AlwaysSuccess::10"]["rate"] is None


def test_changes_omit_the_repeated_results_of_a_reactive_node(cli: Cli, tmp_path: Path) -> None:
    tree = loads(
        """<root BTCPP_format="4"><BehaviorTree ID="Main"><ReactiveSequence name="drive">
        <ScriptCondition name="charged" code="level &gt; 1"/><Sleep name="move" msec="9000"/>
        </ReactiveSequence></BehaviorTree></root>""",
        clock=SimClock(),
    )
    tree.blackboard["level"] = 3
    with open_log(tree, tmp_path / "run.btlog"):
        for level in (3, 2, 1):
            tree.blackboard["level"] = level
            tree.tick_once()
            tree.sleep(0.1)
    changes = json.loads(cli("stats", tmp_path / "run.btlog", "--json").stdout)["changes"]
    assert [(change["time_s"], change["node"], change["result"]) for change in changes] == [
        (0.0, "drive", "RUNNING"),
        (0.0, "charged", "SUCCESS"),
        (0.0, "move", "RUNNING"),
        (0.2, "charged", "FAILURE"),
        (0.2, "move", None),
        (0.2, "drive", "FAILURE"),
    ]


def test_stats_counts_a_log_of_format_3(cli: Cli) -> None:
    result = cli("stats", FBL)
    assert "20 transitions of 11 nodes in 0.456 s" in result.stdout
    assert "root_seq ▶" in result.stdout
    assert "slowest leaves  cnt 0.305 s, Sub::6/Count::8 0.151 s" in result.stdout


def test_sort_and_top_select_the_slowest_nodes(cli: Cli) -> None:
    result = cli("stats", FBL, "--sort", "total", "--top", "2", "--json")
    assert list(json.loads(result.stdout)["nodes"]) == ["root_seq", "Fallback::3"]


def test_truncated_log_is_counted_up_to_the_cut_with_a_warning(cli: Cli, tmp_path: Path) -> None:
    cut = tmp_path / "cut.btlog"
    cut.write_bytes(BTLOG.read_bytes()[:-100])
    result = cli("stats", cut)
    assert result.exit_code == 0
    assert (
        "the file is truncated within a transition, 8 bytes after the last complete transition"
        in result.stderr
    )
    assert "45 transitions are read" in result.stderr
    assert "45 transitions of 10 nodes" in " ".join(result.stdout.split())  # the path may wrap the line


def test_gap_is_reported(cli: Cli, tmp_path: Path) -> None:
    shutil.copy(BTLOG, tmp_path / "run.btlog")
    (tmp_path / "run.btlog.gaps").write_text("20 the transitions 21 to 30 are lost\n")
    result = cli("stats", tmp_path / "run.btlog", "--json")
    assert "a gap before transition 21: the transitions 21 to 30 are lost" in result.stderr
    assert json.loads(result.stdout)["gaps"] == [
        {"before": 21, "reason": "the transitions 21 to 30 are lost"}
    ]


@pytest.mark.parametrize("command", [["stats"], ["diff", str(BTLOG)], ["replay", "--text"]])
@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("gone.btlog", None, "cannot read this log: no such file"),
        ("run.rrd", b"RRF2", "logs that can be read end in .btlog, .btdb, .btrec.txt, .db3, .fbl or .mcap"),
        ("empty.fbl", b"", "this is not a .fbl file"),
        ("head.btlog", BTLOG.read_bytes()[:5000], "this log ends in its header: 5000 of 8339 bytes"),
        ("half.db3", DB3.read_bytes()[:14000], "the file is truncated: it has 14000 of 28672 bytes"),
    ],
)
def test_file_that_is_not_a_log_exits_with_2_and_a_message(
    cli: Cli, tmp_path: Path, command: list[str], name: str, content: bytes | None, message: str
) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    result = cli(*command, name)
    assert result.exit_code == 2, result.output
    assert f"error: {name}: " in result.stderr
    assert message in result.stderr
    assert "Traceback" not in result.stderr


def test_diff_finds_no_difference_between_two_formats_of_a_run(cli: Cli) -> None:
    result = cli("diff", BTLOG, DB3, "--times", "0.001")
    assert (result.exit_code, result.stdout) == (0, "no difference: 57 transitions\n")


def test_diff_compares_two_runs_by_the_transitions_of_their_nodes(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file('<Repeat num_cycles="2"><Sleep name="nap" msec="100"/></Repeat>')
    cli("run", tree, "--fast", "--log", "a.btlog")
    cli("run", tree, "--fast", "--log", "b.db3")
    assert cli("diff", "a.btlog", "b.db3").exit_code == 0
    tree.write_text(tree.read_text().replace('"2"', '"3"'))
    cli("run", tree, "--fast", "--log", "c.btlog")
    longer = cli("diff", "a.btlog", "c.btlog", "--context", "2")
    assert longer.exit_code == 1
    lines = longer.stdout.splitlines()
    assert lines[0] == "the runs differ after 7 common transitions"
    assert [line[:2].strip() for line in lines[1:]] == ["", "", "A", "A", "B", "B", "B"]
    assert "SUCCESS" in lines[3]
    assert "RUNNING" in lines[5]


def test_diff_prints_its_result_as_json(cli: Cli, tree_file: TreeFile) -> None:
    for log, last in (("a.db3", '<Sleep msec="9"/>'), ("b.db3", "<AlwaysFailure/>")):
        cli("run", tree_file(f"<Sequence><AlwaysSuccess/>{last}</Sequence>"), "--fast", "--log", log)
    same, other = (cli("diff", "a.db3", b, "--json", "--context", "1") for b in ("a.db3", "b.db3"))
    assert same.exit_code == 0
    assert json.loads(same.stdout) | {"before": []} == {
        "equal": True, "common": 8, "by_time": False,
        "before": [], "a": [], "b": [], "only_in_a": [], "only_in_b": [],
    }  # fmt: skip
    assert other.exit_code == 1
    data = json.loads(other.stdout)
    assert (data["equal"], data["common"]) == (False, 2)
    assert 0 <= data["before"][0].pop("time_s") < 1e-3
    assert data["before"] == [{"node": "AlwaysSuccess::2", "previous": "IDLE", "status": "SUCCESS"}]
    assert [step["node"] for step in data["a"]] == ["Sleep::3", "Sleep::3"]
    assert (data["only_in_a"], data["only_in_b"]) == (["Sleep::3"], ["AlwaysFailure::3"])


def test_diff_reports_times_beyond_the_tolerance(cli: Cli, tree_file: TreeFile) -> None:
    tree = tree_file('<Sleep name="nap" msec="100"/>')
    cli("run", tree, "--fast", "--log", "a.btlog")
    tree.write_text(tree.read_text().replace('"100"', '"900"'))
    cli("run", tree, "--fast", "--log", "b.btlog")
    assert cli("diff", "a.btlog", "b.btlog").exit_code == 0
    assert cli("diff", "a.btlog", "b.btlog", "--times", "1").exit_code == 0
    result = cli("diff", "a.btlog", "b.btlog", "--times", "0.5")
    assert result.exit_code == 1
    assert "after 1 common transition: the next transition is the same, but 0.800000 s apart" in result.stdout


def test_diff_reports_a_shorter_run_and_different_trees(cli: Cli, tmp_path: Path) -> None:
    (tmp_path / "cut.btlog").write_bytes(BTLOG.read_bytes()[:-18])
    result = cli("diff", "cut.btlog", BTLOG)
    assert result.exit_code == 1
    assert "after 55 common transitions: A ends, B continues" in result.stdout
    assert "(end of cut.btlog)" in result.stdout
    other = cli("diff", BTLOG, FBL)
    assert other.exit_code == 1
    assert "only the tree of A contains Script::2" in other.stderr


def test_stats_names_the_node_that_made_the_tree_fail(cli: Cli, tree_file: TreeFile) -> None:
    long = '<Timeout name="limit" msec="50"><Sleep msec="1000"/></Timeout>'
    inverted = '<Inverter name="not"><AlwaysSuccess/></Inverter>'
    body = (
        f'<Sequence name="Tür"><Sleep msec="100"/><Fallback name="any">{inverted}{long}</Fallback></Sequence>'
    )
    cli("run", tree_file(body), "--fast", "--log", "a.btlog")
    assert "the tree failed at  limit after 0.150 s" in cli("stats", "a.btlog").stdout
    failure = json.loads(cli("stats", "a.btlog", "--json").stdout)["failure"]
    assert [step["node"] for step in failure] == ["Tür", "any", "limit"]
    assert failure[1]["children"] == {"not": "FAILURE", "limit": "FAILURE"}
    # The child was halted by the timeout.
    assert (failure[2]["children"], failure[2]["ports"]) == ({"Sleep::7": None}, {"msec": "50"})
    cli("run", tree_file("<Fallback><AlwaysFailure/><AlwaysSuccess/></Fallback>"), "--log", "b.btlog")
    assert "failed at" not in cli("stats", "b.btlog").stdout
    assert json.loads(cli("stats", "b.btlog", "--json").stdout)["failure"] == []
