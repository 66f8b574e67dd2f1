"""Following a robot that speaks Groot 1's protocol: BehaviorTree.CPP 3's, or ours.

It publishes every transition with its time, some 25 times a second, and before them how all nodes stood
at the end of the update before. So what gets lost on the way shows, though not how much it was. The tree
is asked for at first, when a node is heard of that isn't in it, and after a silence, to see whether the
robot is there.
"""

import time
import uuid
from collections import deque
from typing import Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from btcore_monitor.events import (
    IDLE,
    DataMissed,
    DataSource,
    Event,
    StatusChanged,
    TreeSeen,
)
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.protocol_detection import groot1_tree_in
from btcore_monitor.watch.request_client import NoReplyError, RequestClient, Socket
from btcore_monitor.wire.errors import ProtocolError, describe_bytes
from btcore_monitor.wire.groot1 import (
    QUESTION,
    Update,
    WireChange,
    decode_update,
)
from btcore_monitor.wire.groot1_conversion import Groot1ObservedTree, read_groot1
from btcore_monitor.wire.groot1_tree import WireTree

PROBE_AFTER: Final = 3.0
"""Seconds (wall clock) without an update after which the robot is asked whether it is there."""

FIRST_UPDATE: Final = 0.15
"""Seconds that an update has to come before a tree is shown with the statuses that it came with.

BehaviorTree.CPP answers with those that the nodes had at its start, so an update, if one comes, is better.
"""

NOT_SENT: Final = "not sent by Groot 1"
GROOT1: Final = DataSource(
    "Groot 1",
    {
        "ticks": NOT_SENT,
        "exceptions": NOT_SENT,
        "blackboard": NOT_SENT,
    },
)
"""What this protocol tells, and what not."""

_ASK_AGAIN_AFTER: Final = 0.2
_WAITING_AT_MOST: Final = 250
_UPDATES_A_TURN: Final = 50
_UPDATE_AT_MOST: Final = 16 << 20
_RECONNECT_MS: Final = 100
_FUTURE_NS: Final = 5_000_000_000
"""So far (ns) an update may be ahead of its time: the first one may have been on its way that long."""


