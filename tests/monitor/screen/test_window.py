"""The views of the window: their time, and the moment of a picture."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from btcore_monitor.events import (
    BlackboardEvent,
    ConnectionEvent,
    ExceptionEvent,
    MovingSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.row_buffer import TREE_TIMELINE
from btcore_monitor.screen.screenshot import last_tick
from btcore_monitor.screen.sinks import RecordingSinks

IDLE, RUNNING = range(2)
SECOND = 10**9
FORWARD = 8


def axes(blueprint: defaultdict) -> set[tuple[int, int]]:
    """Return the boundaries of the time axes of lanes and curves, as pairs."""
    return {tuple(row[0].values()) for row in blueprint["TimeAxis:view_range"]}


@pytest.mark.parametrize("ticks", [70, 300, 620])
def test_axes_begin_with_the_run_and_follow_the_cursor_of_a_long_run(
    ticks: int, run: Callable[..., Any], blueprints: Callable[..., Any], tmp_path: Path
) -> None:
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=tmp_path / "run.rrd")))
    events = run(ticks)
    for event in events[:20]:
        screen.process_event(event)
    screen.flush()
    for event in events[20:]:
        screen.process_event(event)
    screen.close()
    sent = [axes(blueprint) for blueprint in blueprints(tmp_path / "run.rrd")]
    assert sent[0] == {(0, 25 * SECOND)}
    if ticks <= 600:
        assert sent[-1] == {(0, ticks * SECOND // 10)}
    else:
        assert sent[-1] == {(-24 * SECOND, 3 * SECOND // 2)}  # from the cursor


def test_default_moment_of_picture_is_last_tick_before_halt(
    run: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path
) -> None:
    events = run(70)
    last = events[-1:]
    t = events[-2].stamp
    halt = TransitionEvent(10_000, t, t, 70, FORWARD, RUNNING, IDLE)
    recording = recorded([*events[:-1], halt, *last], tmp_path / "run.rrd")
    assert isinstance(last[0], ConnectionEvent)
    assert last_tick(tmp_path / "run.rrd", TREE_TIMELINE) == t
    before, after = (recording.at("/tree/pills", "LineStrips2D:colors", at) for at in (t, t + 1))
    assert before[FORWARD - 1] != after[FORWARD - 1]


def test_column_of_time_is_wide_enough_and_lines_do_not_repeat_time(
    run: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path
) -> None:
    """rerun makes the column as wide as the name of its timeline."""
    recording = recorded(run(5), tmp_path / "run.rrd")
    assert len(TREE_TIMELINE) > len("+99m 59.99s")
    assert recording.of("/log", "TextLog:text")[0][1] == ["#1      bumpgo        IDLE → RUNNING"]


def test_blackboards_of_running_subtrees_are_first_with_changes(
    big_tree: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path
) -> None:
    tree = big_tree(60)
    tasks = [node for node in tree.nodes if node.type == "subtree"]
    paths = [tree.by_uid[task.children[0]].subtree for task in tasks]
    boards = {"": {"day": 1}, **{path: {"step": 1} for path in paths}}
    later = {**boards, paths[3]: {"step": 2}}
    changes = [
        (1, tree.root.uid, IDLE, RUNNING),
        (1, tasks[3].uid, IDLE, RUNNING),
        (3, tasks[3].uid, RUNNING, IDLE),
        (3, tasks[1].uid, IDLE, RUNNING),
    ]
    events = [TreeEvent(tree, 0, 0, {}), BlackboardEvent(SECOND // 2, 0, boards)]
    for number, (second, *change) in enumerate(changes):
        events.append(TransitionEvent(number, second * SECOND, 0, second, *change))
        if number == 1:
            events.append(TickEvent(1, SECOND, 0, 1, RUNNING))
            events.append(BlackboardEvent(2 * SECOND, 0, later))
    events.append(TickEvent(3, 3 * SECOND, 0, 1, RUNNING))
    recording = recorded(events, tmp_path / "run.rrd")

    def table(second: int):
        return recording.at("/blackboard", "TextDocument:text", second * SECOND)[0]

    assert table(1).startswith(f"| **{paths[3]}** |")
    assert "| **step** | `2` | **2.0 s** |" in table(2)
    assert table(3).startswith(f"| **{paths[1]}** |")
    assert recording.of("/blackboard_history", "TextLog:text") == [(2 * SECOND, [f"{paths[3]}: step: 1 → 2"])]


def test_panels_without_data_are_not_in_the_window(
    run: Callable[..., Any], recorded: Callable[..., Any], blueprints: Callable[..., Any], tmp_path: Path
) -> None:
    def views(name: str, events: list[Any]):
        recorded(events, tmp_path / name)
        return {name for (name,) in blueprints(tmp_path / name)[-1]["ViewBlueprint:display_name"]}

    everything = run(40)
    bare = [event for event in everything if not isinstance(event, BlackboardEvent)]
    still = [
        MovingSceneEvent(event.stamp, event.wall, replace(event.data, velocity=None))
        if isinstance(event, MovingSceneEvent)
        else event
        for event in bare
    ]
    speed = "Speed [m/s, rad/s]"
    assert {"Blackboard", "History", speed} <= views("all.rrd", everything)
    assert views("bare.rrd", bare) == views("all.rrd", everything) - {"Blackboard", "History"}
    assert views("still.rrd", still) == views("bare.rrd", bare) - {speed}


def test_times_count_from_the_first_data_of_a_robot_whose_clock_began_earlier(
    run: Callable[..., Any], recorded: Callable[..., Any], tmp_path: Path
) -> None:
    later = 16_862 * SECOND
    events = [
        replace(event, stamp=event.stamp + later) if hasattr(event, "stamp") else event for event in run(70)
    ]
    events.insert(-1, ExceptionEvent(later + 7 * SECOND + SECOND // 2, 0, "Forward", "no laser"))
    recording = recorded(events, tmp_path / "run.rrd")
    assert recording.of("/log", "TextLog:text")[0][0] == SECOND // 10
    texts = [values[0] for _, values in recording.of("/now", "TextDocument:text")]
    assert any(text.startswith("**Forward** raised at 7.50 s") for text in texts)
    assert "| **bumps** | `1` | **6.0 s** |" in recording.of("/blackboard", "TextDocument:text")[-1][1][0]
