"""The models of the leaves that need a ROS session, which proofs assume, hold for the code of these leaves.

Each leaf runs in a schedule in which it completes, waits, fails and is halted in every way. The servers and
topics of the other side are in a second session of the same thread, so that a schedule determines when they
answer. The time of the tree is simulated. What a model excludes is defined in
tests/robot_nodes/test_leaf_models.py.
"""

import random
import threading
from collections.abc import Callable
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from action_msgs.srv import CancelGoal
from geometry_msgs.msg import TransformStamped
from rclpy.action import ActionClient, ActionServer
from rclpy.client import Client
from std_msgs.msg import Bool, String
from std_srvs.srv import SetBool, Trigger
from test_msgs.action import Fibonacci, NestedMessage
from tf2_msgs.msg import TFMessage

import btcore
from btcore import Status
from btcore.clock import NS_PER_MS
from btcore_proof.leaf_models import model_of, resources_of
from btcore_robot.schedule import SimulatedSchedule
from btcore_ros2.action_server import RosActionServer
from btcore_ros2.session import RosSession
from tests.robot_nodes.test_leaf_models import ROS, RUNNING, SHIPPED, Watch, records, tree_of, watch_of
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known

IDLE, SUCCESS, FAILURE = Status.IDLE, Status.SUCCESS, Status.FAILURE
SERVER_MS = 1000
"""The time (ms) in which a server has to answer, and a message has to arrive."""
DISCOVERY_MS = 5000
"""The time (ms) in which the other side has to appear."""


class LeafRig:
    """A leaf whose ticks and halts are checked, and the session of the other side.

    Attributes:
        other: The session of the other side. It works while the session of the leaf drains, unless it sleeps.
        sleeps: Whether the other side processes nothing.
    """

    def __init__(self, id: str, watch: type[Watch]) -> None:
        self.session, self.other = RosSession("leaf"), RosSession("other")
        self.session.clock = SimulatedSchedule()
        self.sleeps = False
        self.session.after_drain(lambda: None if self.sleeps else self.other.drain())
        self._id = id
        self._watch = watch
        self.tree: btcore.Tree

    def load(self, attributes: str, **entries: object) -> None:
        """Load the leaf with all outputs connected, and with *entries* on its blackboard."""
        outputs = [port.name for port in SHIPPED[self._id].ports.values() if port.writes]
        attributes += "".join(f' {name}="{{{name}}}"' for name in outputs)
        elements = [f"<{self._id} {attributes}/>"]
        self.tree = tree_of(elements, [self.session], self.session.clock, self._watch)
        for key, value in entries.items():
            self.tree.blackboard[key] = value

    def tick(self) -> Status:
        """Tick the leaf, and return its status."""
        return self._do("tick")

    def halt(self) -> None:
        """Halt the leaf, which is RUNNING."""
        assert self._do("halt") is IDLE

    def tick_until(self, result: Status) -> None:
        """Tick the leaf, which remains RUNNING until it returns *result*."""

        def is_complete() -> bool:
            status = self.tick()
            assert status in (RUNNING, result), status
            return status is result

        self.wait_for(is_complete)

    def wait_for(self, condition: Callable[[], Any]) -> None:
        """Drain both sides until *condition* returns a true value. No simulated time passes."""
        assert self.session.wait_for(condition, LIMIT_S)

    def pass_time(self, ms: int = SERVER_MS + 1) -> None:
        """Let simulated time pass."""
        clock = self.session.clock
        clock.wait_until(clock.now() + ms * NS_PER_MS, threading.Event())

    @property
    def error(self) -> str:
        """The output `error`."""
        return str(self.tree.blackboard["error"])

    def _do(self, what: str) -> Status:
        self._watch.choose = staticmethod(lambda index: what)
        self.tree.tick_exactly_once()
        return next(node for node in self.tree if node.id == self._id).status

    def close(self) -> None:
        """Close both sessions."""
        self.session.close()
        self.other.close()


