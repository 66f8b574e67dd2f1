"""Follow a btcore robot by its run channel."""

import time
from typing import Final

from btcore.suggestions import shortened
from btcore_monitor.events import (
    BlackboardEvent,
    ConnectionEvent,
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
from btcore_monitor.watch.run_channel_client import RunChannelClient
from btcore_monitor.wire import run_channel
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.fulltree import read_fulltree

SILENT_AFTER_S: Final = 3.0
"""Seconds (wall clock) without a heartbeat after which a btcore robot counts as lost."""

REPORT_INTERVAL_S: Final = 5.0
"""Shortest time (s, wall clock) between two reports of invalid messages."""

MAX_DETAIL_CHARS: Final = 500
"""Maximum characters of a text about an error."""


class RunChannelFeed:
    """Converts the messages that *client* receives to events."""

    def __init__(self, client: RunChannelClient) -> None:
        self._client = client
        self._events: list[Event] = []  # those of the present step
        self._next_number: int | None = None
        self._latest_times = (0, 0)
        # Invalid messages that have not been reported yet, and the error of the last.
        self._invalid_count = 0
        self._last_error = ""
        self._reported_at = -REPORT_INTERVAL_S

    @property
    def is_alive(self) -> bool:
        """Whether the robot's tree is known, and messages arrive."""
        silence = time.monotonic() - self._client.last_message_at
        return silence < SILENT_AFTER_S and bool(self._client.tree_id)

    def step(self) -> list[Event]:
        """Read new messages without waiting. Return the new events."""
        self._events = []
        for message in self._client.read():
            self._add_events(message)
        self._report_invalid()
        return self._events

    def _report_invalid(self) -> None:
        """Report invalid messages, at most once in REPORT_INTERVAL_S."""
        now = time.monotonic()
        if self._invalid_count and now - self._reported_at >= REPORT_INTERVAL_S:
            detail = shortened(self._last_error, MAX_DETAIL_CHARS)
            reason = f"{self._invalid_count} invalid, the last because: {detail}"
            self._invalid_count, self._reported_at = 0, now
            stamp, wall = self._latest_times
            self._events.append(MissingDataEvent(stamp, wall, since=stamp, kind="messages", reason=reason))

    def _add_events(self, message: run_channel.Message | ProtocolError) -> None:
        if isinstance(message, run_channel.StreamMessage):
            self._latest_times = message.stamp, message.wall
        if isinstance(message, ProtocolError):
            if self._client.tree_id:
                self._invalid_count += 1
                self._last_error = str(message)
            else:
                self._events.append(ConnectionEvent("lost", str(message)))
        elif isinstance(message, run_channel.TreeMessage):
            try:
                tree = read_fulltree(message.xml, message.tree_id)
            except ProtocolError as error:
                self._events.append(ConnectionEvent("lost", str(error)))
                return
            self._next_number = None
            self._events.append(
                ConnectionEvent("connected", f"{self._client.address}, by btcore's run channel")
            )
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
            self._events.append(ConnectionEvent("ended", f"the run at {self._client.address} is over"))

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
