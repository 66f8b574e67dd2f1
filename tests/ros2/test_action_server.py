"""Action servers on the session's thread, with a plain rclpy client in another process."""

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("test_msgs")

from action_msgs.msg import GoalStatus
from test_msgs.action import Fibonacci

from btcore_ros2.action_server import RosActionServer
from btcore_ros2.session import RosSession

LIMIT_S = 60.0

CLIENT = """
import sys

import rclpy
from rclpy.action import ActionClient
from test_msgs.action import Fibonacci

rclpy.init()
node = rclpy.create_node("client")
client = ActionClient(node, Fibonacci, "count")
assert client.wait_for_server(60)


def wait(future):
    rclpy.spin_until_future_complete(node, future, timeout_sec=60)
    return future.result()


def on_feedback(message):
    print("feedback", list(message.feedback.sequence), flush=True)


handles = []
for line in sys.stdin:
    verb, number = line.split()
    if verb == "send":
        handles.append(wait(client.send_goal_async(Fibonacci.Goal(order=int(number)), on_feedback)))
        print("accepted" if handles[-1].accepted else "rejected", flush=True)
    elif verb == "cancel":
        print("canceling", len(wait(handles[int(number)].cancel_goal_async()).goals_canceling), flush=True)
    elif verb == "result":
        answer = wait(handles[int(number)].get_result_async())
        print("result", answer.status, list(answer.result.sequence), flush=True)
rclpy.shutdown()
"""


class Client:
    """A plain rclpy client in another process, which gets one request per line."""

    def __init__(self) -> None:
        self.process = subprocess.Popen(
            [sys.executable, "-c", CLIENT], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
        )
        self.lines: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line.rstrip())

    def request(self, line: str) -> None:
        assert self.process.stdin is not None
        self.process.stdin.write(line + "\n")
        self.process.stdin.flush()


class Setting:
    """A session with an action server, and the client."""

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.server: Any = RosActionServer(
            session,
            Fibonacci,
            "count",
            reject_reason=lambda goal: "the order is negative" if goal.order < 0 else "",
        )
        self.client = Client()
        self.sent = 0

    def wait_for(self, condition: Callable[[], Any]) -> None:
        assert self.session.wait_for(condition, LIMIT_S), self.client.lines

    def expect(self, *lines: str) -> None:
        """Wait until the client has printed *lines*."""
        self.wait_for(lambda: len(self.client.lines) >= len(lines))
        assert self.client.lines == list(lines)
        self.client.lines.clear()

    def wait_for_result_request(self) -> None:
        """Wait until the client waits for a result."""
        futures = self.server._server._result_futures
        self.wait_for(lambda: any(future._callbacks for future in futures.values()))

    def send(self, order: int) -> int:
        """Send a goal, and return its number."""
        self.client.request(f"send {order}")
        self.expect("accepted")
        self.sent += 1
        return self.sent - 1

    def expect_result(self, number: int, status: int, sequence: object = ()) -> None:
        self.client.request(f"result {number}")
        self.expect(f"result {status} {list(sequence)}")  # type: ignore[call-overload]


@pytest.fixture(scope="module")
def setting() -> Iterator[Setting]:
    with RosSession("test") as session:
        made = Setting(session)
        yield made
        made.server.close()
        made.client.process.communicate(timeout=LIMIT_S)
        assert made.client.process.returncode == 0


def test_goal_waits_until_taken(setting: Setting) -> None:
    number = setting.send(3)
    (waiting,) = setting.server.waiting
    assert waiting._handle.status == GoalStatus.STATUS_ACCEPTED
    goal = setting.server.take()
    assert goal is waiting
    assert goal.request.order == 3
    assert goal._handle.status == GoalStatus.STATUS_EXECUTING
    assert setting.server.take() is None
    goal.publish_feedback(Fibonacci.Feedback(sequence=[0]))
    setting.client.request(f"result {number}")
    setting.expect("feedback [0]")
    goal.succeed(Fibonacci.Result(sequence=[0, 1, 1]))
    assert not goal.is_active
    setting.expect(f"result {GoalStatus.STATUS_SUCCEEDED} [0, 1, 1]")


def test_result_that_is_requested_before_the_end(setting: Setting) -> None:
    number = setting.send(1)
    goal = setting.server.take()
    setting.client.request(f"result {number}")
    setting.wait_for_result_request()
    goal.abort(Fibonacci.Result(sequence=[7]))
    setting.expect(f"result {GoalStatus.STATUS_ABORTED} [7]")


def test_goal_that_has_ended_keeps_its_status(setting: Setting) -> None:
    number = setting.send(1)
    goal = setting.server.take()
    goal.succeed(Fibonacci.Result(sequence=[1]))
    goal.abort(Fibonacci.Result(sequence=[2]))
    goal.publish_feedback(Fibonacci.Feedback(sequence=[3]))
    setting.expect_result(number, GoalStatus.STATUS_SUCCEEDED, [1])


def test_rejected_goal(setting: Setting) -> None:
    setting.client.request("send -1")
    setting.expect("rejected")
    setting.sent += 1
    assert not setting.server.waiting


def test_cancelled_goal(setting: Setting) -> None:
    number = setting.send(1)
    goal = setting.server.take()
    assert not goal.cancel_requested
    setting.client.request(f"cancel {number}")
    setting.wait_for(lambda: goal.cancel_requested)
    setting.expect("canceling 1")
    assert goal.is_active
    goal.canceled(Fibonacci.Result(sequence=[4]))
    setting.expect_result(number, GoalStatus.STATUS_CANCELED, [4])


def test_cancelled_goal_may_still_succeed(setting: Setting) -> None:
    number = setting.send(1)
    goal = setting.server.take()
    setting.client.request(f"cancel {number}")
    setting.wait_for(lambda: goal.cancel_requested)
    setting.expect("canceling 1")
    goal.succeed()
    setting.expect_result(number, GoalStatus.STATUS_SUCCEEDED)


def test_waiting_goal_that_is_cancelled_is_not_taken(setting: Setting) -> None:
    first, second = setting.send(1), setting.send(2)
    goal = setting.server.take()
    setting.client.request(f"cancel {second}")
    setting.wait_for(lambda: not setting.server.waiting)
    setting.expect("canceling 1")
    setting.expect_result(second, GoalStatus.STATUS_CANCELED)
    goal.succeed()
    setting.expect_result(first, GoalStatus.STATUS_SUCCEEDED)
    assert setting.server.take() is None


def test_take_newest_aborts_older_goals(setting: Setting) -> None:
    numbers = [setting.send(order) for order in (1, 2, 3)]
    goal = setting.server.take_newest()
    assert goal.request.order == 3
    for number in numbers[:2]:
        setting.expect_result(number, GoalStatus.STATUS_ABORTED)
    goal.canceled()  # replaced, not cancelled by the client
    setting.expect_result(numbers[2], GoalStatus.STATUS_ABORTED)


def test_close_ends_goals(setting: Setting) -> None:
    """The last test: afterwards there is no server."""
    first, second = setting.send(1), setting.send(2)
    setting.server.take()
    setting.client.request(f"result {first}")
    setting.client.request(f"result {second}")
    setting.wait_for_result_request()
    setting.server.close()
    setting.expect(*[f"result {GoalStatus.STATUS_ABORTED} []"] * 2)
