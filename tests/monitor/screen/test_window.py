"""The views of the window: their time, and the moment of a picture."""

import pytest

from btcore_monitor.events import ConnectionChanged, StatusChanged
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.row_buffer import TREE_TIME
from btcore_monitor.screen.screenshot import last_tick
from btcore_monitor.screen.sinks import RecordingSinks

IDLE, RUNNING = range(2)
SECOND = 10**9
FORWARD = 8


def axes(blueprint):
    """Return the boundaries of the time axes of lanes and curves, as pairs."""
    return {tuple(row[0].values()) for row in blueprint["TimeAxis:view_range"]}


@pytest.mark.parametrize("ticks", [70, 400, 900])
def test_axes_begin_with_the_run_and_follow_the_cursor_of_a_long_run(ticks, run, blueprints, tmp_path):
    screen = RobotView(RecordingSinks(save=tmp_path / "run.rrd"))
    events = run(ticks)
    for event in events[:20]:
        screen.show(event)
    screen.flush()
    for event in events[20:]:
        screen.show(event)
    screen.close()
    sent = [axes(blueprint) for blueprint in blueprints(tmp_path / "run.rrd")]
    assert sent[0] == {(0, 25 * SECOND)}
    if ticks <= 600:
        assert sent[-1] == {(0, ticks * SECOND // 10)}
    else:
        assert sent[-1] == {(-24 * SECOND, 3 * SECOND // 2)}  # from the cursor


def test_the_default_moment_of_a_picture_is_thelast_tick_before_the_halt(run, recorded, tmp_path):
    events = run(70)
    last = events[-1:]
    t = events[-2].t
    halt = StatusChanged(10_000, t, t, 70, FORWARD, RUNNING, IDLE)
    recording = recorded([*events[:-1], halt, *last], tmp_path / "run.rrd")
    assert isinstance(last[0], ConnectionChanged)
    assert last_tick(tmp_path / "run.rrd", TREE_TIME) == t
    before, after = (recording.at("/tree/pills", "LineStrips2D:colors", at) for at in (t, t + 1))
    assert before[FORWARD - 1] != after[FORWARD - 1]


def test_the_column_of_the_time_is_wide_enough_and_lines_do_not_repeat_the_time(run, recorded, tmp_path):
    """rerun makes the column as wide as the name of its timeline."""
    recording = recorded(run(5), tmp_path / "run.rrd")
    assert len(TREE_TIME) > len("+99m 59.99s")
    assert recording.of("/log", "TextLog:text")[0][1] == ["#1      bumpgo        IDLE → RUNNING"]
