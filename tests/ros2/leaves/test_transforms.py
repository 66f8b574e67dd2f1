"""Leaves for tf that need no code. The other ROS node is in a second session of the same thread."""

import math
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from geometry_msgs.msg import Pose, PoseStamped, TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

import btcore
from btcore import Registry, Status, Tree
from btcore_robot.robot import Pose2D
from btcore_ros2 import shared_entities
from btcore_ros2.leaves import register
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
OUTPUTS = 'result="{result}" result_2d="{place}" error="{error}"'
READ = f'<RosTransformRead child="laser" timeout="60000" {OUTPUTS}/>'


def transform(child: str, parent: str, x: float, yaw: float = 0.0, second: int = 0) -> TransformStamped:
    transform = TransformStamped(child_frame_id=child)
    transform.header.frame_id, transform.header.stamp.sec = parent, second
    transform.transform.translation.x = x
    transform.transform.rotation.z, transform.transform.rotation.w = math.sin(yaw / 2), math.cos(yaw / 2)
    return transform


class Robot:
    """A ROS node that publishes the frames map → odom → base → laser; the first link is turned by 90°."""

    def __init__(self, session: RosSession) -> None:
        self.session = session
        self.other = RosSession("frames")
        session.after_drain(self.other.drain)
        self.moving = self.other.node.create_publisher(TFMessage, "/tf", 100)
        static = self.other.node.create_publisher(TFMessage, "/tf_static", LATCHED)
        static.publish(TFMessage(transforms=[transform("laser", "base", 0.5)]))

    def move(self, x: float, second: int) -> None:
        """Publish the pose of the base."""
        base = transform("base", "odom", x, second=second)
        self.moving.publish(TFMessage(transforms=[transform("odom", "map", 1.0, math.pi / 2, second), base]))

    def wait_until_moved(self, x: float, second: int) -> None:
        """Publish the pose of the base until the leaves know it."""
        tree = tree_of(
            '<RosTransformRead child="base" parent="odom" timeout="0" result_2d="{place}"/>', self.session
        )
        assert self.session.wait_for(self.moving.get_subscription_count, LIMIT_S)

        def is_known() -> bool:
            self.move(x, second)
            return tree.tick_once() is Status.SUCCESS and tree.blackboard["place"].x == x

        assert self.session.wait_for(is_known, LIMIT_S)


def tree_of(body: str, session: RosSession, **entries: object) -> Tree:
    nodes = Registry.standard()
    register(nodes)
    text = f'<root BTCPP_format="4"><BehaviorTree ID="Main">{body}</BehaviorTree></root>'
    tree = btcore.loads(text, nodes=nodes, resources=[session], clock=session.clock)
    for key, value in entries.items():
        tree.blackboard[key] = value
    return tree


def is_near(tree: Tree, x: float, y: float, yaw: float) -> bool:
    """Return whether the entry `place` is the pose."""
    place = tree.blackboard["place"]
    return (place.x, place.y, place.yaw) == pytest.approx((x, y, yaw))


@pytest.fixture
def robot(session: RosSession) -> Iterator[Robot]:
    robot = Robot(session)
    yield robot
    robot.other.close()


def test_pose_of_a_frame_is_awaited_and_read(robot: Robot) -> None:
    tree = tree_of(READ, robot.session)
    assert tree.tick_once() is Status.RUNNING  # nothing is known
    robot.wait_until_moved(2.0, second=7)
    assert robot.session.wait_for(lambda: tree.tick_once() is Status.SUCCESS, LIMIT_S)
    result = tree.blackboard["result"]
    assert isinstance(result, PoseStamped)
    assert (result.header.frame_id, result.header.stamp.sec) == ("map", 7)
    assert (result.pose.position.x, result.pose.position.y) == pytest.approx((1.0, 2.5))
    assert is_near(tree, 1.0, 2.5, math.pi / 2)
    assert tree.blackboard["error"] == ""
    field = READ.replace("/>", ' parent="base" field="pose.position.x"/>')
    tree = tree_of(field, robot.session)
    assert tree.tick_while_running() is Status.SUCCESS
    assert tree.blackboard["result"] == 0.5


@pytest.mark.parametrize(
    ("attributes", "error"),
    [
        ('child="lasr"', "there is no frame 'lasr'; did you mean 'laser'?"),
        ('child="laser" parent="elsewhere"', "there is no frame 'elsewhere'; "),
    ],
)
def test_unknown_frame_is_a_failure_with_a_reason(robot: Robot, attributes: str, error: str) -> None:
    body = f'<RosTransformRead {attributes} timeout="50" error="{{error}}"/>'
    tree = tree_of(body, robot.session)
    robot.wait_until_moved(2.0, second=7)
    assert tree.tick_while_running() is Status.FAILURE
    assert tree.blackboard["error"].startswith(error)


