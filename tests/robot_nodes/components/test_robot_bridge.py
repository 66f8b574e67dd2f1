"""The bridge: a robot's readings and commands as topics, under the book's names."""

import numpy as np
import pytest

from btcore_robot.components.component import Component, ComponentContext
from btcore_robot.components.messages import HeadCommand
from btcore_robot.components.robot_bridge import (
    IMAGE_TOPIC,
    JOINT_COMMAND,
    JOINT_STATE,
    ODOMETRY_TOPIC,
    SCAN_TOPIC,
    RobotBridge,
)
from btcore_robot.robot import CameraImage, HeadPosition, LaserScan, Odometry, Pose2D, Twist2D
from tests.robot_nodes.conftest import ComponentRig, RecordingRobot


class BridgeRig(ComponentRig):
    """A robot with a bridge, and a component that uses its topics."""

    def __init__(self, robot: RecordingRobot) -> None:
        super().__init__(robot)
        self.other = Component("other", self.context)
        self.add(RobotBridge(self.context), self.other)
        self.received: list[object] = []

    def listen(self, topic: str, kind: type) -> None:
        self.other.create_subscription(topic, kind, self.received.append)

    def sleep(self, seconds: float) -> None:
        self.robot.clock.sleep(seconds)


@pytest.fixture
def rig(robot: RecordingRobot) -> BridgeRig:
    return BridgeRig(robot)


def test_each_scan_is_published_once(rig: BridgeRig) -> None:
    rig.listen("/scan_raw", LaserScan)
    rig.robot.see(1.0)
    rig.sleep(0.1)
    first = rig.robot.newest_scan
    rig.robot.see(2.0)
    rig.sleep(0.1)
    assert rig.received == [first, rig.robot.newest_scan]
    assert SCAN_TOPIC == "/scan_raw"


def test_odometry_is_published_fifty_times_a_second(rig: BridgeRig) -> None:
    rig.listen(ODOMETRY_TOPIC, Odometry)
    rig.robot.pose = Pose2D(1.0, 2.0, 0.5)
    rig.sleep(1.0)
    assert len(rig.received) == 50
    assert rig.received[-1].pose == Pose2D(1.0, 2.0, 0.5)


def test_the_head_is_published_and_commanded(rig: BridgeRig) -> None:
    rig.listen(JOINT_STATE, HeadPosition)
    rig.robot.head_position = HeadPosition(0.1, 0.2, 7)
    rig.other.create_publisher(JOINT_COMMAND, HeadCommand).publish(HeadCommand(0.3, -0.1))
    rig.sleep(0.1)
    assert rig.received == [HeadPosition(0.1, 0.2, 7)]
    assert rig.robot.head_commands == [(0.3, -0.1)]


@pytest.mark.parametrize(
    ("topic", "priority"), [("/cmd_vel", 10), ("/nav_vel", 10), ("/key_vel", 90), ("/joy_vel", 100)]
)
def test_velocities_are_passed_on_with_their_priority(rig: BridgeRig, topic: str, priority: int) -> None:
    reported: list[int] = []
    drive = rig.robot.drive
    rig.robot.drive = lambda v, w, *, priority: (reported.append(priority), drive(v, w))
    rig.other.create_publisher(topic, Twist2D).publish(Twist2D(0.2, 0.1))
    rig.sleep(0.0)
    assert rig.robot.commands == [(0.2, 0.1)]
    assert reported == [priority]


def test_a_picture_is_requested_only_while_there_is_a_subscriber(rig: BridgeRig) -> None:
    requests: list[int] = []
    picture = CameraImage(np.zeros((2, 2, 3), dtype=np.uint8), 5, "camera")
    rig.robot.camera = lambda: (requests.append(1), picture)[1]
    rig.sleep(0.5)
    assert requests == []
    rig.listen(IMAGE_TOPIC, CameraImage)
    rig.sleep(0.5)
    assert rig.received == [picture]


def test_a_bridge_without_a_robot_is_refused(robot: RecordingRobot) -> None:
    context = ComponentContext(robot.clock, robot.schedule, lambda line: None)
    with pytest.raises(ValueError, match="a bridge needs a robot"):
        RobotBridge(context)
