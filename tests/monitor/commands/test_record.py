"""`btcore record`: recording a running robot over the network in complete files."""

import functools
import signal
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner

import btcore
from btcore.cli.main import main
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs import BtLog, read_btlog, read_log
from btcore.logs.recording import parse_nodes
from btcore_monitor.events import (
    ConnectionEvent,
    DataSource,
    Event,
    LostTransitionsEvent,
    MissingDataEvent,
    ObservedNode,
    ObservedTree,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.log_writer import LogWriter
from btcore_monitor.logs import read_sqlite
from btcore_monitor.serve import serve
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.groot2_client import Groot2Client
from btcore_monitor.wire.fulltree import read_fulltree, write_fulltree
from btcore_monitor.wire.groot2 import Request, decode_transitions
from btcore_recorder import find_divergence, steps

pytestmark = pytest.mark.usefixtures("no_threads_left")
ROOT = Path(__file__).parents[3]
MS = 1_000_000
WALL = 1_700_000_000 * 10**9


@pytest.fixture
def record(command: Callable[..., Any]) -> Callable[..., Any]:
    """Return a function that starts ``btcore record …``."""
    return functools.partial(command, "record")


def test_every_numbered_transition_is_in_every_file(
    endless: btcore.Tree, record: Callable[..., Any], tmp_path: Path
) -> None:
    pytest.importorskip("rerun")
    pytest.importorskip("rosbags")
    with serve(endless, groot2_port=0) as publisher, BtLog(endless, tmp_path / "own.btlog"):
        outputs = [part for name in ("run.btlog", "run.db3", "run.rrd") for part in ("-o", name)]
        outputs += ["--bag", "run.mcap"]
        look = ["--find", "nothing*", "--palette", "colour-blind", "--log-level", "info"]
        recorder = record(publisher.address, *outputs, "--until-end", *look)
        assert publisher.wait_for_clients(1, 60)
        for _ in range(300):
            endless.tick_exactly_once()
        endless.halt()
        publisher.end_stream()
        assert recorder.end() == 0, recorder.stderr_text
    own = read_btlog(tmp_path / "own.btlog")
    assert len(own.transitions) > 2_000
    for name in ("run.btlog", "run.db3", "run.mcap"):
        recording = read_log(tmp_path / name)
        assert find_divergence(steps(own), steps(recording)) is None, name
        assert (recording.damage, recording.gaps) == ("", ())
        assert (recording.xml, recording.nodes) == (own.xml, own.nodes)
    assert f"{len(own.transitions)} transitions in run.btlog, run.db3" in recorder.stderr_text
    numbers = list(_numbers(tmp_path / "run.rrd"))
    assert sorted(numbers) == list(range(1, len(own.transitions) + 1))
    # The drawing options apply to the recording for the viewer.
    assert any("no node's name or path matches 'nothing*'" in line for line in _lines(tmp_path / "run.rrd"))


def _numbers(path: Path) -> Iterator[int]:
    from rerun.chunk import RrdReader

    for chunk in RrdReader(path).stream():
        if chunk.entity_path == "/log/numbers":
            for (number,) in chunk.to_record_batch().column("number").to_pylist():
                yield number


def test_ctrl_c_leaves_complete_files(
    endless: btcore.Tree, record: Callable[..., Any], tmp_path: Path, until: Callable[..., None]
) -> None:
    with serve(endless, groot2_port=0, grace=0) as publisher:
        recorder = record(publisher.address, "-o", "run.btlog", "-o", "run.db3")
        assert publisher.wait_for_clients(1, 60)
        endless.tick_exactly_once()
        until(lambda: "recording 'Endless'" in recorder.stderr_text, "the tree")
        until(lambda: len(read_btlog(tmp_path / "run.btlog").transitions) > 3, "transitions in the file")
        assert recorder.end(signal.SIGINT) == 0, recorder.stderr_text
    assert (
        "logs hold statuses; blackboards, exceptions, ticks and the scene need -o FILE.rrd"
        in recorder.stderr_text
    )
    first, second = read_btlog(tmp_path / "run.btlog"), read_sqlite(tmp_path / "run.db3")
    assert find_divergence(steps(first), steps(second), tolerance=MS) is None
    assert sorted(path.name for path in tmp_path.iterdir()) == ["run.btlog", "run.db3"]


def test_a_robot_with_only_groot_2_is_recorded_and_missing_data_is_reported(
    sample: btcore.Tree, record: Callable[..., Any], tmp_path: Path, until: Callable[..., None]
) -> None:
    path = tmp_path / "run.btlog"
    with serve(sample, groot2_port=0, run_channel=False) as publisher:
        recorder = record(publisher.address, "-o", "run.btlog", "--duration", "60")
        until(lambda: "recording 'Main'" in recorder.stderr_text, "the tree")
        sample.tick_exactly_once()
        until(lambda: len(read_btlog(path).transitions) >= 4, "transitions in the file")
        assert recorder.end(signal.SIGTERM) == 0
    recording = read_btlog(path)
    assert recording.statuses() == {node.uid: node.status for node in sample.nodes}
    assert all(
        f"record: {topic}: " in recorder.stderr_text for topic in ("ticks", "exceptions", "blackboard")
    )
    assert recording.xml == tree_to_xml(sample)


def test_a_robot_with_only_groot_1_is_recorded_in_every_file(
    endless: btcore.Tree, record: Callable[..., Any], tmp_path: Path, until: Callable[..., None]
) -> None:
    pytest.importorskip("rerun")
    names = ("run.btlog", "run.db3", "run.rrd")
    with (
        serve(endless, groot2_port=None, groot1_port=0, run_channel=False) as publisher,
        BtLog(endless, tmp_path / "own.btlog"),
    ):
        assert publisher.groot1_port is not None
        address = f"127.0.0.1:{publisher.groot1_port + 1}"
        recorder = record(address, *(part for name in names for part in ("-o", name)))
        # Groot 1's protocol does not contain the tree's name.
        until(lambda: "record: recording '" in recorder.stderr_text, "the tree")
        assert "by Groot 1's protocol" in recorder.stderr_text
        for _ in range(50):
            endless.tick_exactly_once()
        endless.halt()
        reported = len(read_btlog(tmp_path / "own.btlog").transitions)
        assert reported > 300
        until(lambda: len(read_btlog(tmp_path / "run.btlog").transitions) >= reported, "the transitions")
        assert recorder.end(signal.SIGINT) == 0, recorder.stderr_text
    own = read_btlog(tmp_path / "own.btlog")
    for name in names[:2]:
        recording = read_log(tmp_path / name)
        assert find_divergence(steps(own), steps(recording)) is None, name
        assert (recording.damage, recording.gaps) == ("", ())
    assert sorted(_numbers(tmp_path / "run.rrd")) == list(range(1, reported + 1))
    assert all(
        f"record: {topic}: not sent by Groot 1" in recorder.stderr_text
        for topic in ("ticks", "exceptions", "blackboard")
    )


def test_no_record_leaves_the_robots_buffer_to_another_client(
    sample: btcore.Tree, record: Callable[..., Any], tmp_path: Path, until: Callable[..., None]
) -> None:
    with (
        serve(sample, groot2_port=0, run_channel=False) as publisher,
        Groot2Client(parse_address(publisher.address), timeout=60) as owner,
    ):
        owner.request(Request.TOGGLE_RECORDING, b"start")
        recorder = record(publisher.address, "-o", "run.btlog", "--no-record", "--blackboard-rate", "0")
        until(lambda: "recording 'Main'" in recorder.stderr_text, "the tree")
        sample.tick_exactly_once()
        running = {node.uid: node.status for node in sample.nodes}
        until(lambda: read_btlog(tmp_path / "run.btlog").statuses() == running, "how the nodes stand")
        assert len(decode_transitions(owner.request(Request.GET_TRANSITIONS).body)) == 5
        assert recorder.end(signal.SIGINT) == 0, recorder.stderr_text
    assert "requested 20 times a second (--no-record): short changes are not seen" in recorder.stderr_text
    assert "blackboard: not requested" in recorder.stderr_text
    (gap,) = read_btlog(tmp_path / "run.btlog").gaps
    assert "short changes are not seen" in gap.reason


def _lines(path: Path) -> Iterator[str]:
    from rerun.chunk import RrdReader

    for chunk in RrdReader(path).stream():
        if chunk.entity_path == "/log":
            for (line,) in chunk.to_record_batch().column("TextLog:text").to_pylist():
                yield line


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "Missing option '-o'"),
        (["--bag", "run.btlog"], "a bag ends in .mcap; did you mean run.mcap?"),
        (["-o", "run.txt"], "types are .btlog, .db3, .btdb, .mcap and .rrd; did you mean run.btlog?"),
        (["-o", "nowhere/run.btlog"], "there is no folder"),
        (["-o", "a.btlog", "-o", "./a.btlog"], "is given twice"),
        (["not an address", "-o", "a.btlog"], "'not an address' is not an address"),
        (["127.0.0.1:9", "-o", "a.btlog", "--duration", "0.1"], "no tree was seen at 127.0.0.1:9"),
    ],
)
def test_an_error_is_reported_with_exit_code_2_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], message: str
) -> None:
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(main, ["record", *arguments])
    assert result.exit_code == 2
    assert isinstance(result.exception, SystemExit)
    assert message.casefold() in result.stderr.casefold()
    assert list(tmp_path.iterdir()) == []


