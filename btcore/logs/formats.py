"""The right log for a file, by its extension."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeVar

from btcore.logs.btlog import BtLog, read_btlog
from btcore.logs.console import ConsoleLog
from btcore.logs.fbl import read_fbl
from btcore.logs.files import LogError
from btcore.logs.log import Log
from btcore.logs.recording import Recording
from btcore.logs.sqlite import EXTENSIONS, SqliteLog, read_sqlite
from btcore.logs.trace import TraceLog
from btcore.suggestions import join_names, nearest_name
from btcore.tree.tree import Tree

T = TypeVar("T")

WRITERS: Final[dict[str, Callable[[Tree, Path], Log]]] = {
    ".btlog": BtLog,
    ".db3": SqliteLog,
    ".btdb": SqliteLog,
    ".json": TraceLog,
}
"""What can be written, by extension."""

READERS: Final[dict[str, Callable[[Path], Recording]]] = {
    ".btlog": read_btlog,
    ".db3": read_sqlite,
    ".btdb": read_sqlite,
    ".fbl": read_fbl,
}
"""What can be read, by extension."""

CONSOLE: Final = "-"


def open_log(tree: Tree, path: str | os.PathLike[str]) -> Log:
    """The log of *tree* that *path*'s extension asks for, attached; ``-`` is the console.

    ``.btlog`` is FileLogger2's file, ``.db3`` and ``.btdb`` SqliteLogger's database (its sessions are
    replaced), ``.json`` trace events for Perfetto. Raises LogError.
    """
    if path == CONSOLE:
        return ConsoleLog(tree)
    place = Path(path)
    if place.suffix == ".fbl":
        hint = place.with_suffix(".btlog")
        raise LogError(f"{place}: .fbl is a log of format 3, which btcore reads; it writes {hint.name}")
    return _chosen(place, WRITERS, "written")(tree, place)


def read_log(path: str | os.PathLike[str]) -> Recording:
    """What the log *path* tells; of a database its last session, of ``FILE.db3#2`` its session 2.

    Raises LogError.
    """
    place = Path(path)
    name, mark, number = place.name.rpartition("#")
    if mark and number.isdecimal() and Path(name).suffix in EXTENSIONS and not place.exists():
        return read_sqlite(place.with_name(name), int(number))
    return _chosen(place, READERS, "read")(place)


def _chosen(path: Path, choices: dict[str, T], what: str) -> T:
    if path.suffix in choices:
        return choices[path.suffix]
    guess = nearest_name(path.suffix, choices) or next(iter(choices))
    hint = f"did you mean {path.with_suffix(guess)}?" if path.name else f"say, run{guess}"
    raise LogError(f"{path}: logs that can be {what} end in {join_names(choices, 'or')}; {hint}")
