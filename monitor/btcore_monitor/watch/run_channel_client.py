"""A client of a btcore robot's run channel, which requests missing messages of the stream again.

Every message of the stream has a number. A piece of the stream that arrives too early waits, and the client
requests the missing messages from the robot's history. Only messages that the history no longer holds are
lost.

A robot may send faster than the caller processes the messages. So waiting pieces stay encoded, and take a
limited number of bytes; further pieces are dropped, and requested again later.
"""

import time
import uuid
from typing import Final

import zmq

from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address
from btcore_monitor.wire import run_channel
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.run_channel import (
    EndMessage,
    HeartbeatMessage,
    Message,
    PieceMessage,
    StaticSceneMessage,
    StreamMessage,
    TreeMessage,
    UnknownMessage,
)

MAX_EARLY_BYTES: Final = 4 << 20
"""Maximum bytes of pieces that arrived too early."""

_MAX_MESSAGE_BYTES: Final = 32 << 20
"""Maximum bytes of a message, because the other program may not be a robot."""

_MAX_TREE_REQUESTS: Final = 8
_MAX_REQUESTS: Final = 8
"""Maximum requests for missing messages at a time. Their replies may be late: on a busy machine, or because
other clients of the robot send requests, too."""

_RETRY_AFTER_S: Final = 2.0
_MAX_FRAMES_PER_READ: Final = 500
_MAX_BYTES_PER_READ: Final = 2 << 20
_RECONNECT_MS: Final = 100

Socket = zmq.Socket[bytes]


