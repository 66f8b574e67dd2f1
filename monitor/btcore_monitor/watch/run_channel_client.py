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

_MAX_REQUESTS: Final = 8
"""Maximum requests of a kind at a time. Their replies may be late: on a busy machine, or because other
clients of the robot send requests, too."""

_RETRY_AFTER_S: Final = 2.0
_MAX_FRAMES_PER_READ: Final = 500
_MAX_BYTES_PER_READ: Final = 2 << 20
_RECONNECT_MS: Final = 100

Socket = zmq.Socket[bytes]
Received = Message | ProtocolError
"""A message, or the error of an invalid message."""


class _Requests:
    """The requests of one kind that a client has sent by *socket*.

    A client sends a request by subscribing to a topic. A token makes the topic unique, so no other client
    receives the reply.
    """

    def __init__(self, socket: Socket) -> None:
        self.topics: list[bytes] = []
        """Topics of the requests, the oldest first. A reply without a subscription would be discarded."""
        self._socket = socket
        self._sent_at = 0.0

    def is_late(self) -> bool:
        """Return whether the reply to the last request is so late that the request should be repeated."""
        return time.monotonic() - self._sent_at >= _RETRY_AFTER_S

    def send(self, request: bytes) -> None:
        """Send a request. Earlier requests stay, except the oldest of too many."""
        self.end(keep=_MAX_REQUESTS - 1)
        self.topics.append(b"%s/%s/%s" % (run_channel.REQUEST_TOPIC, request, _create_token()))
        self._sent_at = time.monotonic()
        self._socket.subscribe(self.topics[-1])

    def end(self, keep: int = 0) -> None:
        """End all requests except the last *keep* requests."""
        while len(self.topics) > keep:
            self._socket.unsubscribe(self.topics.pop(0))


class RunChannelClient:
    """Receives the stream of the btcore robot at *address*, in order. Use it from one thread.

    *keys* are the keys of the client, if the robot requires keys.
    """

    def __init__(self, address: Address, keys: ClientKeys | None = None) -> None:
        self.address = address
        self.tree_id = ""
        """The ID of the current tree; empty until a tree is known."""
        self.last_message_at = 0.0
        """When the last message arrived (monotonic s); 0: never."""
        self._next_seq = 1
        self._latest_seq = 0
        # Pieces that arrived too early, by their first number.
        self._early_pieces: dict[int, PieceMessage] = {}
        self._early_bytes = 0
        self._presence_topic = b""
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
        self._tree_requests = _Requests(self.socket)
        self._missing_requests = _Requests(self.socket)
        self._tree_requests.send(run_channel.TREE_REQUEST)
        self._subscribe_presence()
        self.socket.connect(address.at(run_channel.PORT_OFFSET))

    def read(self) -> list[Received]:
        """Return the new messages without waiting, in the robot's order, each message exactly once.

        The list has the error of an invalid message in its place.
        """
        received: list[Received] = []
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
                received.append(error)
        self._request_missing()
        return received

    def reset(self) -> None:
        """Forget the tree and request it again. The stream then begins with the oldest message."""
        self.tree_id = ""
        self._early_pieces.clear()
        self._early_bytes = 0
        self._tree_requests.send(run_channel.TREE_REQUEST)

    def close(self) -> None:
        """Free the socket."""
        self._context.destroy()

    def _subscribe_presence(self) -> None:
        if not self._presence_topic:
            # The robot counts these subscriptions as its clients, and waits for them when it closes.
            self._presence_topic = b"%s/%s" % (run_channel.PRESENCE_TOPIC, _create_token())
            self.socket.subscribe(self._presence_topic)

    def _process(self, message: Message, received: list[Received]) -> None:
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
            if isinstance(message, HeartbeatMessage) and self.tree_id and self._tree_requests.is_late():
                self._tree_requests.send(run_channel.TREE_REQUEST)
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
            self._missing_requests.end()
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
        self._missing_requests.end()
        self._subscribe_presence()
        # The last request stays: after a reconnection ZeroMQ subscribes again, and the reply shows whether
        # the robot has another tree.
        self._tree_requests.end(keep=1)

    def _store_early_piece(self, piece: PieceMessage) -> None:
        size = _count_bytes(piece)
        if piece.first not in self._early_pieces and self._early_bytes + size <= MAX_EARLY_BYTES:
            self._early_pieces[piece.first] = piece
            self._early_bytes += size

    def _read_piece(self, piece: PieceMessage, received: list[Received]) -> None:
        """Decode the messages of *piece* from the number `_next_seq` on."""
        for data in piece.messages:
            try:
                message = run_channel.decode(data)
            except ProtocolError as error:
                received.append(error)
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
        requests = self._missing_requests
        is_missing = bool(self.tree_id) and self._next_seq <= self._latest_seq
        if is_missing and (not requests.topics or requests.is_late()):
            requests.send(b"%d" % self._next_seq)


def _count_bytes(piece: PieceMessage) -> int:
    """Return the approximate memory of *piece* in bytes; its objects take memory, too."""
    return 500 + sum(100 + len(data) for data in piece.messages)


def _create_token() -> bytes:
    return uuid.uuid4().hex[:16].encode()
