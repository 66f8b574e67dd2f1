"""A client of a btcore robot's scene channel, which requests missing messages of the stream again.

Every message of the stream has a number. A message that arrives too early waits, and the client requests the
missing messages from the robot's history. Only messages that the history no longer holds are lost.
"""

import time
import uuid
from typing import Final

import zmq

from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address
from btcore_monitor.wire import scene_channel as wire
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.scene_channel import (
    AliveMessage,
    EndMessage,
    Message,
    PieceMessage,
    StaticMessage,
    StreamMessage,
    TreeMessage,
    UnknownMessage,
)

_WAITING_AT_MOST: Final = 5_000
"""Maximum stored messages that arrived too early. Further messages are dropped and requested again later."""

_ASK_AGAIN_AFTER: Final = 2.0
_FRAMES_A_TURN: Final = 500
_RECONNECT_MS: Final = 100

Socket = zmq.Socket[bytes]


class SceneClient:
    """Receives the stream of the btcore robot at *address*, in order. Use it from one thread.

    *keys* are the keys of the client, if the robot requires keys.
    """

    def __init__(self, address: Address, keys: ClientKeys | None = None) -> None:
        self.tree_id = ""
        """The ID of the current tree; empty until a tree is known."""
        self.last_message = 0.0
        """When the last message arrived (monotonic s); 0: never."""
        self.error = ""
        """Why the last message could not be decoded; empty if it was decoded."""
        self.errors = 0
        """The number of messages that could not be decoded."""
        self._next = 1
        self._latest = 0
        self._lost_up_to = 0
        self._waiting: dict[int, StreamMessage | UnknownMessage] = {}
        self._request_topic = b""
        self._requested_at = 0.0
        self._presence_topic = b""
        self._tree_topics: list[bytes] = []
        self._tree_requested_at = 0.0
        self._context: zmq.Context[Socket] = zmq.Context()
        self.socket = self._context.socket(zmq.SUB)
        for option, value in (
            (zmq.LINGER, 0),
            (zmq.RCVHWM, _WAITING_AT_MOST),
            (zmq.RECONNECT_IVL, _RECONNECT_MS),
            (zmq.RECONNECT_IVL_MAX, 10 * _RECONNECT_MS),
            *((getattr(zmq, name), value) for name, value in wire.KEEPALIVE.items()),
        ):
            self.socket.setsockopt(option, value)
        if keys is not None:
            keys.secure(self.socket)
        self.socket.subscribe(wire.STREAM)
        self.socket.subscribe(wire.ALIVE)
        self._request_tree()
        self._register()
        self.socket.connect(address.at(wire.PORT_OFFSET))

    def read(self) -> list[Message]:
        """Return the new messages without waiting, in the robot's order, each message exactly once."""
        received: list[Message] = []
        for _ in range(_FRAMES_A_TURN):
            try:
                frames = self.socket.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                break
            if len(frames) != 2:
                continue
            try:
                self._process(wire.decode(frames[1]), received)
                self.last_message = time.monotonic()
            except ProtocolError as error:
                self.error = str(error)
                self.errors += 1
        self._request_missing()
        return received

    def close(self) -> None:
        """Free the socket."""
        self._context.destroy()

    def _register(self) -> None:
        if not self._presence_topic:
            # The robot counts these subscriptions as its clients, and waits for them when it closes.
            self._presence_topic = b"here/" + _token()
            self.socket.subscribe(self._presence_topic)

    def _request_tree(self) -> None:
        """Request the tree."""
        # The subscription stays: after a reconnection ZeroMQ subscribes again, and the reply shows whether
        # the robot has another tree.
        self._tree_topics.append(b"again/tree/" + _token())
        self._tree_requested_at = time.monotonic()
        # A client sends a request by subscribing. The token makes the topic unique, so no other client
        # receives the reply.
        self.socket.subscribe(self._tree_topics[-1])

    def _process(self, message: Message, received: list[Message]) -> None:
        if isinstance(message, TreeMessage):
            if message.tree_id != self.tree_id:
                # The robot no longer replies about the previous tree, so its missing messages are lost.
                self._lost_up_to = max(self._waiting, default=0)
                self._advance(received)
                self._begin(message)
                received.append(message)
            return
        if message.tree_id != self.tree_id:
            # The TreeMessage of this tree has not arrived yet, or was lost.
            waited = time.monotonic() - self._tree_requested_at
            if isinstance(message, AliveMessage) and self.tree_id and waited >= _ASK_AGAIN_AFTER:
                self._request_tree()
            return
        self.error = ""
        if isinstance(message, StaticMessage):
            received.append(message)
        elif isinstance(message, AliveMessage):
            self._latest = max(self._latest, message.latest)
        elif isinstance(message, PieceMessage):
            self._latest = max(self._latest, message.latest)
            if message.first <= self._next:
                # Messages in the range of this piece that the piece does not contain are lost.
                self._lost_up_to = max(self._lost_up_to, message.last)
                self._end_request()
            for data in message.messages:
                try:
                    self._store(wire.decode(data), len(message.messages))
                except ProtocolError as error:
                    self.error = str(error)
                    self.errors += 1
            self._advance(received)

    def _begin(self, message: TreeMessage) -> None:
        self.tree_id = message.tree_id
        self._next = message.oldest
        self._latest = message.latest
        self._lost_up_to = 0
        self._waiting.clear()
        self._end_request()
        self._register()
        for topic in self._tree_topics[:-1]:
            self.socket.unsubscribe(topic)
        del self._tree_topics[:-1]

    def _store(self, message: Message, more_room: int) -> None:
        if not isinstance(message, StreamMessage | UnknownMessage):
            return
        room = len(self._waiting) < _WAITING_AT_MOST + more_room
        if message.seq == self._next or (message.seq > self._next and room):
            self._waiting[message.seq] = message

    def _advance(self, received: list[Message]) -> None:
        while True:
            message = self._waiting.pop(self._next, None)
            if message is None and self._next > self._lost_up_to:
                return
            self._next += 1
            if message is None or isinstance(message, UnknownMessage):
                continue
            received.append(message)
            if isinstance(message, EndMessage):
                # A closing robot waits for clients that still hold this subscription.
                self.socket.unsubscribe(self._presence_topic)
                self._presence_topic = b""

    def _request_missing(self) -> None:
        """Request missing messages, unless a reply is pending."""
        if not self.tree_id or self._next > self._latest or self._next in self._waiting:
            return
        now = time.monotonic()
        if self._request_topic and now - self._requested_at < _ASK_AGAIN_AFTER:
            return
        self._end_request()
        self._request_topic = b"again/%d/%s" % (self._next, _token())
        self._requested_at = now
        self.socket.subscribe(self._request_topic)

    def _end_request(self) -> None:
        if self._request_topic:
            self.socket.unsubscribe(self._request_topic)
            self._request_topic = b""


def _token() -> bytes:
    return uuid.uuid4().hex[:16].encode()
