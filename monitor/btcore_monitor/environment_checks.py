"""Check that packages, a display and files that a command needs are there, before the command starts."""

import importlib.util
import os
import sys
from pathlib import Path

from btcore.errors import SettingsError
from btcore.extras import install_command
from btcore_monitor.errors import MonitorError


def check_installed(*modules: str, needed_by: str = "the monitor") -> None:
    """Raise MonitorError if one of *modules*, which *needed_by* needs, is not installed."""
    missing = [name for name in modules if importlib.util.find_spec(name) is None]
    if missing:
        command = install_command(missing[0], "monitor")
        raise MonitorError(f"{needed_by} needs {missing[0]}, which is not installed: {command}")


def has_display() -> bool:
    """Return whether a window can be opened on this machine."""
    if sys.platform in ("win32", "darwin"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def check_is_recording(save: Path) -> None:
    """Raise SettingsError if the file of `--save` does not have the suffix `.rrd`."""
    if save.suffix.lower() != ".rrd":
        raise SettingsError(f"--save {save}: a recording is an .rrd file: --save {save.with_suffix('.rrd')}")


def check_folder(option: str, path: Path) -> None:
    """Raise SettingsError if the folder of *option*'s file does not exist."""
    if not path.resolve().parent.is_dir():
        raise SettingsError(f"{option} {path}: there is no folder {path.resolve().parent}")


def check_writable(option: str, path: Path) -> None:
    """Raise SettingsError if *option*'s file cannot be written; an existing file is not changed."""
    check_folder(option, path)
    is_new = not path.exists()
    try:
        with path.open("ab"):
            pass
        if is_new:
            path.unlink()
    except OSError as error:
        raise SettingsError(f"{option} {path}: it can't be written: {error.strerror or error}") from None
