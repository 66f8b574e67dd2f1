"""Following a stock C++ robot through Groot 2's protocol: what is seen, and what is reported as unseen."""

import contextlib
import re
import signal
import threading
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest

import btcore
from btcore_monitor.events import (
    BlackboardEvent,
    ConnectionEvent,
    DataSource,
    LostTransitionsEvent,
    MissingDataEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.serve import serve
from btcore_monitor.watch import feed, groot2_feed
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.groot2_client import Groot2Client
from btcore_monitor.wire.groot2 import Request
from btcore_monitor.wire.run_channel import ANNOUNCEMENT
from tests.monitor.conftest import Changes, Command
from tests.monitor.watch.conftest import CppRobot, Watcher

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
SECOND = 10**9

TICK_1 = [(1, RUNNING), (2, SUCCESS), (3, RUNNING), (4, FAILURE), (5, RUNNING)]
ROUND = [(4, RUNNING), (4, SUCCESS), (4, IDLE), (5, RUNNING), (5, FAILURE), (5, IDLE)]
OTHER_TREE = (
    b'<root BTCPP_format="4"><BehaviorTree ID="Other" _fullpath=""><AlwaysSuccess name="only" _uid="1"/>'
    b'</BehaviorTree><TreeNodesModel><Action ID="AlwaysSuccess"/></TreeNodesModel></root>\n'
)


def with_previous(*steps: tuple[int, int]) -> list[tuple[int, int, int]]:
    now: dict[int, int] = {}
    found = []
    for uid, status in steps:
        found.append((uid, now.get(uid, IDLE), status))
        now[uid] = status
    return found


def source(viewer: Watcher) -> DataSource:
    return viewer.of(TreeEvent)[-1].source


# --- the simulated robot


def test_the_simulated_robot_answers_like_the_captured_robot(
    cpp_robot: Callable[..., CppRobot], capture: Callable[[str], list[bytes]]
) -> None:
    robot = cpp_robot(tree_id=capture("fulltree.rep")[0][6:])
    records = capture("get_transitions.rep")[1]
    steps = [records[at : at + 9] for at in range(0, len(records), 9)]

    def same(name: str) -> None:
        assert robot.answer(capture(f"{name}.req")) == capture(f"{name}.rep")

    def ticked(count: int) -> None:
        for step in steps[:count]:
            robot.changed(step[6], step[8], int.from_bytes(step[:6], "little"))
        del steps[:count]

    for name in ("fulltree", "status_before_first_tick", "error_bad_header", "error_missing_part2"):
        same(name)
    same("error_unknown_request")
    header, started = robot.answer(capture("toggle_recording_start.req"))
    assert header == capture("toggle_recording_start.rep")[0]
    assert len(started) == 16
    assert started.isdigit()
    ticked(5)
    same("status_after_tick1")
    ticked(len(steps))
    same("status_after_completion")
    robot.boards = capture("blackboard_after.rep")[1]
    same("blackboard_after")
    same("get_transitions")
    assert robot.answer(capture("get_transitions.req"))[1] == b""
    same("toggle_recording_stop")


# --- recorded transitions


def test_every_recorded_transition_is_seen_with_its_time(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    began = time.time_ns()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    for _ in range(60):
        robot.change(*ROUND)
    expected = with_previous(*ROUND * 60)
    until(lambda: len(viewer.steps) >= len(expected), "all transitions")
    assert viewer.steps == expected
    assert [change.number for change in viewer.of(TransitionEvent)] == list(range(1, len(expected) + 1))
    assert not viewer.of(MissingDataEvent)
    assert len(viewer.of(TreeEvent)) == 1
    walls = [change.wall for change in viewer.of(TransitionEvent)]
    assert walls == sorted(walls)
    assert began <= walls[0]
    assert walls[-1] <= time.time_ns()
    seen = viewer.of(TreeEvent)[0]
    assert seen.stamp == 0
    assert [change.stamp for change in viewer.of(TransitionEvent)] == [wall - seen.wall for wall in walls]


def test_transitions_before_the_first_request_are_shown_as_statuses(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    robot.change(*TICK_1)
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    assert viewer.of(TreeEvent)[0].statuses == dict.fromkeys(range(1, 11), IDLE) | dict(TICK_1)
    robot.change((5, SUCCESS), (4, IDLE), (5, IDLE))
    until(lambda: len(viewer.steps) == 3, "what came after")
    assert viewer.steps == [(5, RUNNING, SUCCESS), (4, FAILURE, IDLE), (5, SUCCESS, IDLE)]


def test_data_that_the_protocol_lacks_is_reported_as_unavailable(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.change(*TICK_1)
    until(lambda: len(viewer.steps) == 5, "a tick")
    assert not viewer.of(TreeEvent)[0].has_transition_numbers
    assert source(viewer).name == "Groot 2, recorded"
    assert source(viewer).unavailable == {
        "ticks": "not sent by Groot 2",
        "exceptions": "not sent by Groot 2",
        "blackboard": "requested 2 times a second: short changes are not seen",
    }
    assert not viewer.of(TickEvent)
    assert {change.tick for change in viewer.of(TransitionEvent)} == {0}


def test_more_transitions_than_the_robot_keeps_are_reported_as_a_gap(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.change(*ROUND * 200, (4, RUNNING))
    until(lambda: viewer.steps[-1:] == [(4, IDLE, RUNNING)], "the last transition that the robot kept")
    (gap,) = viewer.of(MissingDataEvent)
    assert gap.kind == "transitions"
    assert gap.reason == (
        "more than 1000 statuses changed between two requests, and the robot keeps only the last ones"
    )
    assert gap.since < gap.stamp
    again = viewer.of(TreeEvent)[1]
    assert again.tree is viewer.of(TreeEvent)[0].tree
    assert again.stamp == gap.stamp
    assert len(viewer.steps) == 1000, "of 1,201"
    robot.change((4, SUCCESS), (4, IDLE))
    until(lambda: len(viewer.steps) == 1002, "what comes after the gap")
    assert viewer.steps[-2:] == [(4, RUNNING, SUCCESS), (4, SUCCESS, IDLE)]
    assert not viewer.of(LostTransitionsEvent)


@pytest.mark.parametrize("request_before", ["S", "t"])
def test_statuses_that_changed_within_a_gap_are_corrected_without_another_gap(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    request_before: str,
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.stall_at = request_before
    assert robot.stalled.wait(60)
    robot.change((7, RUNNING), (8, RUNNING), *ROUND * 200, (8, SUCCESS))
    robot.resume()
    requests = robot.requests["t"]
    until(lambda: robot.requests["t"] > requests + 3, "a batch after the gap")
    robot.change((7, SUCCESS), (8, IDLE))
    until(lambda: (8, SUCCESS, IDLE) in viewer.steps, "what comes after the gap")
    assert viewer.steps[-2:] == [(7, RUNNING, SUCCESS), (8, SUCCESS, IDLE)]
    assert ((7, IDLE, RUNNING) in viewer.steps) == (request_before == "t"), "after the gap"
    assert viewer.of(TreeEvent)[1].statuses[7] == (RUNNING if request_before == "S" else IDLE)
    assert len(viewer.of(MissingDataEvent)) == 1
    times = [
        event.stamp
        for event in viewer.events
        if isinstance(event, TreeEvent | MissingDataEvent | TransitionEvent)
    ]
    assert times == sorted(times)


def test_a_big_tree_that_changes_in_bursts_is_requested_more_often_and_received_completely(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    nodes = "".join(f'<AlwaysSuccess name="node {uid}" _uid="{uid}"/>' for uid in range(2, 902))
    robot = cpp_robot(
        xml=(
            '<root BTCPP_format="4"><BehaviorTree ID="Big" _fullpath=""><Sequence name="all" _uid="1">'
            f"{nodes}</Sequence></BehaviorTree></root>"
        ).encode()
    )
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    ticks = 3
    for _ in range(ticks):
        for status in (SUCCESS, IDLE):
            robot.change(*((uid, status) for uid in range(2, 902)))
            until(lambda: not robot._recorded, "a request before the second half of the tick")
    until(lambda: len(viewer.steps) == 2 * 900 * ticks, "all transitions")
    assert not viewer.of(MissingDataEvent)
    # Requests stay frequent for a while: by the default, sixty would take an hour now.
    monkeypatch.setattr(groot2_feed, "_SLOWER_AFTER_S", 1000.0)
    monkeypatch.setattr(groot2_feed, "STATUS_INTERVAL_S", 60.0)
    requests = robot.requests["t"]
    until(lambda: robot.requests["t"] >= requests + 60, "further requests")


@contextlib.contextmanager
def another_reader(robot: Any) -> Iterator[None]:
    """Another client that reads the recording again and again while node 4 changes."""
    done = threading.Event()

    def read() -> None:
        status = IDLE
        with Groot2Client(parse_address(robot.address), timeout=60) as other:
            while not done.is_set():
                status = SUCCESS if status == IDLE else IDLE
                robot.change((4, status))
                other.request(Request.GET_TRANSITIONS)

    thread = threading.Thread(target=read)
    thread.start()
    try:
        yield
    finally:
        done.set()
        thread.join()


def test_a_recording_that_another_client_reads_is_left_to_that_client(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    with another_reader(robot):
        until(lambda: "transitions" in source(viewer).unavailable, "the end of the recording")
    assert viewer.of(MissingDataEvent)[-1].reason == (
        "another client reads this robot's recording too: statuses are sampled for 10 s"
    )
    assert (
        "another client reads this robot's recording too; next attempt to read it in 10 s"
        in source(viewer).unavailable["transitions"]
    )
    assert source(viewer).name == "Groot 2, sampled"
    drained = robot.requests["t"]
    robot.change((7, RUNNING))
    until(lambda: viewer.steps and viewer.steps[-1] == (7, IDLE, RUNNING), "a sampled change")
    assert robot.requests["t"] == drained


def test_a_recording_is_read_again_after_another_client_has_left(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(groot2_feed, "RETRY_AFTER_S", 0.2)
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    with another_reader(robot):
        until(lambda: "transitions" in source(viewer).unavailable, "the end of the recording")
    until(lambda: source(viewer).name == "Groot 2, recorded", "another attempt that succeeds")
    assert (
        viewer.of(MissingDataEvent)[-1].reason
        == "short changes before this time were not seen in the samples"
    )
    gaps = len(viewer.of(MissingDataEvent))
    robot.change(*ROUND * 20)
    until(lambda: viewer.steps[-1:] == [(5, FAILURE, IDLE)], "all transitions")
    assert [step[::2] for step in viewer.steps[1 - len(ROUND) * 20 :]] == (ROUND * 20)[1:]
    assert len(viewer.of(MissingDataEvent)) == gaps
    times = [event.stamp for event in viewer.of(TransitionEvent)]
    assert times == sorted(times)


def test_a_lost_reply_with_transitions_is_not_blamed_on_another_client(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.drop_reply_to = "t"
    robot.change((4, RUNNING), (5, RUNNING))
    until(lambda: viewer.of(MissingDataEvent), "the gap")
    (gap,) = viewer.of(MissingDataEvent)
    assert gap.reason == "a reply of the robot with its recorded transitions did not arrive"
    robot.change((4, SUCCESS))
    until(lambda: (4, RUNNING, SUCCESS) in viewer.steps, "the next transition")
    assert viewer.of(TreeEvent)[-1].statuses[5] == RUNNING
    assert source(viewer).name == "Groot 2, recorded"


def test_a_recording_that_another_client_restarts_is_left_to_that_client(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    began = time.monotonic()
    until(lambda: time.monotonic() - began > 1.5, "a time between the two recordings")
    with Groot2Client(parse_address(robot.address), timeout=60) as other:
        other.request(Request.TOGGLE_RECORDING, b"start")
    robot.change((4, RUNNING))
    until(lambda: viewer.of(MissingDataEvent), "the gap")
    assert "another client began a recording" in viewer.of(MissingDataEvent)[0].reason
    until(lambda: "transitions" in source(viewer).unavailable, "the end of the recording")
    # The change comes with the tree that is seen again, or with a sample after it.
    until(
        lambda: viewer.of(TreeEvent)[-1].statuses[4] == RUNNING or (4, IDLE, RUNNING) in viewer.steps,
        "the changed status",
    )
    assert robot.recording, "the other client's recording goes on"


def test_a_robot_that_changes_faster_than_it_can_be_polled_is_recorded_with_gaps(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    for count in range(1, 6):
        robot.change(*ROUND * 200)
        until(lambda count=count: len(viewer.of(MissingDataEvent)) == count, "a gap")
    robot.change((4, RUNNING))
    until(lambda: viewer.steps[-1] == (4, IDLE, RUNNING), "the next transition")
    assert source(viewer).name == "Groot 2, recorded"
    # The first of the 1,000 transitions leads to the known status.
    assert len(viewer.steps) == 5 * 999 + 1
    assert all("the robot keeps only the last ones" in gap.reason for gap in viewer.of(MissingDataEvent))
    assert len(viewer.of(MissingDataEvent)) == 5


def test_record_prints_one_line_for_each_gap(
    cpp_robot: Callable[..., CppRobot], command: Callable[..., Command], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    recorder = command("record", robot.address, "-o", "run.btlog")
    recorder.wait_for("recording 'Main'")
    for count in (1, 2):
        robot.change(*ROUND * 200)
        recorder.wait_for(f"(?s)(record: transitions missing from .*){{{count}}}")
    until(lambda: not robot._recorded, "the last batch")
    assert recorder.end(signal.SIGINT) == 0
    lines = [line for line in recorder.stderr_text.splitlines() if "missing" in line]
    assert len(lines) == 2
    pattern = (
        r"record: transitions missing from \d+\.\d{3} s to \d+\.\d{3} s: more than 1000 statuses changed"
    )
    assert all(re.match(pattern, line) for line in lines)
    assert recorder.stderr_text.count("recording 'Main'") == 1
    assert "2 gaps are marked" in recorder.stderr_text


def test_no_record_leaves_the_robots_buffer_to_other_clients(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address, record=False)
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.change(*TICK_1)
    until(lambda: len(viewer.steps) == 5, "the tick")
    assert (robot.requests["r"], robot.requests["t"]) == (0, 0)
    assert source(viewer).unavailable["transitions"] == (
        "statuses are requested 20 times a second (--no-record): short changes are not seen"
    )


def test_a_robot_that_cannot_record_is_sampled(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    robot.refused["r"] = "Request not recognized"
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    assert "refuses TOGGLE_RECORDING: Request not recognized" in source(viewer).unavailable["transitions"]
    robot.change((4, RUNNING), (4, SUCCESS), (4, IDLE))
    until(lambda: len(viewer.steps) == 2, "the status before IDLE")
    assert viewer.steps == [(4, IDLE, SUCCESS), (4, SUCCESS, IDLE)]


def test_a_monitor_that_leaves_stops_the_recording_that_it_began(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: robot.recording, "the recording")
    until(lambda: viewer.of(TreeEvent), "the tree")
    viewer.stop()
    until(lambda: not robot.recording, "its end")


# --- robots that come and go


def test_a_feed_waits_for_a_robot_that_starts_later(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    gone = cpp_robot()
    gone.close()
    viewer = watch(gone.address, reply_within=30.0)
    until(lambda: viewer.of(ConnectionEvent), "a message")
    assert viewer.of(ConnectionEvent)[0].state == "waiting"
    cpp_robot(port=gone.port)
    until(lambda: viewer.of(TreeEvent), "the tree")
    assert viewer.links == ["waiting", "connected"]
    assert viewer.of(ConnectionEvent)[1].detail == f"{gone.address}, by Groot 2's protocol"


def test_a_restarted_robot_shows_its_new_tree(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    first = cpp_robot()
    viewer = watch(first.address)
    until(lambda: viewer.of(TreeEvent), "the first tree")
    first.change(*TICK_1)
    until(lambda: len(viewer.steps) == 5, "a tick")
    first.close()
    second = cpp_robot(port=first.port, xml=OTHER_TREE)
    until(lambda: len(viewer.of(TreeEvent)) == 2, "the second tree")
    second.change((1, SUCCESS), (1, IDLE))
    until(lambda: len(viewer.steps) == 7, "all transitions")
    trees = [(event.tree.name, event.tree.tree_id) for event in viewer.of(TreeEvent)]
    assert trees == [("Main", first.tree_id.hex()), ("Other", second.tree_id.hex())]
    assert [change.number for change in viewer.of(TransitionEvent)][5:] == [1, 2]
    assert not viewer.of(MissingDataEvent)


def test_a_tree_with_a_new_id_is_noticed_without_a_lost_connection(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address, reply_within=30.0)
    until(lambda: viewer.of(TreeEvent), "the first tree")
    with robot.lock:
        robot.tree_id = bytes(16)
        robot.xml = OTHER_TREE
        robot.statuses = {1: RUNNING}
        robot.recording = False
    until(lambda: len(viewer.of(TreeEvent)) == 2, "the second tree")
    assert viewer.of(TreeEvent)[1].statuses == {1: RUNNING}
    until(lambda: robot.recording, "its recording")
    assert viewer.links == ["waiting", "connected"]


def test_transitions_recorded_during_a_short_silence_are_not_lost(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.change(*TICK_1)
    until(lambda: len(viewer.steps) == 5, "a tick")
    robot.stall_at = "S"
    until(lambda: viewer.of(ConnectionEvent)[-1].state == "lost", "the loss")
    robot.change((5, SUCCESS), (5, IDLE), (4, IDLE), *ROUND * 20)
    robot.resume()
    until(lambda: len(viewer.steps) == 8 + len(ROUND) * 20, "what happened meanwhile")
    assert viewer.steps == with_previous(*TICK_1, (5, SUCCESS), (5, IDLE), (4, IDLE), *ROUND * 20)
    assert viewer.links == ["waiting", "connected", "lost", "connected"]
    assert not viewer.of(MissingDataEvent)
    assert len(viewer.of(TreeEvent)) == 1


def test_a_run_channel_that_is_not_reachable_is_not_awaited_again_after_a_lost_connection(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(feed, "ANNOUNCED_RUN_CHANNEL_WAIT_S", 0.0)
    robot = cpp_robot(xml=OTHER_TREE + ANNOUNCEMENT)
    viewer = watch(robot.address)
    until(lambda: viewer.of(TreeEvent), "the tree")
    monkeypatch.setattr(feed, "ANNOUNCED_RUN_CHANNEL_WAIT_S", 1e9)
    robot.drop_reply_to = "S"
    until(lambda: viewer.links[-2:] == ["lost", "connected"], "the return")
    assert "because there is no reply from its run channel" in viewer.of(ConnectionEvent)[-1].detail
    robot.change((1, SUCCESS))
    until(lambda: viewer.steps == [(1, IDLE, SUCCESS)], "a transition")


def test_a_reply_may_take_longer_than_the_first_timeout(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    robot.delay = 1.2
    viewer = watch(robot.address)
    until(lambda: robot.requests["S"], "the first request after the tree")
    robot.delay = 0.1
    until(lambda: viewer.of(TreeEvent), "the tree")
    robot.change(*TICK_1)
    until(lambda: len(viewer.steps) == 5, "the tick")
    # Later, a machine that stops for a second loses the connection, because the reply is late.
    states = viewer.links
    assert (states[:2], states[-1]) == (["waiting", "connected"], "connected")


def test_several_robots_are_followed_at_once(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robots = [cpp_robot() for _ in range(3)]
    viewers = [watch(robot.address) for robot in robots]
    until(lambda: all(viewer.of(TreeEvent) for viewer in viewers), "the trees")
    for number, robot in enumerate(robots, start=1):
        robot.change(*ROUND * number)
    until(lambda: [len(viewer.steps) for viewer in viewers] == [6, 12, 18], "all transitions")


# --- blackboards


@pytest.mark.parametrize(
    ("rate", "message"),
    [(20.0, "requested 20 times a second: short changes are not seen"), (0, "not requested")],
)
def test_blackboards_are_requested_at_the_given_rate(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    capture: Callable[[str], list[bytes]],
    rate: float,
    message: str,
) -> None:
    robot = cpp_robot()
    robot.boards = capture("blackboard_after.rep")[1]
    viewer = watch(robot.address, blackboard_rate=rate)
    until(lambda: robot.requests["S"] > 20, "requests for a second")
    assert source(viewer).unavailable["blackboard"] == message
    assert robot.requests["B"] <= rate * 2
    if rate:
        until(lambda: robot.requests["B"] > 5, "requests")
        assert set(robot.names) == {b"Main;Sub::6"}
        assert len(viewer.of(BlackboardEvent)) == 1
        assert viewer.of(BlackboardEvent)[0].boards["Sub::6"] == {
            "lim": 7,
            "loc": 4.5,
            "mode": "fast",
            "o2": 1.5,
        }


def test_blackboards_that_are_refused_together_are_requested_one_by_one(
    cpp_robot: Callable[..., CppRobot], watch: Callable[..., Watcher], until: Callable[..., None]
) -> None:
    robot = cpp_robot()
    robot.refused["B"] = "two different root blackboards"
    viewer = watch(robot.address, reply_within=30.0, blackboard_rate=50)
    until(lambda: len(viewer.of(MissingDataEvent)) == 2, "a message about each")
    assert robot.names == []
    for hole, name in zip(viewer.of(MissingDataEvent), ("Main", "Sub::6"), strict=True):
        assert hole.kind == "blackboard"
        assert f"{name} isn't shown" in hole.reason
        assert "two different root blackboards" in hole.reason
    requests = robot.requests["B"]
    robot.change((4, RUNNING))
    until(lambda: viewer.steps, "further requests")
    assert robot.requests["B"] == requests == 3
    assert viewer.links == ["waiting", "connected"]


def test_a_slow_network_leaves_time_for_blackboards(
    cpp_robot: Callable[..., CppRobot],
    watch: Callable[..., Watcher],
    until: Callable[..., None],
    capture: Callable[[str], list[bytes]],
) -> None:
    robot = cpp_robot()
    robot.boards = capture("blackboard_after.rep")[1]
    robot.delay = 0.1
    viewer = watch(robot.address)
    until(lambda: viewer.of(BlackboardEvent), "a blackboard, although requests are always late")


# --- a btcore robot without its run channel


def test_a_btcore_robot_can_be_followed_through_groot_2(
    endless: btcore.Tree, watch: Callable[..., Watcher], until: Callable[..., None], changes: type[Changes]
) -> None:
    reported_values = changes(endless)
    with serve(endless, groot2_port=0, run_channel=False) as publisher:
        viewer = watch(publisher.address)
        until(lambda: viewer.of(TreeEvent), "the tree")
        for tick in range(1, 21):
            endless.tick_exactly_once()
            until(
                lambda number=reported_values.count: len(viewer.of(TransitionEvent)) == number, f"tick {tick}"
            )
        assert not viewer.of(MissingDataEvent)
        assert source(viewer).name == "Groot 2, recorded"
