"""Strangers attack a robot's ports; its tree, its memory and its other clients must not notice.

``python tests/acceptance/attacks.py`` runs pairs of robots side by side. One robot of a pair is attacked at
all of its ports, by clients that connect again at once and for ever. For each attack the script prints the
growth of the robot's memory, the lost ticks and the lateness of ticks beside those of the other robot, and
the unanswered requests and lost transitions of another client. It exits with 1 if a value is not permitted.

``--starved RUNS`` instead attacks robots on a starved machine: robot, client and attackers share one
processor with programs that never wait and have a higher priority. The client must not lose a transition.
"""

import argparse
import contextlib
import itertools
import json
import os
import resource
import socket
import statistics
import subprocess
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from checkout import environment

PERIOD = 0.02  # s, of the tree
GROWTH = 50.0  # MB, permitted
REPLY_WITHIN = 60.0  # s
LIMIT = 200  # MB that the robot's process may allocate in addition; then allocations fail
PICTURE = 200_000  # bytes of a camera's picture; the robot has 30 pictures a second
LATENESS = 5.0  # ms, permitted in addition to 1.5 times the lateness of the robot that is not attacked
JUDGED_FROM = 3  # pairs; the ticks of fewer are printed only, because other work on the computer delays them
BUSY = 3  # programs that never wait, on a starved machine
END_TIMEOUT_S = 60.0  # s, for the client to receive the end of a run
LOST = 0.01  # of the ticks, permitted in addition to the lost ticks of the robot that is not attacked
GREETING_TIMEOUT_S = b"\xff" + b"\0" * 8 + b"\x7f\x03\x01" + b"NULL".ljust(20, b"\0") + b"\0" * 32
READY = b"\x04\x19\x05READY\x0bSocket-Type\0\0\0\x03"
TREE = """
<root BTCPP_format="4"><BehaviorTree ID="Main"><KeepRunningUntilFailure><Sequence>
  {}
</Sequence></KeepRunningUntilFailure></BehaviorTree></root>
""".format('<Fallback><AlwaysFailure/><Script code="n := 1"/></Fallback>' * 50)


# --- attacks: each sends to one connection until it is disconnected


def big_topics(to: socket.socket) -> None:
    """Subscribe to topics of 1 MB."""
    for number in range(1_000_000):
        to.sendall(long_frame(0, b"\1" + b"%d" % number + bytes(1 << 20)))


def many_topics(to: socket.socket) -> None:
    """Subscribe to any number of short topics."""
    for number in range(0, 1_000_000_000, 500):
        topics = (b"\1%0150d" % index for index in range(number, number + 500))
        to.sendall(b"".join(b"\0" + bytes([len(topic)]) + topic for topic in topics))


def many_topics_by_command(to: socket.socket) -> None:
    """Subscribe to any number of short topics by the command of ZMTP 3.1."""
    for number in range(0, 1_000_000_000, 500):
        topics = (b"\x09SUBSCRIBE%0150d" % index for index in range(number, number + 500))
        to.sendall(b"".join(b"\4" + bytes([len(topic)]) + topic for topic in topics))


def unfinished(to: socket.socket) -> None:
    """Send empty frames of a message that never ends."""
    while True:
        to.sendall(b"\1\0" * 32_768)


def huge_frames(to: socket.socket) -> None:
    """Send frames of 900 kB of a message that never ends."""
    while True:
        to.sendall(long_frame(1, bytes(900_000)))


def unread_replies(to: socket.socket) -> None:
    """Send requests and subscriptions that are requests, and never read the replies."""
    for number in range(1_000_000_000):
        topic = b"request/tree/%d" % number
        size = bytes([1 + len(topic)])
        to.sendall(b"\0" + size + b"\1" + topic + b"\0" + size + b"\0" + topic)


def unread_trees(to: socket.socket) -> None:
    """Send requests for the tree, and never read the replies."""
    while True:
        to.sendall(b"\1\0\0\x06\x02T1234" * 100)


def slow_reading(to: socket.socket) -> None:
    """Subscribe to everything, and read the pictures at 10 kB/s."""
    to.sendall(subscription(b""))
    while to.recv(1_000):
        time.sleep(0.1)


def old_pieces(to: socket.socket) -> None:
    """Request all past messages again and again, and read the replies at 10 kB/s."""
    for number in range(1_000_000_000):
        to.sendall(b"".join(subscription(b"request/%d/%d" % (first, number)) for first in range(1, 31)))
        if not to.recv(1_000):
            break
        time.sleep(0.1)


