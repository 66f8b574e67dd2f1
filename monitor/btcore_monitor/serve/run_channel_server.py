"""A server of the run channel. It converts queued items to messages, and uses no sockets."""

import io
import logging
import time
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

from btcore.status import Status
from btcore_monitor.serve.blackboards import to_portable_board
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
    HEARTBEAT_TOPIC,
    PRESENCE_TOPIC,
    REQUEST_TOPIC,
    STREAM_TOPIC,
    TREE_REQUEST,
    BlackboardMessage,
    EndMessage,
    ExceptionMessage,
    HeartbeatMessage,
    Message,
    MovingSceneMessage,
    PieceMessage,
    StaticSceneMessage,
    StreamMessage,
    TransitionRow,
    TransitionsMessage,
    TreeMessage,
    decode,
    encode,
)
from btcore_scene import MovingScene, Picture, StaticScene

_MAX_TRANSITIONS: Final = 5_000
_JPEG_QUALITY: Final = 80
_MAX_WARNINGS: Final = 20

_log = logging.getLogger("monitor")

Frames = tuple[bytes, bytes]


MAX_BUFFER_BYTES: Final = {TransitionsMessage.kind: 32 << 20, "moving": 24 << 20, "blackboard": 8 << 20}
"""Maximum bytes per buffer, by a kind of message. Kinds that are not listed are in the buffer `transitions`.

Measured: a transition takes about 30 bytes, so about a million are kept."""

MAX_PIECE_BYTES: Final = 1 << 20
"""Bytes after which a piece ends."""

_MAX_PIECE_NUMBERS: Final = 20_000
"""Maximum message numbers in a piece, including messages that are no longer kept."""


