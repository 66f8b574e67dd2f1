"""A robot over topics follows the protocol; the robot runs in another process."""

import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from btcore.clock import NS_PER_S
from btcore_robot import time_limits
from btcore_robot.robot import CameraInfo, Robot
from btcore_robot.testing import check_camera, check_frames, check_info, check_scan, check_sonars, wait
from btcore_ros2.errors import RosError
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.session import RosSession
from btcore_scene import SceneSource
from tests.ros2.conftest import LIMIT_S
from tests.ros2.robot.conftest import AGREEMENT_S, DESCRIPTION, PARTS, PointRobotProcess, describe


def wait_for(robot: RosRobot, condition: Callable[[], object]) -> None:
    """Wait on the robot's clock until *condition* returns a true value."""
    end = robot.clock.now() + round(LIMIT_S * NS_PER_S)
    while not condition():
        assert robot.clock.now() < end, "the condition was not met in time"
        wait(robot, 0.02)


def test_head_torso_camera_sonar_and_battery(
    session: RosSession, point_robot: PointRobotProcess, tmp_path: Path
) -> None:
    robot = RosRobot(session, describe(tmp_path, f"{DESCRIPTION}{PARTS}battery: {{topic: /battery}}\n"))
    for check in (check_info, check_scan, check_frames):
        check(robot)
    robot.move_head(0.5, -2.0)
    robot.lift(9.0)
    assert robot.camera_info == CameraInfo(8, 6, 100.0, 100.0, 4.0, 3.0, 0.1, 8.0, 10.0, "camera_optical")
    wait_for(robot, lambda: (head := robot.head()) and abs(head.pan - 0.5) + abs(head.tilt + 1.0) < 0.01)
    wait_for(robot, lambda: abs((robot.torso_height() or 0.0) - 0.35) < 0.01)
    wait_for(robot, lambda: (image := robot.camera()) and image.depth is not None)
    image = robot.camera()
    assert image is not None
    assert image.depth is not None
    assert image.rgb[0, 0].tolist() == [30, 20, 10]
    assert image.depth[2, :2].tolist() == [np.inf, 1.5]
    check_camera(robot)
    assert [sonar.range for sonar in robot.sonars()] == [np.inf]
    check_sonars(robot)
    assert session.wait_for(robot.battery, LIMIT_S)
    battery = robot.battery()
    assert battery is not None
    assert battery.level == 75.0
    assert 0 <= robot.clock.now() - battery.stamp < AGREEMENT_S * NS_PER_S


def test_command_expires_without_a_new_command(
    session: RosSession, point_robot: PointRobotProcess, tmp_path: Path
) -> None:
    robot = RosRobot(session, describe(tmp_path))
    robot.drive(9.0, 1.0)
    # Within the limits, and with the same radius of the curve.
    wait_for(robot, lambda: ["/cmd_vel", 0.5, 1.0 / 18] in point_robot.send()["commands"])
    wait_for(robot, lambda: point_robot.send()["commands"][-1][1:] == [0.0, 0.0])


def test_odometry_is_not_stale_because_this_process_was_busy(
    session: RosSession, point_robot: PointRobotProcess, tmp_path: Path
) -> None:
    robot = RosRobot(session, describe(tmp_path))
    before = replace(robot.odometry(), stamp=robot.clock.now() - NS_PER_S)
    robot._odometry = before
    # As in a task that runs late: nothing has waited on the clock, but new messages have arrived.
    end = time.monotonic() + LIMIT_S
    while robot.odometry() is before:
        assert time.monotonic() < end


def test_scene_of_a_robot_without_a_model(
    session: RosSession, point_robot: PointRobotProcess, tmp_path: Path
) -> None:
    robot = RosRobot(session, describe(tmp_path, DESCRIPTION + PARTS))
    assert isinstance(robot, SceneSource)
    static = robot.static_scene()
    assert [(part.kind, part.frame) for part in static.parts] == [("cylinder", "base_footprint")]
    assert static.laser is not None
    assert static.laser.frame == robot.laser_info.frame
    first, second = robot.moving_scene(), robot.moving_scene()
    assert first.scan is not None
    assert [frame[:2] for frame in first.frames if frame.parent in ("odom", "map")] == [
        ("base_footprint", "odom"),
        ("odom", "map"),
    ]
    # From now on, the pose of the odometry comes from the navigation.
    assert "map" not in [frame.parent for frame in second.frames]
    assert robot.laser_info.frame in [frame.child for frame in second.frames]
    assert "/image" not in [subscription.topic_name for subscription in session.node.subscriptions]


def test_a_missing_camera_matters_only_when_it_is_used(
    session: RosSession,
    point_robot: PointRobotProcess,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
) -> None:
    monkeypatch.setattr(time_limits, "MAX_FIRST_PICTURE_WAIT_S", 0.5)
    camera = "camera: {image: {topic: /eye}, info: /eye_info, near: 0.1, far: 8.0, rate: 10}\n"
    robot = RosRobot(session, describe(tmp_path, DESCRIPTION + camera))
    assert isinstance(robot, Robot)
    assert "/eye" not in [subscription.topic_name for subscription in session.node.subscriptions]
    assert robot.camera() is None
    wait(robot, 1.0)
    assert "there are no pictures: /eye: no publisher is visible" in caplog.text
    assert robot.camera() is None
    robot.description = replace(robot.description, start_timeout=0.2)
    with pytest.raises(RosError, match=r"/eye_info: no publisher is visible; .* correct 'camera\.info' in"):
        assert robot.camera_info


def test_unresponsive_robot(session: RosSession, point_robot: PointRobotProcess, tmp_path: Path) -> None:
    RosRobot(session, describe(tmp_path)).close()  # the topics of the robot are known
    text = DESCRIPTION.replace("start_timeout: 60", "start_timeout: 5").replace(
        "topic: /scan", "topic: /lidar"
    )
    with pytest.raises(RosError) as caught:
        RosRobot(session, describe(tmp_path, text))
    message = str(caught.value)
    assert "the robot 'point' is not available" in message
    expected = "no publisher is visible; topics with a publisher of sensor_msgs/msg/LaserScan: /scan"
    assert f"scan: /lidar: {expected}" in message
    assert f"correct {tmp_path / 'point.yaml'}" in message
    assert "odometry" not in message


def test_topic_of_another_type(session: RosSession, point_robot: PointRobotProcess, tmp_path: Path) -> None:
    text = DESCRIPTION.replace("topic: /scan", "topic: /sonar")
    with pytest.raises(RosError, match="the robot uses sensor_msgs/msg/Range, but sensor_msgs/msg/LaserScan"):
        RosRobot(session, describe(tmp_path, text))
