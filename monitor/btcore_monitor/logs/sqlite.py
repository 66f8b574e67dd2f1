"""Writing and reading `.db3`, the database of BehaviorTree.CPP 4's SqliteLogger.

The format is that of src/loggers/bt_sqlite_logger.cpp, with three tables. Definitions has a row for each
session with the tree's XML; Nodes has the full path of each node of a session. Transitions has a time stamp
in µs since 1970, which is the primary key, and therefore strictly increasing over all sessions.
"""

import os
import sqlite3
import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import ClassVar, Final, NamedTuple

from btcore.clock import NS_PER_US
from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs.files import LogError, ensure_writable, expect_extension, read_bytes
from btcore.logs.formats import LogFormat
from btcore.logs.log import Log
from btcore.logs.recording import STATUSES, Gap, RecordedNode, Recording, TransitionCollector, parse_nodes
from btcore.status import IDLE, RUNNING, Status, Transition
from btcore.suggestions import join_names
from btcore.tree.tree import Tree

EXTENSIONS: Final = (".db3", ".btdb")

GAP_PREFIX: Final = "gap: "
"""The beginning of a row's `extra_data` if transitions are missing before it; the reason follows."""

_TABLES: Final = (
    "CREATE TABLE IF NOT EXISTS Definitions (session_id INTEGER PRIMARY KEY AUTOINCREMENT,"
    " date TEXT NOT NULL, xml_tree TEXT NOT NULL)",
    "CREATE TABLE IF NOT EXISTS Nodes (session_id INTEGER NOT NULL, fullpath VARCHAR,"
    " node_uid INTEGER NOT NULL)",
    "CREATE TABLE IF NOT EXISTS Transitions (timestamp INTEGER PRIMARY KEY NOT NULL,"
    " session_id INTEGER NOT NULL, node_uid INTEGER NOT NULL, duration INTEGER,"
    " state INTEGER NOT NULL, extra_data VARCHAR)",
)
_LOCK_TIMEOUT_MS: Final = 1_000  # how long to wait for other programs at the start and the end of the log

_MAGIC: Final = b"SQLite format 3\0"
_HEAD: Final = 100
_PAGE_SIZE: Final = struct.Struct(">H")
_NUMBER: Final = struct.Struct(">I")
# Byte offsets in the header of a database file (https://www.sqlite.org/fileformat.html).
_AT_PAGE_SIZE, _AT_VERSIONS, _AT_CHANGES, _AT_PAGES, _AT_VALID = 16, 18, 24, 28, 92
_GROWTH: Final = 64


