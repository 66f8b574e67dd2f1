"""Write a robot's events to log files: `.btlog`, SQLite, and bags of ROS 2.

The log has the XML that the robot sent. A stamp is the wall time of the first event plus the time of the
tree's clock since then, as in btcore's own logs. Missing transitions are marked (`btcore.logs.Gap`),
and the changed statuses after a gap are written as transitions at that moment.
"""

import sqlite3
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

from btcore.clock import NS_PER_US
from btcore.logs.btlog import EXTENSION as BTLOG
from btcore.logs.btlog import BtLogWriter
from btcore.output_files import numbered_file
from btcore.status import Status
from btcore_bags.log import EXTENSION as BAG
from btcore_bags.log import BagWriter
from btcore_monitor.events import (
    ConnectionEvent,
    Event,
    LostTransitionsEvent,
    MissingDataEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.logs.sqlite import EXTENSIONS as SQLITE
from btcore_monitor.logs.sqlite import SqliteWriter
from btcore_monitor.wire.fulltree import write_fulltree

LOGS: Final = (BTLOG, *SQLITE, BAG)
"""The extensions of files that a log writer can write."""

_LATEST: Final = (1 << 48) - 1
"""The largest time in a log, in µs since its start."""

_Writer = BtLogWriter | BagWriter | SqliteWriter


class LogWriter:
    """Writes the log files *paths* of one robot.

    A robot's second tree gets files with a number: `run.2.btlog`. All methods raise LogError, OSError or
    sqlite3.Error if a file cannot be written.
    """

    def __init__(self, paths: Sequence[Path]) -> None:
        self.paths = paths
        self.files: list[Path] = []
        """The files that were written."""
        self.transitions = 0
        """The number of written transitions of all trees."""
        self.gaps = 0
        """The number of gaps. Transitions that the robot never sends do not count."""
        self._trees = 0
        self._tree_id = ""
        self._writers: list[_Writer] = []
        self._rows: list[tuple[int, int, Status, Status]] = []
        self._statuses: dict[int, int] = {}
        self._start = 0
        self._next: int | None = None
        self._lost = self._incomplete = ""

    def process_event(self, event: Event) -> None:
        """Process an event. Its transitions are written to the files by `flush`."""
        if isinstance(event, TreeEvent):
            self._begin(event)
        elif isinstance(event, TransitionEvent):
            self._write_change(event)
        elif isinstance(event, LostTransitionsEvent):
            self._write_gap(f"the transitions {event.first} to {event.last} are lost")
        elif isinstance(event, MissingDataEvent) and event.kind == "transitions":
            self._incomplete = event.reason
        elif isinstance(event, ConnectionEvent) and event.state == "lost":
            self._lost = f"the robot was away: {event.detail}"

    def flush(self) -> None:
        """Write the remaining transitions to the files."""
        rows, self._rows = self._rows, []
        if rows:
            for writer in self._writers:
                writer.append(rows)

    def close(self) -> None:
        """Write the remaining transitions and close the files."""
        try:
            self.flush()
            for writer in self._writers:
                writer.finish()
        finally:
            for writer in self._writers:
                writer.close()
            self._writers.clear()

    def _begin(self, event: TreeEvent) -> None:
        if event.tree.tree_id == self._tree_id:
            self._write_gap(self._incomplete or self._lost or "the robot was away")
        else:
            self._open(event)
            if "transitions" in event.source.unavailable:
                self._write_gap(event.source.unavailable["transitions"], known=True)
            if any(event.statuses.values()):
                self._write_gap("the tree was running before the recording began")
        self._lost = self._incomplete = ""
        self._update(event.stamp, event.statuses)

    def _open(self, event: TreeEvent) -> None:
        self.close()
        self._tree_id = event.tree.tree_id
        self._start, self._next = event.stamp, 1 if event.has_transition_numbers else None
        self._statuses = dict.fromkeys(event.tree.by_uid, 0)
        self._trees += 1
        for path in self.paths:
            file = numbered_file(path, self._trees)
            self._writers.append(_open_writer(file, event))
            self.files.append(file)

    def _write_change(self, event: TransitionEvent) -> None:
        if event.uid not in self._statuses:
            return
        if self._next is not None and event.number > self._next:
            # The robot's history no longer holds its first transitions.
            self._write_gap(f"the transitions up to {event.number - 1} were before the recording")
        if self._incomplete:
            self._write_gap(self._incomplete)
            self._incomplete = ""
        self._next = None
        # The previous status differs from the known status after a gap.
        self._update(event.stamp, {event.uid: event.previous})
        self._write(event.stamp, event.uid, event.previous, event.status)

    def _update(self, stamp: int, statuses: Mapping[int, int]) -> None:
        """Write a transition for each node whose known status differs from its status in *statuses*."""
        for uid, status in statuses.items():
            before = self._statuses.get(uid, status)
            if before != status:
                self._write(stamp, uid, before, status)

    def _write(self, stamp: int, uid: int, previous: int, status: int) -> None:
        # A log's times must not be negative, even if a robot's clock goes back, and have 48 bits in a .btlog.
        since = min(max(0, stamp - self._start) // NS_PER_US, _LATEST)
        self._statuses[uid] = status
        self.transitions += 1
        self._rows.append((since, uid, Status(previous), Status(status)))

    def _write_gap(self, reason: str, *, known: bool = False) -> None:
        """Mark a gap for *reason*. A gap that is *known* from the beginning is not counted."""
        self.gaps += not known
        self.flush()
        for writer in self._writers:
            writer.gap(reason)


def _open_writer(path: Path, event: TreeEvent) -> _Writer:
    nodes, xml, start = event.tree.nodes, write_fulltree(event.tree), event.wall // NS_PER_US
    if path.suffix == BTLOG:
        return BtLogWriter(path, xml, start)
    if path.suffix == BAG:
        return BagWriter(path, xml, {node.uid: node.name for node in nodes}, start)
    writer = SqliteWriter(path, xml.decode("utf-8", "replace"), [(node.path, node.uid) for node in nodes])
    writer.begin_at(start)
    return writer


WRITE_ERRORS: Final = (OSError, sqlite3.Error)
"""The exceptions that are raised if a file becomes unwritable, for example because the disk is full."""
