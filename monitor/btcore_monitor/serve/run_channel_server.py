"""A server of the run channel. It converts queued items to messages, and uses no sockets."""

import io
import logging
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from btcore.status import Status
from btcore_monitor.serve.blackboards import portable_board
from btcore_monitor.serve.history import History
from btcore_monitor.serve.queueing_observer import (
    BlackboardItem,
    EndItem,
    ExceptionItem,
    MovingSceneItem,
    QueueItem,
    TickItem,
    TransitionItem,
)
from btcore_monitor.wire.run_channel import (
    ALIVE,
    STREAM,
    BlackboardMessage,
    EndMessage,
    ExceptionMessage,
    HeartbeatMessage,
    Message,
    MovingSceneMessage,
    StaticSceneMessage,
    StreamMessage,
    TickMessage,
    TreeMessage,
    encode,
)
from btcore_scene import MovingScene, Picture, StaticScene

_ROWS_AT_MOST: Final = 5_000
_JPEG_QUALITY: Final = 80
_WARNINGS_AT_MOST: Final = 20

_log = logging.getLogger("monitor")

Frames = tuple[bytes, bytes]


class RunChannelServer:
    """Creates the stream of messages about one tree, and replies to requests for past messages.

    Only the publisher's thread may use it.
    """

    def __init__(
        self, tree_id: str, xml: bytes, static: StaticScene | None, statuses: dict[int, int], stamp: int
    ) -> None:
        self.tree_id = tree_id
        self.dropped = 0
        """Transitions that were lost because the queue to this thread was full."""
        self.clients: set[bytes] = set()
        """Tokens of the connected clients."""
        self._xml = xml
        self.history = History(statuses, stamp, time.time_ns())
        self._sent = 0
        self._warned: set[str] = set()
        # Encoded now, on the tick thread: the robot may change its objects later.
        self._static = None if static is None else self._encode(StaticSceneMessage(tree_id, static))
        self._expected: int | None = None
        self._first = 0
        self._rows: list[list[int]] = []

    def put(self, item: QueueItem) -> None:
        """Add *item* to the stream."""
        if isinstance(item, TransitionItem):
            self._put_transition(item)
            return
        if isinstance(item, TickItem):
            self._flush(item.tick, item.stamp, item.wall, item.duration, int(item.status), True)
            return
        self.flush()
        seq = self.history.latest + 1
        if isinstance(item, BlackboardItem):
            boards = {path: portable_board(board) for path, board in item.boards.items()}
            self._add(BlackboardMessage(self.tree_id, seq, item.stamp, item.wall, boards))
        elif isinstance(item, MovingSceneItem):
            self._add(
                MovingSceneMessage(
                    self.tree_id, seq, item.stamp, item.wall, self._convert_pictures(item.data)
                )
            )
        elif isinstance(item, ExceptionItem):
            self._add(ExceptionMessage(self.tree_id, seq, item.stamp, item.wall, item.path, item.message))
        elif isinstance(item, EndItem):
            status = int(item.status)
            self._add(EndMessage(self.tree_id, seq, item.stamp, item.wall, status, self.dropped))

    def flush(self) -> None:
        """Add a message with the transitions of an unfinished tick, so that clients show them early."""
        if self._rows:
            stamp, wall, tick = self._rows[-1][:3]
            self._flush(tick, stamp, wall, 0, int(Status.IDLE), False)

    def pending_frames(self) -> Iterator[Frames]:
        """Yield the messages since the last call, in few large pieces.

        After each call of ZeroMQ this thread waits for the interpreter's lock: up to 5 ms (Python's switch
        interval) while the tick thread computes. So few large messages are faster than many small messages.
        """
        while self._sent < self.history.latest:
            piece = self.history.piece(self.tree_id, self._sent + 1)
            self._sent = piece.last
            yield STREAM, encode(piece)

    def _put_transition(self, item: TransitionItem) -> None:
        change = item.change
        # A message's transitions have consecutive numbers, so a gap starts a new message.
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
        self._add(TickMessage(self.tree_id, seq, stamp, wall, tick, duration, status, ended, first, rows))

    def _add(self, message: StreamMessage) -> None:
        data = self._encode(message)
        if data is not None:
            self.history.add(message.kind, data)

    def _encode(self, message: Message) -> bytes | None:
        try:
            return encode(message)
        except (TypeError, ValueError, LookupError, OverflowError, RecursionError) as error:
            # A scene's `extra` may hold any object. An invalid scene must not end the whole stream.
            self._warn_once(f"a '{message.kind}' message", error)
            return None

    def _convert_pictures(self, scene: MovingScene) -> MovingScene:
        """Return *scene* with its rgb8 pictures as JPEG. Invalid pictures are left out."""
        if not scene.pictures:
            return scene
        pictures = []
        for picture in scene.pictures:
            try:
                pictures.append(to_jpeg(picture))
            # Pillow raises errors of many kinds.
            except Exception as error:
                self._warn_once(f"the picture '{picture.name}'", error)
        return replace(scene, pictures=pictures)

    def _warn_once(self, what: str, error: Exception) -> None:
        if what not in self._warned and len(self._warned) < _WARNINGS_AT_MOST:
            self._warned.add(what)
            _log.warning("%s can't be sent and is left out: %r", what, error)

    def alive(self) -> Frames:
        """Return the frames of a heartbeat."""
        return ALIVE, encode(HeartbeatMessage(self.tree_id, self.history.latest))

    def subscription(self, frame: bytes) -> Iterator[Frames]:
        """Yield the replies to a subscription, the *frame* that an XPUB socket received."""
        # Byte 0 is 1 for a new subscription and 0 for its end. ZeroMQ also reports the end when a client
        # disconnects, so "here" topics count the connected clients.
        subscribes, topic = frame[:1] == b"\x01", frame[1:]
        parts = topic.split(b"/")
        if parts[0] == b"here" and len(parts) == 2:
            (self.clients.add if subscribes else self.clients.discard)(parts[1])
        elif parts[0] == b"again" and subscribes and len(parts) >= 2:
            yield from self._send_again(parts[1], topic)

    def introduction(self) -> Iterator[Frames]:
        """Yield the messages about this tree for clients of the previous tree."""
        return self._send_again(b"tree", STREAM)

    def _send_again(self, request: bytes, topic: bytes) -> Iterator[Frames]:
        if request == b"tree":
            past = self.history
            tree = TreeMessage(
                self.tree_id, past.stamp, past.wall, self._xml, past.oldest, past.latest, past.statuses
            )
            yield topic, encode(tree)
        if request in (b"tree", b"static"):
            if self._static is not None:
                yield topic, self._static
        elif request.isdigit() and len(request) < 19:  # fits into 64 bits
            yield topic, encode(self.history.piece(self.tree_id, int(request)))


def to_jpeg(picture: Picture) -> Picture:
    """Return *picture* as JPEG if it has the format rgb8 and Pillow is installed, or else unchanged.

    Raises:
        ValueError: The number of bytes is not that of rgb8 pixels.
    """
    if picture.format != "rgb8":
        return picture
    width, height = picture.size
    if len(picture.data) != 3 * width * height:
        raise ValueError(
            f"{width} × {height} rgb8 pixels have {3 * width * height} bytes, not {len(picture.data)}"
        )
    # Imported here, because most robots have no camera.
    try:
        from PIL import Image
    except ImportError:
        return picture
    file = io.BytesIO()
    Image.frombytes("RGB", picture.size, picture.data).save(file, "JPEG", quality=_JPEG_QUALITY)
    return replace(picture, format="jpeg", data=file.getvalue())