def action_schedule(rig: LeafRig) -> None:
    """Run RosActionCall: goals that end in every way, and servers that are missing, of another type, or lost.

    A goal also ends because it is rejected, or because the server does not answer.
    """
    attributes = """type="test_msgs/action/Fibonacci" goal='json:{"order": "{n}"}'"""
    RosActionServer[Any, Any, Any](rig.other, NestedMessage, "other_type")
    rig.load(f'name="other_type" {attributes}', n=3)
    rig.pass_time(DISCOVERY_MS + 1)
    rig.wait_for(lambda: rig.tick() is FAILURE and "has the type" in rig.error)
    rig.load(f'name="count" {attributes}', n=3)
    assert rig.tick() is RUNNING
    rig.halt()  # while the leaf waits for a server
    assert rig.tick() is RUNNING
    rig.pass_time(DISCOVERY_MS + 1)
    assert rig.tick() is FAILURE
    assert "no action server" in rig.error
    assert rig.tick() is FAILURE  # at once
    rig.load(f'name="count" wait_for_server_timeout="60000" {attributes}', n=3)
    rig.pass_time(59_999)
    assert rig.tick() is RUNNING
    reject_reason = ""
    server = RosActionServer[Any, Any, Any](
        rig.other, Fibonacci, "count", reject_reason=lambda goal: reject_reason
    )
    wait_until_known(rig.session, "count")
    canceller = rig.other.node.create_client(CancelGoal, "count/_action/cancel_goal")
    rig.wait_for(canceller.service_is_ready)

    def accepted() -> Any:
        assert rig.tick() is RUNNING
        rig.wait_for(lambda: server.waiting)
        return server.take()

    goal = accepted()
    goal.publish_feedback(Fibonacci.Feedback(sequence=[1]))
    rig.wait_for(lambda: rig.tick() is RUNNING and "feedback" in rig.tree.blackboard)
    rig.halt()
    rig.wait_for(lambda: goal.cancel_requested)
    goal.canceled()

    goal = accepted()
    goal.publish_feedback(Fibonacci.Feedback(sequence=[2]))
    goal.succeed(Fibonacci.Result(sequence=[0, 1]))
    rig.tick_until(SUCCESS)
    accepted().abort(Fibonacci.Result(sequence=[0]))
    rig.tick_until(FAILURE)
    assert "aborted the goal" in rig.error
    goal = accepted()
    canceller.call_async(CancelGoal.Request())  # all goals
    rig.wait_for(lambda: goal.cancel_requested)
    goal.canceled()
    rig.tick_until(FAILURE)
    assert "cancelled by" in rig.error
    reject_reason = "no"
    rig.tick_until(FAILURE)
    assert "rejected the goal" in rig.error
    reject_reason = ""

    rig.sleeps = True
    assert rig.tick() is RUNNING
    rig.pass_time()
    assert rig.tick() is FAILURE
    assert "did not answer" in rig.error
    rig.sleeps = False
    rig.wait_for(lambda: not rig.session.unfinished)  # the server knows that this goal is cancelled
    accepted()
    for entity in tuple(rig.other.node.waitables):
        if isinstance(entity, ActionServer):
            entity.destroy()

    def is_lost() -> bool:
        rig.pass_time()  # the time between two checks whether the server exists
        return rig.tick() is FAILURE

    rig.wait_for(is_lost)
    assert "disappeared" in rig.error


def service_schedule(rig: LeafRig) -> None:
    """Run RosServiceCall: responses, and servers that are missing, of another type, silent or lost."""
    attributes = """type="std_srvs/SetBool" request='json:{"data": "{on}"}'"""
    node = rig.other.node
    node.create_service(Trigger, "other_type", lambda request, response: response)
    rig.load(f'name="other_type" {attributes}', on=True)
    rig.pass_time(DISCOVERY_MS + 1)
    rig.wait_for(lambda: rig.tick() is FAILURE and "has the type" in rig.error)
    rig.load(f'name="switch" {attributes}', on=True)
    assert rig.tick() is RUNNING
    rig.halt()  # while the leaf waits for a server
    assert rig.tick() is RUNNING
    rig.pass_time(DISCOVERY_MS + 1)
    assert rig.tick() is FAILURE
    assert "no service" in rig.error
    assert rig.tick() is FAILURE  # at once

    def switch(request: Any, response: Any) -> Any:
        response.success = request.data
        return response

    rig.load(f'name="switch" wait_for_server_timeout="60000" {attributes}', on=True)
    rig.pass_time(59_999)
    assert rig.tick() is RUNNING
    service = node.create_service(SetBool, "switch", switch)
    known = RosActionServer[Any, Any, Any](rig.other, Fibonacci, "known")
    wait_until_known(rig.session, known.name)
    rig.tick_until(SUCCESS)
    rig.tree.blackboard["on"] = False
    rig.tick_until(FAILURE)
    assert "did not succeed" in rig.error
    rig.sleeps = True
    assert rig.tick() is RUNNING
    rig.halt()
    assert rig.tick() is RUNNING
    rig.pass_time()
    assert rig.tick() is FAILURE
    assert "did not answer" in rig.error
    assert rig.tick() is RUNNING
    node.destroy_service(service)
    rig.sleeps = False
    rig.pass_time()
    rig.tick_until(FAILURE)
    assert "did not answer" in rig.error


