"""The screen's recording, read back with rerun's own reader."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rerun.chunk import RrdReader

from btcore_monitor.events import (
    BlackboardEvent,
    ExceptionEvent,
    LostTransitionsEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen import robot_view
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.sinks import RecordingSinks
from btcore_monitor.screen.style import GROOT
from btcore_monitor.screen.tick_states import RESET_OFFSET
from tests.monitor.screen.conftest import Recording

IDLE, RUNNING, SUCCESS, FAILURE = range(4)
ROOT, AVOID, CLEAR, OBSTACLE, ESCAPE, BACK, TURN, FORWARD = range(1, 9)


@pytest.fixture(scope="module")
def thousand(
    run: Callable[..., Any], tmp_path_factory: pytest.TempPathFactory, recorded: Callable[..., Any]
) -> tuple[list[Any], Recording]:
    events = run(1000)
    return events, recorded(events, tmp_path_factory.mktemp("thousand") / "run.rrd")


def test_no_numbered_transition_of_a_thousand_ticks_is_missing(thousand: tuple[list[Any], Recording]) -> None:
    events, recording = thousand
    sent = [event for event in events if isinstance(event, TransitionEvent)]
    columns = {
        name: [values[0] for _, values in recording.of("/log/numbers", name)]
        for name in ("number", "tick", "uid", "previous", "status")
    }
    kept = sorted(zip(*columns.values(), strict=True))
    assert kept == [
        (change.number, change.tick, change.uid, change.previous, change.status) for change in sent
    ]
    assert [number for number, *_ in kept] == list(range(1, len(sent) + 1))
    lines = [values[0] for _, values in recording.of("/log", "TextLog:text")]
    assert len([line for line in lines if "→" in line]) == len(sent) > 5000
    assert any("IsObstacle" in line and "IDLE → SUCCESS" in line for line in lines)


def test_a_file_without_a_viewer_is_written_in_large_pieces(
    run: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robot_view, "WRITE_TRANSITIONS_INTERVAL_S", 1000.0)  # s; a slow machine takes long
    monkeypatch.setattr(robot_view, "WRITE_INTERVAL_S", 1000.0)
    file = tmp_path / "run.rrd"
    view = RobotView(SingleRobotLayout(RecordingSinks(save=file)))
    for event in run(100):
        view.process_event(event)
        view.process_idle()
    view.close()
    entities = [str(chunk.entity_path) for chunk in RrdReader(file).stream() if not chunk.is_static]
    assert entities.count("/log/numbers") == entities.count("/scene/laser/points") == 1


def test_every_tick_has_its_duration_at_its_time(thousand: tuple[list[Any], Recording]) -> None:
    events, recording = thousand
    ticks = [(event.stamp, event.duration_ns / 1e6) for event in events if isinstance(event, TickEvent)]
    assert [(t, values[0]) for t, values in recording.of("/tick/duration", "Scalars:scalars")] == ticks
    rates = [values[0] for _, values in recording.of("/rate/ticks", "Scalars:scalars")]
    assert rates == [10.0] * 999


def test_pills_have_the_colours_of_the_statuses_at_every_tick(thousand: tuple[list[Any], Recording]) -> None:
    events, recording = thousand
    status: dict[int, int] = {}
    for event in events:
        if isinstance(event, TreeEvent):
            status = dict(event.statuses)
            uids = [node.uid for node in event.tree.nodes]
            inner = {node.uid for node in event.tree.nodes if node.children}
        elif isinstance(event, TransitionEvent):
            status[event.uid] = event.status
        elif isinstance(event, TickEvent) and event.tick % 7 == 0:
            colours = recording.at("/tree/pills", "LineStrips2D:colors", event.stamp)
            for uid, colour in zip(uids, colours, strict=True):
                allowed = {int(GROOT.fill[status[uid]])}
                if status[uid] == IDLE:
                    allowed |= {int(colour) for colour in GROOT.fill[RESET_OFFSET + SUCCESS :]}
                if status[uid] == RUNNING and uid in inner:
                    allowed = {GROOT.busy}
                assert colour in allowed, (event.tick, uid)


def test_the_first_row_is_idle(run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]) -> None:
    recording = recorded(run(1), tmp_path / "run.rrd")
    t, colours = recording.of("/tree/pills", "LineStrips2D:colors")[0]
    assert t == 0
    assert colours == [int(GROOT.fill[IDLE])] * 8
    assert recording.of(recording.lane("Back"), "StateChange:state")[0] == (0, ["IDLE"])


def test_lanes_show_result_of_leaf_that_was_reset_in_same_tick(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(70), tmp_path / "run.rrd")
    second = 10**9

    def shown(name: str, t: float) -> str:
        return recording.at(recording.lane(name), "StateChange:state", round(t * second))[0]

    assert [shown("IsObstacle", t) for t in (0.1, 2.0, 4.0, 4.1, 4.2, 6.0, 6.1)] == [
        "FAILURE", "FAILURE", "FAILURE", "SUCCESS", "IDLE", "IDLE", "FAILURE",
    ]  # fmt: skip
    assert [shown("Forward", t) for t in (0.1, 4.0, 4.1, 5.9, 6.0)] == [
        "RUNNING", "RUNNING", "IDLE", "IDLE", "RUNNING",
    ]  # fmt: skip
    assert [shown("Back", t) for t in (4.0, 4.1, 5.0, 5.1, 6.0)] == [
        "IDLE", "RUNNING", "RUNNING", "SUCCESS", "IDLE",
    ]  # fmt: skip
    assert len(recording.of(recording.lane("IsObstacle"), "StateChange:state")) < 10


def test_the_running_path_leads_from_the_root_to_the_running_leaf(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(70), tmp_path / "run.rrd")
    strips = recording.at("/tree/running_edges", "LineStrips2D:strips", 4_500_000_000)
    edges = recording.of("/tree/edges", "LineStrips2D:strips")[0][1]
    assert len(strips) == 3  # to avoid, escape and Back
    assert all(strip in edges for strip in strips)
    assert strips[0][-1][1] < strips[1][0][1] < strips[2][0][1]


def test_lane_names_keep_the_order_of_the_tree(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(1), tmp_path / "run.rrd")
    lanes = sorted({entity for entity, component in recording.columns if component == "StateChange:state"})
    assert lanes == ["/1_IsObstacle", "/2_Back", "/3_Turn", "/4_Forward"]


def test_the_blackboard_is_a_table_with_changes_in_bold(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    recording = recorded(run(130), tmp_path / "run.rrd")
    first = recording.at("/blackboard", "TextDocument:text", 5 * 10**9)[0]
    assert "| bumps | `0` |" in first
    assert "| goal | – |" in first
    assert "| **bumps** | `1` |" in recording.at("/blackboard", "TextDocument:text", 6 * 10**9)[0]


def test_a_table_replaces_bars_and_backticks_and_shortens_long_values(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    boards = {
        "": {"a|b": "x`y\nz", "long": "w" * 500, "pi": 3.14159265, "on": True},
        "Patrol": {"goal": "1;2"},
    }
    events = [*run(1)[:2], BlackboardEvent(5, 5, boards)]
    text = recorded(events, tmp_path / "run.rrd").at("/blackboard", "TextDocument:text", 10)[0]
    assert "| a¦b | `x'y z` |" in text
    assert "| pi | `3.142` |" in text
    assert "| on | `true` |" in text
    assert "**Patrol**" in text
    assert max(len(line) for line in text.splitlines()) < 90


def test_the_robot_moves_with_its_laser_and_leaves_a_trail(thousand: tuple[list[Any], Recording]) -> None:
    events, recording = thousand
    ticks = 1000
    frames = recording.of("/scene/frames/base_link", "Transform3D:translation")
    assert len(frames) == ticks
    assert frames[9][1][0] == pytest.approx([0.3, 0.0, 0.1])
    points = recording.at("/scene/laser/points", "Points3D:positions", events[-2].stamp)
    assert len(points) == 90  # ten readings without an echo are not points
    # Coordinates are rounded to 1/64 m.
    assert np.linalg.norm(points[0]) == pytest.approx(2.0 + 0.5 * np.sin(ticks / 9), abs=0.012)
    assert len(recording.of("/scene/trail", "LineStrips3D:strips")) == ticks - 1
    speeds = recording.of("/speed/v", "Scalars:scalars")
    assert [values for _, values in speeds] == [[0.3]] * ticks


def test_gaps_and_exceptions_are_lines_in_the_log(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    events = [
        *run(3),
        LostTransitionsEvent(40, 44),
        ExceptionEvent(10**9, 10**9, "avoid/Back", "division by zero"),
    ]
    lines = [values[0] for _, values in recorded(events, tmp_path / "run.rrd").of("/log", "TextLog:text")]
    assert any("#40 to #44 are missing" in line for line in lines)
    assert any("avoid/Back raised: division by zero" in line for line in lines)


def test_a_robot_that_returns_with_another_tree_gets_another_recording(
    run: Callable[..., Any], tmp_path: Path, read: type
) -> None:
    path = tmp_path / "run.rrd"
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=path)))
    for event in [*run(20), *run(30, tree_id="b" * 32)]:
        screen.process_event(event)
    screen.close()
    assert screen.files == [path, tmp_path / "run.2.rrd"]
    ticks = [len(read(file).of("/tick/duration", "Scalars:scalars")) for file in screen.files]
    assert ticks == [20, 30]


def test_the_same_tree_after_a_lost_connection_continues_its_recording(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    events = run(45)
    again = TreeEvent(events[1].tree, 5 * 10**9, 5 * 10**9, {BACK: RUNNING, ROOT: RUNNING})
    recording = recorded([*events, again], tmp_path / "run.rrd")
    assert recording.at(recording.lane("Back"), "StateChange:state", 5 * 10**9) == ["RUNNING"]
    assert len(recording.of("/tree/edges", "LineStrips2D:strips")) == 1


def test_a_run_without_ticks_or_scene_is_recorded(
    run: Callable[..., Any], tmp_path: Path, recorded: Callable[..., Any]
) -> None:
    events = [event for event in run(20, scene=False) if not isinstance(event, TickEvent)]
    recording = recorded(events, tmp_path / "run.rrd")
    assert recording.at(recording.lane("Forward"), "StateChange:state", 2 * 10**9) == ["RUNNING"]
    assert not [entity for entity, _ in recording.columns if entity.startswith("/scene")]


def test_recording_a_tick_takes_little_time(run: Callable[..., Any], tmp_path: Path) -> None:
    """A fast run makes some 200 ticks a second: recording a tick must take a small part of its 5 ms.

    It takes as long as 6,000 to 11,000 conversions of a number to a text, on machines of any speed.
    """
    import time

    events = run(600)
    start = time.process_time()
    recorded_ticks = RobotView(SingleRobotLayout(RecordingSinks(save=tmp_path / "run.rrd")))
    for event in events:
        recorded_ticks.process_event(event)
    recorded_ticks.close()
    tick = (time.process_time() - start) / 600
    start = time.process_time()
    for number in range(1_000_000):
        str(number)
    text = (time.process_time() - start) / 1_000_000
    assert tick < 30_000 * text
