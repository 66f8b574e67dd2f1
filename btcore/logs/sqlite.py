"""``.db3``: the database of BehaviorTree.CPP 4's SqliteLogger, written and read (groot2.md §12).

Three tables: Definitions, a row for each session with the tree's XML; Nodes, the full path of every
node of a session; Transitions, with a stamp in µs since 1970 that is the key, and therefore strictly
increasing over all sessions.
"""

import os
import sqlite3
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import ClassVar, Final

from btcore.logs.files import LogFault, expect_extension, reach
from btcore.logs.log import Log
from btcore.node import TreeNode
from btcore.status import IDLE, RUNNING, Transition
from btcore.tree import Tree
from btcore.xml.write import tree_to_xml

EXTENSIONS: Final = (".db3", ".btdb")
NS_PER_US: Final = 1_000

_TABLES: Final = (
    "CREATE TABLE IF NOT EXISTS Definitions (session_id INTEGER PRIMARY KEY AUTOINCREMENT,"
    " date TEXT NOT NULL, xml_tree TEXT NOT NULL)",
    "CREATE TABLE IF NOT EXISTS Nodes (session_id INTEGER NOT NULL, fullpath VARCHAR,"
    " node_uid INTEGER NOT NULL)",
    "CREATE TABLE IF NOT EXISTS Transitions (timestamp INTEGER PRIMARY KEY NOT NULL,"
    " session_id INTEGER NOT NULL, node_uid INTEGER NOT NULL, duration INTEGER,"
    " state INTEGER NOT NULL, extra_data VARCHAR)",
)
_PATIENCE_MS: Final = 1_000

Extra = Callable[[TreeNode, Transition], str]


class SqliteLog(Log):
    """Writes the transitions of *tree* to the database *path*, as SqliteLogger does, in a new session.

    Without *append* the sessions that are there are deleted (the numbers of sessions go on). *extra* is
    called for every transition, on the thread that ticks; its text becomes the row's ``extra_data``.
    Where a database holds stamps that are later than now (of a run in simulated time), the new session
    begins right after them. A row's ``duration`` is how long (µs) the node was RUNNING, in the row in
    which it leaves it, else 0.

    The database keeps a write-ahead log beside it until the log is closed, so that other programs can
    read while the tree runs; it does not wait for the disk, so it outlives the process, but not the
    power. While another program writes, rows wait for the end of a later tick. Raises LogFault.
    """

    failures: ClassVar[tuple[type[Exception], ...]] = (OSError, sqlite3.Error)

    def __init__(
        self,
        tree: Tree,
        path: str | os.PathLike[str],
        *,
        append: bool = False,
        idle: bool = True,
        extra: Extra | None = None,
    ) -> None:
        self.path = Path(path)
        expect_extension(self.path, *EXTENSIONS)
        reach(self.path)
        self.session = 0
        self._rows: list[tuple[int, int, int, int, int, str]] = []
        self._since: dict[int, int] = {}
        self._extra = extra
        self._extras: list[str] = []
        self._nodes = {node.uid: node for node in tree.nodes}
        xml = tree_to_xml(tree)
        self._base = sqlite3.connect(
            self.path, timeout=_PATIENCE_MS / 1000, isolation_level=None, check_same_thread=False
        )
        try:
            self._last = self._begin(tree, xml, append)
        except sqlite3.Error as error:
            self._base.close()
            busy = "; another program writes to it" if _is_busy(error) else ""
            raise LogFault(f"{self.path}: a log can't be written here: {error}{busy}") from None
        super().__init__(tree, str(self.path), idle=idle)
        self._first = max(self.epoch // NS_PER_US, self._last + 1)
        self.attach()

    def _begin(self, tree: Tree, xml: str, append: bool) -> int:
        """Make the tables and the session; returns the last stamp (µs since 1970) that is taken."""
        base = self._base
        base.execute("PRAGMA journal_mode = WAL")
        base.execute("PRAGMA synchronous = OFF")
        base.execute("BEGIN IMMEDIATE")
        for table in _TABLES:
            base.execute(table)
        if not append:
            for name in ("Definitions", "Nodes", "Transitions"):
                base.execute(f"DELETE FROM {name}")
        made = base.execute(
            "INSERT INTO Definitions (date, xml_tree) VALUES (datetime('now', 'localtime'), ?)", (xml,)
        )
        self.session = made.lastrowid or 0
        paths = [(self.session, node.path, node.uid) for subtree in tree.subtrees for node in subtree.nodes]
        base.executemany("INSERT INTO Nodes VALUES (?, ?, ?)", paths)
        (last,) = base.execute("SELECT max(timestamp) FROM Transitions").fetchone()
        base.execute("COMMIT")
        # From now on the thread that ticks does not wait for other programs.
        base.execute("PRAGMA busy_timeout = 0")
        return int(last or 0)

    def transition(self, change: Transition) -> None:
        """Keep *change* for the end of the tick, with its extra data."""
        if self._extra is not None and (change.status is not IDLE or self.idle):
            self._extras.append(self._extra(self._nodes[change.uid], change))
        super().transition(change)

    def write(self, changes: list[Transition]) -> None:
        """Append *changes* in one transaction, with those that had to wait."""
        extras, self._extras = self._extras, []
        for index, change in enumerate(changes):
            stamp = max(self._last + 1, self._first + (change.stamp - self.start) // NS_PER_US)
            self._last = stamp
            duration = 0
            if change.status is RUNNING:
                self._since[change.uid] = stamp
            elif change.previous is RUNNING:
                duration = stamp - self._since.pop(change.uid, stamp)
            said = extras[index] if extras else ""
            self._rows.append((stamp, self.session, change.uid, duration, int(change.status), said))
        self._insert()

    def _insert(self) -> None:
        base = self._base
        try:
            base.execute("BEGIN IMMEDIATE")
            base.executemany("INSERT INTO Transitions VALUES (?, ?, ?, ?, ?, ?)", self._rows)
            base.execute("COMMIT")
        except sqlite3.OperationalError as error:
            if base.in_transaction:
                base.execute("ROLLBACK")
            if not _is_busy(error):
                raise
        else:
            self._rows.clear()

    def finish(self) -> None:
        """Write the rows that had to wait, and put everything into the one file."""
        self._base.execute(f"PRAGMA busy_timeout = {_PATIENCE_MS}")
        if self._rows:
            self._insert()
        if self._rows:
            raise BlockingIOError(f"another program writes, and {len(self._rows)} transitions are lost")
        # A reader that is still there keeps the write-ahead log; nothing is lost by that.
        with suppress(sqlite3.OperationalError):
            self._base.execute("PRAGMA journal_mode = DELETE")

    def release(self) -> None:
        """Close the database."""
        self._base.close()


def _is_busy(error: sqlite3.Error) -> bool:
    """Whether *error* is one that passes: another connection holds the database."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
