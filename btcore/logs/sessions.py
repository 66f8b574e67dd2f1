"""Reading the sessions of a ``.db3`` (groot2.md §12)."""

import os
import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import NamedTuple

from btcore.logs.files import LogFault, contents
from btcore.logs.recording import STATUSES, History, Recording, nodes_of
from btcore.logs.sqlite import NS_PER_US
from btcore.suggest import listing


class Session(NamedTuple):
    """One run in a database; *date* is when it began, in local time (``2026-01-31 12:00:00``)."""

    number: int
    date: str
    transitions: int


def sessions(path: str | os.PathLike[str]) -> list[Session]:
    """The sessions of the database *path*, the oldest first. Raises LogFault if it is no such log."""
    query = (
        "SELECT session_id, date, (SELECT count(*) FROM Transitions AS t WHERE t.session_id = d.session_id)"
        " FROM Definitions AS d ORDER BY session_id"
    )
    with _opened(Path(path)) as base:
        return [Session(*row) for row in base.execute(query)]


def read_sqlite(path: str | os.PathLike[str], session: int | None = None) -> Recording:
    """What *session* of the database *path* tells, by default the last one.

    Raises LogFault if it can't be read, is no such log, or has no such session.
    """
    path = Path(path)
    with _opened(path) as base:
        known: dict[int, str] = dict(
            base.execute("SELECT session_id, xml_tree FROM Definitions ORDER BY session_id")
        )
        if not known:
            raise LogFault(f"{path}: this log has no session")
        number = max(known) if session is None else session
        if number not in known:
            there = listing(str(one) for one in known)
            raise LogFault(f"{path}: this log has no session {number}; there is {there}")
        nodes = nodes_of(known[number], str(path))
        rows = base.execute(
            "SELECT timestamp, node_uid, state FROM Transitions WHERE session_id = ? ORDER BY timestamp",
            (number,),
        )
        history = History()
        damage = ""
        for stamp, uid, code in rows:
            if uid not in nodes or code not in STATUSES:
                what = f"status {code}" if uid in nodes else f"node {uid}"
                damage = f"the log is damaged from the transition at {stamp} µs on: there is no {what}"
                break
            history.add(stamp * NS_PER_US, uid, STATUSES[code])
    start = history.changes[0].stamp if history.changes else 0
    return Recording(path, known[number], start, nodes, history.changes, damage)


@contextmanager
def _opened(path: Path) -> Iterator[sqlite3.Connection]:
    """The database *path*, for reading; what goes wrong with it is a LogFault."""
    # SQLite says of whatever file it can't open only that it can't.
    contents(path, 1)
    try:
        base = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)
        with closing(base):
            yield base
    except sqlite3.Error as error:
        raise LogFault(f"{path}: this log can't be read: {error}") from None
