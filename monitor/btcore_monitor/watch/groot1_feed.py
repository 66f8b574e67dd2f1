"""Follow a robot with Groot 1's protocol: a robot with BehaviorTree.CPP 3 or btcore.

The robot publishes all transitions with their times, at most 25 times per second, together with the statuses
of all nodes at the end of the previous update. So the feed detects lost updates, but not their number. It
requests the tree at the beginning, when an update has an unknown node, and after some time without updates,
to check whether the robot is still there.
"""

import time
import uuid
from collections import deque
from collections.abc import Iterator
from typing import Final

import zmq
from zmq.utils.monitor import parse_monitor_message

from btcore_monitor.events import IDLE, DataSource, Event, MissingDataEvent, TransitionEvent, TreeEvent
from btcore_monitor.watch.groot2_client import Groot1DetectedError, Groot2Client, NoReplyError, Socket
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot1 import Update, decode_update
from btcore_monitor.wire.groot1_tree import WireTree, read_groot1
from btcore_monitor.wire.groot2 import Request

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
_POLL_INTERVAL_S: Final = 0.05
_FUTURE_NS: Final = 5_000_000_000
"""Maximum time (ns) by which an update may be ahead of the estimate of the robot's clock.

The first update, from which the clock is estimated, may have been delayed that long.
"""


class _Clock:
    """Converts times of the robot's wall clock to the time (ns) since the feed was created."""

    def __init__(self) -> None:
        self._start = time.monotonic_ns()
        self._offset = 0
        self._last_wall = 0
        self._last_stamp = 0

    def now(self) -> int:
        """Return the present time; the times that the clock returns never decrease."""
        self._last_stamp = max(self._last_stamp, time.monotonic_ns() - self._start)
        return self._last_stamp

    def stamp(self, wall: int) -> int:
        """Return the time of *wall* (robot's wall clock); it never decreases."""
        self._last_stamp = max(self._last_stamp, wall - self._offset)
        return self._last_stamp

    def compare(self, update: Update) -> None:
        """Measure the offset of the robot's wall clock by *update*, which has just arrived.

        The first measurement is kept until the robot's clock is set. This is noticed if the clock goes back,
        or if an update is too far in the future.
        """
        first, last = update.transitions[0].wall, update.transitions[-1].wall
        now = time.monotonic_ns() - self._start
        if first < self._last_wall or last - self._offset - now > _FUTURE_NS or not self._last_wall:
            self._offset = last - now
        self._last_wall = last


