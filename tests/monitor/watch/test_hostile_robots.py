"""Clients against a hostile robot: a message, never a traceback, and a time limit always ends the command."""

import json
import math
import os
import struct
import subprocess
import sys
import threading
import time
import traceback
import warnings
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import msgpack
import pytest
import zmq
from click.testing import CliRunner

from btcore.cli.main import main
from btcore_monitor.commands.notices import format_notice
from btcore_monitor.events import Event, TreeEvent
from btcore_monitor.log_writer import LogWriter
from btcore_monitor.watch.feed import Feed
from btcore_monitor.wire import groot2
from btcore_monitor.wire import run_channel as wire
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot2 import RequestHeader
from btcore_monitor.wire.hooks import encode_breakpoint_reached

pytest.importorskip("rerun")
from btcore_monitor.screen.robot_layouts import SingleRobotLayout
from btcore_monitor.screen.robot_view import RobotView
from btcore_monitor.screen.sinks import RecordingSinks

ROOT = Path(__file__).parents[3]
TREE_ID = bytes(range(16))
XML = (
    b'<root BTCPP_format="4"><BehaviorTree ID="Main" _fullpath=""><Sequence name="all" _uid="1">'
    b'<AlwaysSuccess name="first" _uid="2"/><AlwaysSuccess name="second" _uid="3"/></Sequence></BehaviorTree>'
    b"</root>"
)
DEEP = 100_000
HUGE = 1 << 62
WALL = 1_700_000_000 * 10**9

Replies = Mapping[str, bytes | None]


def deep_msgpack(depth: int) -> bytes:
    """A blackboard whose entry is nested lists."""
    return b"\x81\xa4Main\x81\xa1x" + b"\x91" * depth + b"\xc0"


def tree_of(nodes: str) -> bytes:
    return f'<root BTCPP_format="4"><BehaviorTree ID="M" _fullpath="">{nodes}</BehaviorTree></root>'.encode()


def transitions(*records: tuple[int, int, int]) -> bytes:
    return b"".join(groot2.encode_transition(*record) for record in records)


REPLIES: dict[str, Replies] = {
    "a recording start of 20 digits": {"r": b"9" * 20},
    "transitions at the end of time": {
        "r": b"4611686018427387",
        "t": transitions((2**48 - 1, 2, 1), (0, 2, 2)),
    },
    "transitions that go back in time": {"t": transitions((2**48 - 1, 2, 1), (0, 2, 2), (5, 99, 1))},
    "14,000 transitions": {"t": transitions((1, 2, 1), (2, 2, 2)) * 7_000},
    "half a transition": {"t": b"1234"},
    "an unknown status": {"S": b"\1\0\x63"},
    "no statuses": {"S": b""},
    "a blackboard nested 100,000 deep": {"B": deep_msgpack(DEEP)},
    "a blackboard of wild values": {
        "B": msgpack.packb(
            {
                "Main": {
                    "nan": math.nan,
                    "inf": -math.inf,
                    "big": 1e308,
                    "u": 2**64 - 1,
                    "k" * 9_999: "|\n\x1b[2J",
                }
            }
        )
    },
    "hooks nested 100,000 deep": {"D": b"[" * DEEP + b"]" * DEEP},
    "hooks with wild numbers": {
        "D": json.dumps(
            [
                {
                    "uid": 1e308,
                    "position": -1e308,
                    "enabled": True,
                    "mode": 2**200,
                    "once": True,
                    "desired_status": "IDLE",
                }
            ]
        ).encode()
    },
    "hooks that are not JSON": {"D": b"\xff\xfe"},
    "a reply without a second frame": {"S": None},
    "a tree nested 100,000 deep": {
        "T": tree_of(
            "".join(f'<Inverter _uid="{uid}">' for uid in range(1, DEEP)) + "</Inverter>" * (DEEP - 1)
        )
    },
    "an entity bomb": {"T": b'<!DOCTYPE r [<!ENTITY a "aaaaaaaaaa">]><root>&a;</root>'},
}
"""The bodies of hostile replies by the letter of the request. The tests of wire/ have more of them."""


