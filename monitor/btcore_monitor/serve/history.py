"""The encoded messages of the stream so far, for clients that connect late or missed messages.

Buffers separate the kinds of messages, so that large scenes do not displace transitions. Each buffer has a
maximum size in bytes, and always keeps its newest message.
"""

from collections import deque
from typing import Final

from btcore_monitor.wire.run_channel import PieceMessage, TransitionsMessage, decode

MAX_BUFFER_BYTES: Final = {"ticks": 32 << 20, "moving": 24 << 20, "blackboard": 8 << 20}
"""Maximum bytes per buffer, by a kind of message. The buffer `ticks` also has the kinds that are not listed.

Measured: a transition takes about 30 bytes, so about a million are kept."""

MAX_PIECE_BYTES: Final = 1 << 20
"""Bytes after which a piece ends."""

_MAX_PIECE_NUMBERS: Final = 20_000
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
        self.oldest_seq = 1
        self.latest_seq = 0
        self._messages: dict[int, bytes] = {}
        self._buffers: dict[str, deque[int]] = {buffer: deque() for buffer in MAX_BUFFER_BYTES}
        self._buffer_bytes = dict.fromkeys(MAX_BUFFER_BYTES, 0)

    def add(self, kind: str, data: bytes) -> None:
        """Add the encoded message number `latest_seq + 1`. Old messages of a full buffer are removed.

        Args:
            kind: The message's kind, which selects the buffer.
            data: The encoded message.
        """
        self.latest_seq += 1
        buffer = kind if kind in self._buffers else "ticks"
        seqs = self._buffers[buffer]
        self._messages[self.latest_seq] = data
        seqs.append(self.latest_seq)
        self._buffer_bytes[buffer] += len(data)
        # The newest message stays, even if it alone needs more room than its buffer has.
        while self._buffer_bytes[buffer] > MAX_BUFFER_BYTES[buffer] and len(seqs) > 1:
            seq = seqs.popleft()
            removed = self._messages.pop(seq)
            self._buffer_bytes[buffer] -= len(removed)
            if buffer == "ticks":
                self._apply(removed)
                self.oldest_seq = seqs[0]

    def _apply(self, data: bytes) -> None:
        """Apply the transitions of a removed message to the statuses before the oldest message."""
        message = decode(data)
        if isinstance(message, TransitionsMessage):
            self.stamp, self.wall = message.stamp, message.wall
            for row in message.transitions:
                # row: stamp, wall, tick, uid, previous, status
                self.statuses[row[3]] = row[5]

    def create_piece(self, tree_id: str, first: int) -> PieceMessage:
        """Return the kept messages from number *first* on, up to about MAX_PIECE_BYTES bytes.

        Args:
            tree_id: The tree's ID, for the message.
            first: The first message number.
        """
        seq = first = max(first, 1)
        messages: list[bytes] = []
        size = 0
        while seq <= self.latest_seq and size < MAX_PIECE_BYTES and seq - first < _MAX_PIECE_NUMBERS:
            data = self._messages.get(seq)
            if data is not None:
                messages.append(data)
                size += len(data)
            seq += 1
        return PieceMessage(tree_id, first, seq - 1, self.latest_seq, messages)
