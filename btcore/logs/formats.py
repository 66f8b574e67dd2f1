"""Choosing the format of a log by the extension of its file."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple, TypeVar

from btcore import entry_points
from btcore.logs.btlog import BtLog, read_btlog
from btcore.logs.console import ConsoleLog
from btcore.logs.fbl import read_fbl
from btcore.logs.files import LogError
from btcore.logs.log import Log
from btcore.logs.recording import Recording
from btcore.logs.sqlite import EXTENSIONS, SqliteLog, read_sqlite
from btcore.logs.trace import TraceLog
from btcore.suggestions import join_names, nearest_name, suggestion
from btcore.tree.tree import Tree

T = TypeVar("T")

WRITERS: Final[dict[str, Callable[[Tree, Path], Log]]] = {
    ".btlog": BtLog,
    ".db3": SqliteLog,
    ".btdb": SqliteLog,
    ".json": TraceLog,
}
"""The logs that btcore writes, by extension."""

READERS: Final[dict[str, Callable[[Path], Recording]]] = {
    ".btlog": read_btlog,
    ".db3": read_sqlite,
    ".btdb": read_sqlite,
    ".fbl": read_fbl,
}
"""The functions that read logs, by extension."""

CONSOLE: Final = "-"


class LogFormat(NamedTuple):
    """A format of another package: an entry point of the group `btcore.logs`, named after the extension."""

    write: Callable[[Tree, Path], Log]
    read: Callable[[Path], Recording]


def open_log(tree: Tree, path: str | os.PathLike[str]) -> Log:
    """Start a log of a tree.

    Args:
        tree: The tree to log.
        path: The file, whose extension determines the format: `.btlog` (FileLogger2), `.db3` or
            `.btdb` (SqliteLogger; existing sessions are deleted), `.mcap` (a bag of ROS 2), `.json` (trace
            events for Perfetto).
            `-` prints to stdout.

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
    if file.suffix == ".fbl":
        hint = file.with_suffix(".btlog")
        raise LogError(f"{file}: btcore reads but does not write .fbl, a log of format 3; use {hint.name}")
    return _by_extension(file, WRITERS, "write", "written")(tree, file)


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
    if mark and number.isdecimal() and Path(name).suffix in EXTENSIONS and not file.exists():
        return read_sqlite(file.with_name(name), int(number))
    return _by_extension(file, READERS, "read", "read")(file)


def _by_extension(path: Path, choices: dict[str, T], field: str, what: str) -> T:
    if path.suffix not in choices:
        formats, unavailable = entry_points.load(entry_points.LOGS_GROUP)
        choices = choices | {f".{each.name}": getattr(each.value, field) for each in formats}
        for each in unavailable:
            if path.suffix == f".{each.name}":
                raise LogError(f"{path}: the format {path.suffix} cannot be loaded: {each.remedy}")
    if path.suffix in choices:
        return choices[path.suffix]
    guess = nearest_name(path.suffix, choices) or next(iter(choices))
    hint = suggestion(path.with_suffix(guess)) if path.name else f"for example run{guess}"
    raise LogError(f"{path}: logs that can be {what} end in {join_names(choices, 'or')}; {hint}")
