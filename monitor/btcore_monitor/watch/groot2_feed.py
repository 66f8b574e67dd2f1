"""Following a robot that only speaks Groot 2's protocol, by asking it again and again.

It is asked to record its transitions, and after each look at the statuses for what it recorded; a batch that
is not in keeping with them is a hole, and is told of as one. The robot's buffer is emptied by whoever asks,
so where somebody else asks too, or the robot refuses, or ``record`` is false, only its statuses are asked
for. Then what happens between two looks is unseen, with one exception that the wire grants: an idle node
says what it was before. Either way transitions are numbered by us, and ``TreeSeen.numbered`` is false.
"""

import time
from collections.abc import Mapping
from typing import Final

from btcore_monitor.events import (
    BlackboardSeen,
    DataMissed,
    DataSource,
    Event,
    ObservedTree,
    StatusChanged,
    Topic,
    TreeSeen,
)
from btcore_monitor.watch.blackboard_poller import BlackboardPoller
from btcore_monitor.watch.groot2_client import Groot2Client
from btcore_monitor.watch.recording_validator import (
    MissingTransitionsError,
    RecordingOverflowError,
    RecordingValidator,
    RobotClock,
)
from btcore_monitor.wire.errors import RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import (
    Reply,
    Request,
    StatusRecord,
    decode_recording_start,
    decode_statuses,
    decode_transitions,
)

STATUS_EVERY: Final = 0.05
"""Seconds (wall clock) between two looks at the statuses."""

HOLES_AT_MOST: Final = 3
"""Holes in what a tree recorded after which its recording is left alone."""

_FORGIVEN_AFTER: Final = 200
"""Batches without a hole after which earlier holes don't count."""

_SOONER_FROM: Final = 400
_LATER_UNTIL: Final = 100
"""Transitions in a batch from which on, and up to which, the next one is asked for sooner, or later."""
_SOONEST: Final = 0.01
_UNSURE_BY: Final = 1_000_000_000
"""ns; beside what an answer takes, how far the robot's clock may be from what is thought here."""

NOT_SENT: Final = "not sent by Groot 2"


