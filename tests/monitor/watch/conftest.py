"""A simulated robot that runs C++: BehaviorTree.CPP 4.10's publisher for Groot 2, from its description.

It shares no code with the monitor. Its replies are checked against the captures of a real robot.
"""

import re
import struct
import threading
import time
import uuid
from collections import Counter, deque
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from btcore_monitor.events import ConnectionEvent, Event, TickEvent, TransitionEvent
from btcore_monitor.watch.feed import Feed

CAPTURES = Path(__file__).parents[1] / "captures"
REPLY_HEADER = struct.Struct("<BBI16s")


def frames(name: str) -> list[bytes]:
    """Return the frames of a capture, each of which follows its length (u32) in the file."""
    data = (CAPTURES / f"v4_{name}.bin").read_bytes()
    parts = []
    while data:
        (size,) = struct.unpack_from("<I", data)
        parts.append(data[4 : 4 + size])
        data = data[4 + size :]
    return parts


class RefusalError(Exception):
    """An error reply."""


class CppRobot:
    """A robot with the captures' tree of ten nodes, until :meth:`close`; port 0 chooses a free port.

    *statuses* is the STATUS buffer (uid → code); a node's status signal calls *changed*. *requests*
    counts requests by their letter. *hooks* is the reply to HOOKS_DUMP. *refused* maps the letter of a
    request to the error in the reply. A reply takes *delay* (s). The robot does not respond to the requests
    with the letter *stall_at* until :meth:`resume`, and loses one reply to those with *drop_reply_to*.
    """

    def __init__(self, port: int = 0, xml: bytes | None = None, tree_id: bytes | None = None) -> None:
        self.xml = xml or frames("fulltree.rep")[1]
        self.tree_id = tree_id or uuid.uuid4().bytes
        # one record for each node in order of creation, which differs from the order of the uids
        self.statuses = dict.fromkeys(map(int, re.findall(rb'_uid="(\d+)"', self.xml)), 0)
        if len(self.statuses) == 10:
            self.statuses = dict.fromkeys((1, 2, 3, 4, 5, 6, 10, 7, 8, 9), 0)
        self._now = dict.fromkeys(self.statuses, 0)
        self.boards = b"\xc0"
        self.hooks = b"[]"
        self.requests: Counter[str] = Counter()
        self.refused: dict[str, str] = {}
        self.names: list[bytes] = []
        self.delay = 0.0
        self.stall_at = ""
        self.stalled = threading.Event()
        self.drop_reply_to = ""
        self.lock = threading.Lock()
        self.recording = False
        self._began = 0
        self._recorded: deque[bytes] = deque(maxlen=1000)
        self._resumed = threading.Event()
        self._stop = threading.Event()
        self._context = zmq.Context()
        self._socket = self._context.socket(zmq.REP)
        self._socket.setsockopt(zmq.LINGER, 0)
        self._socket.setsockopt(zmq.RCVTIMEO, 20)
        self._socket.bind(f"tcp://127.0.0.1:{port or '*'}")
        self.address = self._socket.getsockopt(zmq.LAST_ENDPOINT).decode()
        self.port = int(self.address.rsplit(":", 1)[1])
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def change(self, *changes: tuple[int, int]) -> None:
        """Change the nodes' statuses to (uid, status) in order; no request is answered meanwhile."""
        with self.lock:
            for uid, status in changes:
                self.changed(uid, status)

    def changed(self, uid: int, status: int, offset: int | None = None) -> None:
        previous, self._now[uid] = self._now[uid], status
        assert previous != status, "the signal fires only when the status changes"
        self.statuses[uid] = 10 + previous if status == 0 else status
        if self.recording:
            micros = time.time_ns() // 1000 - self._began if offset is None else offset
            self._recorded.append(micros.to_bytes(8, "little")[:6] + struct.pack("<HB", uid, status))

    def resume(self) -> None:
        self.stall_at = ""
        self._resumed.set()

    def close(self) -> None:
        self._stop.set()
        self._resumed.set()
        self._thread.join()
        self._socket.close()
        self._context.term()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                request = self._socket.recv_multipart()
            except zmq.Again:
                continue
            if self.stall_at and chr(request[0][1]) == self.stall_at:
                self.stalled.set()
                self._resumed.wait()
            self._stop.wait(self.delay)
            reply = self.answer(request)
            if self.drop_reply_to == chr(request[0][1]) and len(reply[1]):
                self.drop_reply_to = ""
                reply = [b""]
            self._socket.send_multipart(reply)

    def answer(self, request: list[bytes]) -> list[bytes]:
        if len(request[0]) != 6:
            return [b"error", b"wrong request header"]
        letter = chr(request[0][1])
        self.requests[letter] += 1
        header = bytes([2]) + request[0][1:] + self.tree_id
        try:
            if letter in self.refused:
                raise RefusalError(self.refused[letter])
            if letter in "BIRUr" and len(request) != 2:
                raise RefusalError("must be 2 parts message")
            with self.lock:
                body = self._body(letter, request)
        except RefusalError as refusal:
            return [b"error", str(refusal).encode()]
        return [header] if body is None else [header, body]

    def _body(self, letter: str, request: list[bytes]) -> bytes | None:
        if letter == "T":
            return self.xml
        if letter == "S":
            return b"".join(struct.pack("<HB", uid, code) for uid, code in self.statuses.items())
        if letter == "B":
            self.names.append(request[1])
            return self._blackboards(request[1])
        if letter == "D":
            return self.hooks
        if letter == "t":
            recorded = b"".join(self._recorded)
            self._recorded.clear()
            return recorded
        if letter == "r":
            self.recording = request[1] == b"start"
            if not self.recording:
                return None
            self._recorded.clear()
            self._began = time.time_ns() // 1000
            return str(self._began).encode()
        raise RefusalError("Request not recognized")

    def _blackboards(self, names: bytes) -> bytes:
        return self.boards if names else b"\xc0"