# --- the log writer alone: events that a real robot does not produce on demand

TREE = ObservedTree(
    "a" * 32,
    "Main",
    (
        ObservedNode(1, "root", "Sequence", "control", "root", 0, (2, 3), {}, ""),
        ObservedNode(2, "A", "A", "action", "A::2", 1, (), {"speed": "{v}"}, ""),
        ObservedNode(3, "Sub", "SubTree", "subtree", "Sub::3", 1, (4,), {"x": "{y}"}, ""),
        ObservedNode(4, "deep", "Wait", "condition", "Sub::3/deep", 3, (), {}, "Sub::3"),
    ),
    {"": "Main", "Sub::3": "Sub"},
)


def changed(number: int, ms: int, uid: int, previous: int, status: int) -> TransitionEvent:
    return TransitionEvent(number, ms * MS, WALL + ms * MS, 1, uid, previous, status)


@pytest.fixture
def logs(tmp_path: Path) -> list[Path]:
    return [tmp_path / "run.btlog", tmp_path / "run.db3"]


def write(logs: list[Path], *events: Event) -> LogWriter:
    book = LogWriter(logs)
    for event in events:
        book.process_event(event)
    book.close()
    return book


def test_a_gap_is_marked_and_status_changes_within_it_are_added(logs: list[Path]) -> None:
    book = write(
        logs,
        TreeEvent(TREE, 0, WALL, {}),
        changed(1, 0, 1, 0, 1),
        changed(2, 1, 2, 0, 1),
        LostTransitionsEvent(3, 8),
        changed(9, 9, 2, 0, 1),
    )
    for log in logs:
        recording = read_log(log)
        assert [change[1:] for change in recording.transitions] == [
            (1, 0, 1),
            (2, 0, 1),
            (2, 1, 0),
            (2, 0, 1),
        ]
        assert recording.gaps == ((2, "the transitions 3 to 8 are lost"),)
        # An SQLite log's stamps increase by 1 µs at least.
        assert recording.transitions[-1].stamp - recording.start in (9 * MS, 9 * MS + 1_000)
    assert (book.transitions, book.gaps) == (4, 1)


