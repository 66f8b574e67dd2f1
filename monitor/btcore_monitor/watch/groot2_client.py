"""A client of Groot 2's protocol: one request at a time. All times are wall-clock seconds."""

import random
import time
from collections.abc import Iterable
from typing import Any

from btcore_monitor.closeable import Closeable
from btcore_monitor.events import ObservedTree
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.protocol_detection import check_speaks_groot2
from btcore_monitor.watch.request_client import TIMEOUT, NoReplyError, RequestClient, Socket
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import RecordedTransition, Reply, Request, StatusRecord
from btcore_monitor.wire.msgpack_values import decode_boards

__all__ = ["TIMEOUT", "Groot2Client", "NoReplyError", "Socket"]


class Groot2Client(Closeable):
    """A client of one robot, and a context manager. Use it from one thread.

    Args:
        address: The robot's address.
        timeout: Maximum seconds for a reply.
        patience: Maximum seconds to which the timeout may grow, as in `RequestClient`.
    """

    def __init__(self, address: Address, timeout: float = TIMEOUT, patience: float = 0.0) -> None:
        self.address = address
        self._client = RequestClient(address, timeout, patience)
        self._pending = Request.FULLTREE
        self._random = random.Random()
        self._unique_id = 0

    @property
    def timeout(self) -> float:
        """Maximum seconds for a reply."""
        return self._client.timeout

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self._client.timeout = seconds

    @property
    def round_trip(self) -> float:
        """Seconds that the latest reply took."""
        return self._client.round_trip

    # Methods that wait for the reply. They raise the exceptions of request().

    def fulltree(self) -> ObservedTree:
        """Return the robot's tree."""
        reply = self.request(Request.FULLTREE)
        return read_fulltree(reply.body, reply.tree_id)

    def statuses(self) -> dict[int, StatusRecord]:
        """Return the status record of every node by uid."""
        return groot2.decode_statuses(self.request(Request.STATUS).body)

    def blackboards(self, names: Iterable[str]) -> dict[str, dict[str, Any]]:
        """Return name → key → value of the blackboards *names*: the main tree's ID, and other paths."""
        return decode_boards(self.request(Request.BLACKBOARD, groot2.encode_names(names)).body)

    def start_recording(self) -> int:
        """Start a recording and clear the previous recording. Return its start in µs since the epoch."""
        return groot2.decode_recording_start(self.request(Request.TOGGLE_RECORDING, b"start").body)

    def stop_recording(self) -> None:
        """Stop recording transitions. The robot keeps the recorded transitions."""
        self.request(Request.TOGGLE_RECORDING, b"stop")

    def transitions(self) -> list[RecordedTransition]:
        """Return the recorded transitions (at most 1,000). This empties the buffer for all clients."""
        return groot2.decode_transitions(self.request(Request.GET_TRANSITIONS).body)

    def request(self, kind: Request, body: bytes | None = None) -> Reply:
        """Send a request and return the robot's reply.

        Args:
            kind: The kind of request.
            body: The request's second frame, if the kind has one.

        Raises:
            NoReplyError: There is no reply within the timeout.
            RobotRefusedError: The robot sent an error reply.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: The reply is invalid.
        """
        self.begin(kind, body)
        while True:
            reply = self.finish()
            if reply is not None:
                return reply
            self.wait(self._client.deadline - time.monotonic())

    # The same in steps, for callers that wait for other sockets too.

    @property
    def busy(self) -> bool:
        """Whether a reply is pending."""
        return self._client.busy

    @property
    def socket(self) -> Socket:
        """The current socket, for a poller. It changes after a timeout."""
        return self._client.socket

    def begin(self, kind: Request, body: bytes | None = None) -> None:
        """Send a request. A pending request is abandoned."""
        self._pending = kind
        self._unique_id = self._random.getrandbits(32)
        self._client.begin(groot2.encode_request(kind, self._unique_id, body))

    def part(self, kind: Request, body: bytes | None = None) -> None:
        """Send a last request before :meth:`close`, without waiting for its reply."""
        self._client.send_last(groot2.encode_request(kind, self._random.getrandbits(32), body))

    def finish(self) -> Reply | None:
        """Return the reply, or None while it is pending.

        Raises:
            NoReplyError: There is no reply within the timeout.
            RobotRefusedError: The robot sent an error reply.
            Groot1DetectedError: The robot replied in Groot 1's protocol.
            ProtocolError: The reply is invalid, or belongs to another request.
        """
        frames = self._client.finish()
        if frames is None:
            return None
        request = self._pending
        try:
            reply = groot2.decode_reply(frames)
        except RobotRefusedError as error:
            raise RobotRefusedError(f"{self.address} refuses {request.name}: {error}") from None
        except ProtocolError:
            check_speaks_groot2(frames, self.address)
            raise
        if reply.kind != request or reply.unique_id != self._unique_id:
            raise ProtocolError(
                f"expected a reply to {request.name}, and {self.address} replied to another request"
            )
        return reply

    def wait(self, seconds: float) -> None:
        """Return when a reply arrives, or after *seconds*."""
        self._client.wait(seconds)

    def close(self) -> None:
        """Free the socket."""
        self._client.close()
