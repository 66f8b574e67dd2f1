"""Feeds of robots whose captured messages are damaged: errors are reported, and the feed recovers."""

import random
import struct
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zmq

from btcore_monitor.events import BlackboardEvent, ConnectionEvent, Event, TransitionEvent, TreeEvent
from btcore_monitor.log_writer import LogWriter
from btcore_monitor.watch import feed, groot1_feed, groot2_feed
from btcore_monitor.watch.address import Address, parse_address
from btcore_monitor.watch.feed import Feed
from btcore_monitor.watch.groot1_feed import Groot1Feed
from btcore_monitor.watch.groot2_client import Groot2Client, NoReplyError
from btcore_monitor.wire.errors import ProtocolError

CAPTURES = Path(__file__).parents[1] / "captures"
REPLIES = {
    "T": ["fulltree"],
    "S": ["status_before_first_tick", "status_after_tick1", "status_after_completion"],
    "B": ["blackboard", "blackboard_after", "blackboard_before_first_tick"],
    "D": ["hooks_dump_one", "hooks_dump_empty"],
    "r": ["toggle_recording_start"],
    "t": ["get_transitions"],
}
CASES = 400


def damaged(data: bytes, rng: random.Random) -> bytes:
    """Return *data* with a few bytes changed, inserted, removed or repeated."""
    changed = bytearray(data)
    for _ in range(rng.choice((1, 1, 3, 12))):
        at = rng.randrange(len(changed) + 1)
        kind = rng.randrange(5)
        if kind == 0 and at < len(changed):
            changed[at] ^= 1 << rng.randrange(8)
        elif kind == 1 and at < len(changed):
            changed[at] = rng.choice((0, 127, 128, 255))
        elif kind == 2:
            changed[at:at] = rng.randbytes(rng.randrange(9))
        elif kind == 3:
            del changed[at : at + rng.randrange(40)]
        else:
            changed[at:at] = changed[: rng.randrange(64)]
    return bytes(changed)


class Robot:
    """Replies to each request with the frames that *answer* returns, from a thread of its own."""

    def __init__(self, answer: Callable[[list[bytes]], list[bytes]]) -> None:
        self._answer = answer
        self._stopped = threading.Event()
        self.context: zmq.Context = zmq.Context()
        self._socket = self.context.socket(zmq.REP)
        self.port = self._socket.bind_to_random_port("tcp://127.0.0.1")
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    @property
    def address(self) -> Address:
        return parse_address(f"127.0.0.1:{self.port}")

    def _run(self) -> None:
        while not self._stopped.is_set():
            if self._socket.poll(20):
                self._socket.send_multipart(self._answer(self._socket.recv_multipart()))
        self._socket.close(linger=0)

    def close(self) -> None:
        self._stopped.set()
        self._thread.join()
        self.context.destroy(linger=0)


@pytest.fixture
def robot() -> Iterator[Callable[..., Robot]]:
    started: list[Robot] = []

    def start(answer: Callable[[list[bytes]], list[bytes]]) -> Robot:
        started.append(Robot(answer))
        return started[-1]

    yield start
    for watcher in started:
        watcher.close()


@pytest.fixture
def log(tmp_path: Path) -> Iterator[LogWriter]:
    writer = LogWriter([tmp_path / "x.btlog", tmp_path / "x.db3"])
    yield writer
    writer.close()


@pytest.mark.parametrize("share", [0.1, 0.6])
def test_a_feed_of_damaged_groot_2_replies_recovers(
    robot: Callable[..., Robot],
    capture: Callable[[str], list[bytes]],
    log: LogWriter,
    until: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
    share: float,
) -> None:
    monkeypatch.setattr(feed, "_PAUSE_AFTER_ERROR_S", 0.0)
    monkeypatch.setattr(feed, "_PAUSE_S", 0.0)
    monkeypatch.setattr(groot2_feed, "STATUS_INTERVAL_S", 0.001)
    rng = random.Random(20)
    answers = damages = 0
    tree_ids = [bytes(16), bytes(range(16))]

    def answer(request: list[bytes]) -> list[bytes]:
        nonlocal answers, damages
        answers += 1
        kind, unique_id = struct.unpack("<xBI", request[0])
        frames = capture(f"{rng.choice(REPLIES[chr(kind)])}.rep")
        # Sometimes the robot restarts.
        frames[0] = struct.pack("<BBI", 2, kind, unique_id) + tree_ids[answers // 100 % 2]
        if answers < CASES and rng.random() < share:
            damages += 1
            at = rng.choice((0, 1, 1, 1, 1, 1, 1, 1, 1, 1))
            frames[at] = damaged(frames[at], rng)
        return frames

    reported: list[str] = []
    seen: list[Event] = []
    with Feed(str(robot(answer).address), blackboard_rate=100) as viewer:

        def poll() -> bool:
            is_healthy = answers > CASES
            for event in viewer.poll(0.1):
                log.process_event(event)
                if isinstance(event, ConnectionEvent) and event.state == "lost":
                    reported.append(event.detail)
                if is_healthy:
                    seen.append(event)
            return any(isinstance(event, TreeEvent) for event in seen) and any(
                isinstance(event, BlackboardEvent) for event in seen
            )

        until(poll, "the tree after the last damaged reply")
    assert damages > CASES * share / 2
    assert reported
    assert all(len(line) < 1_000 for line in reported)


def test_a_feed_of_damaged_groot_1_messages_recovers(
    robot: Callable[..., Robot], log: LogWriter, until: Callable[..., None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(groot1_feed, "_RETRY_AFTER_S", 0.0)
    monkeypatch.setattr(groot1_feed, "FIRST_UPDATE", 0.0)
    rng = random.Random(10)
    tree = (CAPTURES / "v3_behaviortree.flatbuffer.bin").read_bytes()
    updates = [(CAPTURES / f"v3_pub_{number}.bin").read_bytes() for number in (1, 2, 3)]
    sent = 0
    share = 0.5

    def answer(request: list[bytes]) -> list[bytes]:
        return [damaged(tree, rng) if rng.random() < share else tree]

    requests = robot(answer)
    publisher = requests.context.socket(zmq.PUB)
    port = publisher.bind_to_random_port("tcp://127.0.0.1")
    client = Groot2Client(parse_address(f"127.0.0.1:{requests.port}/{port}"))
    viewer = Groot1Feed(client)
    reported: list[str] = []
    seen: list[Event] = []

    def step() -> bool:
        nonlocal sent, share
        sent += 1
        if sent > CASES:
            share = 0.0
        update = rng.choice(updates)
        publisher.send(damaged(update, rng) if rng.random() < share else update)
        try:
            events = viewer.step()
        except (NoReplyError, ProtocolError) as error:
            viewer.resume()
            reported.append(str(error))
            return False
        for event in events:
            log.process_event(event)
        if not share:
            seen.extend(events)
        return any(isinstance(event, TransitionEvent) for event in seen)

    try:
        until(step, "transitions after the last damaged message")
    finally:
        viewer.close()
        client.close()
        publisher.close(linger=0)
    assert len(reported) > CASES / 20
    assert all(len(line) < 1_000 for line in reported)
