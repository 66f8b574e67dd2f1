"""A client of Groot 2's protocol: one request at a time. All times are wall-clock seconds.

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

from btcore_monitor.watch.request_client import RequestClient
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.groot1_tree import WireTree, find_tree
from btcore_monitor.wire.groot2 import Reply, Request

_LAST_REQUEST_MS: Final = 200
"""Maximum time for the last request to be sent after the socket is closed."""


class Groot1DetectedError(ProtocolError):
    """The robot replies in Groot 1's protocol.

    *reply* is the robot's reply, and *tree* the tree in the reply.
    """

    def __init__(self, message: str, reply: bytes, tree: WireTree) -> None:
        super().__init__(message)
        self.reply = reply
        self.tree = tree


class Groot2Client(RequestClient):
    """A client of one robot. See `RequestClient` for the parameters."""

    _pending_kind: IntEnum = Request.FULLTREE
    _unique_id = 0

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
            self.wait(self.deadline - time.monotonic())

    # `request` in two steps, for callers that wait for other sockets at the same time.

    def send_request(self, kind: IntEnum, body: bytes | None = None) -> None:
        """Send a request. A pending request is abandoned."""
        self._pending_kind = kind
        self._unique_id = random.getrandbits(32)
        self.send(groot2.encode_request(kind, self._unique_id, body))

    def receive_reply(self) -> Reply | None:
        """Return the reply, or None while it is pending.

        Raises:
            NoReplyError: There is no reply within the timeout.
            ConnectionRefusedByRobotError: The robot refuses the connection because of the keys.
            RobotRefusedError: The robot sent an error reply.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: The reply is invalid, or belongs to another request.
        """
        frames = self.receive()
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

    def send_last_request(self, kind: IntEnum, body: bytes | None = None) -> None:
        """Send a last request before `close`, without waiting for its reply."""
        self.send_request(kind, body)
        self.is_reply_pending = False
        self.socket.setsockopt(zmq.LINGER, _LAST_REQUEST_MS)