class Groot2Feed:
    """Turns a robot's answers into events. *blackboard_rate* is in Hz; 0: never."""

    def __init__(self, client: Groot2Client, blackboard_rate: float, record: bool = True) -> None:
        self.client = client
        self.tree: ObservedTree | None = None
        self._wants_record = self._record = record
        self._no_record = ""
        self._tree_id = ""
        self._records: dict[int, StatusRecord] | None = None
        self._looked: dict[int, StatusRecord] | None = None
        self._validator: RecordingValidator | None = None
        self._clock = RobotClock()
        self._boards = BlackboardPoller(blackboard_rate)
        self._asking: Request | None = None
        self._asked_at = 0
        self._recording_from = 0
        self._drained_at = 0
        self._unsure_by = _UNSURE_BY
        self._seen_up_to = 0
        self._is_first = True
        self._must_stop = False
        self._holes = self._whole = 0
        self._number = 0
        self._every = STATUS_EVERY
        self._next_status = 0.0

    def forget(self) -> None:
        """Begin anew, with the tree. If it is the one before, its recording is taken up where it was left."""
        self.tree = None
        self._records = None
        self._looked = None
        self._asking = None

    @property
    def following(self) -> bool:
        """Whether the robot's tree and how it stands are known."""
        return self.tree is not None and self._records is not None

    @property
    def next_at(self) -> float:
        """When the next request is due (monotonic s); an answer that is awaited comes first."""
        if self._asking is not None:
            return float("inf")
        if not self.following:
            return 0.0
        return min(self._next_status, self._boards.due)

    def step(self, tree_only: bool = False) -> list[Event]:
        """Take an answer in, and ask what is due next (with *tree_only* nothing but the tree); never waits.

        Raises what :meth:`Groot2Client.finish` raises.
        """
        events: list[Event] = []
        if self.client.busy:
            asked = self._asking
            try:
                reply = self.client.finish()
            except RobotRefusedError as error:
                self._asking = None
                if not self._goes_on_without(asked, str(error), events):
                    raise
            else:
                if reply is None:
                    return events
                self._asking = None
                self._take(reply, events)
        self._ask(tree_only)
        return events

    def leave(self) -> None:
        """Have the robot stop the recording that was begun here; nobody waits for its answer."""
        if self.tree is not None and self._validator is not None:
            self.client.part(Request.TOGGLE_RECORDING, b"stop")

    # what is asked

    def _ask(self, tree_only: bool) -> None:
        now = time.monotonic()
        if self.tree is None:
            self._begin(Request.FULLTREE)
        elif tree_only:
            pass
        elif self._must_stop:
            self._must_stop = False
            self._begin(Request.TOGGLE_RECORDING, b"stop")
        elif self._looked is not None:
            self._begin(Request.GET_TRANSITIONS)
        elif self._records is not None and self._record and self._validator is None:
            self._begin(Request.TOGGLE_RECORDING, b"start")
        elif self._records is None or self._boards.due >= self._next_status <= now:
            self._next_status = now + self._every
            self._begin(Request.STATUS)
        elif self._boards.due <= now:
            self._begin(Request.BLACKBOARD, self._boards.next_request(now))

    def _begin(self, kind: Request, body: bytes | None = None) -> None:
        self._asking = kind
        self._asked_at = self._clock.wall()
        self.client.begin(kind, body)

    # what is answered

    def _take(self, reply: Reply, events: list[Event]) -> None:
        if self.tree is None or reply.tree_id != self.tree.tree_id:
            self.forget()
            if reply.kind == Request.FULLTREE:
                self._meet(read_fulltree(reply.body, reply.tree_id))
            return
        if reply.kind == Request.STATUS:
            self._look(decode_statuses(reply.body), events)
        elif reply.kind == Request.BLACKBOARD:
            boards = self._boards.answer(reply.body)
            if boards is not None:
                wall = self._clock.wall()
                events.append(BlackboardSeen(self._clock.t(wall), wall, boards))
        elif reply.kind == Request.GET_TRANSITIONS:
            self._enter(reply.body, events)
        elif reply.kind == Request.TOGGLE_RECORDING and reply.body:
            self._start(1000 * decode_recording_start(reply.body))

    def _meet(self, tree: ObservedTree) -> None:
        self.tree = tree
        self._boards.begin(tree)
        if tree.tree_id == self._tree_id:
            return
        self._tree_id = tree.tree_id
        self._validator = None
        self._record = self._wants_record
        self._no_record = "" if self._record else "--no-record"
        self._must_stop = False
        self._is_first = True
        self._holes = self._whole = self._number = self._seen_up_to = 0
        self._every = STATUS_EVERY
        self._clock.begin(self._clock.wall())

    def _look(self, looked: dict[int, StatusRecord], events: list[Event]) -> None:
        assert self.tree is not None
        looked = {uid: record for uid, record in looked.items() if uid in self.tree.by_uid}
        before, self._records = self._records, looked
        if self._validator is not None:
            self._looked = looked
        elif before is not None:
            self._compare(before, looked, events)
        elif not self._record:
            self._show(self._clock.wall(), looked, events)

    def _start(self, wall: int) -> None:
        """The robot records from *wall* (its clock) on. The tree is shown when the first batch is there."""
        assert self._records is not None
        answered_at = self._clock.wall()
        self._clock.set(wall, (self._asked_at + answered_at) // 2)
        self._unsure_by = _UNSURE_BY + answered_at - self._asked_at
        if self._is_first:
            self._clock.begin(wall)
        self._recording_from = self._drained_at = wall
        self._validator = RecordingValidator(self._records)
        self._next_status = 0.0

    def _show(self, wall: int, records: Mapping[int, StatusRecord], events: list[Event]) -> None:
        assert self.tree is not None
        statuses = {node.uid: 0 for node in self.tree.nodes}
        statuses |= {uid: record.status for uid, record in records.items()}
        self._seen_up_to = self._clock.t(wall)
        events.append(
            TreeSeen(self.tree, self._seen_up_to, wall, statuses, numbered=False, source=self._source())
        )

    def _source(self) -> DataSource:
        rate = self._boards.rate
        polled = f"asked for {rate:g} times a second" if rate else "not asked for"
        lacks: dict[Topic, str] = {
            "ticks": NOT_SENT,
            "exceptions": NOT_SENT,
            "blackboard": f"{polled}: changes between are unseen",
        }
        if self._validator is not None:
            return DataSource("Groot 2, recorded", lacks)
        why = f" ({self._no_record})" if self._no_record else ""
        lacks["transitions"] = (
            f"statuses are asked for {1 / STATUS_EVERY:g} times a second{why}: changes between are unseen"
        )
        return DataSource("Groot 2, sampled", lacks)

    # what changed

    def _compare(
        self, before: Mapping[int, StatusRecord], looked: Mapping[int, StatusRecord], events: list[Event]
    ) -> None:
        wall = self._clock.wall()
        for uid, record in looked.items():
            old = before.get(uid, StatusRecord(0, 0))
            if record == old:
                continue
            steps = [record.status]
            if record.status == 0 and record.previous not in (0, old.status):
                steps = [record.previous, 0]  # it went through that between the two looks
            previous = old.status
            for status in steps:
                if status != previous:
                    self._report(wall, uid, previous, status, events)
                previous = status

    def _report(self, wall: int, uid: int, previous: int, status: int, events: list[Event]) -> None:
        self._number += 1
        self._seen_up_to = max(self._seen_up_to, self._clock.t(wall))
        events.append(StatusChanged(self._number, self._seen_up_to, wall, 0, uid, previous, status))

    def _enter(self, body: bytes, events: list[Event]) -> None:
        """Take in what the robot recorded since it was asked last."""
        assert self._validator is not None
        assert self._looked is not None
        looked, self._looked = self._looked, None
        batch = decode_transitions(body)
        drained_at, self._drained_at = self._drained_at, self._asked_at
        if batch and self._recording_from + 1000 * batch[0].offset < drained_at - self._unsure_by:
            self._leave(looked, "somebody else began a recording of this robot, or its clock was set", events)
            return
        before = self._validator.statuses
        try:
            steps = self._validator.enter(looked, batch)
        except MissingTransitionsError as hole:
            self._miss(hole, events)
        else:
            if self._is_first:
                self._show(self._recording_from, before, events)
            for one, previous in steps:
                wall = self._recording_from + 1000 * one.offset
                self._report(wall, one.uid, previous, one.status, events)
            self._whole += bool(steps)
            if self._whole >= _FORGIVEN_AFTER:
                self._holes = self._whole = 0
        self._is_first = False
        if len(batch) >= _SOONER_FROM:
            self._every = max(_SOONEST, self._every / 2)
        elif len(batch) <= _LATER_UNTIL:
            self._every = min(STATUS_EVERY, self._every * 2)

    def _miss(self, hole: MissingTransitionsError, events: list[Event]) -> None:
        assert self._validator is not None
        if self._is_first:  # nothing was said yet
            self._show(self._asked_at, self._validator.statuses, events)
            return
        self._holes += 1
        self._whole = 0
        if self._holes < HOLES_AT_MOST:
            self._tell_of_hole(str(hole), events)
            self._show(self._asked_at, self._validator.statuses, events)
        elif isinstance(hole, RecordingOverflowError):
            self._must_stop = True
            self._leave(self._validator.statuses, f"{hole}: it changes faster than it can be asked", events)
        else:
            self._leave(self._validator.statuses, "somebody else reads this robot's recording too", events)

    def _leave(self, records: dict[int, StatusRecord], why: str, events: list[Event]) -> None:
        """Leave the recording alone from now on."""
        self._tell_of_hole(why, events)
        self._record = False
        self._no_record = why
        self._validator = None
        self._records = records
        self._show(self._asked_at, records, events)

    def _tell_of_hole(self, why: str, events: list[Event]) -> None:
        if self._is_first:
            return
        wall = self._asked_at
        events.append(DataMissed(self._clock.t(wall), wall, self._seen_up_to, "transitions", why))

    def _goes_on_without(self, asked: Request | None, why: str, events: list[Event]) -> bool:
        """Do without what the robot refused; false if that can't be."""
        if asked is Request.BLACKBOARD:
            wall = self._clock.wall()
            t = self._clock.t(wall)
            names = self._boards.refused()
            events.extend(
                DataMissed(t, wall, t, "blackboard", f"{name} isn't shown: {why}") for name in names
            )
        elif asked in (Request.TOGGLE_RECORDING, Request.GET_TRANSITIONS) and self._records is not None:
            self._record = False
            self._validator = self._looked = None
            self._no_record = why
            self._show(self._clock.wall(), self._records, events)
        else:
            return False
        return True
