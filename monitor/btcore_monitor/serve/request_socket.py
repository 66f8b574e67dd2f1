"""The socket that requests come to: a REP socket's place and manners, without its weakness.

Bytes that are no request of any shape, as a port scan sends them, make libzmq's REP socket wait where
nothing is to come, and lose the answer to the next request. So the envelope is opened here.
"""

from collections.abc import Sequence
from typing import Final

import zmq

from btcore_monitor.serve.tcp_ports import Socket

WAITING_AT_MOST: Final = 64
"""Requests of one client that wait for an answer, and answers that wait for one that doesn't read: further
requests stay with the client, and further answers are dropped.
"""


class RequestSocket:
    """Requests at :attr:`socket`, which is to be bound; use it from one thread at a time."""

    def __init__(self, context: "zmq.Context[Socket]", at_most: int) -> None:
        self.socket: Socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.MAXMSGSIZE, at_most)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVHWM, WAITING_AT_MOST)
        self.socket.setsockopt(zmq.SNDHWM, WAITING_AT_MOST)
        self._back: list[bytes] = []

    def take(self) -> list[bytes] | None:
        """The frames of a request that has come; None if what came was none."""
        try:
            frames = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        try:
            begin = frames.index(b"", 1) + 1
        except ValueError:
            return None
        self._back = frames[:begin]
        return frames[begin:] or None

    def answer(self, frames: Sequence[bytes]) -> None:
        """Send *frames* to whoever asked what was taken last."""
        self.socket.send_multipart([*self._back, *frames], zmq.DONTWAIT)