class RunChannelClient:
    """Receives the stream of the btcore robot at *address*, in order. Use it from one thread.

    *keys* are the keys of the client, if the robot requires keys.
    """

    def __init__(self, address: Address, keys: ClientKeys | None = None) -> None:
        self.tree_id = ""
        """The ID of the current tree; empty until a tree is known."""
        self.last_message_at = 0.0
        """When the last message arrived (monotonic s); 0: never."""
        self.last_error = ""
        """Why the last invalid message could not be decoded; empty without one."""
        self.error_count = 0
        """The number of messages that could not be decoded."""
        self._next_seq = 1
        self._latest_seq = 0
        # Pieces that arrived too early, by their first number.
        self._early_pieces: dict[int, PieceMessage] = {}
        self._early_bytes = 0
        self._request_topics: list[bytes] = []
        self._requested_at = 0.0
        self._presence_topic = b""
        self._tree_topics: list[bytes] = []
        self._tree_requested_at = 0.0
        self._context: zmq.Context[Socket] = zmq.Context()
        self.socket = self._context.socket(zmq.SUB)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.RCVHWM, _MAX_FRAMES_PER_READ),
            (zmq.MAXMSGSIZE, _MAX_MESSAGE_BYTES),
            (zmq.RECONNECT_IVL, _RECONNECT_MS),
            (zmq.RECONNECT_IVL_MAX, 10 * _RECONNECT_MS),
            *((getattr(zmq, name), value) for name, value in run_channel.KEEPALIVE.items()),
        ):
            self.socket.setsockopt(option, value)
        if keys is not None:
            keys.secure(self.socket)
        self.socket.subscribe(run_channel.STREAM_TOPIC)
        self.socket.subscribe(run_channel.HEARTBEAT_TOPIC)
        self._request_tree()
        self._subscribe_presence()
        self.socket.connect(address.at(run_channel.PORT_OFFSET))

    def read(self) -> list[Message]:
        """Return the new messages without waiting, in the robot's order, each message exactly once."""
        received: list[Message] = []
        size = 0
        for _ in range(_MAX_FRAMES_PER_READ):
            # The caller processes these messages before the others are decoded.
            if size > _MAX_BYTES_PER_READ:
                break
            try:
                frames = self.socket.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                break
            if len(frames) != 2:
                continue
            size += len(frames[1])
            try:
                self._process(run_channel.decode(frames[1]), received)
                self.last_message_at = time.monotonic()
            except ProtocolError as error:
                self.last_error = str(error)
                self.error_count += 1
        self._request_missing()
        return received

    def reset(self) -> None:
        """Forget the tree and request it again. The stream then begins with the oldest message."""
        self.tree_id = ""
        self._early_pieces.clear()
        self._early_bytes = 0
        self._request_tree()

    def close(self) -> None:
        """Free the socket."""
        self._context.destroy()

    def _subscribe_presence(self) -> None:
        if not self._presence_topic:
            # The robot counts these subscriptions as its clients, and waits for them when it closes.
            self._presence_topic = b"%s/%s" % (run_channel.PRESENCE_TOPIC, _create_token())
            self.socket.subscribe(self._presence_topic)

    def _request_tree(self) -> None:
        """Request the tree."""
        # The subscription stays: after a reconnection ZeroMQ subscribes again, and the reply shows whether
        # the robot has another tree.
        if len(self._tree_topics) >= _MAX_TREE_REQUESTS:
            self.socket.unsubscribe(self._tree_topics.pop(0))
        self._tree_topics.append(_create_request_topic(run_channel.TREE_REQUEST))
        self._tree_requested_at = time.monotonic()
        # A client sends a request by subscribing. The token makes the topic unique, so no other client
        # receives the reply.
        self.socket.subscribe(self._tree_topics[-1])

    def _process(self, message: Message, received: list[Message]) -> None:
        if isinstance(message, TreeMessage):
            if message.tree_id != self.tree_id:
                # The robot no longer replies about the previous tree, so its missing messages are lost.
                for first in sorted(self._early_pieces):
                    self._read_piece(self._early_pieces[first], received)
                self._begin_tree(message)
                received.append(message)
            return
        if message.tree_id != self.tree_id:
            # The TreeMessage of this tree has not arrived yet, or was lost.
            waited = time.monotonic() - self._tree_requested_at
            if isinstance(message, HeartbeatMessage) and self.tree_id and waited >= _RETRY_AFTER_S:
                self._request_tree()
            return
        if isinstance(message, StaticSceneMessage):
            received.append(message)
        elif isinstance(message, HeartbeatMessage):
            self._latest_seq = max(self._latest_seq, message.latest)
        elif isinstance(message, PieceMessage):
            self._latest_seq = max(self._latest_seq, message.latest)
            if message.first > self._next_seq:
                self._store_early_piece(message)
                return
            self._end_requests()
            self._read_piece(message, received)
            while (first := min(self._early_pieces, default=self._next_seq + 1)) <= self._next_seq:
                piece = self._early_pieces.pop(first)
                self._early_bytes -= _count_bytes(piece)
                self._read_piece(piece, received)

    def _begin_tree(self, message: TreeMessage) -> None:
        self.tree_id = message.tree_id
        self._next_seq = message.oldest
        self._latest_seq = message.latest
        self._early_pieces.clear()
        self._early_bytes = 0
        self._end_requests()
        self._subscribe_presence()
        for topic in self._tree_topics[:-1]:
            self.socket.unsubscribe(topic)
        del self._tree_topics[:-1]

    def _store_early_piece(self, piece: PieceMessage) -> None:
        size = _count_bytes(piece)
        if piece.first not in self._early_pieces and self._early_bytes + size <= MAX_EARLY_BYTES:
            self._early_pieces[piece.first] = piece
            self._early_bytes += size

    def _read_piece(self, piece: PieceMessage, received: list[Message]) -> None:
        """Decode the messages of *piece* from the number `_next_seq` on."""
        for data in piece.messages:
            try:
                message = run_channel.decode(data)
            except ProtocolError as error:
                self.last_error = str(error)
                self.error_count += 1
                continue
            if not isinstance(message, StreamMessage | UnknownMessage):
                continue
            if not self._next_seq <= message.seq <= piece.last:
                continue
            self._next_seq = message.seq + 1
            if isinstance(message, UnknownMessage):
                continue
            received.append(message)
            if isinstance(message, EndMessage) and self._presence_topic:
                # A closing robot waits for clients that still hold this subscription.
                self.socket.unsubscribe(self._presence_topic)
                self._presence_topic = b""
        # Messages in the range of the piece that the piece does not contain are lost.
        self._next_seq = max(self._next_seq, piece.last + 1)

    def _request_missing(self) -> None:
        """Request missing messages, unless a reply is pending."""
        if not self.tree_id or self._next_seq > self._latest_seq:
            return
        now = time.monotonic()
        if self._request_topics and now - self._requested_at < _RETRY_AFTER_S:
            return
        # Earlier requests stay, because a reply without a subscription would be discarded.
        if len(self._request_topics) >= _MAX_REQUESTS:
            self.socket.unsubscribe(self._request_topics.pop(0))
        self._request_topics.append(_create_request_topic(b"%d" % self._next_seq))
        self._requested_at = now
        self.socket.subscribe(self._request_topics[-1])

    def _end_requests(self) -> None:
        for topic in self._request_topics:
            self.socket.unsubscribe(topic)
        self._request_topics.clear()


def _count_bytes(piece: PieceMessage) -> int:
    """Return the approximate memory of *piece* in bytes; its objects take memory, too."""
    return 500 + sum(100 + len(data) for data in piece.messages)


def _create_request_topic(request: bytes) -> bytes:
    return b"%s/%s/%s" % (run_channel.REQUEST_TOPIC, request, _create_token())


def _create_token() -> bytes:
    return uuid.uuid4().hex[:16].encode()
