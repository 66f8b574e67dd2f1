"""A client that sends requests to a robot: one request at a time, and a new socket after a timeout.

A REQ socket must receive a reply before it can send again. After a timeout the client therefore closes the
socket and opens another, the "Lazy Pirate" pattern of the ZeroMQ guide. All times are wall-clock seconds.
"""

import time
from collections.abc import Sequence
from typing import Final

import zmq

from btcore_monitor.closeable import Closeable
from btcore_monitor.errors import MonitorError
from btcore_monitor.keys import ClientKeys
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.handshakes import Handshakes

TIMEOUT_S: Final = 1.0
"""Default maximum seconds for a reply."""

_MAX_REPLY: Final = 32 << 20
"""Maximum bytes of a frame in a reply, because the other program may not be a robot."""

Socket = zmq.Socket[bytes]


class NoReplyError(MonitorError):
    """No reply within the timeout: there is no robot at the address, or the network is slow."""


class RequestClient(Closeable):
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

    def send(self, frames: Sequence[bytes]) -> None:
        """Send a request. A pending request is abandoned."""
        self.abandon_request()
        try:
            self.socket.send_multipart(frames, zmq.DONTWAIT)
        except zmq.Again:
            # There is no connection and the queue is full: receive() raises after the timeout.
            self._drop()
        self.is_reply_pending = True
        self._requested_at = time.monotonic()
        self.deadline = self._requested_at + self.timeout

    def receive(self) -> list[bytes] | None:
        """Return the frames of the reply, or None while it is pending.

        Raises:
            NoReplyError: There is no reply within the timeout.
            ConnectionRefusedByRobotError: The robot refuses the connection because of the keys.
        """
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

    def wait(self, seconds: float) -> None:
        """Return when a reply arrives, or after *seconds*."""
        poller = zmq.Poller()
        for socket in (self.socket, self._handshakes.events):
            if socket is not None:
                poller.register(socket, zmq.POLLIN)
        poller.poll(max(0, round(1000 * seconds)) + 1)

    def _drop(self) -> None:
        self.is_reply_pending = False
        if self._socket is not None:
            self._handshakes.leave(self._socket)
            self._socket.close(linger=0)
            self._socket = None

    def close(self) -> None:
        """Free the socket."""
        self._context.destroy()
