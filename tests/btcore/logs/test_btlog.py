"""A .btlog equals FileLogger2's file byte by byte, and a truncated file is read up to its end."""

import random
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from btcore import SimClock, Status, Transition, Tree
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs import BtLog, LogError, read_btlog

RUNNING, SUCCESS, FAILURE, IDLE = Status.RUNNING, Status.SUCCESS, Status.FAILURE, Status.IDLE
# The listing of the recorded session: the events of the first run that the client received.
LISTED = [
    (1, 1),
    (2, 2),
    (3, 1),
    (4, 3),
    (5, 1),
    (5, 2),
    (4, 0),
    (5, 0),
    (3, 2),
    (6, 1),
    (7, 1),
    (8, 2),
    (9, 1),
]
HEADER = 23
XML = 8308


def records(data: bytes) -> bytes:
    """Return the bytes after the header."""
    size = int.from_bytes(data[19:23], "little")
    return data[HEADER + size + 8 :]


def test_the_recorded_file_is_read(captures: Path) -> None:
    recording = read_btlog(captures / "v4_sample.btlog")
    assert [(change.uid, change.status) for change in recording.transitions[:13]] == LISTED
    assert len(recording.transitions) == 57
    assert recording.start == 1795223146837310_000
    assert recording.transitions[0].stamp == recording.start + 16664_000
    assert recording.transitions[5] == (1795223146837310_000 + 18263_000, 5, RUNNING, SUCCESS)
    assert recording.xml.startswith('<root BTCPP_format="4">')
    assert recording.damage == ""
    assert set(recording.statuses().values()) == {IDLE}


def test_the_recorded_tree_is_read(captures: Path, sample: Tree) -> None:
    nodes = read_btlog(captures / "v4_sample.btlog").nodes
    found = [(node.uid, node.name, node.id, node.type, node.path) for node in nodes.values()]
    assert found == [(node.uid, node.name, node.id, node.type, node.path) for node in sample]
    assert [node.children for node in nodes.values()] == [
        tuple(child.uid for child in node.children) for node in sample
    ]


def test_equal_transitions_at_equal_times_are_written_as_equal_bytes(
    captures: Path, sample: Tree, tmp_path: Path
) -> None:
    original = (captures / "v4_sample.btlog").read_bytes()
    recording = read_btlog(captures / "v4_sample.btlog")
    with BtLog(sample, tmp_path / "run.btlog") as log:
        log.write(
            [
                Transition(
                    number, change.stamp - recording.start, 1, change.uid, change.previous, change.status
                )
                for number, change in enumerate(recording.transitions, 1)
            ]
        )
    written = (tmp_path / "run.btlog").read_bytes()
    assert records(written) == records(original)
    assert written[:19] == original[:19]
    models = original.index(b"    <TreeNodesModel>")
    assert written[HEADER : models - 200] == original[HEADER : models - 200].replace(
        b"loc:=target", b"loc:=&apos;a&apos;"
    )


def test_the_same_tree_makes_the_same_transitions(captures: Path, sample: Tree, tmp_path: Path) -> None:
    with BtLog(sample, tmp_path / "run.btlog"):
        results = [sample.tick_while_running() for _ in range(3)]
    assert results == [SUCCESS, SUCCESS, FAILURE]
    ours, theirs = read_btlog(tmp_path / "run.btlog"), read_btlog(captures / "v4_sample.btlog")
    assert [change[1:] for change in ours.transitions] == [change[1:] for change in theirs.transitions]
    assert ours.xml == tree_to_xml(sample)


def test_stamps_are_wall_time_at_start_plus_tree_time(small: Callable[..., Tree], tmp_path: Path) -> None:
    clock = SimClock(5_000_000_000)
    tree = small('<Sleep msec="250"/>', clock=clock)
    clock.advance(1.0)
    before = time.time_ns()
    with BtLog(tree, tmp_path / "run.btlog"):
        after = time.time_ns()
        clock.advance(2.0)
        tree.tick_while_running(period=0.05)
    recording = read_btlog(tmp_path / "run.btlog")
    assert before - 1_000 <= recording.start <= after
    since = [(change.stamp - recording.start, change.status) for change in recording.transitions]
    assert since == [(2_000_000_000, RUNNING), (2_250_000_000, SUCCESS), (2_250_000_000, IDLE)]


def test_stamp_of_more_than_32_bits_is_written_and_read(small: Callable[..., Tree], tmp_path: Path) -> None:
    clock = SimClock()
    tree = small("<AlwaysSuccess/>", clock=clock)
    with BtLog(tree, tmp_path / "run.btlog"):
        clock.advance(5000.0)
        tree.tick_once()
    data = (tmp_path / "run.btlog").read_bytes()
    assert records(data)[:9] == (5_000_000_000).to_bytes(6, "little") + b"\x01\x00\x02"
    recording = read_btlog(tmp_path / "run.btlog")
    assert recording.transitions[0].stamp - recording.start == 5_000_000_000_000


def test_transitions_to_idle_can_be_left_out(sample: Tree, tmp_path: Path) -> None:
    with BtLog(sample, tmp_path / "run.btlog", idle=False):
        sample.tick_while_running()
    assert IDLE not in {change.status for change in read_btlog(tmp_path / "run.btlog").transitions}


def test_transition_of_an_unknown_node_ends_the_reading(captures: Path, tmp_path: Path) -> None:
    data = bytearray((captures / "v4_sample.btlog").read_bytes())
    second = HEADER + XML + 8 + 9
    data[second + 6] = 200
    path = tmp_path / "bent.btlog"
    path.write_bytes(data)
    recording = read_btlog(path)
    assert len(recording.transitions) == 1
    assert recording.damage == f"the file is damaged from byte {second} on: unknown node 200"


def test_damaged_file_gives_a_recording_or_a_log_error(captures: Path, tmp_path: Path) -> None:
    data = (captures / "v4_sample.btlog").read_bytes()
    rng = random.Random(3)
    path = tmp_path / "bent.btlog"
    faults: list[str] = []
    for _ in range(300):
        bent = bytearray(data)
        bent[rng.randrange(len(data))] = rng.randrange(256)
        path.write_bytes(bent)
        try:
            read_btlog(path)
        except LogError as fault:
            faults.append(str(fault))
    assert 0 < len(faults) < 300
    assert all(message.startswith(f"{path}: ") for message in faults)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"BTCPP4-FileLogger2\x07\0\0\0\0", "has protocol version 7; btcore supports version 1"),
        (b"BTCPP4-FileLogger2\x01\xff\xff\xff\xff" + bytes(8), "the length of the tree is -1"),
        (b"BTCPP4-FileLogger2\x01\x03\0\0\0<a>" + bytes(8), "the tree in this log is not valid XML"),
        (b"BTCPP4-FileLogger2\x01\x04\0\0\0<a/>" + bytes(8), "has no main tree"),
        (b"SQLite format 3", "it does not begin with BTCPP4-FileLogger2"),
        (b"BTCPP4-FileLogger2\x01", "this log ends in its header, after 19 bytes"),
    ],
)
def test_file_that_is_not_a_btlog_is_refused(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "other.btlog"
    path.write_bytes(content)
    with pytest.raises(LogError) as caught:
        read_btlog(path)
    assert message in str(caught.value)
