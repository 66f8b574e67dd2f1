"""Breakpoints and injected statuses by Groot 2's requests, over real sockets, decoded without our code."""

import json
import os
import struct
import threading
import time
from collections.abc import Callable, Iterator
from itertools import combinations, product
from pathlib import Path
from typing import Any

import pytest
import zmq
from hypothesis import given, settings
from hypothesis import strategies as st

import btcore
from btcore.tree.hooks import Hook, HookMode
from btcore_monitor.serve import Publisher, serve
from btcore_monitor.wire import groot2
from btcore_monitor.wire.hooks import (
    BreakpointUnlock,
    WireHook,
    decode_hooks,
    encode_breakpoint_reached,
    encode_dump,
    encode_hooks,
    encode_place,
    encode_unlocking,
)

pytestmark = pytest.mark.usefixtures("no_threads_left")
CAPTURES = Path(__file__).parents[1] / "captures"
BREAKPOINT = {"enabled": True, "uid": 4, "mode": 0, "once": False, "desired_status": "SKIPPED", "position": 0}


def frames_of(name: str) -> list[bytes]:
    """The frames of a capture: each has its length (u32) before it."""
    data, frames = (CAPTURES / f"{name}.bin").read_bytes(), []
    while data:
        (size,) = struct.unpack_from("<I", data)
        frames.append(data[4 : 4 + size])
        data = data[4 + size :]
    return frames


class Window:
    """A client like Groot 2's window: a REQ socket, and a SUB socket at the next port."""

    def __init__(self, publisher: Publisher) -> None:
        self.publisher = publisher
        self.context: zmq.Context[zmq.Socket[bytes]] = zmq.Context()
        self.requests = self.context.socket(zmq.REQ)
        self.requests.connect(publisher.address)
        self.notices = self.context.socket(zmq.SUB)
        self.notices.setsockopt(zmq.SUBSCRIBE, b"")
        ready = self.notices.get_monitor_socket(zmq.EVENT_HANDSHAKE_SUCCEEDED)
        self.notices.connect(f"tcp://127.0.0.1:{publisher.port + 1}")
        connected = ready.poll(60_000)
        self.notices.disable_monitor()
        ready.close(linger=0)
        assert connected
        self.ask("S")

    def send(self, *frames: bytes) -> list[bytes]:
        self.requests.send_multipart(frames)
        assert self.requests.poll(60_000), "no reply within a minute"
        return self.requests.recv_multipart()

    def ask(self, kind: str, what: object = None) -> bytes:
        body = [] if what is None else [what if isinstance(what, bytes) else json.dumps(what).encode()]
        header = b"\x02" + kind.encode() + os.urandom(4)
        reply = self.send(header, *body)
        assert reply[0][:6] == header, reply
        assert reply[0][6:].hex() == self.publisher.tree_id
        return b"".join(reply[1:])

    def refused(self, kind: str, what: object = None) -> str:
        body = [] if what is None else [what if isinstance(what, bytes) else json.dumps(what).encode()]
        word, sentence = self.send(b"\x02" + kind.encode() + b"abcd", *body)
        assert word == b"error"
        return sentence.decode()

    def dump(self) -> list[dict[str, object]]:
        found: list[dict[str, object]] = json.loads(self.ask("D"))
        return found

    def reached(self) -> int:
        assert self.notices.poll(60_000), "no notification within a minute"
        header, uid = self.notices.recv_multipart()
        assert (len(header), header[:2]) == (6, b"\x02N")
        return int(uid)

    def close(self) -> None:
        self.requests.close(linger=0)
        self.notices.close(linger=0)
        self.context.term()


Opening = Callable[..., Window]


@pytest.fixture
def control() -> Iterator[Opening]:
    """Return a function that publishes a tree, with control allowed, and connects a window to it."""
    opened: list[Window] = []

    def open_window(tree: btcore.Tree, **options: float) -> Window:
        publisher = serve(tree, groot2_port=0, run_channel=False, allow_control=True, **options)
        opened.append(Window(publisher))
        return opened[-1]

    yield open_window
    for window in opened:
        window.close()
        window.publisher.close()