class History:
    """The encoded messages of the stream so far, for clients that connect late or missed messages.

    Buffers separate the kinds of messages, so that large scenes do not displace transitions. Each buffer has
    a maximum size in bytes, and always keeps its newest message.

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
        buffer = kind if kind in self._buffers else TransitionsMessage.kind
        seqs = self._buffers[buffer]
        self._messages[self.latest_seq] = data
        seqs.append(self.latest_seq)
        self._buffer_bytes[buffer] += len(data)
        # The newest message stays, even if it alone needs more room than its buffer has.
        while self._buffer_bytes[buffer] > MAX_BUFFER_BYTES[buffer] and len(seqs) > 1:
            seq = seqs.popleft()
            removed = self._messages.pop(seq)
            self._buffer_bytes[buffer] -= len(removed)
            if buffer == TransitionsMessage.kind:
                self._apply(removed)
                self.oldest_seq = seqs[0]

    def _apply(self, data: bytes) -> None:
        """Apply the transitions of a removed message to the statuses before the oldest message."""
        message = decode(data)
        if isinstance(message, TransitionsMessage):
            self.stamp, self.wall = message.stamp, message.wall
            for row in message.transitions:
                self.statuses[row.uid] = row.status

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


class RunChannelServer:
    """Creates the stream of messages about one tree, and replies to requests for past messages.

    Only the publisher's thread may use it.
    """

    def __init__(
        self, tree_id: str, xml: bytes, static: StaticScene | None, statuses: dict[int, int], stamp: int
    ) -> None:
        self.tree_id = tree_id
        self.dropped_transitions = 0
        """Transitions that were lost because the queue to this thread was full."""
        self.client_tokens: set[bytes] = set()
        """Tokens of the connected clients."""
        self._xml = xml
        self.history = History(statuses, stamp, time.time_ns())
        self._sent_seq = 0
        self._warned: set[str] = set()
        # Encoded now, on the tick thread: the robot may change its objects later.
        self._static_scene_data = (
            None if static is None else self._try_encode(StaticSceneMessage(tree_id, static))
        )
        self._next_number: int | None = None
        self._first_number = 0
        self._transitions: list[TransitionRow] = []

    def add_item(self, item: QueueItem) -> None:
        """Add *item* to the stream."""
        if isinstance(item, TransitionItem):
            self._buffer_transition(item)
            return
        if isinstance(item, TickItem):
            self._add_buffered(
                item.tick, item.stamp, item.wall, item.duration_ns, int(item.status), ended=True
            )
            return
        self.flush()
        head = self.tree_id, self.history.latest_seq + 1, item.stamp, item.wall
        if isinstance(item, BlackboardItem):
            boards = {path: to_portable_board(board) for path, board in item.boards.items()}
            self._add_message(BlackboardMessage(*head, boards))
        elif isinstance(item, MovingSceneItem):
            self._add_message(MovingSceneMessage(*head, self._convert_pictures(item.data)))
        elif isinstance(item, ExceptionItem):
            self._add_message(ExceptionMessage(*head, item.path, item.message))
        elif isinstance(item, EndItem):
            self._add_message(EndMessage(*head, int(item.status), self.dropped_transitions))

    def flush(self) -> None:
        """Add a message with the transitions of an unfinished tick, so that clients show them early."""
        if self._transitions:
            last = self._transitions[-1]
            self._add_buffered(last.tick, last.stamp, last.wall, 0, int(Status.IDLE), ended=False)

    def take_pending_frames(self) -> Iterator[Frames]:
        """Yield the messages since the last call, in few large pieces.

        After each call of ZeroMQ this thread waits for the interpreter's lock: up to 5 ms (Python's switch
        interval) while the tick thread computes. So few large messages are faster than many small messages.
        """
        while self._sent_seq < self.history.latest_seq:
            piece = self.history.create_piece(self.tree_id, self._sent_seq + 1)
            self._sent_seq = piece.last
            yield STREAM_TOPIC, encode(piece)

    def _buffer_transition(self, item: TransitionItem) -> None:
        number, stamp, tick, uid, previous, status = item.transition
        # A message's transitions have consecutive numbers, so a gap starts a new message.
        if self._next_number is not None and number != self._next_number:
            self.flush()
            self.dropped_transitions += number - self._next_number
        if len(self._transitions) >= _MAX_TRANSITIONS:
            self.flush()
        if not self._transitions:
            self._first_number = number
        self._next_number = number + 1
        self._transitions.append(TransitionRow(stamp, item.wall, tick, uid, int(previous), int(status)))

    def _add_buffered(
        self, tick: int, stamp: int, wall: int, duration_ns: int, status: int, *, ended: bool
    ) -> None:
        transitions, self._transitions = self._transitions, []
        first = self._first_number if transitions else (self._next_number or 0)
        head = self.tree_id, self.history.latest_seq + 1, stamp, wall
        self._add_message(TransitionsMessage(*head, tick, duration_ns, status, ended, first, transitions))

    def _add_message(self, message: StreamMessage) -> None:
        data = self._try_encode(message)
        if data is not None:
            self.history.add(message.kind, data)

    def _try_encode(self, message: Message) -> bytes | None:
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

    def _warn_once(self, data_name: str, error: Exception) -> None:
        if data_name not in self._warned and len(self._warned) < _MAX_WARNINGS:
            self._warned.add(data_name)
            _log.warning("%s can't be sent and is left out: %r", data_name, error)

    def create_heartbeat(self) -> Frames:
        """Return the frames of a heartbeat."""
        return HEARTBEAT_TOPIC, encode(HeartbeatMessage(self.tree_id, self.history.latest_seq))

    def process_subscription(self, frame: bytes) -> Iterator[Frames]:
        """Yield the replies to a subscription, the *frame* that an XPUB socket received."""
        # Byte 0 is 1 for a new subscription and 0 for its end. ZeroMQ also reports the end when a client
        # disconnects, so the presence topics count the connected clients.
        subscribes, topic = frame[:1] == b"\x01", frame[1:]
        parts = topic.split(b"/")
        if parts[0] == PRESENCE_TOPIC and len(parts) == 2:
            (self.client_tokens.add if subscribes else self.client_tokens.discard)(parts[1])
        elif parts[0] == REQUEST_TOPIC and subscribes and len(parts) >= 2:
            yield from self._create_reply(parts[1], topic)

    def create_tree_frames(self) -> Iterator[Frames]:
        """Yield the messages about this tree for clients of the previous tree."""
        return self._create_reply(TREE_REQUEST, STREAM_TOPIC)

    def _create_reply(self, request: bytes, topic: bytes) -> Iterator[Frames]:
        if request == TREE_REQUEST:
            history = self.history
            seqs = history.oldest_seq, history.latest_seq
            tree = TreeMessage(self.tree_id, history.stamp, history.wall, self._xml, *seqs, history.statuses)
            yield topic, encode(tree)
            if self._static_scene_data is not None:
                yield topic, self._static_scene_data
        elif request.isdigit() and len(request) < 19:  # fits into 64 bits
            yield topic, encode(self.history.create_piece(self.tree_id, int(request)))


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
