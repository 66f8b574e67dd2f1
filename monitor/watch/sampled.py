"""Following a robot that only speaks Groot 2's protocol: by asking for its statuses again and again.

What happens between two looks is unseen, with one exception that the wire grants: an idle node
says what it was before. So transitions are numbered by us, and ``TreeSeen.numbered`` is false.
"""

import time
from typing import Final

from monitor.picture import BlackboardSeen, Event, Picture, StatusChanged, TreeSeen
from monitor.watch.groot2 import Groot2Client
from monitor.wire.fulltree import read_fulltree
from monitor.wire.groot2 import (
    Reply,
    Request,
    StatusRecord,
    blackboard_name,
    boards_by_path,
    decode_statuses,
    encode_names,
)
from monitor.wire.values import decode_boards

STATUS_EVERY: Final = 0.05
"""Seconds (wall clock) between two looks at the statuses."""


class SampledRobot:
    """Turns a robot's answers into events. *blackboard_rate* is in Hz; 0: never."""

    def __init__(self, client: Groot2Client, blackboard_rate: float) -> None:
        self.client = client
        self.picture: Picture | None = None
        self._board_every = 1 / blackboard_rate if blackboard_rate > 0 else float("inf")
        self._records: dict[int, StatusRecord] | None = None
        self._boards: object = None
        self._started = time.monotonic_ns()
        self._number = 0
        self._next_status = 0.0
        self._next_boards = 0.0

    def forget(self) -> None:
        """Begin anew, with the tree."""
        self.picture = None
        self._records = None
        self._boards = None

    @property
    def next_at(self) -> float:
        """When the next request is due (monotonic s)."""
        if self.picture is None or self._records is None:
            return 0.0
        return min(self._next_status, self._next_boards)

    def step(self, tree_only: bool = False) -> list[Event]:
        """Take an answer in, and ask what is due next (with *tree_only* nothing but the tree); never waits.

        Raises what :meth:`Groot2Client.finish` raises.
        """
        events: list[Event] = []
        if self.client.busy:
            reply = self.client.finish()
            if reply is None:
                return events
            self._take(reply, events)
        now = time.monotonic()
        if self.picture is None:
            self.client.begin(Request.FULLTREE)
        elif tree_only:
            pass
        elif self._records is None or now >= self._next_status:
            self._next_status = now + STATUS_EVERY
            self.client.begin(Request.STATUS)
        elif now >= self._next_boards:
            self._next_boards = now + self._board_every
            main = self.picture.name
            names = [blackboard_name(path, main) for path in self.picture.subtrees]
            self.client.begin(Request.BLACKBOARD, encode_names(names))
        return events

    def _take(self, reply: Reply, events: list[Event]) -> None:
        if self.picture is None or reply.tree_id != self.picture.tree_id:
            self.forget()
            if reply.kind == Request.FULLTREE:
                self.picture = read_fulltree(reply.body, reply.tree_id)
                self._number = 0
            return
        wall = time.time_ns()
        t = time.monotonic_ns() - self._started
        if reply.kind == Request.STATUS:
            self._compare(decode_statuses(reply.body), t, wall, events)
        elif reply.kind == Request.BLACKBOARD:
            boards = boards_by_path(decode_boards(reply.body), self.picture.name)
            if boards != self._boards:
                self._boards = boards
                events.append(BlackboardSeen(t, wall, boards))

    def _compare(self, records: dict[int, StatusRecord], t: int, wall: int, events: list[Event]) -> None:
        assert self.picture is not None
        records = {uid: record for uid, record in records.items() if uid in self.picture.by_uid}
        before, self._records = self._records, records
        if before is None:
            statuses = {node.uid: 0 for node in self.picture.nodes}
            statuses |= {uid: record.status for uid, record in records.items()}
            events.append(TreeSeen(self.picture, t, wall, statuses, numbered=False))
            return
        for uid, record in records.items():
            old = before.get(uid, StatusRecord(0, 0))
            if record == old:
                continue
            steps = [record.status]
            if record.status == 0 and record.previous not in (0, old.status):
                steps = [record.previous, 0]  # it went through that between the two looks
            previous = old.status
            for status in steps:
                if status != previous:
                    self._number += 1
                    events.append(StatusChanged(self._number, t, wall, 0, uid, previous, status))
                previous = status
