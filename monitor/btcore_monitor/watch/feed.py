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
    ConnectionEvent,
    ConnectionState,
    Event,
    ObservedTree,
)
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import parse_address
from btcore_monitor.watch.groot1_feed import Groot1Feed
from btcore_monitor.watch.groot2_client import Groot1DetectedError, Groot2Client, NoReplyError
from btcore_monitor.watch.groot2_feed import Groot2Feed, TreeReplacedError
from btcore_monitor.watch.run_channel_client import RunChannelClient
from btcore_monitor.watch.run_channel_feed import MAX_DETAIL_CHARS, SILENT_AFTER_S, RunChannelFeed
from btcore_monitor.wire import run_channel
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import Request

__all__ = ["Feed"]

ANNOUNCED_RUN_CHANNEL_WAIT_S: Final = 20.0
"""Time (s, wall clock) to wait for the run channel of a robot that announces it.

On a busy machine the first message takes seconds. It takes longer only if the run channel is not reachable,
for example because of a firewall."""

ABANDONED_AFTER_S: Final = 60.0
"""Seconds (wall clock) that `events(until_end=True)` waits for a robot that is away."""

MAX_REPLY_TIMEOUT_S: Final = 8.0
"""Maximum seconds (wall clock) for a reply over a slow network."""

_POLL_INTERVAL_S: Final = 0.2
_PAUSE_S: Final = 0.1
_PAUSE_AFTER_ERROR_S: Final = 0.5