def no_handshake(to: socket.socket) -> None:
    """Connect and disconnect."""


ATTACKS = (
    big_topics,
    many_topics,
    many_topics_by_command,
    unfinished,
    huge_frames,
    unread_replies,
    unread_trees,
    slow_reading,
    old_pieces,
    no_handshake,
)


def subscription(topic: bytes) -> bytes:
    """Return the frame of a subscription."""
    return b"\0" + bytes([1 + len(topic)]) + b"\1" + topic


def long_frame(flags: int, body: bytes) -> bytes:
    """Return a frame with a length of 8 bytes."""
    return bytes([flags | 2]) + len(body).to_bytes(8, "big") + body


def attack_for_ever(name: str, port: int, kind: str) -> None:
    """Run the attack *name* at *port*, as a client with a socket of type *kind*, and connect again."""
    attack = next(attack for attack in ATTACKS if attack.__name__ == name)
    while True:
        with contextlib.suppress(OSError), socket.create_connection(("127.0.0.1", port), 5) as connection:
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
            if attack is not no_handshake:
                connection.sendall(GREETING_TIMEOUT_S)
                received = 0
                while received < 64:
                    data = connection.recv(64)
                    if not data:
                        break
                    received += len(data)
                connection.sendall(READY + kind.encode())
            attack(connection)


# --- robots and their other clients


def memory(key: str) -> float:
    """Return the value of *key* in this process's status, in MB."""
    status = Path("/proc/self/status").read_text(encoding="ascii")
    return int(next(line for line in status.splitlines() if line.startswith(key)).split()[1]) / 1024


def run_robot(seconds: float) -> None:
    """Tick a published tree for *seconds* after a line at the standard input.

    Print the ports, then the ticks, the lost ticks, the transitions, the growth of memory (MB) and the
    lateness of each tick (ms).
    """
    import btcore
    from btcore_monitor.serve import serve
    from btcore_scene import MovingScene, Picture, StaticScene

    class Camera:
        """A camera with pictures of PICTURE bytes."""

        def static_scene(self) -> StaticScene:
            return StaticScene()

        def moving_scene(self) -> MovingScene:
            picture = Picture(name="camera", size=(640, 480), format="jpeg", data=bytes(PICTURE))
            return MovingScene(pictures=[picture])

    class Changes(btcore.Observer):
        """The *count* of transitions."""

        count = 0

        def transition(self, change: btcore.Transition) -> None:
            self.count += 1

    tree, changes = btcore.loads(TREE), Changes()
    tree.subscribe(changes)
    with serve(tree, groot2_port=0, groot1_port=0, allow_control=True, resources=[Camera()]) as publisher:
        first, updates = publisher.port, publisher.groot1_port
        assert updates is not None
        print(json.dumps([first, first + 1, first + 2, updates, updates + 1]), flush=True)
        sys.stdin.readline()
        limit = round((memory("VmData") + LIMIT) * (1 << 20))
        resource.setrlimit(resource.RLIMIT_DATA, (limit, limit))
        before, growth = memory("VmRSS"), 0.0
        lateness: list[float] = []
        lost = 0
        begin = time.monotonic()
        for number in range(round(seconds / PERIOD)):
            due = begin + number * PERIOD
            time.sleep(max(0.0, due - time.monotonic()))
            late = time.monotonic() - due
            if late >= PERIOD:
                lost += 1
                continue
            lateness.append(1e3 * late)
            tree.tick_exactly_once()
            if number % 10 == 0:
                growth = max(growth, memory("VmRSS") - before)
        ticks = tree.ticks
    print(json.dumps([ticks, lost, changes.count, growth, lateness]), flush=True)


@dataclass
class Outcome:
    """What was measured of a robot; *died* if its process ended early.

    *received* counts the transitions that the client received in order, each once.
    """

    died: bool = False
    ticks: int = 0
    lost_ticks: int = 0
    transitions: int = 0
    growth: float = 0.0
    lateness: list[float] = field(default_factory=list)
    received: int = 0
    unanswered: int = 0
    disconnected: int = 0

    @property
    def late(self) -> float:
        """The lateness (ms) that 95 % of the ticks do not exceed."""
        return sorted(self.lateness)[int(0.95 * len(self.lateness))] if self.lateness else 0.0


