"""Levels of the lines in the log of transitions. Users can filter by level in the viewer."""

from collections.abc import Mapping
from typing import Final

from btcore_monitor.events import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS

LEVELS: Final = ("TRACE", "DEBUG", "INFO", "WARN", "ERROR")
"""The levels from the most to the least detailed, with rerun's names."""

OF_STATUS: Final[Mapping[int, str]] = {
    IDLE: "TRACE",
    RUNNING: "DEBUG",
    SKIPPED: "DEBUG",
    SUCCESS: "INFO",
    FAILURE: "WARN",
}
"""Level of a transition, by its new status. Missing data has the level WARN, an exception of a node ERROR."""