class Watcher:
    """Collects a feed's events on its own thread; *pause* (s) after each tick makes it slow.

    With *reply_within* (s), the robot has this time for each reply. The second that it has otherwise is too
    short for a machine that stops for a second.
    """

    def __init__(self, address: str, reply_within: float = 0.0, pause: float = 0.0, **options) -> None:
        self.events: list[Event] = []
        self.feed = Feed(address, **options)
        self._pause = pause
        if reply_within:
            client = self.feed._groot2_client
            client.timeout = client.max_timeout = client._min_timeout = reply_within
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        with self.feed:
            for event in self.feed:
                self.events.append(event)
                if self._pause and isinstance(event, TickEvent):
                    time.sleep(self._pause)

    def of(self, kind: type) -> list:
        return [event for event in self.events if isinstance(event, kind)]

    @property
    def links(self) -> list[str]:
        return [link.state for link in self.of(ConnectionEvent)]

    @property
    def steps(self) -> list[tuple[int, int, int]]:
        return [(change.uid, change.previous, change.status) for change in self.of(TransitionEvent)]

    def ended(self) -> bool:
        return "ended" in self.links

    def stop(self) -> None:
        self.feed.stop()
        self._thread.join()


@pytest.fixture
def capture() -> Callable[[str], list[bytes]]:
    """``capture("status_after_tick1.rep")``: the frames of a capture."""
    return frames


@pytest.fixture
def cpp_robot() -> Iterator[Callable[..., CppRobot]]:
    """``cpp_robot(port=…, xml=…, tree_id=…)``: a robot that runs C++."""
    robots: list[CppRobot] = []

    def start(**options) -> CppRobot:
        robots.append(CppRobot(**options))
        return robots[-1]

    yield start
    for robot in robots:
        if not robot._socket.closed:
            robot.close()


@pytest.fixture
def watch() -> Iterator[Callable[..., Watcher]]:
    """``watch(address, record=…, blackboard_rate=…)``: a feed on a thread of its own."""
    watchers: list[Watcher] = []

    def watch(address: str, **options) -> Watcher:
        watchers.append(Watcher(address, **options))
        return watchers[-1]

    yield watch
    for watcher in watchers:
        watcher.feed.stop()
    for watcher in watchers:
        watcher.stop()