class Robot:
    """A robot in a process of its own, and a client that watches it and requests its status."""

    def __init__(self, seconds: float) -> None:
        self._process = subprocess.Popen(
            [sys.executable, __file__, "--robot", str(seconds)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment(),
            text=True,
        )
        self.outcome = Outcome()
        self.ports: list[int] = []
        self._connected = threading.Event()
        self._ended = threading.Event()
        self._threads = [threading.Thread(target=each) for each in (self._watch, self._request)]

    def connect(self) -> None:
        """Wait until the client is connected."""
        self.ports = json.loads(self._line())
        for thread in self._threads:
            thread.start()
        assert self._connected.wait(120), "the robot can't be watched"

    def _line(self) -> str:
        assert self._process.stdout is not None
        return self._process.stdout.readline()

    def start(self) -> None:
        """Begin to tick."""
        assert self._process.stdin is not None
        self._process.stdin.write("go\n")
        self._process.stdin.flush()

    def end(self) -> Outcome:
        """Wait for the end of the run."""
        line, outcome = self._line(), self.outcome
        self._ended.set()
        for thread in self._threads:
            thread.join()
        self._process.communicate()
        if line:
            outcome.ticks, outcome.lost_ticks, outcome.transitions, outcome.growth, outcome.lateness = (
                json.loads(line)
            )
        else:
            outcome.died = True
        return outcome

    def _watch(self) -> None:
        from btcore_monitor.events import ConnectionEvent, TransitionEvent, TreeEvent
        from btcore_monitor.watch.feed import Feed

        give_up_at = float("inf")
        with Feed(f"tcp://127.0.0.1:{self.ports[0]}") as feed:
            while time.monotonic() < give_up_at:
                for event in feed.poll(0.1):
                    if isinstance(event, TreeEvent):
                        self._connected.set()
                    elif isinstance(event, TransitionEvent):
                        self.outcome.received += event.number == self.outcome.received + 1
                    elif isinstance(event, ConnectionEvent):
                        self.outcome.disconnected += event.state == "lost"
                        if event.state == "ended":
                            return
                # What the robot sent before its end may still wait in this process.
                if self._ended.is_set():
                    give_up_at = min(give_up_at, time.monotonic() + END_TIMEOUT_S)

    def _request(self) -> None:
        from btcore_monitor.watch.address import parse_address
        from btcore_monitor.watch.groot2_client import Groot2Client, NoReplyError
        from btcore_monitor.wire.groot2 import Request

        address = parse_address(f"tcp://127.0.0.1:{self.ports[0]}")
        with Groot2Client(address, timeout=REPLY_WITHIN) as client:
            while not self._ended.wait(0.1):
                client.send_request(Request.STATUS)
                with contextlib.suppress(NoReplyError):
                    while client.receive_reply() is None and not self._ended.is_set():
                        client.socket.poll(100)
                    continue
                self.outcome.unanswered += not self._ended.is_set()


@contextlib.contextmanager
def start_attacks(ports: Sequence[int], names: Sequence[str]) -> Iterator[None]:
    """Attack the *ports* of a robot by *names* until the end of the context."""
    kinds = ("REQ", "SUB", "SUB", "SUB", "REQ")
    attackers = [
        subprocess.Popen([sys.executable, __file__, "--attack", name, str(port), kind])
        for name in names
        for port, kind in zip(ports, kinds, strict=True)
    ]
    try:
        yield
        assert all(attacker.poll() is None for attacker in attackers), "an attack ended"
    finally:
        for attacker in attackers:
            attacker.kill()
            attacker.wait()


def run_pair(names: Sequence[str], seconds: float) -> tuple[Outcome, Outcome]:
    """Return the outcomes of a robot that *names* attack together, and of a robot beside it."""
    attacked, alone = Robot(seconds), Robot(seconds)
    attacked.connect()
    alone.connect()
    with start_attacks(attacked.ports, names):
        attacked.start()
        alone.start()
        return attacked.end(), alone.end()


@contextlib.contextmanager
def starve_machine(priority: int) -> Iterator[None]:
    """Give this process and its children little of one processor until the end of the context.

    *priority* is the number of "nice" steps between them and the programs that never wait.
    """
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(BUSY)]
    os.nice(priority)
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def run_starved(names: Sequence[str], runs: int, seconds: float, priority: int) -> Iterator[str]:
    """Attack *runs* robots on a starved machine, with one of *names* each, and yield violations."""
    print(f"{'attack':24}{'ticks':>8}{'lost ticks':>12}{'transitions':>13}{'missing':>9}{'duration':>11}")
    with starve_machine(priority):
        for name in itertools.islice(itertools.cycle(names), runs):
            begin = time.monotonic()
            robot = Robot(seconds)
            robot.connect()
            with start_attacks(robot.ports, [name]):
                robot.start()
                found = robot.end()
            missing = found.transitions - found.received
            print(
                f"{name:24}{found.ticks:8}{found.lost_ticks:12}{found.transitions:13}{missing:9}"
                f"{time.monotonic() - begin:9.1f} s",
                flush=True,
            )
            if found.died or missing or not found.transitions:
                yield f"{name}: the other client missed {missing} of {found.transitions} transitions"


