"""The encoded messages of the stream so far, for clients that connect late or missed messages.

Lanes separate the kinds of messages, so that large scenes do not displace transitions. Each lane has a
maximum size in bytes, and always keeps its newest message.
"""

from collections import deque
from typing import Final

from btcore_monitor.wire.run_channel import PieceMessage, TickMessage, decode

LANE_ROOM: Final = {"ticks": 32 << 20, "moving": 24 << 20, "blackboard": 8 << 20}
"""Maximum bytes per lane. Measured: a transition takes about 30 bytes, so about a million are kept."""

PIECE_AT_MOST: Final = 1 << 20
"""Bytes after which a piece ends."""

_NUMBERS_AT_MOST: Final = 20_000
"""Maximum message numbers in a piece, including messages that are no longer kept."""


class History:
    """Encoded messages by number.

    Args:
        statuses: Statuses by uid before the oldest message.
        stamp: The time of *statuses*, ns of the tree's clock.
        wall: The time of *statuses*, ns since the epoch.
    """

    def __init__(self, statuses: dict[int, int], stamp: int, wall: int) -> None:
        self.statuses = statuses
        self.stamp = stamp
        self.wall = wall
        self.oldest = 1
        self.latest = 0
        self._data: dict[int, bytes] = {}
        self._lanes: dict[str, deque[int]] = {lane: deque() for lane in LANE_ROOM}
        self._used = dict.fromkeys(LANE_ROOM, 0)

    def add(self, kind: str, data: bytes) -> None:
        """Add the encoded message number `latest + 1`. Old messages of a full lane are removed.

        Args:
            kind: The message's kind, which selects the lane.
            data: The encoded message.
        """
        self.latest += 1
        lane = kind if kind in self._lanes else "ticks"
        numbers = self._lanes[lane]
        self._data[self.latest] = data
        numbers.append(self.latest)
        self._used[lane] += len(data)
        # The newest message stays, even if it alone needs more room than its lane has.
        while self._used[lane] > LANE_ROOM[lane] and len(numbers) > 1:
            number = numbers.popleft()
            removed = self._data.pop(number)
            self._used[lane] -= len(removed)
            if lane == "ticks":
                self._apply(removed)
                self.oldest = numbers[0]

    def _apply(self, data: bytes) -> None:
        """Apply the transitions of a removed message to the statuses before the oldest message."""
        message = decode(data)
        if isinstance(message, TickMessage):
            self.stamp, self.wall = message.stamp, message.wall
            for row in message.transitions:
                # row: stamp, wall, tick, uid, previous, status
                self.statuses[row[3]] = row[5]

    def piece(self, tree_id: str, first: int) -> PieceMessage:
        """Return the kept messages from number *first* on, up to about PIECE_AT_MOST bytes.

        Args:
            tree_id: The tree's ID, for the message.
            first: The first message number.
        """
        number = first = max(first, 1)
        messages: list[bytes] = []
        size = 0
        while number <= self.latest and size < PIECE_AT_MOST and number - first < _NUMBERS_AT_MOST:
            data = self._data.get(number)
            if data is not None:
                messages.append(data)
                size += len(data)
            number += 1
        return PieceMessage(tree_id, first, number - 1, self.latest, messages)
