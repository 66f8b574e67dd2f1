"""What a robot tells, written into log files: ``.btlog`` and SQLite, as BehaviorTree.CPP writes them.

The tree's XML is the robot's own. Stamps are the wall time when the tree was met plus the tree clock's
time since, as in the logs that btcore writes in a run. What is missing is marked (:class:`btcore.logs.Gap`),
and how the nodes are found after it is written as changes at that moment.
"""

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

from btcore.clock import NS_PER_US
from btcore.logs.btlog import EXTENSION as BTLOG
from btcore.logs.btlog import BtLogWriter
from btcore.logs.sqlite import EXTENSIONS as SQLITE
from btcore.logs.sqlite import GAP_PREFIX, SqliteWriter
from btcore.status import Status
from btcore_monitor.events import (
    ConnectionChanged,
    DataMissed,
    Event,
    StatusChanged,
    TransitionsLost,
    TreeSeen,
)
from btcore_monitor.wire.fulltree import write_fulltree

LOGS: Final = (BTLOG, *SQLITE)
"""The files that a log writer writes, by extension."""


class LogWriter:
    """The log files at *paths* of one robot. Another tree gets files with the next number: ``run.2.btlog``.

    Raises LogError, OSError or sqlite3.Error if they can't be written.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = paths
        self.files: list[Path] = []
        """What was written."""
        self.transitions = 0
        """How many changes were written of all trees."""
        self.gaps = 0
        """How often something was missing."""
        self._trees = 0
        self._tree_id = ""
        self._logs: list[_Log] = []
        self._statuses: dict[int, int] = {}
        self._start = 0
        self._next: int | None = None
        self._lost = self._unseen = ""

    def show(self, event: Event) -> None:
        """Take in one event; what belongs into a log is written by :meth:`flush`."""
        if isinstance(event, TreeSeen):
            self._seen(event)
        elif isinstance(event, StatusChanged):
            self._changed(event)
        elif isinstance(event, TransitionsLost):
            self._missing(f"the transitions {event.first} to {event.last} are lost")
        elif isinstance(event, DataMissed) and event.topic == "transitions":
            self._unseen = event.reason
        elif isinstance(event, ConnectionChanged) and event.state == "lost":
            self._lost = f"the robot was away: {event.detail}"

    def flush(self) -> None:
        """Write what isn't written yet."""
        for log in self._logs:
            log.flush()

    def close(self) -> None:
        """Write the rest, and let go of the files."""
        logs, self._logs = self._logs, []
        for log in logs:
            log.close()

    def _seen(self, event: TreeSeen) -> None:
        if event.tree.tree_id == self._tree_id:
            self._missing(self._unseen or self._lost or "the robot was away")
        else:
            self._open(event)
            if "transitions" in event.source.unavailable:
                self._missing(event.source.unavailable["transitions"], known=True)
            if any(event.statuses.values()):
                self._missing("the tree was running before the recording began")
        self._lost = self._unseen = ""
        self._find(event.t, event.statuses)

    def _open(self, event: TreeSeen) -> None:
        self.close()
        self._tree_id = event.tree.tree_id
        self._start, self._next = event.t, 1 if event.numbered else None
        self._statuses = dict.fromkeys(event.tree.by_uid, 0)
        self._trees += 1
        for path in self.paths:
            if self._trees > 1:
                path = path.with_name(f"{path.stem}.{self._trees}{path.suffix}")
            made = _BtLog(path, event) if path.suffix == BTLOG else _Sqlite(path, event)
            self._logs.append(made)
            self.files.append(path)

    def _changed(self, event: StatusChanged) -> None:
        if event.uid not in self._statuses:
            return
        if self._next is not None and event.number > self._next:
            # The robot's memory does not reach back to its first transition.
            self._missing(f"the transitions up to {event.number - 1} were before the recording")
        if self._unseen:
            self._missing(self._unseen)
            self._unseen = ""
        self._next = None
        self._find(event.t, {event.uid: event.previous})
        self._write(event.t, event.uid, event.previous, event.status)

    def _find(self, t: int, statuses: Mapping[int, int]) -> None:
        """Write how nodes are found, where nothing told of the change."""
        for uid, status in statuses.items():
            before = self._statuses.get(uid, status)
            if before != status:
                self._write(t, uid, before, status)

    def _write(self, t: int, uid: int, previous: int, status: int) -> None:
        since = max(0, t - self._start) // NS_PER_US
        self._statuses[uid] = status
        self.transitions += 1
        for log in self._logs:
            log.add(since, uid, Status(previous), Status(status))

    def _missing(self, said: str, *, known: bool = False) -> None:
        """Mark a gap; one that is *known* from the beginning isn't counted."""
        self.gaps += not known
        for log in self._logs:
            log.gap(said)


class _Log(Protocol):
    """One file of one tree."""

    def add(self, since: int, uid: int, previous: Status, status: Status) -> None: ...
    def gap(self, said: str) -> None: ...
    def flush(self) -> None: ...
    def close(self) -> None: ...


class _BtLog:
    def __init__(self, path: Path, event: TreeSeen) -> None:
        self._file = BtLogWriter(path, write_fulltree(event.tree), event.wall // NS_PER_US)
        self._rows: list[tuple[int, int, int]] = []

    def add(self, since: int, uid: int, previous: Status, status: Status) -> None:
        self._rows.append((since, uid, status))

    def gap(self, said: str) -> None:
        self.flush()
        self._file.gap(said)

    def flush(self) -> None:
        rows, self._rows = self._rows, []
        if rows:
            self._file.append(rows)

    def close(self) -> None:
        try:
            self.flush()
        finally:
            self._file.close()


class _Sqlite:
    def __init__(self, path: Path, event: TreeSeen) -> None:
        tree = event.tree
        xml = write_fulltree(tree).decode("utf-8", "replace")
        self._base = SqliteWriter(path, xml, [(node.path, node.uid) for node in tree.nodes])
        self._base.begin_at(event.wall // NS_PER_US)
        self._said: list[str] = []

    def add(self, since: int, uid: int, previous: Status, status: Status) -> None:
        extra = GAP_PREFIX + "; ".join(self._said) if self._said else ""
        self._said.clear()
        self._base.add(since, uid, previous, status, extra)

    def gap(self, said: str) -> None:
        self._said.append(said)

    def flush(self) -> None:
        self._base.flush()

    def close(self) -> None:
        try:
            self._base.finish()
        finally:
            self._base.close()


WRITE_ERRORS: Final = (OSError, sqlite3.Error)
"""What writing raises when a file can't be written any more."""
