"""Our publisher against Groot 2's protocol, over real sockets, decoded here without our code."""

import os
import struct
import threading
import time
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import btcore
from btcore import SimClock
from btcore_monitor.serve import Publisher, serve
from btcore_monitor.serve.blackboards import BlackboardTracker
from btcore_monitor.wire.fulltree import read_fulltree

pytestmark = pytest.mark.usefixtures("no_threads_left")
CAPTURES = Path(__file__).parents[1] / "captures"


@dataclass
class Window:
    """A client like Groot 2's window: a REQ socket."""

    publisher: Publisher
    socket: "zmq.Socket[bytes]"

    def send(self, *frames: bytes) -> list[bytes]:
        self.socket.send_multipart(frames)
        assert self.socket.poll(60_000), "no reply within a minute"
        return self.socket.recv_multipart()

    def ask(self, kind: str, body: bytes | None = None) -> bytes:
        """Check the header of the reply, and return its second frame."""
        unique = os.urandom(4)
        reply = self.send(b"\x02" + kind.encode() + unique, *([] if body is None else [body]))
        assert len(reply[0]) == 22, reply
        assert reply[0][:6] == b"\x02" + kind.encode() + unique
        assert reply[0][6:].hex() == self.publisher.tree_id
        return reply[1] if len(reply) == 2 else b""

    def statuses(self) -> list[tuple[int, int]]:
        return list(struct.iter_unpack("<HB", self.ask("S")))

    def transitions(self) -> list[tuple[int, int, int]]:
        body = self.ask("t")
        records = struct.iter_unpack("<6sHB", body)
        return [(int.from_bytes(offset, "little"), uid, status) for offset, uid, status in records]


def captured(name: str) -> bytes:
    """The second frame of a captured reply."""
    data = (CAPTURES / f"{name}.rep.bin").read_bytes()
    (size,) = struct.unpack_from("<I", data)
    return data[8 + size :]


@pytest.fixture
def window() -> Iterator["Windows"]:
    windows = Windows()
    yield windows
    for socket in windows.sockets:
        socket.close(linger=0)
    windows.context.term()


class Windows:
    def __init__(self) -> None:
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.sockets: list[zmq.Socket[bytes]] = []

    def __call__(self, publisher: Publisher) -> Window:
        socket = self.context.socket(zmq.REQ)
        socket.connect(publisher.address)
        self.sockets.append(socket)
        return Window(publisher, socket)


