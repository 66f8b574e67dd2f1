"""The stream so far, encoded, for clients that come late or missed something.

Lanes keep the kinds apart, so that scenes, which are big, don't push transitions out. Each
lane has room for a number of bytes, and always keeps its newest message.
"""

from collections import deque
from typing import Final

from btcore_monitor.wire.scene_channel import PieceMessage, TicksMessage, decode

LANE_ROOM: Final = {"ticks": 32 << 20, "moving": 24 << 20, "blackboard": 8 << 20}
"""Bytes per lane. Measured: a transition takes some 30 bytes, so a million are kept."""

PIECE_AT_MOST: Final = 1 << 20
"""Bytes of one piece."""

_NUMBERS_AT_MOST: Final = 20_000
"""Numbers in one piece, of which some may be gone."""


class History:
    """Messages by number. *statuses*, *stamp* and *wall* tell how the tree stood before the oldest."""

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
        """Keep the encoded message number ``latest + 1``; the oldest of its lane may have to go."""
        self.latest += 1
        lane = kind if kind in self._lanes else "ticks"
        numbers = self._lanes[lane]
        self._data[self.latest] = data
        numbers.append(self.latest)
        self._used[lane] += len(data)
        while self._used[lane] > LANE_ROOM[lane] and len(numbers) > 1:
            number = numbers.popleft()
            gone = self._data.pop(number)
            self._used[lane] -= len(gone)
            if lane == "ticks":
                self._forget(gone)
                self.oldest = numbers[0]

    def _forget(self, data: bytes) -> None:
        message = decode(data)
        if isinstance(message, TicksMessage):
            self.stamp, self.wall = message.stamp, message.wall
            for row in message.transitions:
                self.statuses[row[3]] = row[5]

    def piece(self, tree_id: str, first: int) -> PieceMessage:
        """What is kept from number *first* on, up to about PIECE_AT_MOST bytes."""
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
