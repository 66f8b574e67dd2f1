"""Asking a robot: one request at a time, and a fresh socket after silence.

A REQ socket that got no answer can't ask again, so it is thrown away ("lazy pirate"). All times
here are wall-clock seconds.
"""

import time
from collections.abc import Sequence
from typing import Final

import zmq

from btcore_monitor.errors import MonitorError
from btcore_monitor.watch.address import Address

TIMEOUT: Final = 1.0
"""Seconds that a robot has for an answer."""

_REPLY_AT_MOST: Final = 256 << 20
_PARTING_MS: Final = 200

Socket = zmq.Socket[bytes]


class NoReplyError(MonitorError):
    """The robot is silent: it is not there, or something between is slow."""


class RequestClient:
    """Sends frames to one robot and brings its answers; use it from one thread.

    *timeout* is for an answer. With a *patience* it is doubled after each silence, up to that, so that an
    answer comes through a slow network too, and then is four times what the answer took.
    """

    def __init__(self, address: Address, timeout: float = TIMEOUT, patience: float = 0.0) -> None:
        self.address = address
        self.timeout = timeout
        self.patience = patience
        self.round_trip = 0.0
        """How long the latest answer took."""
        self._least = timeout
        self._asked_at = 0.0
        self.busy = False
        """Whether an answer is due."""
        self.deadline = 0.0
        """Until when (monotonic s) the robot may answer what was asked last."""
        self._context: zmq.Context[Socket] = zmq.Context()
        self._socket: Socket | None = None

    @property
    def socket(self) -> Socket:
        """The socket of now, for a poller. It changes after a silence."""
        if self._socket is None:
            self._socket = self._context.socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.setsockopt(zmq.MAXMSGSIZE, _REPLY_AT_MOST)
            self._socket.connect(self.address.at())
        return self._socket

    def begin(self, frames: Sequence[bytes]) -> None:
        """Send a request; a pending one is given up."""
        if self.busy:
            self._drop()
        try:
            self.socket.send_multipart(frames, zmq.DONTWAIT)
        except zmq.Again:
            # nobody is connected and the queue of one is full: the timeout will tell
            self._drop()
        self.busy = True
        self._asked_at = time.monotonic()
        self.deadline = self._asked_at + self.timeout

    def finish(self) -> list[bytes] | None:
        """The answer, or None while it is on its way. Raises :class:`NoReplyError` after the timeout."""
        if not self.busy:
            return None
        try:
            frames = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.ZMQError:  # nothing is there, or the request was never sent
            if time.monotonic() < self.deadline:
                return None
            self._drop()
            silent = self.timeout
            if self.patience:
                self.timeout = min(self.patience, 2 * silent)
            raise NoReplyError(f"no answer from {self.address} in {silent:.3g} s") from None
        self.busy = False
        self.round_trip = time.monotonic() - self._asked_at
        if self.patience:
            self.timeout = min(self.patience, max(self._least, 4 * self.round_trip))
        return frames

    def send_last(self, frames: Sequence[bytes]) -> None:
        """Send a last request before :meth:`close`; nobody waits for its answer."""
        self.begin(frames)
        self.busy = False
        self.socket.setsockopt(zmq.LINGER, _PARTING_MS)

    def wait(self, seconds: float) -> None:
        """Return when something came, or after *seconds*."""
        self.socket.poll(max(0, round(1000 * seconds)) + 1, zmq.POLLIN)

    def _drop(self) -> None:
        self.busy = False
        if self._socket is not None:
            self._socket.close(linger=0)
            self._socket = None

    def close(self) -> None:
        """Free the socket."""
        if self._socket is not None:
            self._socket.close()
        self._context.term()
