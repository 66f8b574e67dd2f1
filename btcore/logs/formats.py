"""Choosing the format of a log by the extension of its file."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

from btcore import entry_points
from btcore.logs.btlog import BtLog, read_btlog
from btcore.logs.console import ConsoleLog
from btcore.logs.files import LogError
from btcore.logs.log import Log
from btcore.logs.recording import Recording
from btcore.suggestions import join_names, nearest_name, suggestion
from btcore.tree.tree import Tree

CONSOLE: Final = "-"


class LogFormat(NamedTuple):
    """A format of log files: an entry point of the group `btcore.logs`, named after the extension.

    Attributes:
        write: Starts a log of a tree, or None if btcore only reads the format.
        read: Reads a log, or None if btcore only writes the format.
        read_session: Reads the session with a number (`FILE.db3#2`), if a file may have several sessions.
    """

    write: Callable[[Tree, Path], Log] | None
    read: Callable[[Path], Recording] | None
    read_session: Callable[[Path, int], Recording] | None = None


FORMATS: Final = {".btlog": LogFormat(BtLog, read_btlog)}
"""The formats of the core, by extension."""


def open_log(tree: Tree, path: str | os.PathLike[str]) -> Log:
    """Start a log of a tree.

    Args:
        tree: The tree to log.
        path: The file, whose extension determines the format: `.btlog` (FileLogger2), `.db3` or
            `.btdb` (SqliteLogger; existing sessions are deleted), `.mcap` (a bag of ROS 2), `.json` (trace
            events for Perfetto), `.btrec.txt` (a recording). `-` prints to stdout.

    Returns:
        The log. Close it to complete the file.

    Raises:
        LogError: The extension is unknown, or the file cannot be written.

    Examples:
        >>> import btcore
        >>> from btcore.logs import open_log, read_log
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess())
        >>> with open_log(tree, "any.btlog"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
    """
    if path == CONSOLE:
        return ConsoleLog(tree)
    file = Path(path)
    format = _find(file)
    if format is None:
        raise _unknown(file, "write", "written")
    if format.write is None:
        hint = file.with_suffix(".btlog").name
        raise LogError(f"{file}: a log in this format can be read, but not written; use {hint}")
    return format.write(tree, file)


def read_log(path: str | os.PathLike[str]) -> Recording:
    """Read a log of any format. A truncated or damaged file is read up to the damage.

    In a database, the last session is read; `FILE.db3#2` selects session 2.

    Returns:
        The recording. Its `warnings` describe damage.

    Raises:
        LogError: The extension is unknown, or the file cannot be read or is not a log.

    Examples:
        >>> import btcore
        >>> from btcore.logs import open_log, read_log
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"))
        >>> with open_log(tree, "door.btlog"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> recording = read_log("door.btlog")
        >>> [node.path for node in recording.nodes.values()]
        ['door']
        >>> [change.status.name for change in recording.transitions]
        ['SUCCESS', 'IDLE']
    """
    file = Path(path)
    name, mark, number = file.name.rpartition("#")
    if mark and number.isdecimal() and not file.exists():
        format = _find(file.with_name(name))
        if format is not None and format.read_session is not None:
            return format.read_session(file.with_name(name), int(number))
    format = _find(file)
    if format is None or format.read is None:
        raise _unknown(file, "read", "read")
    return format.read(file)


def _find(path: Path) -> LogFormat | None:
    """Return the format for the extension of *path*, such as `.btlog` or `.btrec.txt`."""
    for extension in ("".join(path.suffixes[-2:]), path.suffix):
        if extension in FORMATS:
            return FORMATS[extension]
        found, unavailable = entry_points.load(entry_points.LOGS_GROUP, extension.removeprefix("."))
        for point in unavailable:
            raise LogError(f"{path}: the format {extension} cannot be loaded: {point.remedy}")
        if found:
            format: LogFormat = found[0].value
            return format
    return None


def _unknown(path: Path, field: str, participle: str) -> LogError:
    installed, _ = entry_points.load(entry_points.LOGS_GROUP)
    formats = FORMATS | {f".{point.name}": point.value for point in installed}
    choices = [extension for extension, format in formats.items() if getattr(format, field) is not None]
    guess = nearest_name(path.suffix, choices) or choices[0]
    hint = suggestion(path.with_suffix(guess)) if path.name else f"for example run{guess}"
    return LogError(f"{path}: logs that can be {participle} end in {join_names(choices, 'or')}; {hint}")
