"""The session on a tree's thread: waiting, errors, Ctrl-C, forks and several sessions in a process."""

import asyncio
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
from multiprocessing.connection import Connection
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.qos import qos_profile_action_status_default
from std_msgs.msg import String

import btcore
from btcore import Status
from btcore_ros2.errors import RosError
from btcore_ros2.session import RosSession
from btcore_ros2.testing import isolate_ros
from tests.ros2.conftest import LIMIT_S


class Listen(btcore.StatefulAction):
    """SUCCESS after a message on the topic "words"."""

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.received: list[str] = []
        session.node.create_subscription(String, "words", self.receive, 10)

    def receive(self, message: String) -> None:
        """Keep the message, unless it is "raise" or "shut down", after which the session cannot be used."""
        if message.data == "raise":
            raise ZeroDivisionError("in a callback")
        if message.data == "shut down":
            self.session.context.shutdown()
        else:
            self.received.append(message.data)

    def on_start(self) -> Status:
        """See `on_running`."""
        return self.on_running()

    def on_running(self) -> Status:
        """Take, and return SUCCESS if a message was received."""
        self.session.refresh()
        return Status.SUCCESS if self.received else Status.RUNNING


class Halted(btcore.StatefulAction):
    """Always RUNNING; counts how often it was halted."""

    count = 0

    def on_start(self) -> Status:
        """Return RUNNING."""
        return Status.RUNNING

    def on_running(self) -> Status:
        """Return RUNNING."""
        return Status.RUNNING

    def on_halted(self) -> None:
        """Count."""
        type(self).count += 1


def listening_tree(session: RosSession) -> btcore.Tree:
    """Return a tree that listens while another leaf is RUNNING."""
    nodes = btcore.Registry.standard()
    nodes.add(Listen)
    nodes.add(Halted)
    return btcore.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Parallel success_count="1" failure_count="1">'
        '<Halted/><Listen name="ear"/></Parallel></BehaviorTree></root>',
        nodes=nodes,
        resources=[session],
        clock=session.clock,
    )


class Speaker:
    """A context in which another ROS node publishes a text 50 times a second, in a thread."""

    def __init__(self, text: str) -> None:
        self.text = text
        self.end = threading.Event()
        self.thread = threading.Thread(target=self.run)

    def run(self) -> None:
        """Publish until the end."""
        with RosSession("speaker") as session:
            publisher = session.node.create_publisher(String, "words", 10)
            while not self.end.wait(0.02):
                publisher.publish(String(data=self.text))

    def __enter__(self) -> None:
        self.thread.start()

    def __exit__(self, *_: object) -> None:
        self.end.set()
        self.thread.join()


def test_message_arrives_while_the_clock_waits(session: RosSession) -> None:
    received: list[str] = []
    session.node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    with Speaker("hello"):
        wake = threading.Event()
        session.node.create_subscription(String, "words", lambda message: wake.set(), 10)
        assert session.clock.wait_until(session.clock.now() + LIMIT_S * 10**9, wake)
    assert received
    assert set(received) == {"hello"}


def test_tree_receives_while_it_waits_for_its_next_tick(session: RosSession) -> None:
    tree = listening_tree(session)
    with Speaker("hello"):
        assert tree.tick_while_running(period=0.1) is Status.SUCCESS


def test_tree_receives_in_an_event_loop(session: RosSession) -> None:
    tree = listening_tree(session)
    calls: list[int] = []
    session.clock.schedule.add_task(1000.0, 0, calls.append)

    async def main() -> tuple[Status, int]:
        other = asyncio.create_task(count_up())
        status = await tree.run(period=0.02)
        other.cancel()
        return status, turns

    turns = 0

    async def count_up() -> None:
        nonlocal turns
        while True:
            await asyncio.sleep(0.001)
            turns += 1

    with Speaker("hello"):
        status, turned = asyncio.run(main())
    assert status is Status.SUCCESS
    assert turned, "the event loop runs between the ticks"
    assert calls, "the tasks of the clock run too"


def test_leaf_without_waiting_receives_by_refresh(session: RosSession) -> None:
    tree = listening_tree(session)
    with Speaker("hello"):
        assert RosSession.wait_for(session, lambda: tree.tick_once() is Status.SUCCESS, LIMIT_S)


@pytest.mark.parametrize(
    ("text", "cause", "message"),
    [("raise", ZeroDivisionError, "in a callback"), ("shut down", RosError, "context was shut down")],
)
def test_error_while_the_tree_waits_halts_the_tree_and_names_the_leaf(
    session: RosSession, text: str, cause: type[Exception], message: str
) -> None:
    tree = listening_tree(session)
    before = Halted.count
    with Speaker(text), pytest.raises(btcore.NodeExecutionError, match="ear") as raised:
        tree.tick_while_running(period=0.1)
    assert isinstance(raised.value.__cause__, cause)
    assert message in str(raised.value)
    assert Halted.count == before + 1
    assert tree.status is Status.IDLE


def test_error_that_no_leaf_takes_is_raised_by_the_next_wait(session: RosSession) -> None:
    def fail() -> None:
        raise ZeroDivisionError

    clock, wake = session.clock, threading.Event()
    end = session.after_drain(fail)
    assert not clock.wait_until(clock.now() + 20_000_000, wake)
    end()
    with pytest.raises(ZeroDivisionError):
        clock.wait_until(clock.now(), wake)
    assert not clock.wait_until(clock.now(), wake)


def test_closed_session_is_refused_with_a_message(session: RosSession) -> None:
    session.close()
    session.close()
    with pytest.raises(RosError, match="session was closed"):
        session.refresh()


