"""A client of Groot 2's protocol: one request at a time. All times are wall-clock seconds.

A REQ socket must receive a reply before it can send again. After a timeout the client therefore closes the
socket and opens another, the "Lazy Pirate" pattern of the ZeroMQ guide.

Groot 1 and Groot 2 have the same port of requests, 1667. The first request is FULLTREE, a frame of six bytes:
a Groot 2 publisher replies to it, and so does a Groot 1 publisher, which ignores a request's content. The
request must be a single frame: BehaviorTree.CPP 3 (`bt_zmq_publisher.cpp`) receives only the first frame,
and sending a reply while more frames wait is an error of its REP socket that ends its server thread.
"""

import random
import time
from enum import IntEnum
from typing import Final

import zmq

from btcore_monitor.closeable import Closeable
from btcore_monitor.errors import MonitorError
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.handshakes import Handshakes
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.groot1_tree import WireTree, find_tree
from btcore_monitor.wire.groot2 import Reply, Request

TIMEOUT_S: Final = 1.0
"""Default maximum seconds for a reply."""

_MAX_REPLY: Final = 32 << 20
"""Maximum bytes of a frame in a reply, because the other program may not be a robot."""

_LAST_REQUEST_MS: Final = 200
"""Maximum time for the last request to be sent after the socket is closed."""

Socket = zmq.Socket[bytes]


class NoReplyError(MonitorError):
    """No reply within the timeout: there is no robot at the address, or the network is slow."""


class Groot1DetectedError(ProtocolError):
    """The robot replies in Groot 1's protocol.

    *reply* is the robot's reply, and *tree* the tree in the reply.
    """

    def __init__(self, message: str, reply: bytes, tree: WireTree) -> None:
        super().__init__(message)
        self.reply = reply
        self.tree = tree


class Groot2Client(Closeable):
    """Sends requests to one robot and receives its replies; a context manager. Use it from one thread.

    Args:
        address: The robot's address.
        timeout: Maximum seconds for a reply.
        max_timeout: If positive, the timeout doubles after each missing reply, up to this number of seconds,
            so that replies arrive through a slow network too. After a reply the timeout is four times the
            round trip, and at least *timeout*.
        keys: The keys of the client, if the robot requires keys.
    """

    def __init__(
        self,
        address: Address,
        timeout: float = TIMEOUT_S,
        max_timeout: float = 0.0,
        keys: ClientKeys | None = None,
    ) -> None:
        self.address = address
        self.keys = keys
        self._handshakes = Handshakes(address, keys)
        self.timeout = timeout
        self.max_timeout = max_timeout
        self._min_timeout = timeout
        self._requested_at = 0.0
        self._pending_kind: IntEnum = Request.FULLTREE
        self._unique_id = 0
        self.is_reply_pending = False
        """Whether a reply is pending."""
        self.deadline = 0.0
        """The end of the timeout of the pending request (monotonic s)."""
        self._context: zmq.Context[Socket] = zmq.Context()
        self._socket: Socket | None = None

    @property
    def socket(self) -> Socket:
        """The current socket, for a poller. It changes after a timeout."""
        if self._socket is None:
            self._socket = self._context.socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.setsockopt(zmq.MAXMSGSIZE, _MAX_REPLY)
            if self.keys is not None:
                self.keys.secure(self._socket)
            self._handshakes.watch(self._socket)
            self._socket.connect(self.address.at())
        return self._socket

    def request(self, kind: IntEnum, body: bytes | None = None) -> Reply:
        """Send a request and return the robot's reply.

        Args:
            kind: The kind of request: a `Request`, or a `ChangeRequest` of btcore.
            body: The request's second frame, if the kind has one.

        Raises:
            NoReplyError: There is no reply within the timeout.
            ConnectionRefusedByRobotError: The robot refuses the connection because of the keys.
            RobotRefusedError: The robot sent an error reply.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: The reply is invalid.
        """
        self.send_request(kind, body)
        while True:
            reply = self.receive_reply()
            if reply is not None:
                return reply
            self._wait(self.deadline - time.monotonic())

    # `request` in two steps, for callers that wait for other sockets at the same time.

    def send_request(self, kind: IntEnum, body: bytes | None = None) -> None:
        """Send a request. A pending request is abandoned."""
        self.abandon_request()
        self._pending_kind = kind
        self._unique_id = random.getrandbits(32)
        try:
            self.socket.send_multipart(groot2.encode_request(kind, self._unique_id, body), zmq.DONTWAIT)
        except zmq.Again:
            # There is no connection and the queue is full: receive_reply() raises after the timeout.
            self._drop()
        self.is_reply_pending = True
        self._requested_at = time.monotonic()
        self.deadline = self._requested_at + self.timeout

    def receive_reply(self) -> Reply | None:
        """Return the reply, or None while it is pending.

        Raises:
            NoReplyError: There is no reply within the timeout.
            ConnectionRefusedByRobotError: The robot refuses the connection because of the keys.
            RobotRefusedError: The robot sent an error reply.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: The reply is invalid, or belongs to another request.
        """
        frames = self._receive()
        if frames is None:
            return None
        request = self._pending_kind
        try:
            reply = groot2.decode_reply(frames)
        except RobotRefusedError as error:
            raise RobotRefusedError(
                f"{self.address} refuses {request.name}: {error}", error.sentence
            ) from None
        except ProtocolError:
            tree = find_tree(frames)
            if tree is None:
                raise
            raise Groot1DetectedError(
                f"{self.address} uses Groot 1's protocol (BehaviorTree.CPP 3), which supports only the tree "
                "and its statuses",
                frames[0],
                tree,
            ) from None
        if reply.kind != request or reply.unique_id != self._unique_id:
            raise ProtocolError(
                f"expected a reply to {request.name}, and {self.address} replied to another request"
            )
        return reply

    def _receive(self) -> list[bytes] | None:
        """Return the frames of the reply, or None while it is pending."""
        if not self.is_reply_pending:
            return None
        self._handshakes.check()
        try:
            frames = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.ZMQError:  # no reply yet, or the request was never sent
            if time.monotonic() < self.deadline:
                return None
            self._drop()
            timeout = self.timeout
            if self.max_timeout:
                self.timeout = min(self.max_timeout, 2 * timeout)
            raise NoReplyError(f"no answer from {self.address} in {timeout:.3g} s") from None
        self.is_reply_pending = False
        if self.max_timeout:
            round_trip = time.monotonic() - self._requested_at
            self.timeout = min(self.max_timeout, max(self._min_timeout, 4 * round_trip))
        return frames

    def abandon_request(self) -> None:
        """Stop waiting for a pending reply."""
        if self.is_reply_pending:
            self._drop()

    def _wait(self, seconds: float) -> None:
        """Return when a reply arrives, or after *seconds*."""
        poller = zmq.Poller()
        for socket in (self.socket, self._handshakes.events):
            if socket is not None:
                poller.register(socket, zmq.POLLIN)
        poller.poll(max(0, round(1000 * seconds)) + 1)

    def send_last_request(self, kind: IntEnum, body: bytes | None = None) -> None:
        """Send a last request before `close`, without waiting for its reply."""
        self.send_request(kind, body)
        self.is_reply_pending = False
        self.socket.setsockopt(zmq.LINGER, _LAST_REQUEST_MS)

    def _drop(self) -> None:
        self.is_reply_pending = False
        if self._socket is not None:
            self._handshakes.leave(self._socket)
            self._socket.close(linger=0)
            self._socket = None

    def close(self) -> None:
        """Free the socket."""
        self._context.destroy()
