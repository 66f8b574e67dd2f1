"""Levels of the lines in the log of transitions, by which the viewer lets people filter."""

from collections.abc import Mapping
from typing import Final

from btcore_monitor.events import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS

LEVELS: Final = ("TRACE", "DEBUG", "INFO", "WARN", "ERROR")
"""From all that is told to what went wrong; the names are rerun's."""

OF_STATUS: Final[Mapping[int, str]] = {
    IDLE: "TRACE",
    RUNNING: "DEBUG",
    SKIPPED: "DEBUG",
    SUCCESS: "INFO",
    FAILURE: "WARN",
}
"""Level of a transition, by the status that it goes to. What is missing is WARN, what a node raised ERROR."""