class _Run:
    """Converts the updates of one run of a robot to events: until a disconnection or another tree.

    Args:
        tree: The tree in the robot's reply.
        clock: The clock of the feed.
    """

    def __init__(self, tree: WireTree, clock: _Clock) -> None:
        self.is_reported = False
        """Whether the tree has been reported."""
        self.is_certain = False
        """Whether the known statuses are those at the end of the last update."""
        self._shape = _without_statuses(tree)
        self._observed = read_groot1(tree, uuid.uuid4().hex)
        self._statuses = dict(self._observed.statuses)
        self._clock = clock
        self._last_number = 0
        self._reported_up_to = 0

    def has_tree(self, tree: WireTree) -> bool:
        """Return whether *tree* differs from the tree of this run in its statuses at most."""
        return self._shape == _without_statuses(tree)

    def has_nodes_of(self, update: Update) -> bool:
        """Return whether the tree has all nodes of *update*."""
        uids = self._observed.uids
        return update.statuses.keys() <= uids.keys() and all(
            transition.uid in uids for transition in update.transitions
        )

    def first_events(self, update: Update | None) -> list[Event]:
        """Return the event of the tree, with the statuses of the first *update* or else of the reply."""
        if update is not None:
            self._statuses |= self._received_statuses(update)
            self.is_certain = True
            if update.transitions:
                # The statuses of an update are those before its transitions, so the tree is shown at the
                # time of the first transition.
                self._clock.compare(update)
                wall = update.transitions[0].wall
                return [self._tree_event(self._clock.stamp(wall), wall)]
        return [self._tree_event(self._clock.now(), time.time_ns())]

    def events(self, update: Update) -> Iterator[Event]:
        """Yield the events of *update*."""
        if not update.transitions:
            return
        self._clock.compare(update)
        wall = update.transitions[0].wall
        yield from self._correct(self._received_statuses(update), self._clock.stamp(wall), wall)
        for transition in update.transitions:
            uid, wall = self._observed.uids[transition.uid], transition.wall
            stamp = self._clock.stamp(wall)
            if transition.previous != self._statuses[uid]:
                if transition.previous != IDLE:
                    yield self._gap(stamp, wall)
                yield self._transition(uid, transition.previous, stamp, wall)
            if transition.status != transition.previous:
                yield self._transition(uid, transition.status, stamp, wall)

    def _received_statuses(self, update: Update) -> dict[int, int]:
        """Return the statuses in *update* by the uids of the observed tree."""
        return {self._observed.uids[uid]: status for uid, status in update.statuses.items()}

    def _correct(self, received: dict[int, int], stamp: int, wall: int) -> Iterator[Event]:
        """Compare the known statuses with the *received* statuses, and correct the known statuses."""
        different = {uid: status for uid, status in received.items() if self._statuses[uid] != status}
        if self.is_certain and not any(different.values()):
            # A robot can be configured not to publish transitions to IDLE: StatusChangeLogger's
            # enableTransitionToIdle(false). Then this is not a gap.
            for uid in different:
                yield self._transition(uid, IDLE, stamp, wall)
        elif different:
            if self.is_certain:
                yield self._gap(stamp, wall)
            self._statuses |= different
            yield self._tree_event(stamp, wall)
        self.is_certain = True

    def _tree_event(self, stamp: int, wall: int) -> TreeEvent:
        self.is_reported = True
        self._reported_up_to = stamp
        return TreeEvent(self._observed.tree, stamp, wall, dict(self._statuses), False, GROOT1)

    def _transition(self, uid: int, status: int, stamp: int, wall: int) -> TransitionEvent:
        self._last_number += 1
        previous, self._statuses[uid] = self._statuses[uid], status
        self._reported_up_to = stamp
        # Tick 0: the protocol has no numbers of ticks.
        return TransitionEvent(self._last_number, stamp, wall, 0, uid, previous, status)

    def _gap(self, stamp: int, wall: int) -> MissingDataEvent:
        reason = "updates of the robot were lost on the network"
        return MissingDataEvent(stamp, wall, self._reported_up_to, "transitions", reason)


def _without_statuses(tree: WireTree) -> WireTree:
    return tree._replace(nodes=tuple(node._replace(status=IDLE) for node in tree.nodes))


