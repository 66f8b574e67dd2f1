"""Our tree speaks on the scene channel: queued items in, messages out, no sockets."""

import logging
import time
from collections.abc import Iterator
from typing import Final

from btcore.status import Status
from btcore_monitor.serve.blackboards import portable_board
from btcore_monitor.serve.history import History
from btcore_monitor.serve.jpeg import with_jpeg
from btcore_monitor.serve.queueing_observer import (
    BoardsChanged,
    Finished,
    Item,
    NodeException,
    SceneTaken,
    StampedTransition,
    TickEnded,
)
from btcore_monitor.wire.scene_channel import (
    ALIVE,
    STREAM,
    AliveMessage,
    BlackboardMessage,
    EndMessage,
    Message,
    MovingMessage,
    RaisedMessage,
    StaticMessage,
    StreamMessage,
    TicksMessage,
    TreeMessage,
    encode,
)
from btcore_scene import StaticScene

_ROWS_AT_MOST: Final = 5_000

_log = logging.getLogger("monitor")

Frames = tuple[bytes, bytes]


class SceneServer:
    """Makes the stream of one tree and answers who asks for its past. Belongs to the publisher's thread."""

    def __init__(
        self, tree_id: str, xml: bytes, static: StaticScene | None, statuses: dict[int, int], stamp: int
    ) -> None:
        self.tree_id = tree_id
        self.dropped = 0
        """Transitions that fell out of the full queue."""
        self.clients: set[bytes] = set()
        """Tokens of the clients that are here."""
        self._xml = xml
        self.history = History(statuses, stamp, time.time_ns())
        self._sent = 0
        self._complained = False
        # Encoded at once, on the thread that ticks: nobody else may look into it later.
        self._static = None if static is None else self._encoded(StaticMessage(tree_id, static))
        self._expected: int | None = None
        self._first = 0
        self._rows: list[list[int]] = []

    def put(self, item: Item) -> None:
        """Take *item* into the stream."""
        if isinstance(item, StampedTransition):
            self._put_transition(item)
            return
        if isinstance(item, TickEnded):
            self._flush(item.tick, item.stamp, item.wall, item.duration, int(item.status), True)
            return
        self.flush()
        seq = self.history.latest + 1
        if isinstance(item, BoardsChanged):
            boards = {path: portable_board(board) for path, board in item.boards.items()}
            self._add(BlackboardMessage(self.tree_id, seq, item.stamp, item.wall, boards))
        elif isinstance(item, SceneTaken):
            self._add(MovingMessage(self.tree_id, seq, item.stamp, item.wall, with_jpeg(item.data)))
        elif isinstance(item, NodeException):
            self._add(RaisedMessage(self.tree_id, seq, item.stamp, item.wall, item.path, item.message))
        elif isinstance(item, Finished):
            status = int(item.status)
            self._add(EndMessage(self.tree_id, seq, item.stamp, item.wall, status, self.dropped))

    def flush(self) -> None:
        """End a message with the transitions of a tick that goes on: they are shown before it ends."""
        if self._rows:
            stamp, wall, tick = self._rows[-1][:3]
            self._flush(tick, stamp, wall, 0, int(Status.IDLE), False)

    def pending_frames(self) -> Iterator[Frames]:
        """What is to be sent since the last call, in few big pieces.

        Each call of ZMQ waits for the interpreter's lock, up to 5 ms if the tree computes.
        """
        while self._sent < self.history.latest:
            piece = self.history.piece(self.tree_id, self._sent + 1)
            self._sent = piece.last
            yield STREAM, encode(piece)

    def _put_transition(self, item: StampedTransition) -> None:
        change = item.change
        if self._expected is not None and change.number != self._expected:
            self.flush()
            self.dropped += change.number - self._expected
        if len(self._rows) >= _ROWS_AT_MOST:
            self.flush()
        if not self._rows:
            self._first = change.number
        self._expected = change.number + 1
        self._rows.append(
            [change.stamp, item.wall, change.tick, change.uid, int(change.previous), int(change.status)]
        )

    def _flush(self, tick: int, stamp: int, wall: int, duration: int, status: int, ended: bool) -> None:
        rows, self._rows = self._rows, []
        first = self._first if rows else (self._expected or 0)
        seq = self.history.latest + 1
        self._add(TicksMessage(self.tree_id, seq, stamp, wall, tick, duration, status, ended, first, rows))

    def _add(self, message: StreamMessage) -> None:
        data = self._encoded(message)
        if data is not None:
            self.history.add(message.kind, data)

    def _encoded(self, message: Message) -> bytes | None:
        try:
            return encode(message)
        except (TypeError, ValueError, LookupError, OverflowError, RecursionError) as error:
            # a scene may hold anything; one that can't be sent must not silence the rest
            if not self._complained:
                self._complained = True
                _log.warning("a '%s' message can't be sent and is left out: %r", message.kind, error)
            return None

    def alive(self) -> Frames:
        """A sign of life."""
        return ALIVE, encode(AliveMessage(self.tree_id, self.history.latest))

    def subscription(self, frame: bytes) -> Iterator[Frames]:
        """Answers to a subscription (the frame that an XPUB socket received)."""
        begins, topic = frame[:1] == b"\x01", frame[1:]
        parts = topic.split(b"/")
        if parts[0] == b"here" and len(parts) == 2:
            (self.clients.add if begins else self.clients.discard)(parts[1])
        elif parts[0] == b"again" and begins and len(parts) >= 2:
            yield from self._again(parts[1], topic)

    def introduction(self) -> Iterator[Frames]:
        """The tree, for clients that listened to another one here."""
        return self._again(b"tree", STREAM)

    def _again(self, what: bytes, topic: bytes) -> Iterator[Frames]:
        if what == b"tree":
            past = self.history
            yield (
                topic,
                encode(
                    TreeMessage(
                        self.tree_id,
                        past.stamp,
                        past.wall,
                        self._xml,
                        past.oldest,
                        past.latest,
                        past.statuses,
                    )
                ),
            )
        if what in (b"tree", b"static"):
            if self._static is not None:
                yield topic, self._static
        elif what.isdigit() and len(what) < 19:
            yield topic, encode(self.history.piece(self.tree_id, int(what)))