class Ticking:
    """A single tick of a tree, on its own thread."""

    def __init__(self, tree: btcore.Tree) -> None:
        self._tree = tree
        self._status: btcore.Status | None = None
        self.thread = threading.Thread(target=self._tick)
        self.thread.start()

    def _tick(self) -> None:
        self._status = self._tree.tick_exactly_once()

    def end(self) -> btcore.Status | None:
        self.thread.join(60)
        assert not self.thread.is_alive(), "the tick still stands"
        return self._status


# --- bytes


def test_our_requests_equal_the_captured_requests_byte_for_byte() -> None:
    assert encode_hooks([WireHook(4)]) == frames_of("v4_hook_insert_breakpoint.req")[1]
    failing = WireHook(5, position=1, mode=1, once=True, desired_status="FAILURE")
    assert b"[" + encode_hooks([failing]) + b"]" == frames_of("v4_hook_insert_array_replace_post.req")[1]
    assert encode_place(4, 0) == frames_of("v4_hook_remove.req")[1]
    unlocking = BreakpointUnlock(4, 0, "SUCCESS", False)
    assert encode_unlocking(unlocking) == frames_of("v4_breakpoint_unlock.req")[1]


def test_our_dump_and_notification_equal_the_captures_byte_for_byte() -> None:
    assert encode_dump([WireHook(4)]) == frames_of("v4_hooks_dump_one.rep")[1]
    assert encode_dump([]) == frames_of("v4_hooks_dump_empty.rep")[1]
    captured = frames_of("v4_breakpoint_reached.pub")
    assert encode_breakpoint_reached(4, int.from_bytes(captured[0][2:], "little")) == captured
    assert groot2.decode_breakpoint_reached(captured) == 4


def test_a_dump_is_read_back() -> None:
    hooks = [WireHook(4), WireHook(7, 1, 1, True, "FAILURE", False)]
    assert decode_hooks(encode_dump(hooks)) == decode_hooks(encode_hooks(hooks)) == hooks


@pytest.mark.parametrize(
    "name",
    [
        "hooks_dump_empty",
        "hook_insert_breakpoint",
        "hooks_dump_one",
        "breakpoint_unlock",
        "hook_remove",
        "hook_remove_missing_error",
        "hook_insert_array_replace_post",
        "remove_all_hooks",
        "disable_all_hooks",
        "error_missing_part2",
        "error_unknown_request",
        "error_bad_header",
    ],
)
def test_captured_requests_get_the_captured_replies_except_for_the_tree_id(
    sample: btcore.Tree, control: Opening, name: str
) -> None:
    window = control(sample)
    if name in ("hooks_dump_one", "breakpoint_unlock", "hook_remove"):
        window.send(*frames_of("v4_hook_insert_breakpoint.req"))
    expected = frames_of(f"v4_{name}.rep")
    if len(expected[0]) == 22:
        expected[0] = expected[0][:6] + bytes.fromhex(window.publisher.tree_id)
    assert window.send(*frames_of(f"v4_{name}.req")) == expected


def test_the_whole_captured_session_can_be_repeated(sample: btcore.Tree, control: Opening) -> None:
    """g2cli.out.txt: a breakpoint before AlwaysFailure, released with SUCCESS; then Count is made to fail."""
    window = control(sample)
    while sample.tick_exactly_once() is btcore.Status.RUNNING:
        pass
    window.send(*frames_of("v4_hook_insert_breakpoint.req"))
    tick = Ticking(sample)
    assert window.reached() == 4
    assert window.ask("S").hex() == "01000102000203000104000d05000c06000c0a000007000c08000c09000c"
    window.send(*frames_of("v4_breakpoint_unlock.req"))
    assert tick.end() is btcore.Status.RUNNING
    window.send(*frames_of("v4_hook_remove.req"))
    window.send(*frames_of("v4_hook_insert_array_replace_post.req"))
    assert sample.tick_exactly_once() is btcore.Status.SUCCESS
    assert sample.tick_exactly_once() is btcore.Status.FAILURE
    assert window.reached() == 5
    assert window.ask("D") == b"[]"
    assert window.ask("S").hex() == "01000d02000c03000d04000d05000d06000c0a000007000c08000c09000c"


