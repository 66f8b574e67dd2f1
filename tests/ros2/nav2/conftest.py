"""Plain servers of Nav2 in another process, and trees of Nav2's nodes that use them."""

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

import btcore
from btcore import Registry, Status, Tree
from btcore.clock import NS_PER_S
from btcore_navigation import nodes as nav2_nodes
from btcore_navigation.nodes import action_node
from tests.ros2.conftest import LIMIT_S

LONG_TIMEOUTS = """
from btcore_navigation.nodes import action_node
action_node.MIN_ACCEPTANCE_MS = 60_000
from btcore_ros2.nav2 import navigator_server
navigator_server.FIRST_POSE_PATIENCE_S = 60.0
from btcore.__main__ import main
main()
"""
"""The command `btcore` that waits long for servers and for the first pose, for `python -c`."""


def start(*command: str) -> subprocess.Popen[str]:
    """Start a Python program, and wait until it prints "ready"."""
    process = subprocess.Popen(
        [sys.executable, *command], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    return process


@pytest.fixture(scope="module")
def plain_nav2(request: pytest.FixtureRequest) -> Iterator[subprocess.Popen[str]]:
    """The process of `plain_nav2.py`, with the arguments `PLAIN_NAV2` of the test module."""
    arguments = getattr(request.module, "PLAIN_NAV2", ())
    process = start(str(Path(__file__).parent / "plain_nav2.py"), *arguments)
    yield process
    process.communicate(timeout=LIMIT_S)


class ClientRig:
    """A session with the servers of Nav2, and what the other process has received."""

    def __init__(self) -> None:
        from std_msgs.msg import String

        from btcore_ros2.nav2.client import Nav2Client
        from btcore_ros2.session import RosSession

        self.session = RosSession("rig")
        self.client = Nav2Client(self.session)
        self.received: list[tuple[str, Any]] = []
        self.session.node.create_subscription(String, "received", self.take, 100)
        self.marker = self.session.node.create_publisher(String, "mark", 10)
        self.marks = 0

    def take(self, message: Any) -> None:
        """Store what the other process has received."""
        name, content = json.loads(message.data)
        self.received.append((name, content))

    def forget(self) -> None:
        """Forget what the other process has received. Reports of earlier tests may still arrive."""
        from std_msgs.msg import String

        self.marks += 1
        mark = ("mark", str(self.marks))
        self.marker.publish(String(data=mark[1]))
        assert self.session.wait_for(lambda: mark in self.received, LIMIT_S), self.names()
        self.received.clear()

    def names(self) -> list[str]:
        """Return the names of the servers that have received something, in order."""
        return [name for name, _ in self.received]

    def tree(self, content: str, **entries: object) -> Tree:
        """Return a tree with the XML *content*, on a blackboard with *entries*."""
        nodes = Registry.standard()
        nav2_nodes.register(nodes)
        nodes.add_plugin("btcore_ros2.nav2.nodes")
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{content}</BehaviorTree></root>'
        tree = btcore.loads(text, nodes=nodes, resources=[self.client], clock=self.session.clock)
        for key, value in entries.items():
            tree.blackboard[key] = value
        return tree

    def wait(self, seconds: float) -> None:
        """Wait on the clock of the session."""
        clock = self.session.clock
        clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())

    def run(self, tree: Tree, until: Callable[[], object] = lambda: False) -> Status:
        """Tick at 100 Hz until the result is not RUNNING, or until *until* returns a true value."""
        end = time.monotonic() + LIMIT_S
        status = tree.tick_exactly_once()
        while status is Status.RUNNING and not until():
            assert time.monotonic() < end, f"still running; received: {self.names()}; {_handles(tree)}"
            self.wait(0.01)
            status = tree.tick_exactly_once()
        return status


def _handles(tree: Tree) -> list[dict[str, object]]:
    """Return the attributes of the handles of goals and requests in *tree*, and of their goals."""
    handles = [handle for node in tree.nodes if (handle := getattr(node, "handle", None)) is not None]
    return [vars(part) for handle in handles for part in (handle, getattr(handle, "_sent", None)) if part]


@pytest.fixture(scope="module")
def shared_rig(plain_nav2: subprocess.Popen[str]) -> Iterator[ClientRig]:
    """A rig that is connected with the other process."""
    rig = ClientRig()
    rig.client.odometry()
    is_connected = rig.session.wait_for(
        lambda: (
            rig.client.pose()
            and rig.client.odometry()
            and rig.session.node.count_publishers("received")
            and rig.marker.get_subscription_count()
        ),
        LIMIT_S,
    )
    assert is_connected
    yield rig
    rig.session.close()


@pytest.fixture
def rig(shared_rig: ClientRig, monkeypatch: pytest.MonkeyPatch) -> ClientRig:
    """The rig of the module, without what was received before, whose nodes wait long for an answer."""
    monkeypatch.setattr(action_node, "MIN_ACCEPTANCE_MS", 1000 * LIMIT_S)
    shared_rig.forget()
    return shared_rig