def publish_schedule(rig: LeafRig) -> None:
    """Run RosTopicPublish: without a subscriber, and with subscribers of another type and of its type."""
    attributes = """type="std_msgs/String" message='json:{"data": "{word}"}'"""
    node, received = rig.other.node, []
    node.create_subscription(Bool, "other_type", received.append, 1)
    rig.load(f'name="other_type" {attributes}', word="one")
    rig.wait_for(lambda: rig.session.node.count_subscribers("other_type"))
    rig.pass_time(DISCOVERY_MS + 1)
    assert rig.tick() is SUCCESS
    assert rig.error.endswith("its type is std_msgs/msg/Bool")
    rig.load(f'name="words" {attributes}', word="one")
    assert rig.tick() is RUNNING
    rig.halt()  # while the leaf waits for a subscriber
    assert rig.tick() is RUNNING
    rig.pass_time(DISCOVERY_MS + 1)
    assert rig.tick() is SUCCESS
    assert "no subscriber of the topic 'words' gets the message: nothing subscribes to it" in rig.error
    rig.load(f'name="words" qos="latched" wait_for_subscriber_timeout="0" {attributes}', word="one")
    assert rig.tick() is SUCCESS  # at once
    assert rig.error == ""
    rig.load(f'name="words" wait_for_subscriber_timeout="60000" {attributes}', word="two")
    rig.pass_time(59_999)
    assert rig.tick() is RUNNING
    node.create_subscription(String, "words", lambda message: received.append(message.data), 1)
    rig.tick_until(SUCCESS)
    rig.wait_for(lambda: received)
    assert (received, rig.error) == (["two"], "")


def read_schedule(rig: LeafRig) -> None:
    """Run RosTopicRead: messages before and after its start, old messages, and topics that are silent."""
    attributes = 'type="std_msgs/String" max_age="0.5" timeout="{timeout}"'
    node = rig.other.node
    node.create_publisher(Bool, "other_type", 1)
    rig.load(f'name="other_type" {attributes}', timeout=0)
    rig.wait_for(lambda: rig.tick() is FAILURE and "its type is std_msgs/msg/Bool" in rig.error)
    attributes += ' name="words"'
    rig.load(attributes, timeout=SERVER_MS)

    def fails() -> str:
        assert rig.tick() is RUNNING
        rig.pass_time()
        assert rig.tick() is FAILURE
        return rig.error

    assert rig.tick() is RUNNING
    rig.pass_time(DISCOVERY_MS - 1)
    assert rig.tick() is RUNNING  # ROS 2 may not have found the publisher yet
    rig.pass_time()
    assert rig.tick() is FAILURE
    assert "nothing publishes it" in fails()
    rig.load(f'name="late" {attributes.partition(" name=")[0]}', timeout=SERVER_MS)
    assert rig.tick() is RUNNING
    rig.pass_time()
    assert rig.tick() is RUNNING
    node.create_publisher(String, "late", 1)
    rig.wait_for(lambda: rig.session.node.count_publishers("late"))
    rig.pass_time()
    assert rig.tick() is FAILURE, "the timeout counts as soon as there is a publisher"
    assert "have sent nothing" in rig.error
    rig.load(attributes, timeout=SERVER_MS)
    rig.tree.blackboard["timeout"] = 0
    assert rig.tick() is FAILURE  # at once
    rig.tree.blackboard["timeout"] = SERVER_MS

    publisher = node.create_publisher(String, "words", 1)
    rig.wait_for(publisher.get_subscription_count)
    assert rig.tick() is RUNNING
    rig.halt()
    assert rig.tick() is RUNNING
    publisher.publish(String(data="after the start"))
    rig.tick_until(SUCCESS)
    rig.load(attributes, timeout=SERVER_MS)
    assert rig.tick() is SUCCESS  # at once, with the message that arrived before
    rig.pass_time(501)
    assert "have sent nothing" in fails()
    assert rig.tick() is RUNNING
    node.destroy_publisher(publisher)
    rig.pass_time()
    rig.wait_for(lambda: not rig.session.node.count_publishers("words"))
    assert rig.tick() is FAILURE