def test_a_lost_connection_and_an_earlier_start_are_marked_as_gaps(logs: list[Path]) -> None:
    book = LogWriter(logs)
    sampled = DataSource(
        "Groot 2, sampled", {"ticks": "not sent", "transitions": "short changes are not seen"}
    )
    book.process_event(TreeEvent(TREE, 0, WALL, {1: 1}, has_transition_numbers=False, source=sampled))
    book.process_event(ConnectionEvent("lost", "no answer for 3 s"))
    book.process_event(TreeEvent(TREE, 5 * MS, WALL, {1: 2}, has_transition_numbers=False))
    book.close()
    assert [gap.reason for gap in read_log(logs[0]).gaps] == [
        "short changes are not seen",
        "the tree was running before the recording began",
        "the robot was away: no answer for 3 s",
    ]
    for log in logs:
        assert [change[1:] for change in read_log(log).transitions] == [(1, 0, 1), (1, 1, 2)]
        assert read_log(log).gaps[-1] == (1, "the robot was away: no answer for 3 s")


def test_missed_transitions_are_marked_as_a_gap_and_other_missed_data_is_not(logs: list[Path]) -> None:
    write(
        logs,
        TreeEvent(TREE, 0, WALL, {}, has_transition_numbers=False),
        changed(1, 1, 2, 0, 1),
        MissingDataEvent(2 * MS, WALL, MS, "blackboard", "not asked for"),
        MissingDataEvent(2 * MS, WALL, MS, "transitions", "the robot's buffer ran over"),
        changed(2, 2, 2, 2, 0),
    )
    for log in logs:
        assert read_log(log).gaps == ((1, "the robot's buffer ran over"),)
        assert [change[1:] for change in read_log(log).transitions] == [(2, 0, 1), (2, 1, 2), (2, 2, 0)]


