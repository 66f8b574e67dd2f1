"""``.db3``: the database of BehaviorTree.CPP 4's SqliteLogger, written and read (groot2.md §12).

Three tables: Definitions, a row for each session with the tree's XML; Nodes, the full path of every
node of a session; Transitions, with a stamp in µs since 1970 that is the key, and therefore strictly
increasing over all sessions.
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
from btcore.logs.files import LogError, ensure_writable, expect_extension, read_bytes
from btcore.logs.log import Log
from btcore.logs.recording import (
    STATUSES,
    Gap,
    RecordedNode,
    Recording,
    TransitionCollector,
    parse_nodes,
)
from btcore.status import IDLE, RUNNING, Status, Transition
from btcore.suggestions import join_names
from btcore.tree.tree import Tree
from btcore.xml.render.tree_xml import tree_to_xml

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

_MAGIC: Final = b"SQLite format 3\0"
_HEAD: Final = 100
_PAGE_SIZE: Final = struct.Struct(">H")
_NUMBER: Final = struct.Struct(">I")
# Offsets in the head of a database file (https://www.sqlite.org/fileformat.html).
_AT_PAGE_SIZE, _AT_VERSIONS, _AT_CHANGES, _AT_PAGES, _AT_VALID = 16, 18, 24, 28, 92
_GROWTH: Final = 64


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
    power. While another program writes, rows wait for the end of a later tick. Raises LogError.
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
        paths = ((node.path, node.uid) for subtree in tree.subtrees for node in subtree.nodes)
        self._base = SqliteWriter(self.path, tree_to_xml(tree), paths, append=append)
        self.session = self._base.session
        super().__init__(tree, str(self.path), idle=idle)
        self._base.begin_at(self.epoch // NS_PER_US)
        self._stop_asking = tree.subscribe(ExtraDataCollector(self)) if extra is not None else None
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Append *changes* in one transaction, with those that had to wait."""
        extras, self.extras = self.extras, []
        for index, (_, stamp, _, uid, previous, status) in enumerate(changes):
            said = extras[index] if index < len(extras) else ""
            self._base.add((stamp - self.start) // NS_PER_US, uid, previous, status, said)
        self._base.flush()

    def finish(self) -> None:
        """Write the rows that had to wait, and put everything into the one file."""
        self._base.finish()

    def release(self) -> None:
        """Close the database."""
        if self._stop_asking is not None:
            self._stop_asking()
        self._base.close()


class ExtraDataCollector(Observer):
    """Asks for the extra data of *log* at the moment of each transition."""

    def __init__(self, log: SqliteLog) -> None:
        self._log = log
        self._nodes = {node.uid: node for node in log.tree.nodes}

    def transition(self, change: Transition) -> None:
        """Ask, and keep the answer for the end of the tick."""
        extra = self._log.extra
        if extra is not None and (change.status is not IDLE or self._log.idle):
            self._log.extras.append(extra(self._nodes[change.uid], change))


class Session(NamedTuple):
    """One run in a database; *date* is when it began, in local time (``2026-01-31 12:00:00``)."""

    number: int
    date: str
    transitions: int


def sessions(path: str | os.PathLike[str]) -> list[Session]:
    """The sessions of the database *path*, the oldest first. Raises LogError if it is no such log."""
    query = (
        "SELECT session_id, date, (SELECT count(*) FROM Transitions AS t WHERE t.session_id = d.session_id)"
        " FROM Definitions AS d ORDER BY session_id"
    )
    with _opened(Path(path)) as (base, _):
        return [Session(*row) for row in base.execute(query)]


def read_sqlite(path: str | os.PathLike[str], session: int | None = None) -> Recording:
    """What *session* of the database *path* tells, by default the last one.

    A database that is cut off or damaged is read up to there. Raises LogError if it can't be read, is no
    such log, or has no such session.
    """
    path = Path(path)
    with _opened(path) as (base, damage):
        there = [
            number for (number,) in base.execute("SELECT session_id FROM Definitions ORDER BY session_id")
        ]
        if not there:
            raise LogError(f"{path}: this log has no session")
        number = there[-1] if session is None else session
        if number not in there:
            known = join_names(str(one) for one in there)
            raise LogError(f"{path}: this log has no session {number}; there is {known}")
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
                    what = f"status {code}" if uid in nodes else f"node {uid}"
                    damage = f"the log is damaged from the transition at {stamp} µs on: there is no {what}"
                    break
                if isinstance(extra, str) and extra.startswith(GAP_PREFIX):
                    gaps.append(Gap(len(history.changes), extra.removeprefix(GAP_PREFIX)))
                history.add(stamp * NS_PER_US, uid, STATUSES[code])
        except sqlite3.Error as error:
            damage = damage or f"the log can't be read beyond its transition {len(history.changes)}: {error}"
    start = history.changes[0].stamp if history.changes else 0
    return Recording(path, xml, start, nodes, history.changes, damage, tuple(gaps))


def _tree(
    base: sqlite3.Connection, session: int, path: Path, damage: str
) -> tuple[dict[int, RecordedNode], str]:
    """The nodes of *session*, and their XML. Raises LogError."""
    try:
        (xml,) = base.execute("SELECT xml_tree FROM Definitions WHERE session_id = ?", (session,)).fetchone()
        return parse_nodes(str(xml), str(path)), str(xml)
    except (sqlite3.Error, LogError):
        if damage:
            raise LogError(f"{path}: {damage}, and its tree was in the rest") from None
        raise


@contextmanager
def _opened(path: Path) -> Iterator[tuple[sqlite3.Connection, str]]:
    """The database *path*, for reading, and where it is cut off; what goes wrong with it is a LogError."""
    # SQLite says of whatever file it can't open only that it can't.
    head = read_bytes(path, _HEAD)
    if not head.startswith(_MAGIC):
        what = "it doesn't begin as one" if head else "it is empty"
        raise LogError(f"{path}: this isn't an SQLite database, {what}")
    missing = _missing(path, head)
    try:
        if missing:
            base = sqlite3.connect(":memory:")
        else:
            base = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        with closing(base):
            if missing:
                base.deserialize(_whole_pages(path, head))
            yield base, missing
    except sqlite3.Error as error:
        why = f"{missing}, too few to read it" if missing else f"this log can't be read: {error}"
        raise LogError(f"{path}: {why}") from None


def _missing(path: Path, head: bytes) -> str:
    """The sentence on how much of the database is missing; "" if nothing is, or a journal may have it."""
    if len(head) < _HEAD:
        raise LogError(f"{path}: this log ends in its header, after {len(head)} bytes")
    if any(path.with_name(path.name + more).exists() for more in ("-wal", "-journal")):
        return ""
    (pages,) = _NUMBER.unpack_from(head, _AT_PAGES)
    # An SQLite of before 2010 left another program's number of pages as it was.
    counted = head[_AT_CHANGES : _AT_CHANGES + 4] == head[_AT_VALID : _AT_VALID + 4]
    size, announced = path.stat().st_size, pages * _page_size(head)
    if not counted or size >= announced:
        return ""
    return f"the file is cut off: it has {size} of {announced} bytes"


def _page_size(head: bytes) -> int:
    (size,) = _PAGE_SIZE.unpack_from(head, _AT_PAGE_SIZE)
    return 65536 if size == 1 else int(size)


def _whole_pages(path: Path, head: bytes) -> bytes:
    """Return the complete pages of the database *path*, with empty pages for the rest.

    SQLite refuses a database that was cut off as a whole, though most of it may be there. Its head counts
    the pages; SQLite reads nothing from a page that is empty.
    """
    size = _page_size(head)
    data = read_bytes(path)
    there = len(data) // size if size else 0
    if not there:
        raise LogError(f"{path}: this log ends in its first page, after {len(data)} bytes")
    (announced,) = _NUMBER.unpack_from(head, _AT_PAGES)
    # A damaged head may announce more than any memory has.
    pages = min(announced, _GROWTH * (there + 1))
    whole = bytearray(data[: there * size]) + bytes((pages - there) * size)
    _NUMBER.pack_into(whole, _AT_PAGES, pages)
    # A database in memory can't have a write-ahead log.
    whole[_AT_VERSIONS : _AT_VERSIONS + 2] = b"\1\1"
    return bytes(whole)