def look_up_schedule(rig: LeafRig, attributes: str, **entries: object) -> None:
    """Run a leaf that looks up the frame `base` in `map`: unknown, known, and too old."""
    rig.load(f'{attributes} timeout="{{timeout}}" max_age="0.5"', timeout=SERVER_MS, **entries)
    publisher = rig.other.node.create_publisher(TFMessage, "/tf", 10)
    rig.wait_for(publisher.get_subscription_count)
    assert rig.tick() is RUNNING
    rig.halt()
    assert rig.tick() is RUNNING
    rig.pass_time()
    assert rig.tick() is FAILURE
    assert "no frame is known yet" in rig.error
    assert rig.tick() is RUNNING
    transform = TransformStamped(child_frame_id="base")
    transform.header.frame_id, transform.header.stamp.sec = "map", 1
    publisher.publish(TFMessage(transforms=[transform]))
    rig.tick_until(SUCCESS)
    assert rig.tick() is SUCCESS  # at once
    rig.pass_time()
    assert rig.tick() is RUNNING
    rig.pass_time()
    assert rig.tick() is FAILURE
    assert "max_age" in rig.error
    rig.tree.blackboard["timeout"] = 0
    assert rig.tick() is FAILURE  # at once


def read_transform_schedule(rig: LeafRig) -> None:
    """Run RosTransformRead."""
    look_up_schedule(rig, 'child="base"')


def transform_pose_schedule(rig: LeafRig) -> None:
    """Run RosPoseTransform."""
    look_up_schedule(rig, 'pose="{pose}"', pose={"header": {"frame_id": "base"}})


def publish_transform_schedule(rig: LeafRig) -> None:
    """Run RosTransformPublish: with a pose, and with numbers that are no pose."""
    received: list[Any] = []
    rig.other.node.create_subscription(TFMessage, "/tf", received.append, 10)
    rig.load('child="box" pose="{pose}"', pose={"header": {"frame_id": "base"}})
    rig.wait_for(lambda: rig.tick() is SUCCESS and received)
    rig.tree.blackboard["pose"] = {"pose": {"position": {"x": "nan"}}}
    assert rig.tick() is FAILURE
    assert "not finite" in rig.error


SCHEDULES = {
    "RosActionCall": action_schedule,
    "RosServiceCall": service_schedule,
    "RosTopicPublish": publish_schedule,
    "RosTopicRead": read_schedule,
    "RosTransformRead": read_transform_schedule,
    "RosPoseTransform": transform_pose_schedule,
    "RosTransformPublish": publish_transform_schedule,
}


@pytest.mark.parametrize("id", sorted(id for id in SHIPPED if resources_of(SHIPPED[id]) & ROS))
def test_leaf_follows_its_model(id: str, monkeypatch: pytest.MonkeyPatch) -> None:
    watch = watch_of(random.Random(1), 1.0, 0.0)
    watch.resource = ROS
    # A server works on a goal or a request after the tick that sends it; a published message is done.
    for owner, name in ((ActionClient, "send_goal_async"), (Client, "call_async")):
        monkeypatch.setattr(owner, name, getattr(owner, name))  # restored after the test
        records(owner, name, watch.used, lambda *_, name=name: name)
    rig = LeafRig(id, watch)
    try:
        SCHEDULES[id](rig)
    finally:
        rig.close()
    assert sorted(set(watch.faults)) == []
    model = model_of(SHIPPED[id])
    allowed = {*model.results, *([RUNNING, IDLE] if model.lasts else [])}  # IDLE: it was halted
    assert watch.seen == {(id, status.name) for status in allowed}