def message(kind: str, **values: object) -> bytes:
    """A message of the run channel without any check."""
    return bytes(msgpack.packb({"v": 1, "kind": kind, "tree_id": TREE_ID.hex(), **values}))


def piece(*messages: bytes, first: int = 1, last: int | None = None, latest: int | None = None) -> bytes:
    last = first + len(messages) - 1 if last is None else last
    return message("piece", first=first, last=last, latest=latest or last, messages=messages)


def tree(statuses: object = (), oldest: int = 1, latest: int = 0, stamp: int = 0, xml: bytes = XML) -> bytes:
    return message("tree", stamp=stamp, wall=WALL, xml=xml, oldest=oldest, latest=latest, statuses=statuses)


def stream(kind: str, seq: int = 1, stamp: int = 10**9, wall: int = WALL, **values: object) -> bytes:
    return message(kind, seq=seq, stamp=stamp, wall=wall, **values)


def ticks(
    *rows: object, first: int = 1, tick: int = 1, duration: int = 1, status: int = 1, **more: int
) -> bytes:
    return stream(
        "transitions",
        tick=tick,
        duration=duration,
        status=status,
        ended=True,
        first=first,
        transitions=rows,
        **more,
    )


def moving(**data: object) -> list[bytes]:
    return [tree(), piece(stream("moving", data=data))]


def static(**data: object) -> list[bytes]:
    return [tree(), message("static", data=data), piece(ticks())]


def grid(**values: object) -> dict[str, object]:
    cells = zlib.compress(b"\0" * 4)
    return {
        "name": "map",
        "kind": "occupancy",
        "resolution": 0.1,
        "origin": [0, 0],
        "size": [2, 2],
        "cells": cells,
        "coding": "zlib",
    } | values


def picture(**values: object) -> dict[str, object]:
    return {"name": "c", "size": [2, 2], "format": "jpeg", "data": b"no JPEG"} | values


def box(**values: object) -> dict[str, object]:
    return {"kind": "box", "position": [0, 0, 0], "size": [1, 1, 1]} | values


def floats(*values: float) -> bytes:
    return struct.pack(f"<{len(values)}f", *values)


