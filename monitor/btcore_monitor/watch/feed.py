"""The events of a robot, from btcore's run channel if the robot has it, else from Groot 2 or Groot 1.

    with Feed("tcp://robot.local:1667") as feed:
        for event in feed:
            ...

The robot may start later, disappear, and come back with another tree.
"""

import threading
import time
from collections.abc import Iterator
from enum import Enum, auto
from itertools import chain
from typing import Final

import zmq

from btcore.suggestions import shortened
from btcore_monitor.closeable import Closeable
from btcore_monitor.events import (
    BlackboardEvent,
    ConnectionEvent,
    ConnectionState,
    Event,
    ExceptionEvent,
    LostTransitionsEvent,
    MissingDataEvent,
    MovingSceneEvent,
    StaticSceneEvent,
    TickEvent,
    TransitionEvent,
    TreeEvent,
)
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.groot1_feed import Groot1Feed
from btcore_monitor.watch.groot2_client import Groot1DetectedError, Groot2Client
from btcore_monitor.watch.groot2_feed import Groot2Feed
from btcore_monitor.watch.request_client import NoReplyError
from btcore_monitor.watch.run_channel_client import RunChannelClient
from btcore_monitor.wire import run_channel
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.fulltree import read_fulltree

__all__ = ["Feed"]

ANNOUNCED_RUN_CHANNEL_WAIT_S: Final = 20.0
"""Time (s, wall clock) to wait for the run channel of a robot that announces it.

On a busy machine the first message takes seconds. It takes longer only if the run channel is not reachable,
for example because of a firewall."""

SILENT_AFTER_S: Final = 3.0
"""Seconds (wall clock) without a heartbeat after which a btcore robot counts as lost."""

ABANDONED_AFTER_S: Final = 60.0
"""Seconds (wall clock) that `events(until_end=True)` waits for a robot that is away."""

MAX_REPLY_TIMEOUT_S: Final = 8.0
"""Maximum seconds (wall clock) for a reply over a slow network."""

REPORT_INTERVAL_S: Final = 5.0
"""Shortest time (s, wall clock) between two reports of invalid messages."""

_POLL_INTERVAL_S: Final = 0.2
_PAUSE_AFTER_ERROR_S: Final = 0.5
_MAX_DETAIL_CHARS: Final = 500
_GROOT1_POLL_INTERVAL_S: Final = 0.05


class _State(Enum):
    """What a feed reads. `Feed._change_state` is the only method that changes it:

    | from | to | when |
    |---|---|---|
    | any | RUN_CHANNEL | a message of the run channel arrived, and its tree is known |
    | RUN_CHANNEL | SEARCHING | no message for SILENT_AFTER_S: the robot may return with another protocol |
    | SEARCHING | ANNOUNCED | the reply to a request of Groot announces a run channel |
    | SEARCHING | GROOT2, GROOT1 | such a reply without announcement, with the tree in that protocol |
    | ANNOUNCED | GROOT2, GROOT1 | ANNOUNCED_RUN_CHANNEL_WAIT_S passed: the run channel is not reachable |
    | GROOT2 | SEARCHING | no reply, or an invalid reply |
    | GROOT2 | GROOT1, ANNOUNCED | a reply in Groot 1's protocol, without or with announcement |
    | GROOT1 | SEARCHING | an invalid update |

    The run channel comes first, because only it has all data.
    """

    SEARCHING = auto()
    """Connect to the run channel, and send requests of Groot 2 to find out which protocol the robot has."""
    ANNOUNCED = auto()
    """Wait for the run channel, without further requests in Groot's protocols."""
    RUN_CHANNEL = auto()
    GROOT2 = auto()
    GROOT1 = auto()