def test_transitions_before_the_recording_are_marked_as_a_gap(logs: list[Path]) -> None:
    write(logs, TreeEvent(TREE, 0, WALL, {}), changed(500, 1, 2, 0, 1), changed(501, 2, 2, 1, 2))
    assert read_log(logs[0]).gaps == ((0, "the transitions up to 499 were before the recording"),)


def test_another_tree_is_written_to_separate_files(logs: list[Path]) -> None:
    book = LogWriter(logs)
    book.process_event(TreeEvent(TREE, 0, WALL, {}))
    book.process_event(changed(1, 0, 1, 0, 1))
    other = ObservedTree("b" * 32, "Main", TREE.nodes, TREE.subtrees)
    book.process_event(TreeEvent(other, 0, WALL, {}))
    book.process_event(changed(1, 0, 2, 0, 2))
    book.close()
    assert [file.name for file in book.files] == ["run.btlog", "run.db3", "run.2.btlog", "run.2.db3"]
    assert [read_log(file).transitions[0].uid for file in book.files] == [1, 1, 2, 2]


def test_a_tree_received_without_xml_is_written_as_xml(logs: list[Path]) -> None:
    again = read_fulltree(write_fulltree(TREE), TREE.tree_id)
    assert again == TREE
    nodes = parse_nodes(write_fulltree(TREE), "here")
    assert [node.path for node in nodes.values()] == [node.path for node in TREE.nodes]


def test_a_tree_received_with_xml_is_written_byte_for_byte(sample: btcore.Tree) -> None:
    xml = tree_to_xml(sample).encode()
    assert write_fulltree(read_fulltree(xml, "0" * 32)) == xml


def test_stamps_are_the_first_wall_time_plus_the_trees_elapsed_time(tmp_path: Path) -> None:
    write(
        [tmp_path / "run.btlog"],
        TreeEvent(TREE, 100 * MS, WALL, {}),
        TransitionEvent(1, 350 * MS, WALL + 2 * MS, 1, 1, 0, 1),  # a run faster than real time
    )
    recording = read_btlog(tmp_path / "run.btlog")
    assert recording.start == WALL
    assert recording.transitions[0].stamp == WALL + 250 * MS
