"""Asking a robot in Groot 2's protocol: one request at a time, and a fresh socket after silence.

A REQ socket that got no answer can't ask again, so it is thrown away ("lazy pirate"). All times
here are wall-clock seconds.
"""

import random
import time
from collections.abc import Iterable
from types import TracebackType
from typing import Any, Final, Self

import zmq

from monitor.picture import Picture
from monitor.watch.address import Address
from monitor.wire import groot2
from monitor.wire.fault import RefusedByRobot, WireFault
from monitor.wire.fulltree import read_fulltree
from monitor.wire.groot2 import RecordedTransition, Reply, Request, StatusRecord
from monitor.wire.values import decode_boards

TIMEOUT: Final = 1.0
"""Seconds that a robot has for an answer."""

_REPLY_AT_MOST: Final = 256 << 20

Socket = zmq.Socket[bytes]


class NoAnswer(Exception):
    """The robot is silent: it is not there, or something between is slow."""


class Groot2Client:
    """A client of one robot; use it from one thread. Closing it, or ``with``, frees the socket."""

    def __init__(self, address: Address, timeout: float = TIMEOUT) -> None:
        self.address = address
        self.timeout = timeout
        self._context: zmq.Context[Socket] = zmq.Context()
        self._socket: Socket | None = None
        self._asked: Request | None = None
        self._unique_id = 0
        self._deadline = 0.0

    # one request after another

    def fulltree(self) -> Picture:
        """The tree as it is running."""
        reply = self.ask(Request.FULLTREE)
        return read_fulltree(reply.body, reply.tree_id)

    def statuses(self) -> dict[int, StatusRecord]:
        """uid → standing, of every node."""
        return groot2.decode_statuses(self.ask(Request.STATUS).body)

    def blackboards(self, names: Iterable[str]) -> dict[str, dict[str, Any]]:
        """Name → key → value. *names*: the main tree by its ID, the others by their path."""
        return decode_boards(self.ask(Request.BLACKBOARD, groot2.encode_names(names)).body)

    def start_recording(self) -> int:
        """Let the robot record transitions; the start in µs since the epoch. Clears what it had."""
        return groot2.decode_recording_start(self.ask(Request.TOGGLE_RECORDING, b"start").body)

    def stop_recording(self) -> None:
        """Let the robot record no more; what it has stays."""
        self.ask(Request.TOGGLE_RECORDING, b"stop")

    def transitions(self) -> list[RecordedTransition]:
        """What the robot recorded (1,000 at most), which empties its buffer for everybody."""
        return groot2.decode_transitions(self.ask(Request.GET_TRANSITIONS).body)

    def ask(self, kind: Request, body: bytes | None = None) -> Reply:
        """The robot's answer.

        Raises :class:`NoAnswer` after the timeout, :class:`RefusedByRobot` for an error reply and
        :class:`WireFault` for bytes that are none.
        """
        self.begin(kind, body)
        while True:
            reply = self.finish()
            if reply is not None:
                return reply
            self.wait(self._deadline - time.monotonic())

    # the same in steps, for who has other things to wait for

    @property
    def busy(self) -> bool:
        """Whether an answer is due."""
        return self._asked is not None

    @property
    def socket(self) -> Socket:
        """The socket of now, for a poller. It changes after a silence."""
        if self._socket is None:
            self._socket = self._context.socket(zmq.REQ)
            self._socket.setsockopt(zmq.LINGER, 0)
            self._socket.setsockopt(zmq.MAXMSGSIZE, _REPLY_AT_MOST)
            self._socket.connect(self.address.at())
        return self._socket

    def begin(self, kind: Request, body: bytes | None = None) -> None:
        """Send a request; a pending one is given up."""
        if self._asked is not None:
            self._drop()
        self._unique_id = random.getrandbits(32)
        try:
            self.socket.send_multipart(groot2.encode_request(kind, self._unique_id, body), zmq.DONTWAIT)
        except zmq.Again:
            # nobody is connected and the queue of one is full: the timeout will tell
            self._drop()
        self._asked = kind
        self._deadline = time.monotonic() + self.timeout

    def finish(self) -> Reply | None:
        """The answer, or None while it is on its way; raises as :meth:`ask` does."""
        if self._asked is None:
            return None
        try:
            frames = self.socket.recv_multipart(zmq.DONTWAIT)
        except zmq.Again:
            if time.monotonic() < self._deadline:
                return None
            self._drop()
            raise NoAnswer(f"no answer from {self.address} in {self.timeout:g} s") from None
        except zmq.ZMQError:  # the request was never sent
            if time.monotonic() < self._deadline:
                return None
            self._drop()
            raise NoAnswer(f"no answer from {self.address} in {self.timeout:g} s") from None
        asked, self._asked = self._asked, None
        try:
            reply = groot2.decode_reply(frames)
        except RefusedByRobot as error:
            raise RefusedByRobot(f"{self.address} refuses {asked.name}: {error}") from None
        if reply.kind != asked or reply.unique_id != self._unique_id:
            raise WireFault(
                f"expected an answer to {asked.name}, and {self.address} answered another request"
            )
        return reply

    def wait(self, seconds: float) -> None:
        """Return when something came, or after *seconds*."""
        self.socket.poll(max(0, round(1000 * seconds)) + 1, zmq.POLLIN)

    def _drop(self) -> None:
        self._asked = None
        if self._socket is not None:
            self._socket.close(linger=0)
            self._socket = None

    def close(self) -> None:
        """Free the socket."""
        self._drop()
        self._context.term()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