class Feed(Closeable):
    """The events of a robot, in order. Use it from one thread, except `stop`.

    Args:
        address: The robot's address, as in `parse_address`.
        blackboard_rate: Rate (Hz) of blackboard requests to a robot without run channel (0: never).
        record: Whether such a robot is also requested to record its transitions. Then other clients do not
            receive these transitions.
        keys: The keys of the client, if the robot requires keys.

    Raises:
        AddressError: *address* is invalid.
        ConnectionRefusedByRobotError: In every method that returns events: the robot refuses the keys.

    Examples:
        >>> import btcore
        >>> from btcore_monitor.events import TreeEvent
        >>> from btcore_monitor.serve import serve
        >>> from btcore_monitor.watch.feed import Feed
        >>> b = btcore.Builder()
        >>> with serve(b.build(b.AlwaysSuccess(name="door")), groot2_port=0) as publisher:
        ...     with Feed(publisher.address) as feed:
        ...         event = next(event for event in feed if isinstance(event, TreeEvent))
        >>> event.tree.name
        'Main'
    """

    def __init__(
        self,
        address: str,
        *,
        blackboard_rate: float = 2.0,
        record: bool = True,
        keys: ClientKeys | None = None,
    ) -> None:
        self.address = parse_address(address)
        self._keys = keys
        self._run_channel_client = RunChannelClient(self.address, keys)
        self._groot2_client = Groot2Client(self.address, max_timeout=MAX_REPLY_TIMEOUT_S, keys=keys)
        self._groot2_feed = Groot2Feed(self._groot2_client, blackboard_rate, record)
        self._state = _State.SEARCHING
        # In the state GROOT1, and in the state ANNOUNCED of a robot that replies as Groot 1, which receives
        # updates until then; otherwise None.
        self._groot1_feed: Groot1Feed | None = None
        self._events: list[Event] = []  # that `poll` has not returned yet
        self._stopped = threading.Event()
        self._connection_state: ConnectionState | None = None
        # Time of the reply that ended the state SEARCHING.
        self._groot_replied_at = 0.0
        # Why Groot's protocol is used, if the robot has announced a run channel.
        self._groot_reason = ""
        self._next_number: int | None = None
        self._latest_times = (0, 0)
        self._reported_error_count = 0
        self._reported_at = -REPORT_INTERVAL_S

    def poll(self, timeout: float) -> list[Event]:
        """Return the events since the last call. If there are none, wait up to *timeout* s (wall clock)."""
        deadline = time.monotonic() + timeout
        while True:
            self._collect_events()
            left = deadline - time.monotonic()
            # A robot's buffer would overflow while the caller processes the events.
            is_behind = self._groot2_feed.is_behind and self._state is not _State.RUN_CHANNEL
            if (self._events and not is_behind) or left <= 0 or self._stopped.is_set():
                events, self._events = self._events, []
                return events
            self._wait(min(left, _POLL_INTERVAL_S))

    def events(self, until_end: bool = False) -> Iterator[Event]:
        """Yield events until `stop`.

        With *until_end*, also stop when the robot reports the end of its run, or is away for long.
        """
        return chain.from_iterable(self.batches(until_end))

    def batches(self, until_end: bool = False) -> Iterator[list[Event]]:
        """Yield the events in lists, and an empty list whenever no event arrives for 0.2 s."""
        away_since: float | None = time.monotonic()
        while not self._stopped.is_set():
            events = self.poll(_POLL_INTERVAL_S)
            yield events
            for event in events:
                if isinstance(event, ConnectionEvent):
                    if until_end and event.state == "ended":
                        return
                    away_since = None if event.state == "connected" else time.monotonic()
            if until_end and away_since is not None and time.monotonic() - away_since > ABANDONED_AFTER_S:
                return

    def __iter__(self) -> Iterator[Event]:
        return self.events()

    def stop(self) -> None:
        """End the iteration. Any thread or signal handler may call this method."""
        self._stopped.set()

    def close(self) -> None:
        """Close the sockets. The robot continues."""
        self._stopped.set()
        self._run_channel_client.close()
        self._groot2_feed.stop_recording()
        self._groot2_client.close()
        self._close_groot1()

    def _collect_events(self) -> None:
        if self._connection_state is None:
            self._report_connection("waiting", f"waiting for the robot at {self.address}")
        for message in self._run_channel_client.read():
            self._add_events(message)
        now = time.monotonic()
        self._report_errors(now)
        silence = now - self._run_channel_client.last_message_at
        if silence < SILENT_AFTER_S and self._run_channel_client.tree_id:
            self._change_state(_State.RUN_CHANNEL)
            if self._connection_state == "lost":
                self._report_connection("connected", f"{self.address} is back")
        elif self._state is _State.RUN_CHANNEL:
            self._change_state(_State.SEARCHING)
            self._groot2_feed.reset()
            if self._connection_state == "connected":
                self._report_connection(
                    "lost", f"no sign of life from {self.address} for {SILENT_AFTER_S:g} s"
                )
        else:
            waited = now - self._groot_replied_at
            if self._state is _State.ANNOUNCED and waited >= ANNOUNCED_RUN_CHANNEL_WAIT_S:
                self._abandon_run_channel()
            if self._state is _State.GROOT1:
                self._read_groot1()
            elif self._state is not _State.ANNOUNCED:
                self._read_groot2(now)

    def _change_state(self, state: _State) -> None:
        self._state = state
        if state not in (_State.ANNOUNCED, _State.GROOT1):
            self._close_groot1()

    def _report_connection(self, state: ConnectionState, detail: str) -> None:
        if state != self._connection_state:
            self._connection_state = state
            self._events.append(ConnectionEvent(state, shortened(detail, _MAX_DETAIL_CHARS)))

    def _report_errors(self, now: float) -> None:
        """Report messages of the run channel that are invalid, at most once in REPORT_INTERVAL_S."""
        if self._run_channel_client.error_count == self._reported_error_count:
            return
        if not self._run_channel_client.tree_id:
            self._reported_error_count = self._run_channel_client.error_count
            self._report_connection("lost", self._run_channel_client.last_error)
        elif now - self._reported_at >= REPORT_INTERVAL_S:
            count = self._run_channel_client.error_count - self._reported_error_count
            self._reported_error_count, self._reported_at = self._run_channel_client.error_count, now
            detail = shortened(self._run_channel_client.last_error, _MAX_DETAIL_CHARS)
            reason = f"{count} invalid, the last because: {detail}"
            stamp, wall = self._latest_times
            self._events.append(MissingDataEvent(stamp, wall, since=stamp, kind="messages", reason=reason))

    def _add_events(self, message: run_channel.Message) -> None:
        if isinstance(message, run_channel.StreamMessage):
            self._latest_times = message.stamp, message.wall
        if isinstance(message, run_channel.TreeMessage):
            try:
                tree = read_fulltree(message.xml, message.tree_id)
            except ProtocolError as error:
                self._report_connection("lost", str(error))
                return
            self._next_number = None
            self._report_connection("connected", f"{self.address}, by btcore's run channel")
            statuses = {node.uid: 0 for node in tree.nodes} | message.statuses
            self._events.append(TreeEvent(tree, message.stamp, message.wall, statuses))
        elif isinstance(message, run_channel.StaticSceneMessage):
            self._events.append(StaticSceneEvent(message.data))
        elif isinstance(message, run_channel.TransitionsMessage):
            self._add_transitions(message)
        elif isinstance(message, run_channel.MovingSceneMessage):
            self._events.append(MovingSceneEvent(message.stamp, message.wall, message.data))
        elif isinstance(message, run_channel.BlackboardMessage):
            self._events.append(BlackboardEvent(message.stamp, message.wall, message.boards))
        elif isinstance(message, run_channel.ExceptionMessage):
            self._events.append(ExceptionEvent(message.stamp, message.wall, message.path, message.message))
        elif isinstance(message, run_channel.EndMessage):
            self._report_connection("ended", f"the run at {self.address} is over")

    def _add_transitions(self, message: run_channel.TransitionsMessage) -> None:
        number = message.first
        if message.transitions:
            if self._next_number is not None and number > self._next_number:
                self._events.append(LostTransitionsEvent(self._next_number, number - 1))
            self._next_number = number + len(message.transitions)
        for stamp, wall, tick, uid, previous, status in message.transitions:
            self._events.append(TransitionEvent(number, stamp, wall, tick, uid, previous, status))
            number += 1
        if message.ended:
            self._events.append(
                TickEvent(message.tick, message.stamp, message.wall, message.duration, message.status)
            )

    def _end_search(self, reply: bytes, now: float) -> None:
        """Change the state: the robot replied to a request of Groot with its tree, *reply*."""
        self._groot_replied_at = now
        self._groot_reason = ""
        is_announced = reply.endswith(run_channel.ANNOUNCEMENT)
        self._change_state(_State.ANNOUNCED if is_announced else self._groot_state)

    def _abandon_run_channel(self) -> None:
        """Use Groot's protocol, although the robot has announced a run channel."""
        self._change_state(self._groot_state)
        port = self.address.at(run_channel.PORT_OFFSET)
        self._groot_reason = f", because there is no reply from its run channel, {port}"
        # If the run channel connects later, it begins with the tree.
        self._run_channel_client.reset()

    @property
    def _groot_state(self) -> _State:
        """The state in which the robot's version of Groot's protocol is used."""
        return _State.GROOT2 if self._groot1_feed is None else _State.GROOT1

    def _read_groot2(self, now: float) -> None:
        """Send requests of Groot 2, and add their events."""
        if self._state is _State.SEARCHING and self._groot2_feed.tree is not None:
            self._end_search(self._groot2_feed.tree.xml, now)
            return
        try:
            sampled = self._groot2_feed.step(tree_only=self._state is _State.SEARCHING)
        except Groot1DetectedError as detected:
            self._groot2_feed.reset()
            self._groot1_feed = Groot1Feed(self.address, MAX_REPLY_TIMEOUT_S, self._keys)
            self._end_search(detected.reply, now)
            if self._connection_state == "connected":
                self._report_connection("lost", str(detected))
            return
        except (NoReplyError, ProtocolError) as error:
            is_invalid = isinstance(error, ProtocolError)
            self._groot2_feed.reset(_PAUSE_AFTER_ERROR_S if is_invalid else 0.0)
            self._change_state(_State.SEARCHING)
            # A robot that has not answered yet may be starting.
            if self._connection_state == "connected" or is_invalid:
                self._report_connection("lost", str(error))
            return
        if self._groot2_feed.is_following:
            self._report_connection("connected", f"{self.address}, by Groot 2's protocol{self._groot_reason}")
        self._events.extend(sampled)

    def _read_groot1(self) -> None:
        """Read updates of Groot 1, and add their events."""
        feed = self._groot1_feed
        assert feed is not None
        try:
            sampled = feed.step()
        except NoReplyError as error:
            sampled = []
            if self._connection_state == "connected":
                self._report_connection("lost", str(error))
        except ProtocolError as error:
            self._change_state(_State.SEARCHING)
            self._report_connection("lost", str(error))
            return
        if sampled or feed.is_back:
            self._report_connection("connected", f"{feed}{self._groot_reason}")
        self._events += sampled

    def _close_groot1(self) -> None:
        if self._groot1_feed is not None:
            self._groot1_feed.close()
            self._groot1_feed = None

    def _wait(self, seconds: float) -> None:
        poller = zmq.Poller()
        poller.register(self._run_channel_client.socket, zmq.POLLIN)
        if self._state in (_State.RUN_CHANNEL, _State.ANNOUNCED):
            pass
        elif self._state is _State.GROOT1:
            assert self._groot1_feed is not None
            for socket in self._groot1_feed.sockets:
                poller.register(socket, zmq.POLLIN)
            seconds = min(seconds, _GROOT1_POLL_INTERVAL_S)
        else:
            if self._groot2_client.is_reply_pending:
                poller.register(self._groot2_client.socket, zmq.POLLIN)
            seconds = min(seconds, self._groot2_feed.next_request_at - time.monotonic())
        # At least 1 ms: poll(0) would make the loop in poll() occupy the processor.
        poller.poll(max(1, round(1000 * seconds)))
