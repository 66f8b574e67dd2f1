"""The database of BehaviorTree.CPP 4's SqliteLogger, being written (groot2.md §12)."""

import sqlite3
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Final

from btcore.logs.files import LogError, ensure_writable, expect_extension
from btcore.status import RUNNING, Status

EXTENSIONS: Final = (".db3", ".btdb")

GAP_PREFIX: Final = "gap: "
"""What a row's ``extra_data`` begins with where something is missing before it; the sentence follows."""

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


class SqliteWriter:
    """A new session in the database *path*, for the tree *xml* with its *nodes* (path and uid).

    Without *append* the sessions that are there are deleted (the numbers of sessions go on). While another
    program writes, rows wait for a later :meth:`flush`. Raises LogError.
    """

    def __init__(
        self, path: Path, xml: str, nodes: Iterable[tuple[str, int]], *, append: bool = False
    ) -> None:
        expect_extension(path, *EXTENSIONS)
        ensure_writable(path)
        self.session = 0
        self._rows: list[tuple[int, int, int, int, int, str]] = []
        self._since: dict[int, int] = {}
        self._base = sqlite3.connect(
            path, timeout=_PATIENCE_MS / 1000, isolation_level=None, check_same_thread=False
        )
        try:
            self._last = self._begin(xml, nodes, append)
        except sqlite3.Error as error:
            self._base.close()
            busy = "; another program writes to it" if _is_busy(error) else ""
            raise LogError(f"{path}: a log can't be written here: {error}{busy}") from None
        self._first = self._last + 1

    def _begin(self, xml: str, nodes: Iterable[tuple[str, int]], append: bool) -> int:
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
        paths = [(self.session, path, uid) for path, uid in nodes]
        base.executemany("INSERT INTO Nodes VALUES (?, ?, ?)", paths)
        (last,) = base.execute("SELECT max(timestamp) FROM Transitions").fetchone()
        base.execute("COMMIT")
        # From now on whoever writes does not wait for other programs.
        base.execute("PRAGMA busy_timeout = 0")
        return int(last or 0)

    def begin_at(self, start: int) -> None:
        """Stamps are to count from *start* (µs since 1970), or from right after the last one there is."""
        self._first = max(start, self._last + 1)

    def add(self, since: int, uid: int, previous: Status, status: Status, extra: str = "") -> None:
        """Keep a row for the next :meth:`flush`; *since* is in µs since the start.

        Stamps are made to increase. The row's ``duration`` is how long (µs) the node was RUNNING, in the row
        in which it leaves it, else 0.
        """
        stamp = max(self._last + 1, self._first + since)
        self._last = stamp
        duration = 0
        if status is RUNNING:
            self._since[uid] = stamp
        elif previous is RUNNING:
            duration = stamp - self._since.pop(uid, stamp)
        self._rows.append((stamp, self.session, uid, duration, int(status), extra))

    def flush(self) -> None:
        """Write the rows that wait, in one transaction. Raises sqlite3.Error."""
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
        """Write the rows that had to wait, and put everything into the one file. Raises BlockingIOError."""
        self._base.execute(f"PRAGMA busy_timeout = {_PATIENCE_MS}")
        if self._rows:
            self.flush()
        if self._rows:
            raise BlockingIOError(f"another program writes, and {len(self._rows)} transitions are lost")
        # A reader that is still there keeps the write-ahead log; nothing is lost by that.
        with suppress(sqlite3.OperationalError):
            self._base.execute("PRAGMA journal_mode = DELETE")

    def close(self) -> None:
        """Close the database."""
        self._base.close()


def _is_busy(error: sqlite3.Error) -> bool:
    """Whether *error* is one that passes: another connection holds the database."""
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
