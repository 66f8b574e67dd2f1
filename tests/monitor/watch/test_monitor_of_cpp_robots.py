"""``btcore monitor`` and the screen, with robots that support Groot 2's protocol only."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from btcore_monitor.events import (
    BlackboardEvent,
    DataSource,
    LostTransitionsEvent,
    MissingDataEvent,
    ObservedNode,
    ObservedTree,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.row_buffer import TREE_TIMELINE
from btcore_monitor.screen.sinks import RecordingSinks
from tests.monitor.watch.conftest import CppRobot

ROOT = Path(__file__).parents[3]
IDLE, RUNNING, SUCCESS, FAILURE = range(4)
MS = 1_000_000
WIRE = DataSource(
    "Groot 2, sampled", {"ticks": "not sent", "blackboard": "polled", "exceptions": "no errors"}
)
TREE = ObservedTree(
    "a" * 32,
    "Main",
    (
        ObservedNode(1, "root", "Sequence", "control", "root", 0, (2,)),
        ObservedNode(2, "Go", "Go", "action", "Go", 1),
    ),
    {"": "Main"},
)


def documents(path: Path, entity: str) -> list[str]:
    """The texts of *entity* in an .rrd, in the order of their times."""
    rows = []
    for chunk in RrdReader(path).stream():
        if str(chunk.entity_path) == entity:
            batch = chunk.to_record_batch()
            names = [name for name in batch.schema.names if name.endswith(":text")]
            times = (
                batch.column(TREE_TIMELINE).cast("int64").to_pylist()
                if TREE_TIMELINE in batch.schema.names
                else [0] * len(batch)
            )
            rows += [(t, text[0]) for t, text in zip(times, batch.column(names[0]).to_pylist(), strict=True)]
    return [text for _, text in sorted(rows, key=lambda row: row[0])]


@pytest.fixture
def seen() -> TreeEvent:
    return TreeEvent(TREE, 0, 0, {1: IDLE, 2: IDLE}, has_transition_numbers=False, source=WIRE)


def shown(events: Any, path: Path) -> Path:
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=path)))
    for event in events:
        screen.process_event(event)
    screen.close()
    return path


def test_each_panel_shows_which_data_is_not_sent(seen: TreeEvent, tmp_path: Path) -> None:
    path = shown([seen, BlackboardEvent(MS, MS, {"": {"x": 1}})], tmp_path / "x.rrd")
    assert documents(path, "/blackboard")[0] == "*polled*"
    assert documents(path, "/blackboard")[1].startswith("*polled*\n\n| key | value |")
    lines = documents(path, "/log")
    assert any("exceptions: no errors" in line for line in lines)
    assert any("ticks: not sent" in line for line in lines)


def test_panels_of_a_robot_that_sends_all_data_have_no_such_notes(seen: TreeEvent, tmp_path: Path) -> None:
    reported = TreeEvent(TREE, 0, 0, {1: IDLE, 2: IDLE})
    path = shown([reported, TickEvent(1, MS, MS, 1, RUNNING)], tmp_path / "x.rrd")
    assert "| by |" not in documents(path, "/now")[0]


def test_the_running_panel_works_without_ticks(seen: TreeEvent, tmp_path: Path) -> None:
    changes = [TransitionEvent(n, 5 * MS, 5 * MS, 0, n, IDLE, RUNNING) for n in (1, 2)]
    now = documents(shown([seen, *changes], tmp_path / "x.rrd"), "/now")[-1]
    assert "| runs | **Go** |" in now
    assert "| root | RUNNING |" in now
    assert "| by | Groot 2, sampled |\n| raised | no errors |" in now


def test_the_latest_changes_are_shown_when_nothing_follows(seen: TreeEvent, tmp_path: Path) -> None:
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=tmp_path / "x.rrd")))
    for event in (seen, TransitionEvent(1, 5 * MS, 5 * MS, 0, 2, IDLE, RUNNING)):
        screen.process_event(event)
    screen.flush()
    assert screen._panels is not None
    assert screen._panels.states._shown_before.tolist() == [IDLE, RUNNING]
    screen.close()


def test_missing_data_is_counted_and_shown(seen: TreeEvent, tmp_path: Path) -> None:
    events = [
        seen,
        MissingDataEvent(10 * MS, 10 * MS, 4 * MS, "transitions", "the buffer ran over"),
        seen,
        LostTransitionsEvent(3, 7),
        MissingDataEvent(11 * MS, 11 * MS, 11 * MS, "blackboard", "Main isn't shown: it refuses"),
        TransitionEvent(8, 20 * MS, 20 * MS, 0, 2, IDLE, RUNNING),
    ]
    path = shown(events, tmp_path / "x.rrd")
    lines = documents(path, "/log")
    assert any("transitions since 0.00s incomplete: the buffer ran over" in line for line in lines)
    assert any("blackboard incomplete: Main isn't shown: it refuses" in line for line in lines)
    now = documents(path, "/now")[-1]
    assert "| lost | 5 transitions |" in now
    assert "| lost | transitions, 1 times |" in now


def test_another_data_source_of_same_tree_starts_another_recording(seen: TreeEvent, tmp_path: Path) -> None:
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=tmp_path / "x.rrd")))
    for event in (seen, TreeEvent(TREE, 10**12, 0, {1: IDLE, 2: IDLE})):
        screen.process_event(event)
    screen.close()
    assert [file.name for file in screen.files] == ["x.rrd", "x.2.rrd"]


def test_several_robots_are_watched_in_one_window_and_in_one_recording(
    cpp_robot: Callable[..., CppRobot], until: Callable[..., None], tmp_path: Path
) -> None:
    robots = [cpp_robot(), cpp_robot()]
    command = ["-m", "btcore_monitor", *(robot.address for robot in robots), "--no-view", "--save"]
    process = subprocess.Popen(
        [sys.executable, *command, str(tmp_path / "two.rrd"), "--blackboard-rate", "0"],
        stderr=subprocess.PIPE,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    try:
        until(lambda: all(robot.recording for robot in robots), "both robots")
        for robot in robots:
            robot.change((4, RUNNING), (4, SUCCESS), (4, IDLE))
        until(lambda: all(not robot._recorded for robot in robots), "the tree in the monitor")
        process.send_signal(signal.SIGINT)
        _, message = process.communicate(timeout=100)
    finally:
        process.kill()
    assert process.returncode == 0
    for robot in robots:
        assert f"{robot.address}, by Groot 2's protocol" in message.decode()
        assert robot.requests["B"] == 0
        assert not robot.recording, "the monitor stopped what it began"
    assert [file.name for file in tmp_path.iterdir()] == ["two.rrd"]
    for robot in robots:
        lines = documents(tmp_path / "two.rrd", f"/port_{robot.port}/log")
        assert len([line for line in lines if "→" in line]) == 3


def test_no_record_leaves_the_robots_buffer_alone(cpp_robot: Callable[..., CppRobot], tmp_path: Path) -> None:
    robot = cpp_robot()
    command = [
        sys.executable,
        "-m",
        "btcore_monitor",
        robot.address,
        "--no-view",
        "--no-record",
        "--duration",
        "2",
    ]
    done = subprocess.run(
        [*command, "--save", str(tmp_path / "x.rrd")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=60,
    )
    assert done.returncode == 0
    assert robot.requests["S"] > 0
    assert (robot.requests["r"], robot.requests["t"]) == (0, 0)
    assert any("(--no-record)" in line for line in documents(tmp_path / "x.rrd", "/log"))
