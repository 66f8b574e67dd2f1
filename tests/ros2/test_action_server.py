"""Action servers on the session's thread, with a plain rclpy client in another process."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("test_msgs")

from action_msgs.msg import GoalStatus
from test_msgs.action import Fibonacci

from btcore_ros2.action_server import RosActionServer
from btcore_ros2.session import RosSession
from tests.ros2.action_client import ClientProcess
from tests.ros2.conftest import LIMIT_S

FIBONACCI = "test_msgs/action/Fibonacci"


class ServerRig:
    """A session with an action server, and the client."""

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.server: Any = RosActionServer(
            session,
            Fibonacci,
            "count",
            reject_reason=lambda goal: "the order is negative" if goal.order < 0 else "",
        )
        self.client = ClientProcess(self.wait_for)

    def wait_for(self, condition: Callable[[], Any]) -> None:
        assert self.session.wait_for(condition, LIMIT_S), self.client.events[-9:]

    def wait_for_result_requests(self) -> None:
        """Wait until the client waits for the results of all goals that have not ended."""
        futures = self.server._server._result_futures
        self.wait_for(lambda: all(future.done() or future._callbacks for future in futures.values()))

    def send(self, order: int) -> int:
        """Send a goal, and return its number. The client requests its result."""
        return self.client.send("count", FIBONACCI, {"order": order})

    def cancel(self, number: int, condition: Callable[[], Any]) -> None:
        """Cancel a goal, and wait until *condition* is met."""
        assert self.client.cancel(number) == 1
        self.wait_for(condition)

    def expect_result(self, number: int, status: int, sequence: object = ()) -> None:
        assert self.client.result(number) == (status, {"sequence": list(sequence)})  # type: ignore[call-overload]


@pytest.fixture(scope="module")
def rig() -> Iterator[ServerRig]:
    with RosSession("test") as session:
        rig = ServerRig(session)
        yield rig
        rig.server.close()
        rig.client.close()


def test_goal_waits_until_taken(rig: ServerRig) -> None:
    number = rig.send(3)
    (waiting,) = rig.server.waiting
    assert waiting._handle.status == GoalStatus.STATUS_ACCEPTED
    goal = rig.server.take()
    assert goal is waiting
    assert goal.request.order == 3
    assert goal._handle.status == GoalStatus.STATUS_EXECUTING
    assert rig.server.take() is None
    goal.publish_feedback(Fibonacci.Feedback(sequence=[0]))
    rig.wait_for(lambda: rig.client.feedback(number) == [{"sequence": [0]}])
    goal.succeed(Fibonacci.Result(sequence=[0, 1, 1]))
    assert not goal.is_active
    rig.expect_result(number, GoalStatus.STATUS_SUCCEEDED, [0, 1, 1])


def test_result_that_is_requested_before_the_end(rig: ServerRig) -> None:
    number = rig.send(1)
    goal = rig.server.take()
    rig.wait_for_result_requests()
    goal.abort(Fibonacci.Result(sequence=[7]))
    rig.expect_result(number, GoalStatus.STATUS_ABORTED, [7])


def test_goal_that_has_ended_keeps_its_status(rig: ServerRig) -> None:
    number = rig.send(1)
    goal = rig.server.take()
    goal.succeed(Fibonacci.Result(sequence=[1]))
    goal.abort(Fibonacci.Result(sequence=[2]))
    goal.publish_feedback(Fibonacci.Feedback(sequence=[3]))
    rig.expect_result(number, GoalStatus.STATUS_SUCCEEDED, [1])


def test_rejected_goal(rig: ServerRig) -> None:
    rig.client.send("count", FIBONACCI, {"order": -1}, accepted=False)
    assert not rig.server.waiting


def test_cancelled_goal(rig: ServerRig) -> None:
    number = rig.send(1)
    goal = rig.server.take()
    assert not goal.cancel_requested
    rig.cancel(number, lambda: goal.cancel_requested)
    assert goal.is_active
    goal.canceled(Fibonacci.Result(sequence=[4]))
    rig.expect_result(number, GoalStatus.STATUS_CANCELED, [4])


def test_cancelled_goal_may_still_succeed(rig: ServerRig) -> None:
    number = rig.send(1)
    goal = rig.server.take()
    rig.cancel(number, lambda: goal.cancel_requested)
    goal.succeed()
    rig.expect_result(number, GoalStatus.STATUS_SUCCEEDED)


def test_waiting_goal_that_is_cancelled_is_not_taken(rig: ServerRig) -> None:
    first, second = rig.send(1), rig.send(2)
    goal = rig.server.take()
    rig.cancel(second, lambda: not rig.server.waiting)
    rig.expect_result(second, GoalStatus.STATUS_CANCELED)
    goal.succeed()
    rig.expect_result(first, GoalStatus.STATUS_SUCCEEDED)
    assert rig.server.take() is None


def test_close_ends_goals(rig: ServerRig) -> None:
    """The last test: afterwards there is no server."""
    numbers = [rig.send(1), rig.send(2)]
    rig.server.take()
    rig.wait_for_result_requests()
    rig.server.close()
    for number in numbers:
        rig.expect_result(number, GoalStatus.STATUS_ABORTED)
