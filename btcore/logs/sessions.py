"""Reading the sessions of a ``.db3`` (groot2.md §12).

A database that was cut off is refused by SQLite as a whole, though most of it may be there. Its head says
how many pages there should be (https://www.sqlite.org/fileformat.html), so those that are not whole are
made empty, and the rest is read as far as it goes: an empty page is none that SQLite reads anything from.
"""

import os
import sqlite3
import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Final, NamedTuple

from btcore.logs.database import GAP_PREFIX
from btcore.logs.files import LogError, read_bytes
from btcore.logs.recording import (
    STATUSES,
    Gap,
    RecordedNode,
    Recording,
    TransitionCollector,
    parse_nodes,
)
from btcore.logs.sqlite import NS_PER_US
from btcore.suggestions import join_names

_MAGIC: Final = b"SQLite format 3\0"
_HEAD: Final = 100
_PAGE_SIZE: Final = struct.Struct(">H")
_NUMBER: Final = struct.Struct(">I")
# Where in the head they are.
_AT_PAGE_SIZE, _AT_VERSIONS, _AT_CHANGES, _AT_PAGES, _AT_VALID = 16, 18, 24, 28, 92
_GROWTH: Final = 64


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
    """What is whole of the database *path*, with empty pages for the rest."""
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