def test_close_waits_for_work_and_logs_errors(session: RosSession, caplog: pytest.LogCaptureFixture) -> None:
    calls: list[int] = []
    session.unfinished.add("work")

    def work() -> None:
        calls.append(0)
        if len(calls) == 1:
            raise ZeroDivisionError
        session.unfinished.discard("work")

    session.after_drain(work)
    session.close()
    assert len(calls) >= 2
    assert "ZeroDivisionError" in caplog.text
    assert not session.context.ok()


@pytest.mark.parametrize(("domain", "origin"), [(233, "domain"), (-1, "domain"), (None, "ROS_DOMAIN_ID")])
def test_invalid_domain_is_reported_with_its_origin(
    monkeypatch: pytest.MonkeyPatch, domain: int | None, origin: str
) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "999")
    with pytest.raises(RosError, match=f"^{origin}: there is no domain {domain or 999}, only 0 to 232"):
        RosSession(domain=domain)


def test_context_that_was_shut_down_is_refused_with_a_message(session: RosSession) -> None:
    session.context.shutdown()
    with pytest.raises(RosError, match=r"context was shut down.*SignalHandlerOptions\.NO"):
        session.drain()
    session.close()


def in_forked_process(session: RosSession, result: Connection) -> None:
    """Send the error of the inherited session over *result*."""
    try:
        session.refresh()
    except RosError as error:
        result.send(str(error))
    session.close()


@pytest.mark.filterwarnings("ignore:This process .* is multi-threaded:DeprecationWarning")
def test_fork_refuses_the_session_of_its_parent_and_leaves_it_intact(session: RosSession) -> None:
    session.drain()
    ours, theirs = multiprocessing.Pipe()
    child = multiprocessing.get_context("fork").Process(target=in_forked_process, args=[session, theirs])
    child.start()
    child.join(LIMIT_S)
    assert child.exitcode == 0
    assert ours.poll()
    assert "forked from the process that created the ROS session" in ours.recv()
    received: list[str] = []
    session.node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    with Speaker("hello"):
        assert session.wait_for(lambda: received, LIMIT_S)


def test_two_sessions_of_a_process_are_separate(session: RosSession, monkeypatch: pytest.MonkeyPatch) -> None:
    here = os.environ["ROS_DOMAIN_ID"]
    monkeypatch.setenv("ROS_DOMAIN_ID", here)  # which is restored after the test
    elsewhere = isolate_ros()  # no other test runs there
    monkeypatch.setenv("ROS_DOMAIN_ID", here)
    received: list[str] = []
    session.node.create_subscription(String, "words", lambda message: received.append(message.data), 10)
    with RosSession("near") as near, RosSession("far", domain=elsewhere) as far:
        publishers = {made: made.node.create_publisher(String, "words", 10) for made in (near, far)}
        assert session.wait_for(publishers[near].get_subscription_count, LIMIT_S)
        publishers[far].publish(String(data="far"))
        publishers[near].publish(String(data="near"))
        assert session.wait_for(lambda: received, LIMIT_S)
        assert publishers[far].get_subscription_count() == 0
        near.close()
        publishers[far].publish(String(data="far"))
        far.drain()
        session.drain()
    assert received == ["near"]


LEAVES = '''
import time

from rclpy.action import ActionClient
from std_msgs.msg import String
from test_msgs.action import Fibonacci

import btcore
from btcore import Status
from btcore_ros2.session import RosSession


class Drive(btcore.StatefulAction):
    """Publish "go", and "stop" when halted; a goal of an action is cancelled when halted."""

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.publisher = session.node.create_publisher(String, "drive", 10)
        self.client = ActionClient(session.node, Fibonacci, "fibonacci")
        self.goal = None
        self.sent = 0.0

    def on_start(self) -> Status:
        return self.on_running()

    def on_running(self) -> Status:
        self.session.refresh()
        if self.goal is not None and self.goal.done():
            self.publisher.publish(String(data="go"))
        elif self.client.server_is_ready() and time.monotonic() - self.sent > 5:  # a response may be lost
            self.goal = self.client.send_goal_async(Fibonacci.Goal(order=100_000))
            self.sent = time.monotonic()
        return Status.RUNNING

    def on_halted(self) -> None:
        self.publisher.publish(String(data="stop"))
        self.goal.result().cancel_goal_async()


def register(nodes) -> None:
    nodes.add(Drive)
'''


@pytest.mark.usefixtures("server")
def test_last_messages_go_out_after_ctrl_c(session: RosSession, tmp_path: Path) -> None:
    (tmp_path / "leaves.py").write_text(LEAVES)
    tree = tmp_path / "tree.xml"
    tree.write_text('<root BTCPP_format="4"><BehaviorTree ID="Main"><Drive/></BehaviorTree></root>')
    commands: list[str] = []
    statuses: list[int] = []
    session.node.create_subscription(String, "drive", lambda message: commands.append(message.data), 100)
    session.node.create_subscription(
        GoalStatusArray,
        "fibonacci/_action/status",
        lambda message: statuses.extend(goal.status for goal in message.status_list),
        qos_profile_action_status_default,
    )
    command = [
        sys.executable,
        "-m",
        "btcore",
        "run",
        str(tree),
        "--plugin",
        str(tmp_path / "leaves.py"),
        "--json",
    ]
    with subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
    ) as process:
        try:
            assert session.wait_for(lambda: commands, LIMIT_S)
            process.send_signal(signal.SIGINT)
            assert session.wait_for(lambda: commands[-1] == "stop", LIMIT_S)
            assert session.wait_for(lambda: GoalStatus.STATUS_CANCELED in statuses, LIMIT_S)
            output, errors = process.communicate(timeout=LIMIT_S)
        finally:
            process.kill()
    assert process.returncode == 130, errors
    assert "Traceback" not in errors
    assert json.loads(output.splitlines()[-1])["status"] == "RUNNING"
