"""Goals and cancellations whose answers are lost: they are sent again, and the log has the true outcome.

The server is in a second session of the same thread, and the time of the tree is simulated.
"""

import itertools
import logging
import threading
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")

from rclpy.action.client import ClientGoalHandle
from rclpy.task import Future
from test_msgs.action import Fibonacci

import btcore
from btcore import Registry, Status
from btcore.clock import NS_PER_S
from btcore_robot.schedule import SimulatedSchedule
from btcore_ros2 import direct_take
from btcore_ros2.action_server import RosActionServer
from btcore_ros2.leaves import register
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known

NUMBERS = itertools.count()
GOAL = """<root BTCPP_format="4"><BehaviorTree ID="Main"><RosActionCall name="{}"
    type="test_msgs/action/Fibonacci" goal='json:{{"order": 3}}'/></BehaviorTree></root>"""


class LeafRig:
    """A leaf with a goal, and its server.

    Attributes:
        name: The name of the action.
        rejects: Whether the server rejects goals.
    """

    def __init__(self) -> None:
        self.name = f"lossy{next(NUMBERS)}"  # servers of earlier tests may still be visible
        self.session, self.other = RosSession("leaf"), RosSession("other")
        self.session.clock = SimulatedSchedule()
        self.session.after_drain(self.other.drain)
        self.rejects = False
        self.server = RosActionServer[Any, Any, Any](
            self.other, Fibonacci, self.name, reject_reason=lambda goal: "no" if self.rejects else ""
        )
        nodes = Registry.standard()
        register(nodes)
        self.tree = btcore.loads(
            GOAL.format(self.name), nodes=nodes, resources=[self.session], clock=self.session.clock
        )
        wait_until_known(self.session, self.name)

    def start(self) -> None:
        """Send the goal."""
        assert self.tree.tick_once() is Status.RUNNING

    def accepted(self) -> Any:
        """Return the goal that the server gets."""
        self.wait_for(lambda: self.server.waiting)
        return self.server.take()

    def wait_for(self, condition: Any) -> None:
        """Drain both sides, while simulated time passes slowly, until *condition* returns a true value."""
        assert self.session.wait_for(lambda: condition() or self.pass_time(0.01), LIMIT_S)

    def pass_time(self, seconds: float) -> None:
        """Let simulated time pass."""
        clock = self.session.clock
        clock.wait_until(clock.now() + round(seconds * NS_PER_S), threading.Event())

    def answer_all(self) -> None:
        """Process what has been sent in both directions."""
        wait_until_known(self.session, self.name)
        self.session.drain()

    def follow_up(self) -> None:
        """Let more time pass than that in which a cancelled goal is watched."""
        for _ in range(32):
            self.pass_time(1)
            self.answer_all()


@pytest.fixture
def rig() -> Iterator[LeafRig]:
    rig = LeafRig()
    yield rig
    rig.session.close()
    rig.other.close()


def lose_answers(monkeypatch: pytest.MonkeyPatch, owner: object, name: str, count: int) -> list[Any]:
    """Let ROS drop the answers of the first *count* calls of a method. Return a list of all calls."""
    call, calls = getattr(owner, name), []

    def lossy(*arguments: Any, **named: Any) -> Any:
        future = call(*arguments, **named)
        calls.append(future)
        return Future() if len(calls) <= count else future

    monkeypatch.setattr(owner, name, lossy)
    return calls


def test_cancellation_whose_answer_is_lost_is_sent_again(
    rig: LeafRig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    rig.start()
    goal = rig.accepted()
    rig.wait_for(lambda: rig.tree.tick_once() and next(iter(rig.tree))._goal.accepted)
    sent = lose_answers(monkeypatch, ClientGoalHandle, "cancel_goal_async", 2)
    rig.tree.halt()
    rig.wait_for(lambda: goal.cancel_requested)
    assert rig.session.unfinished
    rig.wait_for(lambda: not rig.session.unfinished)  # the third was answered
    assert len(sent) == 3
    goal.canceled()
    rig.wait_for(lambda: "was cancelled: it ended as CANCELED" in caplog.text)


@pytest.mark.parametrize(
    ("rejects", "ends_before", "outcome"),
    [
        (False, True, "it ended as SUCCEEDED"),
        (False, False, "it ended as CANCELED"),
        (True, True, "its server disappeared, or does not know it"),
    ],
)
def test_goal_that_ended_without_an_answer_is_not_said_to_go_on(
    rig: LeafRig,
    rejects: bool,
    ends_before: bool,
    outcome: str,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO)
    rig.rejects = rejects
    lose_answers(monkeypatch, direct_take, "send_goal", 1)
    lose_answers(monkeypatch, ClientGoalHandle, "get_result_async", 0 if ends_before else 2)
    rig.start()
    goal = None if rejects else rig.accepted()
    if goal is not None and ends_before:
        goal.succeed()
    rig.answer_all()
    rig.tree.halt()
    if goal is not None and not ends_before:
        rig.wait_for(lambda: goal.cancel_requested)
        goal.canceled()
    rig.follow_up()
    assert f"the goal on '{rig.name}' was cancelled: {outcome}" in caplog.text
    assert "may still work on it" not in caplog.text


def test_goal_that_goes_on_after_its_cancellation_is_reported(
    rig: LeafRig, caplog: pytest.LogCaptureFixture
) -> None:
    rig.start()
    goal = rig.accepted()
    rig.tree.halt()
    rig.wait_for(lambda: goal.cancel_requested)
    rig.follow_up()
    assert f"'{rig.name}' has not ended the goal; it may still work on it" in caplog.text


def test_goal_of_a_server_that_is_visible_again_is_cancelled(
    rig: LeafRig, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    rig.start()
    goal = rig.accepted()
    (leaf,) = rig.tree
    rig.wait_for(lambda: rig.tree.tick_once() and leaf._goal.accepted)
    with monkeypatch.context() as outage:
        outage.setattr(leaf._endpoint.get(), "server_is_ready", lambda: False)
        rig.wait_for(lambda: rig.tree.tick_once() is Status.FAILURE)
    assert "disappeared while it worked on the goal" in leaf.error_message
    assert not goal.cancel_requested
    assert not rig.session.unfinished
    rig.wait_for(lambda: goal.cancel_requested)
    goal.canceled()
    rig.wait_for(lambda: "was cancelled: it ended as CANCELED" in caplog.text)