def test_old_transform_does_not_count(robot: Robot) -> None:
    tree = tree_of(READ.replace("60000", "0").replace("/>", ' max_age="0.05"/>'), robot.session)
    robot.wait_until_moved(2.0, second=7)

    def is_old() -> bool:
        robot.move(2.0, second=7)  # a repetition is not new
        return tree.tick_once() is Status.FAILURE and "max_age" in tree.blackboard["error"]

    assert robot.session.wait_for(is_old, LIMIT_S)
    assert "the transform from 'laser' to 'map' is 0." in tree.blackboard["error"]
    assert "s old (max_age 0.05 s)" in tree.blackboard["error"]


@pytest.mark.parametrize(
    ("pose", "entries"),
    [
        ("""'json:{"header": {"frame_id": "/laser"}, "pose": {"position": {"x": "{x}"}}}'""", {"x": 3.0}),
        ('"{pose}" pose_frame="laser"', {"pose": Pose2D(3.0, 0.0, 0.0)}),
        ('"{pose}" pose_frame="laser"', {"pose": Pose()}),
        ('"{pose}"', {"pose": {"header": {"frame_id": "laser", "stamp": 7}}}),
    ],
)
def test_pose_is_transformed(robot: Robot, pose: str, entries: dict[str, Any]) -> None:
    body = f'<RosPoseTransform pose={pose} parent="map" timeout="60000" {OUTPUTS}/>'
    tree = tree_of(body, robot.session, **entries)
    robot.wait_until_moved(2.0, second=7)
    assert tree.tick_while_running() is Status.SUCCESS
    forward = 3.0 if "x" in entries or isinstance(entries.get("pose"), Pose2D) else 0.0
    assert is_near(tree, 1.0, 2.5 + forward, math.pi / 2)


def test_transform_at_the_time_of_a_pose(robot: Robot) -> None:
    body = f'<RosPoseTransform pose="{{pose}}" parent="odom" timeout="100" {OUTPUTS}/>'
    tree = tree_of(body, robot.session)
    robot.wait_until_moved(2.0, second=7)
    robot.wait_until_moved(4.0, second=9)
    tree.blackboard["pose"] = {"header": {"frame_id": "base", "stamp": 8}}
    assert tree.tick_while_running() is Status.SUCCESS
    assert tree.blackboard["place"].x == pytest.approx(3.0)
    assert tree.blackboard["result"].header.stamp.sec == 8
    tree.blackboard["pose"] = {"header": {"frame_id": "base", "stamp": 12}}
    assert tree.tick_while_running() is Status.FAILURE
    assert "12.000 s is 3.000 s after that; wait for newer data" in tree.blackboard["error"]
    tree.blackboard["pose"] = {"pose": {"orientation": {"w": 0}}}
    assert tree.tick_once() is Status.FAILURE
    assert tree.blackboard["error"] == "the pose is not finite, or its orientation has the length 0"


def test_published_transforms_are_read_by_others(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shared_entities, "CHECK_NS", 10_000_000)
    body = """<Sequence>
        <RosTransformPublish child="dock" pose="{dock}" static="true"/>
        <RosTransformPublish child="shelf" pose='json:{"header": {"frame_id": "dock"},
            "pose": {"position": {"y": 1.5}}}' static="true"/>
        <RosTransformPublish child="box" pose="{box}" pose_frame="shelf" error="{error}"/>
        </Sequence>"""
    tree = tree_of(body, robot.session, dock=Pose2D(2.0, 0.0, 0.0), box=Pose2D(0.0, 0.0, 1.0))
    assert tree.tick_once() is Status.SUCCESS
    with RosSession("late") as late:
        end = robot.session.after_drain(late.drain)
        reading = tree_of(READ.replace("laser", "box"), late)

        def is_read() -> bool:
            tree.tick_once()  # the transform of the box is valid at its time only
            return reading.tick_once() is Status.SUCCESS

        assert robot.session.wait_for(is_read, LIMIT_S)
        assert is_near(reading, 2.0, 1.5, 1.0)
        assert reading.blackboard["result"].header.stamp.sec > 0
        end()
    tree.blackboard["box"] = Pose2D(math.nan, 0.0, 0.0)
    assert tree.tick_once() is Status.FAILURE
    assert "not finite" in tree.blackboard["error"]
    robot.session.entities.release(tree)
    node = robot.session.node
    assert robot.session.wait_for(lambda: "/tf" not in {each.topic_name for each in node.publishers}, LIMIT_S)