class Groot1Feed:
    """Turns a robot's updates into events; use it from one thread.

    Transitions are numbered here, so ``TreeSeen.numbered`` is false. Where an update doesn't begin as the
    one before ended, a DataMissed says that some are missing, and a TreeSeen with the same tree id how the
    nodes stand. A robot that was disconnected has started anew. *patience* (s) is what an answer may take.
    """

    def __init__(self, address: Address, patience: float = 0.0) -> None:
        self.address = address
        self._client = RequestClient(address, patience=patience)
        self._context: zmq.Context[Socket] = zmq.Context()
        self._news = self._context.socket(zmq.SUB)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.MAXMSGSIZE, _UPDATE_AT_MOST),
            (zmq.RECONNECT_IVL, _RECONNECT_MS),
            (zmq.RECONNECT_IVL_MAX, 10 * _RECONNECT_MS),
        ):
            self._news.setsockopt(option, value)
        self._news.subscribe(b"")
        self._links = self._news.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED)
        self._news.connect(address.published())
        self._tree: WireTree | None = None
        self._seen: Groot1ObservedTree | None = None
        self._linked = False
        self._asked_at = 0.0
        self._shown_from = 0.0
        self._must_ask = True
        self._started_anew = False
        self._waiting: deque[Update] = deque(maxlen=_WAITING_AT_MOST)
        self._shown = False
        self._sure = False
        self._statuses: dict[int, int] = {}
        self._number = 0
        self._began = time.monotonic_ns()
        self._ahead = 0
        self._stamp = 0
        self._told_up_to = 0
        self._t = 0
        self.alive_at = 0.0
        """When something came last (monotonic s); 0: never."""
        self._silent_since = 0.0

    def __str__(self) -> str:
        said = f"{self.address}, by Groot 1's protocol"
        if not self._linked:
            said += (
                f", and nothing is published at {self.address.published()}: if that is elsewhere, "
                f"write {self.address.at()}/PORT"
            )
        return said

    @property
    def is_back(self) -> bool:
        """Whether a tree that was shown is heard of again, after a silence."""
        return self._shown and self._silent_since < self.alive_at

    @property
    def sockets(self) -> list[Socket]:
        """Those of now, for a poller."""
        return [self._news, self._links, *([self._client.socket] if self._client.busy else [])]

    def step(self) -> list[Event]:
        """Take in what came, and ask what is due; never waits.

        Raises :class:`~btcore_monitor.watch.request_client.NoReplyError` if the robot is silent (go on
        stepping: it may come
        back) and :class:`ProtocolError` if what is there speaks otherwise.
        """
        events: list[Event] = []
        self._hear()
        self._advance(events)
        self._look_at_links()
        self._ask()
        self._advance(events)
        return events

    def close(self) -> None:
        """Free the sockets."""
        self._news.disable_monitor()
        self._links.close(linger=0)
        self._news.close()
        self._client.close()
        self._context.term()

    # what comes

    def _look_at_links(self) -> None:
        while self._links.poll(0):
            event = parse_monitor_message(self._links.recv_multipart())["event"]
            # Who is no publisher is disconnected too, again and again.
            if event == zmq.EVENT_DISCONNECTED and self._linked:
                self._started_anew = self._must_ask = True
                self._asked_at = 0.0
                self._waiting.clear()
            self._linked = event == zmq.EVENT_HANDSHAKE_SUCCEEDED

    def _hear(self) -> None:
        for _ in range(_UPDATES_A_TURN):
            try:
                frame = self._news.recv(zmq.DONTWAIT)
            except zmq.Again:
                return
            self._waiting.append(decode_update(frame))
            self.alive_at = time.monotonic()

    def _ask(self) -> None:
        try:
            frames = self._client.finish()
        except NoReplyError:
            self._must_ask = True
            if self._shown and time.monotonic() - self.alive_at < PROBE_AFTER:
                return  # it is there, since it publishes
            self._sure = False
            self._silent_since = time.monotonic()
            raise
        now = time.monotonic()
        if frames is not None:
            self._take(frames, now)
        silent = now - max(self.alive_at, self._asked_at) >= PROBE_AFTER
        if not self._client.busy and (silent or self._must_ask) and now - self._asked_at >= _ASK_AGAIN_AFTER:
            self._asked_at = now
            self._client.begin(QUESTION)

    def _take(self, frames: list[bytes], now: float) -> None:
        tree = groot1_tree_in(frames)
        if tree is None:
            what = describe_bytes(frames[0]) if len(frames) == 1 else f"{len(frames)} frames"
            raise ProtocolError(f"expected a tree in Groot 1's protocol from {self.address}, and got {what}")
        self.alive_at = now
        self._must_ask = False
        shape = tree._replace(nodes=tuple(node._replace(status=IDLE) for node in tree.nodes))
        if shape == self._tree and not self._started_anew:
            self._drop_unknown()
            return
        self._seen = read_groot1(tree, uuid.uuid4().hex)
        self._tree = shape
        self._shown = self._sure = self._started_anew = False
        self._shown_from = now + FIRST_UPDATE
        self._number = 0
        self._drop_unknown()

    def _drop_unknown(self) -> None:
        """Forget the updates that are not about the tree; they are about another one, or about nothing."""
        self._waiting = deque(filter(self._known, self._waiting), maxlen=_WAITING_AT_MOST)

    # what it says

    def _advance(self, events: list[Event]) -> None:
        if self._seen is None or self._started_anew:
            return
        if not self._shown and (self._waiting or time.monotonic() >= self._shown_from):
            self._show(events)
        while self._waiting and self._shown:
            if not self._known(self._waiting[0]):
                self._must_ask = True
                return
            self._apply(self._waiting.popleft(), events)

    def _show(self, events: list[Event]) -> None:
        """Let the tree be seen, as the first update says that it stood, or else the tree itself."""
        assert self._seen is not None
        self._statuses = dict(self._seen.statuses)
        wall = time.time_ns()
        if self._waiting and self._known(self._waiting[0]):
            update = self._waiting[0]
            self._statuses |= self._translated(update)
            self._sure = True
            if update.changes:
                self._compare_clocks(update)
                wall = update.changes[0].stamp
                events.append(self._tree_seen(self._time(wall), wall))
                return
        self._t = max(self._t, self._now())
        events.append(self._tree_seen(self._t, wall))

    def _tree_seen(self, t: int, wall: int) -> TreeSeen:
        assert self._seen is not None
        self._shown = True
        self._told_up_to = t
        return TreeSeen(self._seen.tree, t, wall, dict(self._statuses), numbered=False, source=GROOT1)

    def _known(self, update: Update) -> bool:
        assert self._seen is not None
        uids = self._seen.uids
        return update.statuses.keys() <= uids.keys() and all(one.uid in uids for one in update.changes)

    def _translated(self, update: Update) -> dict[int, int]:
        assert self._seen is not None
        return {self._seen.uids[uid]: status for uid, status in update.statuses.items()}

    def _apply(self, update: Update, events: list[Event]) -> None:
        if not update.changes:
            return
        self._compare_clocks(update)
        first = update.changes[0].stamp
        self._compare(self._translated(update), self._time(first), first, events)
        for change in update.changes:
            self._change(change, events)

    def _compare(self, said: dict[int, int], t: int, wall: int, events: list[Event]) -> None:
        """See whether what the robot *said* is what is known, and correct that."""
        other = {uid: status for uid, status in said.items() if self._statuses[uid] != status}
        if self._sure and not any(other.values()):
            # A robot may be told not to publish transitions to IDLE.
            for uid in other:
                self._report(uid, IDLE, t, wall, events)
        elif other:
            if self._sure:
                events.append(self._unseen(t, wall))
            self._statuses |= other
            events.append(self._tree_seen(t, wall))
        self._sure = True

    def _change(self, change: WireChange, events: list[Event]) -> None:
        assert self._seen is not None
        uid, t = self._seen.uids[change.uid], self._time(change.stamp)
        if change.previous != self._statuses[uid]:
            if change.previous != IDLE:
                events.append(self._unseen(t, change.stamp))
            self._report(uid, change.previous, t, change.stamp, events)
        if change.status != change.previous:
            self._report(uid, change.status, t, change.stamp, events)

    def _report(self, uid: int, status: int, t: int, wall: int, events: list[Event]) -> None:
        self._number += 1
        previous, self._statuses[uid] = self._statuses[uid], status
        self._told_up_to = t
        events.append(StatusChanged(self._number, t, wall, 0, uid, previous, status))

    def _unseen(self, t: int, wall: int) -> DataMissed:
        return DataMissed(
            t, wall, self._told_up_to, "transitions", "updates of the robot got lost on the way"
        )

    def _now(self) -> int:
        return time.monotonic_ns() - self._began

    def _compare_clocks(self, update: Update) -> None:
        """See how far the robot's wall clock is ahead of the time since the first thing seen.

        Once is enough, unless it was set: then it goes back, or tells of what can't have been yet.
        """
        first, last = update.changes[0].stamp, update.changes[-1].stamp
        now = self._now()
        if first < self._stamp or last - self._ahead - now > _FUTURE_NS or not self._stamp:
            self._ahead = last - now
        self._stamp = last

    def _time(self, stamp: int) -> int:
        """*stamp*, of the robot's wall clock, as time since the first thing seen; it never goes back."""
        self._t = max(self._t, stamp - self._ahead)
        return self._t