def test_statuses_equal_original_bytes_before_in_and_after_run(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        assert groot.ask("S") == captured("v4_status_before_first_tick")
        sample.tick_exactly_once()
        assert groot.ask("S") == captured("v4_status_after_tick1")
        sample.tick_exactly_once()
        sample.tick_exactly_once()
        assert groot.ask("S") == captured("v4_status_after_completion")


def test_blackboards_equal_the_originals_bytes(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        assert groot.ask("B", b"Main;Sub::6") == captured("v4_blackboard_before_first_tick")
        sample.tick_exactly_once()
        assert groot.ask("B", b"Main;Sub::6;nope") == captured("v4_blackboard")
        sample.tick_exactly_once()
        sample.tick_exactly_once()
        assert groot.ask("B", b"Main;Sub::6") == captured("v4_blackboard_after")


def test_recorded_transitions_equal_originals_and_are_read_once(sample: btcore.Tree, window: Windows) -> None:
    original = captured("v4_get_transitions")
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        assert groot.transitions() == []
        before = time.time_ns() // 1000
        start = groot.ask("r", b"start")
        assert start.isdigit()
        assert len(start) == 16
        assert before <= int(start) <= time.time_ns() // 1000
        for _ in range(3):
            sample.tick_exactly_once()
        found = groot.transitions()
        assert groot.transitions() == []
    assert [transition[1:] for transition in found] == [
        struct.unpack_from("<HB", original, at + 6) for at in range(0, len(original), 9)
    ]
    offsets = [transition[0] for transition in found]
    assert offsets == sorted(offsets)
    assert int(start) + offsets[-1] <= time.time_ns() // 1000


def test_stop_keeps_the_recording_and_start_clears_it(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        groot.ask("r", b"start")
        sample.tick_exactly_once()
        assert groot.ask("r", b"stop") == b""
        sample.tick_exactly_once()
        sample.tick_exactly_once()
        changes = [change[1:] for change in groot.transitions()]
        assert changes == [(1, 1), (2, 2), (3, 1), (4, 3), (5, 1)]
        groot.ask("r", b"start")
        sample.halt()
        groot.ask("r", b"start")
        assert groot.transitions() == []


def test_a_recording_keeps_the_last_thousand_transitions(endless: btcore.Tree, window: Windows) -> None:
    with serve(endless, groot2_port=0) as publisher:
        groot = window(publisher)
        groot.ask("r", b"start")
        for _ in range(400):
            endless.tick_exactly_once()
        assert len(groot.transitions()) == 1000


def test_a_halted_node_has_10_plus_its_last_status_but_is_recorded_as_idle(
    sample: btcore.Tree, window: Windows
) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        sample.tick_exactly_once()
        groot.ask("r", b"start")
        sample.halt()
        assert dict(groot.statuses())[5] == 11
        assert dict(groot.statuses())[2] == 12
        assert dict(groot.statuses())[4] == 13
        assert {status for _, _, status in groot.transitions()} == {0}


def test_the_full_tree_equals_the_captured_tree(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        xml = window(publisher).ask("T")
    ours = read_fulltree(xml, publisher.tree_id)
    original = read_fulltree((CAPTURES / "v4_fulltree.xml").read_bytes(), publisher.tree_id)
    assert ours == original


def test_the_tree_id_is_a_new_random_uuid_for_each_publisher(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as first:
        identity = uuid.UUID(first.tree_id)
        assert (identity.version, identity.variant) == (4, uuid.RFC_4122)
    with serve(sample, groot2_port=0) as second:
        window(second).ask("S")
        assert second.tree_id != first.tree_id


INVALID_REQUESTS = [
    ([b"\x02T\x00"], "wrong request header"),
    ([b""], "wrong request header"),
    ([b"\x02I\x01\x02\x03\x04"], "must be 2 parts message"),
    ([b"\x02B\x01\x02\x03\x04"], "must be 2 parts message"),
    ([b"\x02r\x01\x02\x03\x04", b"start", b"now"], "must be 2 parts message"),
    ([b"\x02Z\x01\x02\x03\x04"], "Request not recognized"),
    ([b"\x02N\x01\x02\x03\x04"], "Request not recognized"),
    ([b"\x02\x00\x01\x02\x03\x04"], "Request not recognized"),
    ([b"\x02I\x01\x02\x03\x04", b"{}"], "hooks are disabled"),
    ([b"\x02R\x01\x02\x03\x04", b"{}"], "hooks are disabled"),
    ([b"\x02U\x01\x02\x03\x04", b"not json"], "hooks are disabled"),
    ([b"\x02D\x01\x02\x03\x04"], "hooks are disabled"),
    ([b"\x02A\x01\x02\x03\x04"], "hooks are disabled"),
    ([b"\x02X\x01\x02\x03\x04"], "hooks are disabled"),
]


def test_an_invalid_request_gets_an_error_of_two_frames(
    sample: btcore.Tree, window: Windows, subtests: Any
) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        for frames, sentence in INVALID_REQUESTS:
            with subtests.test(frames=frames):
                assert groot.send(*frames) == [b"error", sentence.encode()]


def test_protocol_byte_is_ignored_and_extra_frames_too(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        reply = window(publisher).send(b"\x07S\x01\x00\x00\x00", b"extra")
        assert reply[0][:6] == b"\x02S\x01\x00\x00\x00"
        assert reply[1] == captured("v4_status_before_first_tick")


def test_request_without_known_blackboard_is_answered_with_nil(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        assert groot.ask("B", b"") == b"\xc0"
        assert groot.ask("B", b"nope;;\xff") == b"\xc0"


def test_the_publisher_survives_random_requests(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        letters = st.sampled_from(list(b"TSBIRNUDAXrtZ\x00"))
        header = st.builds(
            lambda kind, rest: bytes([2, kind]) + rest, letters, st.binary(min_size=4, max_size=4)
        )
        frames = st.lists(st.binary(max_size=30), min_size=0, max_size=3)

        @given(header | st.binary(max_size=8), frames)
        @settings(max_examples=2 * settings().max_examples, suppress_health_check=list(HealthCheck))
        def noise(first: bytes, rest: list[bytes]):
            reply = groot.send(first, *rest)
            assert reply[0] == b"error" or len(reply[0]) == 22

        noise()
        assert len(groot.statuses()) == 10


@pytest.fixture
def writing() -> Iterator[btcore.Tree]:
    """A tree that ticks as fast as it can on its own thread, and writes its blackboard in each tick."""
    turns = [0]

    @btcore.action
    def write() -> bool:
        board = tree.blackboard
        turns[0] += 1
        board["row"] = [float(turns[0])] * 200
        board[f"key{turns[0] % 50}"] = turns[0]
        if turns[0] % 7 == 0:
            del board[f"key{turns[0] % 50}"]
        return True

    registry = btcore.Registry.standard()
    registry.add(write)
    xml = '<root BTCPP_format="4"><BehaviorTree ID="M"><Write/></BehaviorTree></root>'
    tree = btcore.loads(xml, nodes=registry, resources=[SimClock()])
    stop = threading.Event()

    def tick() -> None:
        while not stop.is_set():
            tree.tick_exactly_once()

    ticking = threading.Thread(target=tick)
    ticking.start()
    yield tree
    stop.set()
    ticking.join()
    assert turns[0] > 100


def test_blackboards_are_consistent_while_the_tree_writes_them(writing: btcore.Tree, window: Windows) -> None:
    with serve(writing, groot2_port=0) as publisher:
        groot = window(publisher)
        for _ in range(15):
            board = (msgpack.unpackb(groot.ask("B", b"M")) or {}).get("M") or {"row": []}
            assert len(set(board["row"])) <= 1


def test_the_tracker_can_read_blackboards_while_the_tree_ticks(writing: btcore.Tree) -> None:
    tracker = BlackboardTracker(writing)
    for _ in range(500):
        board = tracker.read_now()[""]
        assert len(set(board.get("row", []))) <= 1


def test_values_written_from_outside_are_shown_without_a_tick(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        groot = window(publisher)
        sample.blackboard["x"] = 7
        assert msgpack.unpackb(groot.ask("B", b"Main"))["Main"]["x"] == 7


def test_the_port_is_free_again_after_closing(sample: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as publisher:
        port = publisher.port
        window(publisher).ask("S")
    with serve(sample, groot2_port=port) as publisher:
        assert publisher.port == port
        assert len(window(publisher).statuses()) == 10


def test_without_run_channel_its_port_stays_free(sample: btcore.Tree) -> None:
    with (
        serve(sample, groot2_port=0, run_channel=False) as first,
        zmq.Context() as context,
        context.socket(zmq.REP) as other,
    ):
        other.bind(f"tcp://127.0.0.1:{first.port + 2}")


def test_one_process_publishes_two_trees(sample: btcore.Tree, endless: btcore.Tree, window: Windows) -> None:
    with serve(sample, groot2_port=0) as first, serve(endless, groot2_port=0) as second:
        assert abs(first.port - second.port) >= 3
        assert first.address == f"tcp://127.0.0.1:{first.port}"
        assert len(window(first).statuses()) == 10
        assert len(window(second).statuses()) == 7