# --- errors


def without(key: str) -> dict[str, object]:
    return {name: value for name, value in BREAKPOINT.items() if name != key}


OUT = "[json.exception.out_of_range.403] key '{}' not found"
TYPE = "[json.exception.type_error.302] type must be {}, but is {}"


INVALID_REQUESTS: list[tuple[str, Any, str]] = [
    ("I", {"uid": 4}, OUT.format("position")),
    ("I", {}, OUT.format("uid")),
    *(("I", without(key), OUT.format(key)) for key in BREAKPOINT),
    ("I", BREAKPOINT | {"uid": "four"}, TYPE.format("number", "string")),
    ("I", BREAKPOINT | {"enabled": 1}, TYPE.format("boolean", "number")),
    ("I", BREAKPOINT | {"desired_status": None}, TYPE.format("string", "null")),
    ("I", BREAKPOINT | {"desired_status": "MAYBE"}, "Cannot convert this to NodeStatus: MAYBE"),
    ("I", [1], "[json.exception.type_error.304] cannot use at() with number"),
    (
        "I",
        b"not json",
        "[json.exception.parse_error.101] parse error at line 1, column 2: "
        "syntax error while parsing value - invalid literal; last read: 'no'",
    ),
    ("R", {"uid": 4}, OUT.format("position")),
    ("R", {"uid": 4, "position": 0}, "Node ID not found"),
    ("U", {"uid": 4, "position": 0, "desired_status": "SUCCESS"}, OUT.format("remove_when_done")),
    (
        "U",
        {"uid": 4, "position": 1, "desired_status": "", "remove_when_done": False},
        "Node ID not found",
    ),
]


def test_an_invalid_request_is_refused_with_the_originals_message(
    sample: btcore.Tree, control: Opening, subtests: Any
) -> None:
    window = control(sample)
    for kind, body, sentence in INVALID_REQUESTS:
        with subtests.test(kind=kind, body=body):
            assert window.refused(kind, body) == sentence
            assert window.dump() == []


