"""The server's socket for requests: a ROUTER socket that behaves like a REP socket.

A REP socket would be the obvious choice, and BehaviorTree.CPP uses it. But libzmq's REP socket gets stuck in
the middle of a message when it receives bytes without a valid envelope, as port scanners send them, and then
loses the reply to the next request. Therefore this module uses a ROUTER socket and handles the envelope
itself: the routing frames, an empty delimiter frame, then the request.
"""

from collections.abc import Sequence
from typing import Final

import zmq

from btcore_monitor.serve.tcp_ports import Socket

MAX_WAITING_FRAMES: Final = 64
"""Maximum queued requests and replies per client.

Further requests wait on the client's side. Further replies to a client that does not read are dropped.
"""


class RequestSocket:
    """Receives requests at `socket`, which the caller binds. Use it from one thread at a time.

    Args:
        context: The ZeroMQ context.
        max_size: Maximum bytes of a frame. A client that sends more is disconnected.
    """

    def __init__(self, context: "zmq.Context[Socket]", max_size: int) -> None:
        self.socket: Socket = context.socket(zmq.ROUTER)
        self.socket.setsockopt(zmq.MAXMSGSIZE, max_size)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.RCVHWM, MAX_WAITING_FRAMES)
        self.socket.setsockopt(zmq.SNDHWM, MAX_WAITING_FRAMES)
        self._envelope: list[bytes] = []

    def receive(self) -> list[bytes] | None:
        """Return the frames of the next request, or None if there is none or it is invalid."""
        try:
            frames = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            return None
        try:
            # Frame 0 is the routing ID; an empty frame ends the envelope.
            start = frames.index(b"", 1) + 1
        except ValueError:
            return None
        self._envelope = frames[:start]
        return frames[start:] or None

    @property
    def client(self) -> bytes:
        """The connection of the last request that `receive` returned."""
        return self._envelope[0]

    @property
    def envelope(self) -> Sequence[bytes]:
        """The envelope of the last request that `receive` returned, for a later reply."""
        return self._envelope

    def answer(self, frames: Sequence[bytes], envelope: Sequence[bytes] | None = None) -> None:
        """Send *frames* as the reply to the request of *envelope*; default the last of `receive`."""
        self.socket.send_multipart([*(envelope or self._envelope), *frames], zmq.DONTWAIT)
