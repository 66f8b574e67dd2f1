"""Follow a robot with Groot 1's protocol: a robot with BehaviorTree.CPP 3 or btcore.

The robot publishes all transitions with their times, at most 25 times per second, together with the statuses
of all nodes at the end of the previous update. So the feed detects lost updates, but not their number. It
requests the tree at the beginning, when an update has an unknown node, and after some time without updates,
to check whether the robot is still there.
"""

import time
import uuid
from collections import deque
from typing import Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from btcore_monitor.events import IDLE, DataSource, Event, MissingDataEvent, TransitionEvent, TreeEvent
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.request_client import NoReplyError, RequestClient, Socket
from btcore_monitor.wire.errors import ProtocolError, describe_bytes
from btcore_monitor.wire.groot1 import QUESTION, Update, WireTransition, decode_update
from btcore_monitor.wire.groot1_tree import Groot1ObservedTree, WireTree, find_tree, read_groot1

PROBE_AFTER_S: Final = 3.0
"""Seconds (wall clock) without an update after which a request checks whether the robot is there."""

FIRST_UPDATE: Final = 0.15
"""Seconds that the feed waits for an update before it shows a tree with the statuses of the reply.

BehaviorTree.CPP replies with the statuses at its start, so the statuses of an update are better.
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
"""The data source of this feed, with the topics that Groot 1's protocol does not send."""

_RETRY_AFTER_S: Final = 0.2
_MAX_WAITING: Final = 250
_MAX_UPDATES_PER_STEP: Final = 10
_MAX_UPDATE: Final = 1 << 20
"""Maximum bytes of an update: the statuses of 65,535 nodes and 70,000 transitions."""
_RECONNECT_MS: Final = 100
_FUTURE_NS: Final = 5_000_000_000
"""Maximum time (ns) by which an update may be ahead of the estimate of the robot's clock.

The first update, from which the clock is estimated, may have been delayed that long.
"""