ROW = [10**9, WALL, 1, 2, 0, 1]
WILD = (math.nan, math.inf, -math.inf, 1e308, -1e308, 1e9, -1e9, 0)
SCENES: dict[str, list[bytes]] = {
    "a piece up to 2^62": [tree(), piece(last=HUGE, first=1), piece(ticks(ROW, seq=HUGE), first=HUGE)],
    "a piece from 2^62 on": [tree(), piece(ticks(), first=HUGE - 1)],
    "a piece of messages that end at 2^62": [tree(), piece(ticks(), ticks(), last=HUGE - 1)],
    "a latest number of 2^62": [tree(), message("heartbeat", latest=HUGE - 1), piece(latest=HUGE - 1)],
    "a tree whose oldest message is 2^62": [tree(oldest=HUGE - 1, latest=HUGE - 1), piece(ticks())],
    "a million early pieces": [tree(), *(piece(ticks(), first=at * 7) for at in range(2, 200))],
    "stamps of 2^62": [tree(stamp=1 - HUGE), piece(ticks([HUGE - 1, 1 - HUGE, 1, 2, 0, 1], stamp=HUGE - 1))],
    "numbers of transitions at 2^62": [
        tree(),
        piece(ticks(ROW), ticks(ROW, seq=2, first=HUGE - 1, tick=HUGE - 1)),
    ],
    "a duration of 2^62": [tree(), piece(ticks(duration=HUGE - 1), ticks(seq=2, tick=3, duration=1 - HUGE))],
    "unknown nodes": [
        tree(statuses=[[-5, 1], [HUGE - 1, 1]]),
        piece(ticks([10**9, WALL, 1, HUGE - 1, 0, 1])),
    ],
    "a message nested 100,000 deep": [tree(), b"\x91" * DEEP + b"\xc0"],
    "messages that are pieces": [tree(), piece(piece(piece(ticks())))],
    "a version of the future": [b"", msgpack.packb({"v": 99})],
    "a tree that is not XML": [tree(xml=b"\0"), piece(ticks())],
    "an error of a million characters": [
        tree(),
        piece(stream("exception", path="p" * 10**6, message="\x1b[2J" * 10**5)),
    ],
    "ends without end": [
        tree(),
        piece(*(stream("end", seq=at, status=1, dropped=HUGE - 1) for at in (1, 2, 3))),
    ],
    "wild positions": [
        tree(),
        *(
            piece(
                stream("moving", seq=at, data={"frames": [["base_link", "map", [x, x, x], [x, x, x, x]]]}),
                first=at,
            )
            for at, x in enumerate(WILD, start=1)
        ),
    ],
    "wild speeds": [
        tree(),
        *(
            piece(stream("moving", seq=at, data={"velocity": [x, x], "battery": x}), first=at)
            for at, x in enumerate(WILD, start=1)
        ),
    ],
    "frames in a circle": moving(
        frames=[[f"f{at}", f"f{(at + 1) % 200}", [0, 0, 1], [0, 0, 0, 1]] for at in range(200)]
        + [["base_link", "f1", [0, 0, 0], [0, 0, 0, 1]]]
    ),
    "a scan of wild ranges": [
        tree(),
        message(
            "static",
            data={"laser": {"frame": "l", "angle_min": 1e9, "angle_increment": 1e9, "range_max": -1e9}},
        ),
        piece(
            stream(
                "moving", data={"scan": {"ranges": floats(math.nan, math.inf, -math.inf, 3e38, -3e38) * 99}}
            )
        ),
    ],
    "wild poses": moving(
        poses=[
            {"name": kind, "kind": kind, "rows": floats(math.nan, math.inf, 3e38, 1, 1, math.inf, 1, 1, 1)}
            for kind in ("path", "cloud", "goal", "estimate", "odometry")
        ]
    ),
    "strange names": moving(
        arrows=[
            {"name": name, "start": [0, 0, 0], "end": [1, 1, 1]}
            for name in (
                "",
                "/",
                "../..",
                "a/b",
                "\0",
                "😀",
                "n" * 99_999,
                " ",
                "[",
                '"',
                "\x1b[2J",
                "\u202e",
            )
        ],
        notes={"| \n": "<script>\x1b[2J" * 100},
    ),
    "grids with a wild resolution": moving(
        grids=[grid(name=str(at), resolution=x) for at, x in enumerate((0, -1, 1e9))]
    ),
    "wild detections": moving(
        detections=[{"picture": "c", "name": "x" * 9_999, "box": [1e9, -1e9, -1e9, 1e9]}]
    ),
    "wild boxes": moving(
        boxes=[{"name": "b", "position": [1e9] * 3, "size": [-1e9] * 3, "quaternion": [0, 0, 0, 0]}]
    ),
    "wild parts": static(
        parts=[
            box(size=[-1e9, 0, 1e9]),
            box(position=[1e9, -1e9, 1e9], quaternion=[1e9, 1e9, 1e9, 1e9]),
            {"kind": "sphere", "position": [0, 0, 0], "radius": -1e9},
            {
                "kind": "cylinder",
                "position": [0, 0, 0],
                "radius": 0,
                "length": -1e9,
                "quaternion": [0, 0, 0, 0],
            },
        ]
    ),
    "huge areas": static(
        areas=[{"name": "a", "corners": [-1e9, -1e9, 1e9, 1e9]}, {"name": "b", "corners": [9, 9, 0, 0]}]
    ),
    "a camera without focal length": static(
        cameras=[{"name": "c", "frame": "f", "size": [HUGE - 1, -1], "focal": [0, 0], "center": [1e9, 1e9]}]
    ),
    "places and a frame without names": static(frame="", places=[{"name": "", "position": [0, 0, 0]}]),
}
"""Messages of the run channel: the reply to the request for the tree, and the stream."""


