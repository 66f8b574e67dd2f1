"""Listening to a btcore robot's scene channel, so that nothing of its stream is missing.

Every message of the stream has a number. One that comes out of turn waits, and what is missing is
asked for again: the robot keeps a history. Only what that no longer holds is lost for good.
"""

import time
import uuid
from typing import Final

import zmq

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
"""Messages kept that came too early; further ones are asked for again when it is their turn."""

_ASK_AGAIN_AFTER: Final = 2.0
_FRAMES_A_TURN: Final = 500
_RECONNECT_MS: Final = 100

Socket = zmq.Socket[bytes]


class SceneClient:
    """The stream of whatever btcore robot is at *address*, in order; use it from one thread."""

    def __init__(self, address: Address) -> None:
        self.tree_id = ""
        """The tree that is followed; empty until one is known."""
        self.heard_at = 0.0
        """When something came last (monotonic s); 0: never."""
        self.fault = ""
        """Why the last message could not be read; empty if it could."""
        self.faults = 0
        """Messages that could not be read."""
        self._next = 1
        self._latest = 0
        self._gone_up_to = 0
        self._waiting: dict[int, StreamMessage | UnknownMessage] = {}
        self._topic = b""
        self._asked_at = 0.0
        self._here = b""
        self._questions: list[bytes] = []
        self._questioned_at = 0.0
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
        self.socket.subscribe(wire.STREAM)
        self.socket.subscribe(wire.ALIVE)
        self._ask_which()
        self._be_here()
        self.socket.connect(address.at(wire.PORT_OFFSET))

    def read(self) -> list[Message]:
        """What came, without waiting, in the robot's order: each message of a stream exactly once."""
        came: list[Message] = []
        for _ in range(_FRAMES_A_TURN):
            try:
                frames = self.socket.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                break
            if len(frames) != 2:
                continue
            try:
                self._take(wire.decode(frames[1]), came)
                self.heard_at = time.monotonic()
            except ProtocolError as error:
                self.fault = str(error)
                self.faults += 1
        self._ask()
        return came

    def close(self) -> None:
        """Free the socket."""
        self.socket.close()
        self._context.term()

    def _be_here(self) -> None:
        if not self._here:
            self._here = b"here/" + _token()
            self.socket.subscribe(self._here)

    def _ask_which(self) -> None:
        """Ask for the tree."""
        # Kept: after a reconnection ZMQ subscribes again, and the answer tells which tree it is.
        self._questions.append(b"again/tree/" + _token())
        self._questioned_at = time.monotonic()
        self.socket.subscribe(self._questions[-1])

    def _take(self, message: Message, came: list[Message]) -> None:
        if isinstance(message, TreeMessage):
            if message.tree_id != self.tree_id:
                # Nobody answers for the tree before any more: what waited for an answer is all there is.
                self._gone_up_to = max(self._waiting, default=0)
                self._advance(came)
                self._begin(message)
                came.append(message)
            return
        if message.tree_id != self.tree_id:
            # of a tree whose TreeMessage is on its way, or got lost
            if isinstance(message, AliveMessage) and self._may_be_lost():
                self._ask_which()
            return
        self.fault = ""
        if isinstance(message, StaticMessage):
            came.append(message)
        elif isinstance(message, AliveMessage):
            self._latest = max(self._latest, message.latest)
        elif isinstance(message, PieceMessage):
            self._latest = max(self._latest, message.latest)
            if message.first <= self._next:
                # whatever is not in it up to its end is gone for good
                self._gone_up_to = max(self._gone_up_to, message.last)
                self._answered()
            for data in message.messages:
                try:
                    self._keep(wire.decode(data), len(message.messages))
                except ProtocolError as error:
                    self.fault = str(error)
                    self.faults += 1
            self._advance(came)

    def _may_be_lost(self) -> bool:
        return bool(self.tree_id) and time.monotonic() - self._questioned_at >= _ASK_AGAIN_AFTER

    def _begin(self, message: TreeMessage) -> None:
        self.tree_id = message.tree_id
        self._next = message.oldest
        self._latest = message.latest
        self._gone_up_to = 0
        self._waiting.clear()
        self._answered()
        self._be_here()
        for topic in self._questions[:-1]:
            self.socket.unsubscribe(topic)
        del self._questions[:-1]

    def _keep(self, message: Message, more_room: int) -> None:
        if not isinstance(message, StreamMessage | UnknownMessage):
            return
        room = len(self._waiting) < _WAITING_AT_MOST + more_room
        if message.seq == self._next or (message.seq > self._next and room):
            self._waiting[message.seq] = message

    def _advance(self, came: list[Message]) -> None:
        while True:
            message = self._waiting.pop(self._next, None)
            if message is None and self._next > self._gone_up_to:
                return
            self._next += 1
            if message is None or isinstance(message, UnknownMessage):
                continue
            came.append(message)
            if isinstance(message, EndMessage):
                self.socket.unsubscribe(self._here)
                self._here = b""

    def _ask(self) -> None:
        """Ask for what is missing, unless an answer is due."""
        if not self.tree_id or self._next > self._latest or self._next in self._waiting:
            return
        now = time.monotonic()
        if self._topic and now - self._asked_at < _ASK_AGAIN_AFTER:
            return
        self._answered()
        self._topic = b"again/%d/%s" % (self._next, _token())
        self._asked_at = now
        self.socket.subscribe(self._topic)

    def _answered(self) -> None:
        if self._topic:
            self.socket.unsubscribe(self._topic)
            self._topic = b""


def _token() -> bytes:
    return uuid.uuid4().hex[:16].encode()
