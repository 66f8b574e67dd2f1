"""The bridge: a robot's readings and commands as topics, under the book's names."""

import numpy as np
import pytest

from btcore_robot.components.component import Component, ComponentContext, Executor
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
from tests.robot_nodes.conftest import RecordingRobot


class Bridged:
    """A robot with a bridge, and a component that uses its topics."""

    def __init__(self, robot: RecordingRobot) -> None:
        self.robot = robot
        self.context = ComponentContext(robot.clock, robot.schedule, lambda line: None, robot=robot)
        self.other = Component("other", self.context)
        executor = Executor(robot.schedule, robot.clock)
        executor.add(RobotBridge(self.context))
        executor.add(self.other)
        self.received: list[object] = []

    def listen(self, topic: str, kind: type) -> None:
        self.other.create_subscription(topic, kind, self.received.append)

    def sleep(self, seconds: float) -> None:
        self.robot.clock.sleep(seconds)


@pytest.fixture
def bridged(robot: RecordingRobot) -> Bridged:
    return Bridged(robot)


def test_each_scan_is_published_once(bridged: Bridged) -> None:
    bridged.listen("/scan_raw", LaserScan)
    bridged.robot.see(1.0)
    bridged.sleep(0.1)
    first = bridged.robot.newest_scan
    bridged.robot.see(2.0)
    bridged.sleep(0.1)
    assert bridged.received == [first, bridged.robot.newest_scan]
    assert SCAN_TOPIC == "/scan_raw"


def test_odometry_is_published_fifty_times_a_second(bridged: Bridged) -> None:
    bridged.listen(ODOMETRY_TOPIC, Odometry)
    bridged.robot.pose = Pose2D(1.0, 2.0, 0.5)
    bridged.sleep(1.0)
    assert len(bridged.received) == 50
    assert bridged.received[-1].pose == Pose2D(1.0, 2.0, 0.5)


def test_the_head_is_published_and_commanded(bridged: Bridged) -> None:
    bridged.listen(JOINT_STATE, HeadPosition)
    bridged.robot.head_position = HeadPosition(0.1, 0.2, 7)
    bridged.other.create_publisher(JOINT_COMMAND, HeadCommand).publish(HeadCommand(0.3, -0.1))
    bridged.sleep(0.1)
    assert bridged.received == [HeadPosition(0.1, 0.2, 7)]
    assert bridged.robot.head_commands == [(0.3, -0.1)]


@pytest.mark.parametrize(
    ("topic", "priority"), [("/cmd_vel", 10), ("/nav_vel", 10), ("/key_vel", 90), ("/joy_vel", 100)]
)
def test_velocities_are_passed_on_with_their_priority(bridged: Bridged, topic: str, priority: int) -> None:
    reported: list[int] = []
    drive = bridged.robot.drive
    bridged.robot.drive = lambda v, w, *, priority: (reported.append(priority), drive(v, w))
    bridged.other.create_publisher(topic, Twist2D).publish(Twist2D(0.2, 0.1))
    bridged.sleep(0.0)
    assert bridged.robot.commands == [(0.2, 0.1)]
    assert reported == [priority]


def test_a_picture_is_requested_only_while_there_is_a_subscriber(bridged: Bridged) -> None:
    asked: list[int] = []
    picture = CameraImage(np.zeros((2, 2, 3), dtype=np.uint8), 5, "camera")
    bridged.robot.camera = lambda: (asked.append(1), picture)[1]
    bridged.sleep(0.5)
    assert asked == []
    bridged.listen(IMAGE_TOPIC, CameraImage)
    bridged.sleep(0.5)
    assert bridged.received == [picture]


def test_a_bridge_without_a_robot_is_refused(robot: RecordingRobot) -> None:
    context = ComponentContext(robot.clock, robot.schedule, lambda line: None)
    with pytest.raises(ValueError, match="a bridge needs a robot"):
        RobotBridge(context)