class Groot1Feed:
    """Converts a robot's updates to events. Use it from one thread.

    The feed numbers the transitions itself, so `TreeEvent.has_transition_numbers` is false. If an update does
    not begin with the statuses at the end of the previous update, a MissingDataEvent and a TreeEvent with the
    current statuses follow. A disconnection counts as a restart.

    Args:
        address: The robot's address.
        max_timeout: Maximum time for a reply, in s (wall clock).
        keys: The keys of the client, if the robot requires keys.
    """

    def __init__(self, address: Address, max_timeout: float = 0.0, keys: ClientKeys | None = None) -> None:
        self.address = address
        self._client = RequestClient(address, max_timeout=max_timeout, keys=keys)
        self._context: zmq.Context[Socket] = zmq.Context()
        self._update_socket = self._context.socket(zmq.SUB)
        # ZeroMQ doubles the time between attempts to connect, up to the maximum.
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.MAXMSGSIZE, _MAX_UPDATE),
            (zmq.RECONNECT_IVL, _RECONNECT_MS),
            (zmq.RECONNECT_IVL_MAX, 10 * _RECONNECT_MS),
        ):
            self._update_socket.setsockopt(option, value)
        if keys is not None:
            keys.secure(self._update_socket)
        # Everything: updates have no topic, their first bytes are a size.
        self._update_socket.subscribe(b"")
        self._events: list[Event] = []  # those of the present step
        self._connection_events = self._update_socket.get_monitor_socket(
            zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED
        )
        self._update_socket.connect(address.published())
        self._tree: WireTree | None = None
        self._observed: Groot1ObservedTree | None = None
        self._is_connected = False
        self._requested_at = 0.0
        self._report_tree_at = 0.0
        self._needs_tree = True
        self._has_restarted = False
        self._waiting_updates: deque[Update] = deque(maxlen=_MAX_WAITING)
        self._is_tree_reported = False
        self._is_certain = False
        self._statuses: dict[int, int] = {}
        self._last_number = 0
        self._start = time.monotonic_ns()
        self._clock_offset = 0
        self._last_wall = 0
        self._reported_up_to = 0
        self._last_stamp = 0
        self.last_message_at = 0.0
        """When the last update or reply arrived (monotonic s); 0: never."""
        self._silent_since = 0.0

    def __str__(self) -> str:
        description = f"{self.address}, by Groot 1's protocol"
        if not self._is_connected:
            description += (
                f", and nothing is published at {self.address.published()}: if updates have another port, "
                f"write {self.address.at()}/PORT"
            )
        return description

    @property
    def is_back(self) -> bool:
        """Whether a robot whose tree is shown sends messages again after it was away."""
        return self._is_tree_reported and self._silent_since < self.last_message_at

    @property
    def sockets(self) -> list[Socket]:
        """The current sockets, for a poller."""
        requests = [self._client.socket] if self._client.is_reply_pending else []
        return [self._update_socket, self._connection_events, *requests]

    def step(self) -> list[Event]:
        """Read new messages and send the next request, without waiting. Return the new events.

        Raises:
            NoReplyError: The robot does not reply. It may come back, so the caller should continue to step.
            ProtocolError: The program at the address does not use this protocol.
        """
        self._events = []
        self._read_updates()
        self._process_updates()
        self._read_connection_events()
        self._request()
        self._process_updates()
        return self._events

    def close(self) -> None:
        """Free the sockets."""
        self._update_socket.disable_monitor()
        self._client.close()
        self._context.destroy(linger=0)

    # Receiving

    def _read_connection_events(self) -> None:
        while self._connection_events.poll(0):
            event = parse_monitor_message(self._connection_events.recv_multipart())["event"]
            # Only after a handshake: a socket that is not a ZeroMQ publisher also causes DISCONNECTED events,
            # at every attempt to connect.
            if event == zmq.EVENT_DISCONNECTED and self._is_connected:
                self._has_restarted = self._needs_tree = True
                self._requested_at = 0.0
                self._waiting_updates.clear()
            self._is_connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED

    def _read_updates(self) -> None:
        for _ in range(_MAX_UPDATES_PER_STEP):
            try:
                frame = self._update_socket.recv(zmq.DONTWAIT)
            except zmq.Again:
                return
            self._waiting_updates.append(decode_update(frame))
            self.last_message_at = time.monotonic()

    def _request(self) -> None:
        try:
            frames = self._client.receive()
        except NoReplyError:
            self._needs_tree = True
            if self._is_tree_reported and time.monotonic() - self.last_message_at < PROBE_AFTER_S:
                return  # the robot is there, since it publishes
            self._is_certain = False
            self._silent_since = time.monotonic()
            raise
        now = time.monotonic()
        if frames is not None:
            self._process_reply(frames, now)
        is_silent = now - max(self.last_message_at, self._requested_at) >= PROBE_AFTER_S
        if (
            not self._client.is_reply_pending
            and (is_silent or self._needs_tree)
            and now - self._requested_at >= _RETRY_AFTER_S
        ):
            self._requested_at = now
            self._client.send(QUESTION)

    def _process_reply(self, frames: list[bytes], now: float) -> None:
        tree = find_tree(frames)
        if tree is None:
            reply = describe_bytes(frames[0]) if len(frames) == 1 else f"{len(frames)} frames"
            raise ProtocolError(f"expected a tree in Groot 1's protocol from {self.address}, and got {reply}")
        self.last_message_at = now
        self._needs_tree = False
        # Replies of the same robot differ only in the statuses, so trees are compared without them.
        shape = tree._replace(nodes=tuple(node._replace(status=IDLE) for node in tree.nodes))
        if shape == self._tree and not self._has_restarted:
            self._drop_unknown()
            return
        self._observed = read_groot1(tree, uuid.uuid4().hex)
        self._tree = shape
        self._is_tree_reported = self._is_certain = self._has_restarted = False
        self._report_tree_at = now + FIRST_UPDATE
        self._last_number = 0
        self._drop_unknown()

    def _drop_unknown(self) -> None:
        """Remove waiting updates with unknown nodes: they belong to a previous tree."""
        self._waiting_updates = deque(filter(self._is_known, self._waiting_updates), maxlen=_MAX_WAITING)

    # Events

    def _process_updates(self) -> None:
        if self._observed is None or self._has_restarted:
            return
        if not self._is_tree_reported and (self._waiting_updates or time.monotonic() >= self._report_tree_at):
            self._report_tree()
        while self._waiting_updates and self._is_tree_reported:
            if not self._is_known(self._waiting_updates[0]):
                self._needs_tree = True
                return
            self._apply(self._waiting_updates.popleft())

    def _report_tree(self) -> None:
        """Add an event for the tree, with the statuses of the first update or else of the reply."""
        assert self._observed is not None
        self._statuses = dict(self._observed.statuses)
        wall = time.time_ns()
        if self._waiting_updates and self._is_known(self._waiting_updates[0]):
            # The statuses of an update are those before its transitions, so the tree is shown at the time of
            # the first transition.
            update = self._waiting_updates[0]
            self._statuses |= self._map_to_own_uids(update)
            self._is_certain = True
            if update.transitions:
                self._compare_clocks(update)
                wall = update.transitions[0].wall
                self._events.append(self._create_tree_event(self._to_stamp(wall), wall))
                return
        self._last_stamp = max(self._last_stamp, self._read_clock())
        self._events.append(self._create_tree_event(self._last_stamp, wall))

    def _create_tree_event(self, stamp: int, wall: int) -> TreeEvent:
        assert self._observed is not None
        self._is_tree_reported = True
        self._reported_up_to = stamp
        return TreeEvent(self._observed.tree, stamp, wall, dict(self._statuses), False, GROOT1)

    def _is_known(self, update: Update) -> bool:
        assert self._observed is not None
        uids = self._observed.uids
        return update.statuses.keys() <= uids.keys() and all(
            transition.uid in uids for transition in update.transitions
        )

    def _map_to_own_uids(self, update: Update) -> dict[int, int]:
        assert self._observed is not None
        return {self._observed.uids[uid]: status for uid, status in update.statuses.items()}

    def _apply(self, update: Update) -> None:
        if not update.transitions:
            return
        self._compare_clocks(update)
        first = update.transitions[0].wall
        self._compare(self._map_to_own_uids(update), self._to_stamp(first), first)
        for transition in update.transitions:
            self._add_transition(transition)

    def _compare(self, received: dict[int, int], stamp: int, wall: int) -> None:
        """Compare the known statuses with the *received* statuses, and correct the known statuses."""
        different = {uid: status for uid, status in received.items() if self._statuses[uid] != status}
        if self._is_certain and not any(different.values()):
            # A robot can be configured not to publish transitions to IDLE: StatusChangeLogger's
            # enableTransitionToIdle(false). Then this is not a gap.
            for uid in different:
                self._report(uid, IDLE, stamp, wall)
        elif different:
            if self._is_certain:
                self._events.append(self._create_gap(stamp, wall))
            self._statuses |= different
            self._events.append(self._create_tree_event(stamp, wall))
        self._is_certain = True

    def _add_transition(self, transition: WireTransition) -> None:
        assert self._observed is not None
        uid, stamp = self._observed.uids[transition.uid], self._to_stamp(transition.wall)
        if transition.previous != self._statuses[uid]:
            if transition.previous != IDLE:
                self._events.append(self._create_gap(stamp, transition.wall))
            self._report(uid, transition.previous, stamp, transition.wall)
        if transition.status != transition.previous:
            self._report(uid, transition.status, stamp, transition.wall)

    def _report(self, uid: int, status: int, stamp: int, wall: int) -> None:
        self._last_number += 1
        previous, self._statuses[uid] = self._statuses[uid], status
        self._reported_up_to = stamp
        # Tick 0: the protocol has no numbers of ticks.
        self._events.append(TransitionEvent(self._last_number, stamp, wall, 0, uid, previous, status))

    def _create_gap(self, stamp: int, wall: int) -> MissingDataEvent:
        return MissingDataEvent(
            stamp, wall, self._reported_up_to, "transitions", "updates of the robot were lost on the network"
        )

    def _read_clock(self) -> int:
        return time.monotonic_ns() - self._start

    def _compare_clocks(self, update: Update) -> None:
        """Measure the offset between the robot's wall clock and the time since the feed was created.

        The first measurement is kept until the robot's clock is set. The feed notices that if the clock goes
        back, or if an update is too far in the future.
        """
        first, last = update.transitions[0].wall, update.transitions[-1].wall
        now = self._read_clock()
        if first < self._last_wall or last - self._clock_offset - now > _FUTURE_NS or not self._last_wall:
            self._clock_offset = last - now
        self._last_wall = last

    def _to_stamp(self, wall: int) -> int:
        """Return *wall* (robot's wall clock) as time (ns) since the feed was created; it never decreases."""
        self._last_stamp = max(self._last_stamp, wall - self._clock_offset)
        return self._last_stamp
