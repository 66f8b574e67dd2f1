"""Checks the keys of clients: a handler of ZAP, the ZeroMQ Authentication Protocol (RFC 27).

libzmq sends a request for each connection to a socket with keys, and waits for the reply before the
connection carries any message.
"""

from typing import Final

import zmq

from btcore_monitor.keys import RobotKeys
from btcore_monitor.serve.tcp_ports import Socket

_ENDPOINT: Final = "inproc://zeromq.zap.01"
_VERSION: Final = b"1.0"
_FRAMES: Final = 7


class Authenticator:
    """Replies to the requests that arrive at `socket`. Use it from one thread at a time.

    Args:
        context: The ZeroMQ context of the sockets with keys.
        keys: The keys of the robot.
    """

    def __init__(self, context: "zmq.Context[Socket]", keys: RobotKeys) -> None:
        self._allowed = keys.allowed
        self.socket: Socket = context.socket(zmq.REP)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.bind(_ENDPOINT)

    def answer(self) -> None:
        """Reply to a waiting request: accept clients with an allowed public key, and refuse all others."""
        frames = self.socket.recv_multipart(zmq.DONTWAIT)
        # The version, the request's number, the domain, the client's address and identity, the mechanism, and
        # the public key. libzmq has verified that the client has the secret key.
        allowed = len(frames) == _FRAMES and frames[5] == b"CURVE" and frames[6] in self._allowed
        status, text = (b"200", b"OK") if allowed else (b"400", b"unknown key")
        self.socket.send_multipart([_VERSION, frames[1], status, text, b"", b""])