class SqliteWriter:
    """A writer of a new session in a database.

    While another program writes to the database, rows are kept for a later `flush`.

    Args:
        nodes: The path and UID of each node.
        append: Whether to keep the existing sessions. Their numbers are not reused in either case.
    """

    def __init__(
        self, path: Path, xml: str, nodes: Iterable[tuple[str, int]], *, append: bool = False
    ) -> None:
        expect_extension(path, *EXTENSIONS)
        ensure_writable(path)
        self.session = 0
        self._rows: list[tuple[int, int, int, int, int, str]] = []
        self._gaps: list[str] = []
        self._since: dict[int, int] = {}
        self._base = sqlite3.connect(
            path, timeout=_LOCK_TIMEOUT_MS / 1000, isolation_level=None, check_same_thread=False
        )
        try:
            self._last = self._begin(xml, nodes, append)
        except sqlite3.Error as error:
            self._base.close()
            busy = "; another program is writing to it" if _is_busy(error) else ""
            raise LogError(f"{path}: cannot write a log here: {error}{busy}") from None
        self._first = self._last + 1

    def _begin(self, xml: str, nodes: Iterable[tuple[str, int]], append: bool) -> int:
        """Create the tables and the session. Return the largest existing stamp (µs since 1970), or 0."""
        base = self._base
        # With a write-ahead log, readers and this writer do not block each other.
        base.execute("PRAGMA journal_mode = WAL")
        base.execute("PRAGMA synchronous = OFF")
        base.execute("BEGIN IMMEDIATE")
        for table in _TABLES:
            base.execute(table)
        if not append:
            for name in ("Definitions", "Nodes", "Transitions"):
                base.execute(f"DELETE FROM {name}")
        cursor = base.execute(
            "INSERT INTO Definitions (date, xml_tree) VALUES (datetime('now', 'localtime'), ?)", (xml,)
        )
        self.session = cursor.lastrowid or 0
        paths = [(self.session, path, uid) for path, uid in nodes]
        base.executemany("INSERT INTO Nodes VALUES (?, ?, ?)", paths)
        (last,) = base.execute("SELECT max(timestamp) FROM Transitions").fetchone()
        base.execute("COMMIT")
        # From now on a locked database is an immediate error, so that a tick never waits for other programs.
        base.execute("PRAGMA busy_timeout = 0")
        return int(last or 0)

    def begin_at(self, start: int) -> None:
        """Set the start of the session (µs since 1970), or begin after the last stamp if that is later."""
        self._first = max(start, self._last + 1)

    def add(self, since: int, uid: int, previous: Status, status: Status, extra: str = "") -> None:
        """Keep a row for the next `flush`. Equal stamps are increased, since they must be unique.

        Args:
            since: The time since the start (µs).
            previous: Its previous status. If it is RUNNING, the row's `duration` is the time (µs) that the
                node was RUNNING, else 0.
            extra: The row's `extra_data`.
        """
        stamp = max(self._last + 1, self._first + since)
        self._last = stamp
        duration = 0
        if status is RUNNING:
            self._since[uid] = stamp
        elif previous is RUNNING:
            duration = stamp - self._since.pop(uid, stamp)
        self._rows.append((stamp, self.session, uid, duration, int(status), extra))

    def append(self, records: Iterable[tuple[int, int, Status, Status]]) -> None:
        """Write transitions, given as (time since the start in µs, UID, previous, status)."""
        for record in records:
            self.add(*record, GAP_PREFIX + "; ".join(self._gaps) if self._gaps else "")
            self._gaps.clear()
        self.flush()

    def gap(self, reason: str) -> None:
        """Mark the next row: transitions before it are missing, for *reason*."""
        self._gaps.append(reason)

    def flush(self) -> None:
        """Write the pending rows in a transaction; keep them if another program locks the database."""
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
        """Write the pending rows, and merge the write-ahead log into the database file."""
        self._base.execute(f"PRAGMA busy_timeout = {_LOCK_TIMEOUT_MS}")
        if self._rows:
            self.flush()
        if self._rows:
            raise BlockingIOError(
                f"another program is writing to the database, {len(self._rows)} transitions are lost"
            )
        # Fails while another program reads: the write-ahead log is then kept, and nothing is lost.
        with suppress(sqlite3.OperationalError):
            self._base.execute("PRAGMA journal_mode = DELETE")

    def close(self) -> None:
        """Close the database."""
        self._base.close()


def _is_busy(error: sqlite3.Error) -> bool:
    return getattr(error, "sqlite_errorcode", 0) & 0xFF in (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)


Extra = Callable[[TreeNode, Transition], str]
"""A function that returns the `extra_data` of the row for a transition of a node."""