class Groot1Feed:
    """Converts a robot's updates to events. Use it from one thread.

    The feed numbers the transitions itself, so `TreeEvent.has_transition_numbers` is false. If an update does
    not begin with the statuses at the end of the previous update, a MissingDataEvent and a TreeEvent with the
    current statuses follow. A disconnection counts as a restart.

    *client* sends the requests for the tree. A publisher of Groot 1 ignores their content.
    """

    def __init__(self, client: Groot2Client) -> None:
        self._client = client
        self._context: zmq.Context[Socket] = zmq.Context()
        self._update_socket = self._context.socket(zmq.SUB)
        # ZeroMQ doubles the time between attempts to connect, up to the maximum.
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.RCVHWM, _MAX_UPDATES_PER_STEP),
            (zmq.MAXMSGSIZE, _MAX_UPDATE),
            (zmq.RECONNECT_IVL, _RECONNECT_MS),
            (zmq.RECONNECT_IVL_MAX, 10 * _RECONNECT_MS),
        ):
            self._update_socket.setsockopt(option, value)
        if client.keys is not None:
            client.keys.secure(self._update_socket)
        # Everything: updates have no topic, their first bytes are a size.
        self._update_socket.subscribe(b"")
        self._connection_events = self._update_socket.get_monitor_socket(
            zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_DISCONNECTED
        )
        self._update_socket.connect(client.address.published())
        self._events: list[Event] = []  # those of the present step
        self._is_connected = False
        self._waiting_updates: deque[Update] = deque(maxlen=_MAX_WAITING)
        self._run: _Run | None = None
        # When the tree is reported even without an update (monotonic s).
        self._report_tree_at = 0.0
        self._clock = _Clock()
        # When the last update or reply arrived (monotonic s); 0: never.
        self._last_message_at = 0.0
        self.resume()

    def resume(self) -> None:
        """Begin or, after an error of `step`, continue to follow the robot."""
        self._needs_tree = True
        self._requested_at = 0.0
        if self._run is not None:
            self._run.is_certain = False

    def __str__(self) -> str:
        address = self._client.address
        description = f"{address}, by Groot 1's protocol"
        if not self._is_connected:
            description += (
                f", and nothing is published at {address.published()}: if updates have another port, "
                f"write {address.at()}/PORT"
            )
        return description

    @property
    def is_following(self) -> bool:
        """Whether the robot's tree has been reported."""
        return self._run is not None and self._run.is_reported

    @property
    def sockets(self) -> list[Socket]:
        """The sockets of the updates, for a poller."""
        return [self._update_socket, self._connection_events]

    @property
    def next_step_at(self) -> float:
        """When the next step is due (monotonic s), unless a message arrives before."""
        return time.monotonic() + _POLL_INTERVAL_S

    def step(self) -> list[Event]:
        """Read new messages and send the next request, without waiting. Return the new events.

        After an exception, `resume` must be called before the next step.

        Raises:
            NoReplyError: The robot does not reply.
            ProtocolError: The program at the address does not use this protocol.
        """
        self._events = []
        self._read_updates()
        self._process_updates()
        self._read_connection_events()
        self._read_reply()
        self._request_tree()
        self._process_updates()
        return self._events

    def close(self) -> None:
        """Free the sockets of the updates."""
        self._update_socket.disable_monitor()
        self._context.destroy(linger=0)

    def _read_connection_events(self) -> None:
        while self._connection_events.poll(0):
            event = parse_monitor_message(self._connection_events.recv_multipart())["event"]
            # Only after a handshake: a socket that is not a ZeroMQ publisher also causes DISCONNECTED events,
            # at every attempt to connect.
            if event == zmq.EVENT_DISCONNECTED and self._is_connected:
                self._run = None
                self._waiting_updates.clear()
                self.resume()
            self._is_connected = event == zmq.EVENT_HANDSHAKE_SUCCEEDED

    def _read_updates(self) -> None:
        for _ in range(_MAX_UPDATES_PER_STEP):
            try:
                frame = self._update_socket.recv(zmq.DONTWAIT)
            except zmq.Again:
                return
            self._waiting_updates.append(decode_update(frame))
            self._last_message_at = time.monotonic()

    def _request_tree(self) -> None:
        now = time.monotonic()
        is_silent = now - max(self._last_message_at, self._requested_at) >= PROBE_AFTER_S
        if (
            not self._client.is_reply_pending
            and (is_silent or self._needs_tree)
            and now - self._requested_at >= _RETRY_AFTER_S
        ):
            self._requested_at = now
            self._client.send_request(Request.FULLTREE)

    def _read_reply(self) -> None:
        try:
            reply = self._client.receive_reply()
        except Groot1DetectedError as detected:
            self._process_tree(detected.tree)
        except NoReplyError:
            self._needs_tree = True
            if not self.is_following or time.monotonic() - self._last_message_at >= PROBE_AFTER_S:
                raise
            # Otherwise the robot is there, since it publishes.
        else:
            if reply is not None:
                raise ProtocolError(f"{self._client.address} no longer uses Groot 1's protocol")

    def _process_tree(self, tree: WireTree) -> None:
        self._last_message_at = time.monotonic()
        self._needs_tree = False
        if self._run is None or not self._run.has_tree(tree):
            self._run = _Run(tree, self._clock)
            self._report_tree_at = self._last_message_at + FIRST_UPDATE
        # Updates with unknown nodes belong to a previous tree.
        known = filter(self._run.has_nodes_of, self._waiting_updates)
        self._waiting_updates = deque(known, maxlen=_MAX_WAITING)

    def _process_updates(self) -> None:
        run, updates = self._run, self._waiting_updates
        if run is None:
            return
        if not run.is_reported and (updates or time.monotonic() >= self._report_tree_at):
            first = updates[0] if updates and run.has_nodes_of(updates[0]) else None
            self._events += run.first_events(first)
        while updates and run.is_reported:
            if not run.has_nodes_of(updates[0]):
                self._needs_tree = True
                return
            self._events += run.events(updates.popleft())