FRIENDLY: dict[str, bytes | None] = {
    "T": XML,
    "S": groot2.encode_statuses([(1, 1), (2, 0), (3, 0)]),
    "B": msgpack.packb({"Main": {"x": 1}}),
    "D": b"[]",
    "t": b"",
    "I": None,
    "A": None,
    "R": None,
    "U": None,
}
"""The bodies of a friendly robot's replies, except for the start of a recording."""


CONTEXT: "zmq.Context[zmq.Socket[bytes]]" = zmq.Context()
"""The context of all robots. It is never terminated, because term() did not return once on a busy machine."""


class Robot(threading.Thread):
    """A robot with Groot 2's protocol, and with the run channel if it has *messages* for it.

    Args:
        replies: Bodies that differ from those of a friendly robot.
        messages: Encoded messages of the run channel, after the tree's. They are sent again and again.
        notices: Frames that are published on the port of notifications, without end.
    """

    def __init__(
        self, replies: Replies, messages: Sequence[bytes] = (), notices: Sequence[bytes] = ()
    ) -> None:
        super().__init__()
        self._attacks = dict(replies)
        self.replies = {**FRIENDLY, "r": str(time.time_ns() // 1000).encode(), **replies}
        self.messages, self.notices = messages, notices
        self.requests: list[str] = []
        self.sent = 0
        self.stopped = threading.Event()
        kinds = (zmq.REP, zmq.PUB, zmq.XPUB)
        while True:
            sockets = [CONTEXT.socket(kind) for kind in kinds]
            for socket in sockets:
                # At once: libzmq also applies it to connections that end before the socket is closed.
                socket.linger = 0
            port = sockets[0].bind_to_random_port("tcp://127.0.0.1")
            try:
                for offset in (1, 2):
                    sockets[offset].bind(f"tcp://127.0.0.1:{port + offset}")
                break
            except zmq.ZMQError:  # the port is in use
                for socket in sockets:
                    socket.close()
        self._requests, self._notifications, self._run_channel = sockets
        self.address = f"127.0.0.1:{port}"

    def run(self) -> None:
        scene = 0.0
        while not self.stopped.is_set():
            if self._requests.poll(5 if self.notices else 50):  # ms
                self._answer()
            if self.notices:
                for _ in range(50):
                    self._notifications.send_multipart(self.notices)
            while self._run_channel.poll(0):
                frame = self._run_channel.recv()
                if self.messages and frame.startswith(b"\x01request/tree/"):
                    self._run_channel.send_multipart([frame[1:], self.messages[0]])
            if time.monotonic() - scene > 0.25:
                scene = time.monotonic()
                self.sent += 1
                for message in self.messages[1:]:
                    self._run_channel.send_multipart([wire.STREAM_TOPIC, message])
        for socket in (self._requests, self._notifications, self._run_channel):
            socket.close()

    def _answer(self) -> None:
        # The port may have been that of another test, whose client still sends what is no request. With
        # poll(), that counts as a message, but recv() drops it and would wait for the next one.
        try:
            frames = self._requests.recv_multipart(zmq.NOBLOCK)
        except zmq.Again:
            return
        try:
            header = RequestHeader.decode(frames[0])
        except ProtocolError as error:
            self._requests.send(str(error).encode())
            return
        self.requests.append(chr(header.kind))
        reply = groot2.encode_reply(header, TREE_ID, self.replies[chr(header.kind)])
        self._requests.send_multipart(reply)

    @property
    def has_attacked(self) -> bool:
        """Whether the robot has sent each of its hostile replies and messages."""
        return all(letter in self.requests for letter in self._attacks) and (
            not self.messages or self.sent > 1
        )

    def close(self) -> None:
        self.stopped.set()
        self.join()


class Outcome:
    """What a feed, a log writer and a view made of a hostile robot's messages within some time."""

    def __init__(self, name: str, robot: Robot, folder: Path, draws: bool) -> None:
        self.name = name
        self.robot = robot
        self.lines: list[str] = []
        self.events: list[Event] = []
        self.error = ""
        self.slowest = 0.0
        self.feed = Feed(robot.address)
        self.log = LogWriter([folder / f"{id(self)}.btlog", folder / f"{id(self)}.db3"])
        layout = SingleRobotLayout(RecordingSinks(save=folder / f"{id(self)}.rrd"))
        self.views = [RobotView(layout)] if draws else []

    def step(self) -> None:
        began = time.monotonic()
        self._guarded(self._step)
        self.slowest = max(self.slowest, time.monotonic() - began)

    def _step(self) -> None:
        for event in self.feed.poll(0.0):
            self.events.append(event)
            self.lines += [line for line in [format_notice(event)] if line]
            self.log.process_event(event)
            for view in self.views:
                view.process_event(event)
        self.log.flush()
        for view in self.views:
            view.flush()

    def _guarded(self, action: Callable[[], None]) -> None:
        try:
            if not self.error:
                with warnings.catch_warnings():
                    warnings.simplefilter("error")
                    action()
        except Exception:
            self.error = traceback.format_exc()

    def close(self) -> None:
        for action in (self.log.close, *(view.close for view in self.views), self.feed.close):
            self._guarded(action)
        self.robot.close()

    @property
    def has_tree(self) -> bool:
        return any(isinstance(event, TreeEvent) for event in self.events)


def watched(robots: Mapping[str, Robot], folder: Path) -> dict[str, Outcome]:
    """Watch all robots at once: the duration of the tests does not depend on the number of attacks."""
    outcomes = [
        Outcome(name, robot, folder, draws=bool(robot.messages) or robot.replies["B"] != FRIENDLY["B"])
        for name, robot in robots.items()
    ]
    for outcome in outcomes:
        outcome.robot.start()
    deadline = time.monotonic() + 200
    end = deadline
    while time.monotonic() < min(end, deadline):
        for outcome in outcomes:
            outcome.step()
        time.sleep(0.05)
        if end == deadline and all(outcome.robot.has_attacked for outcome in outcomes):
            end = time.monotonic() + 1
    for outcome in outcomes:
        outcome.close()
    return {outcome.name: outcome for outcome in outcomes}


# One test for all attacks: the robots of all attacks are watched at the same time.


def test_hostile_replies_are_reported_and_do_not_stop_the_client(tmp_path: Path, subtests: Any) -> None:
    outcomes = watched({name: Robot(replies) for name, replies in REPLIES.items()}, tmp_path)
    for attack, outcome in outcomes.items():
        with subtests.test(attack):
            assert not outcome.error, outcome.error
            assert outcome.slowest < 100
            assert sum(map(len, outcome.lines)) < 20_000
            assert outcome.has_tree or any("expected" in line or "rejected" in line for line in outcome.lines)
            shows_tree = not {"T", "S"} & REPLIES[attack].keys() or not REPLIES[attack].get("S", b"-")
            assert outcome.has_tree == shows_tree


def test_hostile_messages_are_reported_and_do_not_stop_the_client(tmp_path: Path, subtests: Any) -> None:
    outcomes = watched({name: Robot({}, messages) for name, messages in SCENES.items()}, tmp_path)
    for attack, outcome in outcomes.items():
        with subtests.test(attack):
            assert not outcome.error, outcome.error
            assert outcome.slowest < 100
            assert outcome.has_tree or any("expected" in line or "update" in line for line in outcome.lines)
            assert sum(map(len, outcome.lines)) < 20_000


# --- commands


def run(*arguments: object) -> str:
    """Run the command in this process, and return its output. Check that there is no traceback."""
    result = CliRunner().invoke(main, [str(argument) for argument in arguments])
    assert result.exception is None or isinstance(result.exception, SystemExit), result.exception
    assert result.exit_code in (0, 1, 2)
    assert len(result.output) < 20_000
    return str(result.output)


@pytest.fixture
def attacker() -> Iterator[Callable[..., Robot]]:
    """Return a function that starts a hostile robot."""
    started: list[Robot] = []

    def start(replies: Replies, notices: Sequence[bytes] = ()) -> Robot:
        started.append(Robot(replies, notices=notices))
        started[-1].start()
        return started[-1]

    yield start
    for robot in started:
        robot.close()


def test_record_ends_at_its_time_limit_with_a_message(attacker: Callable[..., Robot], tmp_path: Path) -> None:
    robot = attacker(REPLIES["a tree nested 100,000 deep"])
    output = run("record", robot.address, "-o", tmp_path / "x.btlog", "--duration", 1)
    assert "record: expected" in output
    assert output.endswith(f"error: no tree was seen at {robot.address}, so nothing is recorded\n")


def test_monitor_ends_at_time_limit_with_message(attacker: Callable[..., Robot], tmp_path: Path) -> None:
    robot = attacker(REPLIES["a blackboard nested 100,000 deep"])
    output = run("monitor", robot.address, "--no-view", "--save", tmp_path / "x.rrd", "--duration", 2.5)
    assert "monitor: blackboard missing: Main isn't shown" in output
    assert "expected MessagePack" in output


@pytest.mark.parametrize(
    ("attack", "arguments", "expected_message"),
    [
        ("hooks nested 100,000 deep", ["list"], "sent an invalid reply: [json.exception.parse_error.101]"),
        ("hooks that are not JSON", ["clear"], "sent an invalid reply: [json.exception.parse_error.101]"),
        ("hooks with wild numbers", ["list"], "injects after node 1000000"),
        ("an unknown status", ["step", "1", "--within", "0.5"], "no tick began within 0.5 s"),
        ("an entity bomb", ["list"], "sent an invalid reply: the full tree declares a document type"),
        ("a tree nested 100,000 deep", ["break", "x"], "sent an invalid reply: expected"),
    ],
)
def test_hook_reports_hostile_replies(
    attacker: Callable[..., Robot], attack: str, arguments: list[str], expected_message: str
) -> None:
    robot = attacker(REPLIES[attack])
    assert expected_message in run("hook", robot.address, *arguments)


@pytest.mark.parametrize(
    ("notices", "arguments", "expected_message"),
    [
        ([b"x" * 100], ["step", "1"], "no tick began within 0.5 s"),
        (encode_breakpoint_reached(2, 1), ["step", "1"], "no tick began within 0.5 s"),
        (encode_breakpoint_reached(2, 1), ["inject", "second", "FAILURE"], "not ticked within 0.5 s"),
        ([b"\0" * 1_000_000], ["inject", "second", "FAILURE"], "not ticked within 0.5 s"),
    ],
)
def test_hook_ends_at_its_time_limit_though_notifications_never_end(
    attacker: Callable[..., Robot], notices: list[bytes], arguments: list[str], expected_message: str
) -> None:
    robot = attacker({}, notices)
    assert expected_message in run("hook", robot.address, *arguments, "--within", "0.5")


def test_time_limit_ends_command_that_draws_huge_tree(attacker: Callable[..., Robot], tmp_path: Path) -> None:
    nodes = "".join(f'<A name="node {uid}" _uid="{uid}"/>' for uid in range(2, 60_000))
    robot = attacker({"T": tree_of(f'<Sequence _uid="1">{nodes}</Sequence>')})
    program = (
        "from btcore_monitor import process_end; process_end.END_TIMEOUT_S = 0.1\n"
        "from btcore_monitor.commands.record import record; record()"
    )
    done = subprocess.run(
        [sys.executable, "-c", program, robot.address, "-o", "x.rrd", "--duration", "4"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(ROOT / "monitor")])},
        capture_output=True,
        text=True,
        timeout=250,
    )
    assert done.returncode == 4
    assert "error: the time limit of 4 s is over, and the recording could not be completed" in done.stderr
    assert "Traceback" not in done.stderr