class _State(Enum):
    """What a feed reads.

    | from | to | when |
    |---|---|---|
    | any | RUN_CHANNEL | a message of the run channel arrived, and its tree is known |
    | RUN_CHANNEL | SEARCHING | no message for SILENT_AFTER_S: the robot may return with another protocol |
    | SEARCHING | ANNOUNCED | the reply to a request of Groot announces a run channel |
    | ANNOUNCED | SEARCHING | ANNOUNCED_RUN_CHANNEL_WAIT_S passed: the run channel is not reachable |
    | SEARCHING | GROOT | such a reply without announcement, or from a robot with such a run channel |
    | GROOT | SEARCHING | no reply, an invalid reply or update, or another tree or protocol |

    The run channel comes first, because only it has all data.
    """

    SEARCHING = auto()
    """Connect to the run channel, and request the tree in Groot's protocol to find out its version."""
    ANNOUNCED = auto()
    """Wait for the run channel."""
    RUN_CHANNEL = auto()
    GROOT = auto()
    """Read Groot 2 or Groot 1."""


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
        self._run_channel_client = RunChannelClient(self.address, keys)
        self._run_channel_feed = RunChannelFeed(self._run_channel_client)
        self._groot2_client = Groot2Client(self.address, max_timeout=MAX_REPLY_TIMEOUT_S, keys=keys)
        self._blackboard_rate = blackboard_rate
        self._record = record
        # The feed of the state GROOT. In the state SEARCHING it is kept, since the robot may come back.
        self._groot_feed: Groot1Feed | Groot2Feed | None = None
        self._state = _State.SEARCHING
        # When the search continues (monotonic s), also in the state ANNOUNCED.
        self._search_at = 0.0
        # Why Groot's protocol is used, if the robot has announced a run channel that is not reachable.
        self._groot_reason = ""
        self._events: list[Event] = []  # that `poll` has not returned yet
        self._stopped = threading.Event()
        self._connection_state: ConnectionState | None = None

    def poll(self, timeout: float) -> list[Event]:
        """Return the events since the last call. If there are none, wait up to *timeout* s (wall clock)."""
        deadline = time.monotonic() + timeout
        while True:
            self._collect_events()
            left = deadline - time.monotonic()
            # A robot's buffer would overflow while the caller processes the events.
            if (self._events and not self._is_behind) or left <= 0 or self._stopped.is_set():
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
        if self._state is _State.GROOT and isinstance(self._groot_feed, Groot2Feed):
            self._groot_feed.stop_recording()
        self._close_groot_feed()
        self._groot2_client.close()

    def _collect_events(self) -> None:
        if self._connection_state is None:
            self._report_connection("waiting", f"waiting for the robot at {self.address}")
        for event in self._run_channel_feed.step():
            if isinstance(event, ConnectionEvent):
                self._report_connection(event.state, event.detail)
            else:
                self._events.append(event)
        now = time.monotonic()
        if self._run_channel_feed.is_alive:
            self._state = _State.RUN_CHANNEL
            self._groot_reason = ""
            self._groot2_client.abandon_request()
            self._close_groot_feed()
            if self._connection_state == "lost":
                self._report_connection("connected", f"{self.address} is back")
        elif self._state is _State.RUN_CHANNEL:
            self._start_search(_PAUSE_S)
            if self._connection_state == "connected":
                self._report_connection(
                    "lost", f"no sign of life from {self.address} for {SILENT_AFTER_S:g} s"
                )
        elif self._state is _State.GROOT:
            assert self._groot_feed is not None
            self._read_groot(self._groot_feed)
        elif now >= self._search_at:
            if self._state is _State.ANNOUNCED:
                self._abandon_run_channel()
            self._search(now)

    def _report_connection(self, state: ConnectionState, detail: str) -> None:
        if state != self._connection_state:
            self._connection_state = state
            self._events.append(ConnectionEvent(state, shortened(detail, MAX_DETAIL_CHARS)))

    # Groot's protocols

    def _start_search(self, pause: float) -> None:
        """Find out which protocol the robot has, after *pause* s."""
        self._state = _State.SEARCHING
        self._search_at = time.monotonic() + pause

    def _search(self, now: float) -> None:
        """Request the tree, or process the reply."""
        if not self._groot2_client.is_reply_pending:
            self._groot2_client.send_request(Request.FULLTREE)
            return
        try:
            reply = self._groot2_client.receive_reply()
            if reply is None:
                return
            self._use_groot(reply.body, read_fulltree(reply.body, reply.tree_id), now)
        except Groot1DetectedError as detected:
            self._use_groot(detected.reply, None, now)
        except (NoReplyError, ProtocolError) as error:
            self._lose_robot(error)

    def _use_groot(self, reply: bytes, tree: ObservedTree | None, now: float) -> None:
        """Follow *tree* by Groot 2 (None: by Groot 1), unless *reply* announces a run channel."""
        if not reply.endswith(run_channel.ANNOUNCEMENT):
            self._groot_reason = ""
        elif not self._groot_reason:
            self._state = _State.ANNOUNCED
            self._search_at = now + ANNOUNCED_RUN_CHANNEL_WAIT_S
            return
        self._state = _State.GROOT
        client, feed = self._groot2_client, self._groot_feed
        if tree is None and not isinstance(feed, Groot1Feed):
            self._groot_feed = Groot1Feed(client)
        elif tree is not None and not (isinstance(feed, Groot2Feed) and feed.tree.tree_id == tree.tree_id):
            self._close_groot_feed()
            self._groot_feed = Groot2Feed(client, tree, self._blackboard_rate, self._record)
        elif feed is not None:
            feed.resume()

    def _abandon_run_channel(self) -> None:
        """Use Groot's protocol, although the robot has announced a run channel."""
        self._state = _State.SEARCHING
        port = self.address.at(run_channel.PORT_OFFSET)
        self._groot_reason = f", because there is no reply from its run channel, {port}"
        # If the run channel connects later, it begins with the tree.
        self._run_channel_client.reset()

    def _read_groot(self, feed: Groot1Feed | Groot2Feed) -> None:
        try:
            events = feed.step()
        except TreeReplacedError:
            self._start_search(_PAUSE_S)
        except (NoReplyError, ProtocolError) as error:
            self._lose_robot(error)
        else:
            if feed.is_following:
                self._report_connection("connected", f"{feed}{self._groot_reason}")
            self._events += events

    def _lose_robot(self, error: NoReplyError | ProtocolError) -> None:
        is_invalid = isinstance(error, ProtocolError)
        self._start_search(_PAUSE_AFTER_ERROR_S if is_invalid else 0.0)
        # A robot that has not answered yet may be starting.
        if self._connection_state == "connected" or is_invalid:
            self._report_connection("lost", str(error))

    @property
    def _is_behind(self) -> bool:
        return (
            self._state is _State.GROOT
            and isinstance(self._groot_feed, Groot2Feed)
            and self._groot_feed.is_behind
        )

    def _close_groot_feed(self) -> None:
        if isinstance(self._groot_feed, Groot1Feed):
            self._groot_feed.close()
        self._groot_feed = None

    def _wait(self, seconds: float) -> None:
        poller = zmq.Poller()
        poller.register(self._run_channel_client.socket, zmq.POLLIN)
        if self._groot2_client.is_reply_pending:
            poller.register(self._groot2_client.socket, zmq.POLLIN)
        elif self._state in (_State.SEARCHING, _State.ANNOUNCED):
            seconds = min(seconds, self._search_at - time.monotonic())
        feed = self._groot_feed if self._state is _State.GROOT else None
        if isinstance(feed, Groot1Feed):
            for socket in feed.sockets:
                poller.register(socket, zmq.POLLIN)
        if feed is not None:
            seconds = min(seconds, feed.next_step_at - time.monotonic())
        # At least 1 ms: poll(0) would make the loop in poll() occupy the processor.
        poller.poll(max(1, round(1000 * seconds)))