def test_unencodable_text_and_invalid_json_are_refused(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    assert "NodeStatus" in window.refused("I", BREAKPOINT | {"desired_status": "\ud800"})
    for noise in (b"", b"[" * 100_000, b"\xff\xfe", b"9" * 5000, b"NaN", b'{"uid": 1e999}', b"[1,", b"nul"):
        assert "json" in window.refused("I", noise)
    assert window.dump() == []


def test_a_hook_for_an_unknown_node_is_accepted_and_ignored(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    assert window.ask("I", BREAKPOINT | {"uid": 999}) == b""
    assert window.dump() == []


# --- effects of hooks


def test_a_dump_lists_hooks_before_a_tick_first(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    window.ask("I", [BREAKPOINT | {"position": 1}, BREAKPOINT | {"uid": 7, "mode": 1}])
    assert [(hook["uid"], hook["position"], hook["mode"]) for hook in window.dump()] == [(7, 0, 1), (4, 1, 0)]


def test_a_hook_at_the_same_place_is_replaced(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    window.ask("I", BREAKPOINT)
    changed = BREAKPOINT | {"mode": 1, "once": True, "desired_status": "FAILURE", "enabled": False}
    window.ask("I", changed)
    assert window.dump() == [changed]


@pytest.mark.parametrize(
    ("kind", "body", "left"),
    [
        ("R", {"uid": 4, "position": 0}, 0),
        ("A", None, 0),
        ("X", None, 1),
        ("I", BREAKPOINT | {"mode": 1}, 1),
        ("U", {"uid": 4, "position": 0, "desired_status": "RUNNING", "remove_when_done": True}, 0),
    ],
)
def test_requests_that_release_a_waiting_tick(
    sample: btcore.Tree,
    control: Opening,
    kind: str,
    body: dict[str, int] | dict[str, object] | None,
    left: int,
) -> None:
    window = control(sample)
    window.ask("I", BREAKPOINT)
    tick = Ticking(sample)
    assert window.reached() == 4
    window.ask(kind, body)
    assert tick.end() is btcore.Status.RUNNING
    assert dict(struct.iter_unpack("<HB", window.ask("S")))[4] == 3
    assert len(window.dump()) == left


def test_statuses_and_blackboards_are_answered_at_a_breakpoint(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    window.ask("I", BREAKPOINT)
    tick = Ticking(sample)
    window.reached()
    assert dict(struct.iter_unpack("<HB", window.ask("S")))[2] == 2
    assert b"hello" in window.ask("B", b"Main")
    window.ask("A")
    tick.end()


def test_recorded_transitions_show_the_injected_status(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    window.ask("r", b"start")
    window.ask("I", BREAKPOINT | {"uid": 5, "mode": 1, "position": 1, "desired_status": "FAILURE"})
    assert sample.tick_exactly_once() is btcore.Status.FAILURE
    body = window.ask("t")
    changes = [struct.unpack_from("<HB", body, at + 6) for at in range(0, len(body), 9)]
    assert (5, 3) in changes
    assert (5, 1) not in changes


# --- hooks work only as long as their client stays connected


def test_hooks_that_a_silent_client_left_stay_disabled_until_they_are_inserted_again(
    sample: btcore.Tree, control: Opening
) -> None:
    window = control(sample, max_heartbeat_delay=0.3)
    window.ask("I", [BREAKPOINT, BREAKPOINT | {"uid": 5}])
    tick = Ticking(sample)
    window.reached()
    assert tick.end() is btcore.Status.RUNNING
    assert [hook.enabled for hook in sample.hooks.all()] == [False, False]
    assert [hook["enabled"] for hook in window.dump()] == [False, False]
    window.ask("I", BREAKPOINT)
    assert {hook["uid"]: hook["enabled"] for hook in window.dump()} == {4: True, 5: False}


def test_a_client_that_only_watches_neither_enables_hooks_nor_keeps_them_enabled(
    sample: btcore.Tree, control: Opening, until: Callable[..., None]
) -> None:
    """In BehaviorTree.CPP 4.10 the first request of a monitor brings back the breakpoints of others."""
    window = control(sample, max_heartbeat_delay=0.3)
    watching = Window(window.publisher)
    try:
        window.ask("I", BREAKPOINT)

        def are_disabled() -> bool:
            watching.ask("S")
            return [hook["enabled"] for hook in watching.dump()] == [False]

        until(are_disabled, "the breakpoint of the silent client is disabled")
        for kind, body in ("S", None), ("r", b"start"), ("t", None), ("X", None), ("T", None):
            watching.ask(kind, body)
        assert [hook.enabled for hook in sample.hooks.all()] == [False]
        while sample.tick_exactly_once() is btcore.Status.RUNNING:
            pass
    finally:
        watching.close()


def test_a_client_that_releases_breakpoints_keeps_hooks_enabled(
    sample: btcore.Tree, control: Opening, until: Callable[..., None]
) -> None:
    """Single commands, each with a connection of its own: break, and then release again and again."""
    window = control(sample, max_heartbeat_delay=3.0)
    releasing = Window(window.publisher)
    try:
        window.ask("I", BREAKPOINT)
        deadline = time.monotonic() + 4.0
        while time.monotonic() < deadline:
            time.sleep(0.1)
            releasing.ask("U", {"uid": 4, "position": 0, "desired_status": "", "remove_when_done": False})
            assert [hook["enabled"] for hook in releasing.dump()] == [True]
        until(lambda: not sample.hooks.all()[0].enabled, "both are silent")
    finally:
        releasing.close()


def test_hooks_of_program_itself_stay_enabled_without_client(sample: btcore.Tree, control: Opening) -> None:
    publisher = control(sample, max_heartbeat_delay=0.01).publisher
    sample.hooks.insert(Hook(5, mode=HookMode.REPLACE, desired_status=btcore.Status.FAILURE))
    assert not publisher.wait_for_clients(1, 0.1)
    assert [hook.enabled for hook in sample.hooks.all()] == [True]


def test_a_request_of_any_kind_counts_as_a_heartbeat(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample, max_heartbeat_delay=3.0)
    window.ask("I", BREAKPOINT)
    tick = Ticking(sample)
    window.reached()
    deadline = threading.Event()
    for _ in range(10):
        assert window.send(b"no request")[0] == b"error"
        deadline.wait(0.4)
    assert tick.thread.is_alive()
    window.ask("A")
    tick.end()


def test_a_finished_publisher_removes_its_hooks(sample: btcore.Tree, control: Opening) -> None:
    window = control(sample)
    window.ask("I", BREAKPOINT)
    tick = Ticking(sample)
    window.reached()
    window.publisher.end_stream()
    tick.end()
    assert sample.hooks.all() == []
    assert window.refused("I", BREAKPOINT) == "hooks are disabled"
    assert window.refused("D") == "hooks are disabled"


def test_replacing_the_tree_removes_its_hooks(
    sample: btcore.Tree, endless: btcore.Tree, control: Opening, until: Callable[..., None]
) -> None:
    window = control(sample)
    window.ask("I", BREAKPOINT)
    window.publisher.replace_tree(endless)
    assert sample.hooks.all() == []
    until(lambda: window.send(b"\x02D0000")[0][6:].hex() == window.publisher.tree_id, "the new tree")
    assert window.dump() == []
    window.ask("I", BREAKPOINT | {"uid": 1})
    assert [hook.uid for hook in endless.hooks.all()] == [1]


# --- noise

GOOD = {
    "enabled": (True,),
    "uid": range(1, 9),
    "mode": (0, 1),
    "once": (False, True),
    "desired_status": ("SUCCESS", "FAILURE", "SKIPPED"),
    "position": (0, 1),
    "remove_when_done": (False, True),
}
BAD = {
    "enabled": (False, None),
    "uid": (0, None),
    "mode": (-1, 2),
    "once": (1,),
    "desired_status": ("RUNNING", "IDLE", "?"),
    "position": (-1, 2),
    "remove_when_done": ("no",),
}
# Whole hooks and fields are sampled, because drawing each value takes longer than the request.
HOOKS = st.sampled_from([dict(zip(GOOD, values, strict=True)) for values in product(*GOOD.values())])
FEWER = st.sampled_from([(), *combinations(GOOD, 1), *combinations(GOOD, 3), tuple(GOOD)])
CHANGES = st.sampled_from([{}, *({key: value} for key, values in BAD.items() for value in values)])
UIDS = st.builds(lambda uid: {"uid": uid}, st.text(max_size=3) | st.floats())
PIECES = st.builds(
    lambda hook, fewer, change: {key: value for key, value in hook.items() if key not in fewer} | change,
    HOOKS,
    FEWER,
    CHANGES | UIDS,
)
BODIES = st.builds(lambda value: json.dumps(value).encode(), PIECES | HOOKS | st.lists(HOOKS, max_size=3))
KINDS = st.sampled_from(list(b"TSBIRNUDAXrtZ\x00IRU?=<"))
HEADERS = st.builds(lambda kind, rest: bytes([2, kind]) + rest, KINDS, st.binary(min_size=4, max_size=4))


def test_robot_and_publisher_survive_random_requests(
    endless: btcore.Tree, control: Opening, until: Callable[..., None]
) -> None:
    window = control(endless)
    stop = threading.Event()

    def tick() -> None:
        while not stop.wait(0.001):
            endless.tick_exactly_once()

    ticking = threading.Thread(target=tick)
    ticking.start()
    answers = {"error": 0, "reply": 0}

    @given(HEADERS | st.binary(max_size=8), st.lists(BODIES | st.binary(max_size=20), max_size=2))
    @settings(max_examples=4 * settings().max_examples, database=None)
    def noise(first: bytes, rest: list[bytes]) -> None:
        reply = window.send(first, *rest)
        if reply[0] == b"error":
            assert len(reply) == 2
            answers["error"] += 1
        else:
            assert reply[0][:1] + reply[0][2:6] == b"\x02" + first[2:6]
            assert len(reply[0]) == 22
            answers["reply"] += 1

    try:
        noise()
    finally:
        window.ask("A")
        before = endless.ticks
        until(lambda: endless.ticks > before, "a further tick")
        stop.set()
        ticking.join(60)
    assert min(answers.values()) > 4  # both kinds of answers
