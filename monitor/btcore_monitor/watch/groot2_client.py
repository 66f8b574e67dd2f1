"""Asking a robot in Groot 2's protocol: one request at a time. All times here are wall-clock seconds."""

import random
import time
from collections.abc import Iterable
from typing import Any

from btcore_monitor.closeable import Closeable
from btcore_monitor.events import ObservedTree
from btcore_monitor.watch.address import Address
from btcore_monitor.watch.protocol_detection import check_speaks_groot2
from btcore_monitor.watch.request_client import (
    TIMEOUT,
    NoReplyError,
    RequestClient,
    Socket,
)
from btcore_monitor.wire import groot2
from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError
from btcore_monitor.wire.fulltree import read_fulltree
from btcore_monitor.wire.groot2 import (
    RecordedTransition,
    Reply,
    Request,
    StatusRecord,
)
from btcore_monitor.wire.msgpack_values import decode_boards

__all__ = ["TIMEOUT", "Groot2Client", "NoReplyError", "Socket"]


class Groot2Client(Closeable):
    """A client of one robot; use it from one thread. Closing it, or ``with``, frees the socket."""

    def __init__(self, address: Address, timeout: float = TIMEOUT, patience: float = 0.0) -> None:
        self.address = address
        self._client = RequestClient(address, timeout, patience)
        self._asked = Request.FULLTREE
        self._random = random.Random()
        self._unique_id = 0

    @property
    def timeout(self) -> float:
        """Seconds that the robot has for an answer."""
        return self._client.timeout

    @timeout.setter
    def timeout(self, seconds: float) -> None:
        self._client.timeout = seconds

    @property
    def round_trip(self) -> float:
        """Seconds that the latest answer took."""
        return self._client.round_trip

    # one request after another

    def fulltree(self) -> ObservedTree:
        """The tree as it is running."""
        reply = self.request(Request.FULLTREE)
        return read_fulltree(reply.body, reply.tree_id)

    def statuses(self) -> dict[int, StatusRecord]:
        """uid → standing, of every node."""
        return groot2.decode_statuses(self.request(Request.STATUS).body)

    def blackboards(self, names: Iterable[str]) -> dict[str, dict[str, Any]]:
        """Name → key → value. *names*: the main tree by its ID, the others by their path."""
        return decode_boards(self.request(Request.BLACKBOARD, groot2.encode_names(names)).body)

    def start_recording(self) -> int:
        """Let the robot record transitions; the start in µs since the epoch. Clears what it had."""
        return groot2.decode_recording_start(self.request(Request.TOGGLE_RECORDING, b"start").body)

    def stop_recording(self) -> None:
        """Let the robot record no more; what it has stays."""
        self.request(Request.TOGGLE_RECORDING, b"stop")

    def transitions(self) -> list[RecordedTransition]:
        """What the robot recorded (1,000 at most), which empties its buffer for everybody."""
        return groot2.decode_transitions(self.request(Request.GET_TRANSITIONS).body)

    def request(self, kind: Request, body: bytes | None = None) -> Reply:
        """The robot's answer.

        Raises :class:`NoReplyError` after the timeout, :class:`RobotRefusedError` for an error reply,
        :class:`~btcore_monitor.watch.protocol_detection.Groot1DetectedError` for an answer in Groot 1's
        protocol and
        :class:`ProtocolError` for bytes that are none.
        """
        self.begin(kind, body)
        while True:
            reply = self.finish()
            if reply is not None:
                return reply
            self.wait(self._client.deadline - time.monotonic())

    # the same in steps, for who has other things to wait for

    @property
    def busy(self) -> bool:
        """Whether an answer is due."""
        return self._client.busy

    @property
    def socket(self) -> Socket:
        """The socket of now, for a poller. It changes after a silence."""
        return self._client.socket

    def begin(self, kind: Request, body: bytes | None = None) -> None:
        """Send a request; a pending one is given up."""
        self._asked = kind
        self._unique_id = self._random.getrandbits(32)
        self._client.begin(groot2.encode_request(kind, self._unique_id, body))

    def part(self, kind: Request, body: bytes | None = None) -> None:
        """Send a last request before :meth:`close`; nobody waits for its answer."""
        self._client.send_last(groot2.encode_request(kind, self._random.getrandbits(32), body))

    def finish(self) -> Reply | None:
        """The answer, or None while it is on its way; raises as :meth:`request` does."""
        frames = self._client.finish()
        if frames is None:
            return None
        asked = self._asked
        try:
            reply = groot2.decode_reply(frames)
        except RobotRefusedError as error:
            raise RobotRefusedError(f"{self.address} refuses {asked.name}: {error}") from None
        except ProtocolError:
            check_speaks_groot2(frames, self.address)
            raise
        if reply.kind != asked or reply.unique_id != self._unique_id:
            raise ProtocolError(
                f"expected an answer to {asked.name}, and {self.address} answered another request"
            )
        return reply

    def wait(self, seconds: float) -> None:
        """Return when something came, or after *seconds*."""
        self._client.wait(seconds)

    def close(self) -> None:
        """Free the socket."""
        self._client.close()