class SqliteLog(Log):
    """A log of a tree in a new session of a database, as SqliteLogger writes it.

    If the database contains stamps that are later than now (from a run in simulated time), the new session
    begins directly after them. In the row in which a node leaves RUNNING, `duration` is the time (µs) that
    it was RUNNING, else 0.

    Until the log is closed, a write-ahead log exists next to the database, so that other programs can read
    while the tree runs. Writing does not wait for the disk: the log survives a crash of the process, but not
    a power failure. While another program writes to the database, rows are kept for the end of a later tick.

    Args:
        tree: The tree to log.
        path: The database.
        append: Whether to keep the existing sessions. Their numbers are not reused in either case.
        idle: Whether to log transitions to IDLE.
        extra: Called for each transition, on the thread that ticks; returns the row's `extra_data`.

    Attributes:
        extras: The extra data of the current tick's transitions.
        session: The number of the session in the database.

    Raises:
        LogError: The extension is wrong, or the database cannot be written.

    Examples:
        >>> import btcore
        >>> from btcore_monitor.logs import SqliteLog, sessions
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess())
        >>> with SqliteLog(tree, "runs.db3"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> [(session.number, session.transitions) for session in sessions("runs.db3")]
        [(1, 2)]
    """

    write_errors: ClassVar[tuple[type[Exception], ...]] = (OSError, sqlite3.Error)

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
        self.extra = extra
        self.extras: list[str] = []
        paths = ((node.config.path, node.config.uid) for subtree in tree.subtrees for node in subtree.nodes)
        self._base = SqliteWriter(self.path, tree_to_xml(tree), paths, append=append)
        self.session = self._base.session
        super().__init__(tree, str(self.path), idle=idle)
        self._base.begin_at(self.epoch // NS_PER_US)
        self._unsubscribe_extra = tree.subscribe(ExtraDataCollector(self)) if extra is not None else None
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Write the transitions *changes* and pending rows in a single database transaction."""
        extras, self.extras = self.extras, []
        for index, (_, stamp, _, uid, previous, status) in enumerate(changes):
            extra = extras[index] if index < len(extras) else ""
            self._base.add((stamp - self.start) // NS_PER_US, uid, previous, status, extra)
        self._base.flush()

    def finish(self) -> None:
        """Write the pending rows, and merge the write-ahead log into the database file."""
        self._base.finish()

    def release(self) -> None:
        """Close the database."""
        if self._unsubscribe_extra is not None:
            self._unsubscribe_extra()
        self._base.close()


class ExtraDataCollector(Observer):
    """An observer that collects the extra data of *log* at the time of each transition."""

    def __init__(self, log: SqliteLog) -> None:
        self._log = log
        self._nodes = {node.config.uid: node for node in log.tree.nodes}

    def transition(self, change: Transition) -> None:
        """Call the log's function for *change*, and keep the result for the end of the tick."""
        extra = self._log.extra
        if extra is not None and (change.status is not IDLE or self._log.idle):
            self._log.extras.append(extra(self._nodes[change.uid], change))


class Session(NamedTuple):
    """A run in a database.

    Attributes:
        number: The number of the session in the database, from 1.
        date: The start of the run in local time (`2026-01-31 12:00:00`).
        transitions: The number of transitions.
    """

    number: int
    date: str
    transitions: int


def sessions(path: str | os.PathLike[str]) -> list[Session]:
    """Return the sessions of a database, the oldest first.

    Raises:
        LogError: The file cannot be read, or is not a log.
    """
    query = (
        "SELECT session_id, date, (SELECT count(*) FROM Transitions AS t WHERE t.session_id = d.session_id)"
        " FROM Definitions AS d ORDER BY session_id"
    )
    with _opened(Path(path)) as (base, _):
        return [Session(*row) for row in base.execute(query)]


def read_sqlite(path: str | os.PathLike[str], session: int | None = None) -> Recording:
    """Read a session of a database. A truncated or damaged database is read up to the damage.

    Args:
        path: The database.
        session: The number of the session; None for the last session.

    Returns:
        The recording. Its `warnings` describe damage.

    Raises:
        LogError: The file cannot be read, is not a log, or does not contain the session.

    Examples:
        >>> import btcore
        >>> from btcore_monitor.logs import SqliteLog, read_sqlite
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"))
        >>> with SqliteLog(tree, "runs.db3"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> read_sqlite("runs.db3").nodes[1].path
        'door'
    """
    path = Path(path)
    with _opened(path) as (base, damage):
        numbers = [
            number for (number,) in base.execute("SELECT session_id FROM Definitions ORDER BY session_id")
        ]
        if not numbers:
            raise LogError(f"{path}: this log has no session")
        number = numbers[-1] if session is None else session
        if number not in numbers:
            known = join_names(map(str, numbers))
            raise LogError(f"{path}: this log has no session {number}; it has {known}")
        nodes, xml = _tree(base, number, path, damage)
        rows = base.execute(
            "SELECT timestamp, node_uid, state, extra_data FROM Transitions WHERE session_id = ?"
            " ORDER BY timestamp",
            (number,),
        )
        history = TransitionCollector()
        gaps: list[Gap] = []
        try:
            for stamp, uid, code, extra in rows:
                if uid not in nodes or code not in STATUSES:
                    unknown = f"status {code}" if uid in nodes else f"node {uid}"
                    damage = f"the log is damaged from the transition at {stamp} µs on: unknown {unknown}"
                    break
                if isinstance(extra, str) and extra.startswith(GAP_PREFIX):
                    gaps.append(Gap(len(history.changes), extra.removeprefix(GAP_PREFIX)))
                history.add(stamp * NS_PER_US, uid, STATUSES[code])
        except sqlite3.Error as error:
            damage = damage or f"cannot read the log after its transition {len(history.changes)}: {error}"
    start = history.changes[0].stamp if history.changes else 0
    return Recording(path, xml, start, nodes, history.changes, damage, tuple(gaps))


def _tree(
    base: sqlite3.Connection, session: int, path: Path, damage: str
) -> tuple[dict[int, RecordedNode], str]:
    try:
        (xml,) = base.execute("SELECT xml_tree FROM Definitions WHERE session_id = ?", (session,)).fetchone()
        return parse_nodes(str(xml), str(path)), str(xml)
    except (sqlite3.Error, LogError):
        if damage:
            raise LogError(f"{path}: {damage}, and the tree is in the missing part") from None
        raise


@contextmanager
def _opened(path: Path) -> Iterator[tuple[sqlite3.Connection, str]]:
    """Return a context with the database *path*, open for reading, and a message if it is truncated, else "".

    SQLite's errors in the context are raised as LogError.
    """
    # Checked here, because SQLite's own errors do not explain why it cannot open a file.
    head = read_bytes(path, _HEAD)
    if not head.startswith(_MAGIC):
        reason = "it does not begin with the header of a database" if head else "it is empty"
        raise LogError(f"{path}: this is not an SQLite database, {reason}")
    missing = _truncation(path, head)
    try:
        if missing:
            base = sqlite3.connect(":memory:")
        else:
            base = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        with closing(base):
            if missing:
                base.deserialize(_complete_pages(path, head))
            yield base, missing
    except sqlite3.Error as error:
        reason = f"{missing}, too few to read it" if missing else f"cannot read this log: {error}"
        raise LogError(f"{path}: {reason}") from None


def _truncation(path: Path, head: bytes) -> str:
    """Return the message about the missing part of a truncated database.

    "" if the database is complete, or a journal next to it may contain the missing pages.
    """
    if len(head) < _HEAD:
        raise LogError(f"{path}: this log ends in its header, after {len(head)} bytes")
    if any(path.with_name(path.name + more).exists() for more in ("-wal", "-journal")):
        return ""
    (pages,) = _NUMBER.unpack_from(head, _AT_PAGES)
    # SQLite before 3.7.0 (2010) did not update the number of pages; it is valid if these counters are equal.
    valid = head[_AT_CHANGES : _AT_CHANGES + 4] == head[_AT_VALID : _AT_VALID + 4]
    size, expected = path.stat().st_size, pages * _page_size(head)
    if not valid or size >= expected:
        return ""
    return f"the file is truncated: it has {size} of {expected} bytes"


def _page_size(head: bytes) -> int:
    (size,) = _PAGE_SIZE.unpack_from(head, _AT_PAGE_SIZE)
    return 65536 if size == 1 else int(size)  # 65536 does not fit into the field's 16 bits


def _complete_pages(path: Path, head: bytes) -> bytes:
    """Return the complete pages of the database *path*, with empty pages for the missing part.

    SQLite rejects a truncated database completely, although most of its pages may be intact. It accepts a
    file with the number of pages in the header, and reads no rows from empty pages.
    """
    size = _page_size(head)
    data = read_bytes(path)
    count = len(data) // size if size else 0
    if not count:
        raise LogError(f"{path}: this log ends in its first page, after {len(data)} bytes")
    (expected,) = _NUMBER.unpack_from(head, _AT_PAGES)
    # A damaged header may contain a number of pages that does not fit into the memory.
    pages = min(expected, _GROWTH * (count + 1))
    database = bytearray(data[: count * size]) + bytes((pages - count) * size)
    _NUMBER.pack_into(database, _AT_PAGES, pages)
    # 1 is the legacy journal mode: a database in memory cannot have a write-ahead log.
    database[_AT_VERSIONS : _AT_VERSIONS + 2] = b"\1\1"
    return bytes(database)


FORMAT: Final = LogFormat(SqliteLog, read_sqlite, read_sqlite)