# --- the report


def judge_attack(name: str, pairs: Sequence[tuple[Outcome, Outcome]]) -> Iterator[str]:
    """Print a row about the *pairs* of the attack *name*, and yield the values that are not permitted."""
    attacked = [pair[0] for pair in pairs]
    late = statistics.median(robot.late for robot in attacked)
    late_alone = statistics.median(alone.late for _, alone in pairs)
    lost = sum(robot.lost_ticks for robot in attacked)
    lost_alone = sum(alone.lost_ticks for _, alone in pairs)
    growth = max(robot.growth for robot in attacked)
    growth_alone = max(alone.growth for _, alone in pairs)
    missing = sum(robot.transitions - robot.received for robot in attacked)
    unanswered = sum(robot.unanswered + robot.disconnected for robot in attacked)
    print(
        f"{name:24}{growth:8.1f} MB {growth_alone:6.1f} MB {lost:6} {lost_alone:6} "
        f"{late:9.2f} ms {late_alone:6.2f} ms {missing:8} {unanswered:8}",
        flush=True,
    )
    planned = sum(robot.ticks + robot.lost_ticks for robot in attacked)
    if any(robot.died for robot in attacked):
        yield f"{name}: the robot's process ended"
        return
    if growth > GROWTH:
        yield f"{name}: the robot's memory grew by {growth:.0f} MB"
    judged = len(pairs) >= JUDGED_FROM
    # On a busy computer both robots lose ticks; chance explains three standard deviations.
    if judged and lost - lost_alone > LOST * planned + 3 * (lost + lost_alone) ** 0.5:
        yield f"{name}: {lost} ticks were lost, and {lost_alone} without the attack"
    if judged and late > 1.5 * late_alone + LATENESS:
        yield f"{name}: ticks were late by {late:.1f} ms, and by {late_alone:.1f} ms without the attack"
    if missing or unanswered:
        yield f"{name}: the other client missed {missing} transitions and {unanswered} replies"


def main() -> int:
    """Run the attacks, and return 1 if a robot or its client noticed, otherwise 0."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--pairs", type=int, default=3, help="pairs of robots per attack")
    parser.add_argument("--seconds", type=float, default=10.0, help="duration of a run")
    parser.add_argument("--attacks", nargs="+", choices=[attack.__name__ for attack in ATTACKS])
    parser.add_argument(
        "--starved", type=int, help="attack this number of robots on a starved machine instead"
    )
    parser.add_argument("--priority", type=int, default=5, help="how far below the programs that never wait")
    parser.add_argument("--robot", type=float, help=argparse.SUPPRESS)
    parser.add_argument("--attack", nargs=3, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.robot is not None:
        run_robot(options.robot)
        return 0
    if options.attack is not None:
        name, port, kind = options.attack
        attack_for_ever(name, int(port), kind)
    names = options.attacks or [attack.__name__ for attack in ATTACKS]
    if options.starved is not None:
        return print_violations(run_starved(names, options.starved, options.seconds, options.priority))
    from btcore_monitor.watch import run_channel_feed

    run_channel_feed.SILENT_AFTER_S = REPLY_WITHIN  # a busy machine is silent for seconds, too
    print(
        f"{'attack':24}{'growth':>21} {'lost ticks':>13} {'late (95 %)':>22} {'missing':>8} {'no reply':>8}"
    )
    found: list[str] = []
    for name in names:
        pairs = [run_pair([name], options.seconds) for _ in range(options.pairs)]
        found += judge_attack(name, pairs)
    return print_violations(found)


def print_violations(found: Iterable[str]) -> int:
    """Print what is not permitted, and return the exit code."""
    violations = list(found)
    for violation in violations:
        print(f"✗ {violation}")
    return 1 if violations else 0


if __name__ == "__main__":
    raise SystemExit(main())
