"""The log of transitions: every line has a level, and the viewer shows the selected levels."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rerun.chunk import RrdReader

from btcore_monitor.events import (
    ExceptionEvent,
    LostTransitionsEvent,
    ObservedNode,
    ObservedTree,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.screen.panels import LEVELS
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.sinks import RecordingSinks
from btcore_monitor.viewer_options import LOG_LEVELS

IDLE, RUNNING, SUCCESS, FAILURE, SKIPPED = range(5)
TREE = ObservedTree("a" * 32, "T", (ObservedNode(1, "Go", "Go", "action", "Go"),), {"": "T"})


def events() -> list:
    steps = [(IDLE, RUNNING), (RUNNING, SUCCESS), (SUCCESS, IDLE), (IDLE, SKIPPED), (SKIPPED, FAILURE)]
    changes = [
        TransitionEvent(number, number, number, number, 1, *step)
        for number, step in enumerate(steps, start=1)
    ]
    return [
        TreeEvent(TREE, 0, 0, {1: 0}),
        *changes,
        LostTransitionsEvent(6, 7),
        ExceptionEvent(9, 9, "Go", "no"),
    ]


def test_levels_rise_from_idle_to_exceptions(tmp_path: Path, recorded: Callable[..., Any]) -> None:
    rows = recorded(events(), tmp_path / "x.rrd")
    texts = [values[0].split()[-1] for _, values in rows.of("/log", "TextLog:text")]
    levels = [values[0] for _, values in rows.of("/log", "TextLog:level")]
    assert dict(zip(texts, levels, strict=True)) == {
        "RUNNING": "DEBUG",
        "SUCCESS": "INFO",
        "IDLE": "TRACE",
        "SKIPPED": "DEBUG",
        "FAILURE": "WARN",
        "arrived": "WARN",
        "no": "ERROR",
    }


@pytest.mark.parametrize(
    ("level", "shown"), [("TRACE", None), ("WARN", ["WARN", "ERROR"]), ("ERROR", ["ERROR"])]
)
def test_window_shows_selected_levels_and_recording_has_all(
    level: str, shown: list[str] | None, tmp_path: Path, read: type
) -> None:
    path = tmp_path / "x.rrd"
    screen = RobotView(SingleRobotLayout(RecordingSinks(save=path)), log_level=level)
    for event in events():
        screen.process_event(event)
    screen.close()
    reader = RrdReader(path)
    filters = [
        values
        for chunk in reader.stream(store=reader.blueprints()[-1])
        for name in ["TextLogRows:filter_by_log_level"]
        if name in chunk.to_record_batch().schema.names
        for values in chunk.to_record_batch().column(name).to_pylist()
    ]
    assert filters == ([shown] if shown else [])
    assert len(read(path).of("/log", "TextLog:text")) == 7


def test_the_command_line_lists_all_levels() -> None:
    assert [level.upper() for level in LOG_LEVELS] == list(LEVELS)
