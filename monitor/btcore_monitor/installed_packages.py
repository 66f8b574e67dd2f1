"""Check that the packages of a command are installed."""

import importlib.util

from btcore.extras import install_command
from btcore_monitor.errors import MonitorError


def check_installed(*modules: str, needed_by: str = "the monitor") -> None:
    """Raise MonitorError if one of *modules*, which *needed_by* needs, is not installed."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        command = install_command(missing[0], "monitor")
        raise MonitorError(f"{needed_by} needs {missing[0]}, which is not installed: {command}")
