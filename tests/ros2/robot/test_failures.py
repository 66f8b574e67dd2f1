"""A robot that fails, or has other types: the error names the topic, and the robot gets a stop command."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from btcore_robot.testing import wait
from btcore_ros2.errors import RosError
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.robot.conftest import (
    DESCRIPTION,
    PARTS,
    PointRobotProcess,
    describe,
    drive_until_error,
    stopped,
)

SHORT_LIMITS = DESCRIPTION.replace("timeout: 20.0", "timeout: 1.0")


def test_topic_that_stops(session: RosSession, fresh_robot: PointRobotProcess, tmp_path: Path) -> None:
    process = fresh_robot
    text = DESCRIPTION.replace("topic: /scan, timeout: 20.0", "topic: /scan, timeout: 1.0")
    robot = RosRobot(session, describe(tmp_path, text))

    def drives() -> bool:
        robot.drive(0.1, 0.2)
        return bool(process.send()["twist"][0] > 0.0)

    assert session.wait_for(drives, LIMIT_S)
    process.send(silent=["/scan"])
    message = drive_until_error(robot)
    assert message.startswith("/scan: no message for ")
    assert "(limit 1 s): its driver has stopped; zero velocity was commanded" in message
    assert stopped(process, session)
    # The error is raised again, and commands are not sent any more.
    robot.drive(0.1, 0.2)
    with pytest.raises(RosError, match="/scan: no message") as caught:
        wait(robot, 0.2)
    assert stopped(process, session)
    # Without scans the wait does not end; with scans the robot drives again.
    calls = iter(range(2000))
    robot.recover(caught.value, lambda: next(calls, None) is None)
    assert next(calls, None) is None
    process.send(silent=[])
    robot.recover(caught.value, lambda: False)
    robot.raise_failure()
    assert session.wait_for(drives, LIMIT_S)


def test_jump_of_robots_clock(session: RosSession, fresh_robot: PointRobotProcess, tmp_path: Path) -> None:
    process = fresh_robot
    robot = RosRobot(session, describe(tmp_path))
    wait(robot, 2.2)
    process.send(offset=999_940.0)
    assert "its stamps jumped back by " in drive_until_error(robot)
    assert stopped(process, session)


def test_last_command_is_zero_when_the_robot_is_closed(
    session: RosSession, fresh_robot: PointRobotProcess, tmp_path: Path
) -> None:
    process = fresh_robot
    with RosSession("driver") as own, RosRobot(own, describe(tmp_path)) as robot:
        robot.drive(0.1, 0.2, priority=90)

    def commands() -> list[list[Any]]:
        return [command for command in process.send()["commands"] if command[0] == "/key_vel"]

    # The last command of an earlier test may still arrive, on the other topic.
    assert session.wait_for(lambda: len(commands()) == 2, LIMIT_S)
    assert [command[1:] == [0.0, 0.0] for command in commands()] == [False, True]


def test_messages_that_arrive_twice_or_late_do_not_replace_newer_ones(
    session: RosSession, fresh_robot: PointRobotProcess, tmp_path: Path
) -> None:
    process = fresh_robot
    process.send(disorder=True)
    robot = RosRobot(session, describe(tmp_path, DESCRIPTION + PARTS))
    robot.lift(0.35)
    places, heights, links = [], [], []
    while robot.torso_height() < 0.2:
        robot.drive(0.3, 0.0)
        wait(robot, 0.01)
        places.append(robot.odometry().pose.x)
        heights.append(robot.torso_height())
        links.append(next(each.position[2] for each in robot.frames() if each.child == "torso"))
    for values in (places, heights, links):
        assert values == sorted(values)
        assert values[0] < values[-1]


def test_old_message_that_is_repeated_counts_as_silence(
    session: RosSession, fresh_robot: PointRobotProcess, tmp_path: Path
) -> None:
    text = DESCRIPTION.replace("topic: /odom, timeout: 20.0", "topic: /odom, timeout: 1.0")
    robot = RosRobot(session, describe(tmp_path, text))
    fresh_robot.send(repeating=["/odom"], disorder=True)
    message = drive_until_error(robot)
    assert message.startswith("/odom: no new message for 1.")
    assert "its stamps do not advance, so a driver or a bridge repeats old messages" in message
    assert stopped(fresh_robot, session)


def test_robot_that_is_killed(session: RosSession, fresh_robot: PointRobotProcess, tmp_path: Path) -> None:
    """The last test with the robot of the module: afterwards there is none."""
    process = fresh_robot
    robot = RosRobot(session, describe(tmp_path, SHORT_LIMITS))
    process.process.kill()  # it stays visible for 20 s
    message = drive_until_error(robot)
    assert "/scan: no message" in message
    assert "/odom: no message" in message
    assert "the robot or the network is down" in message


def test_stamped_velocity(
    session: RosSession, start_robot: Callable[..., PointRobotProcess], tmp_path: Path
) -> None:
    process = start_robot(stamped=True)
    began = time.monotonic()
    with pytest.raises(RosError) as caught:
        RosRobot(session, describe(tmp_path))
    assert (
        "velocity: /cmd_vel: the robot uses geometry_msgs/msg/TwistStamped, "
        "but geometry_msgs/msg/Twist is expected"
    ) in str(caught.value)
    assert time.monotonic() - began < 30.0  # it does not wait for the start timeout
    # In a session of its own, since a ROS node uses one type for a topic.
    text = DESCRIPTION.replace("type: Twist,", "type: TwistStamped,")
    with RosSession("stamped") as own, RosRobot(own, describe(tmp_path, text)) as robot:

        def drives() -> bool:
            robot.drive(0.1, 0.0)
            return bool(process.send()["twist"][0] > 0.05)

        assert own.wait_for(drives, LIMIT_S)


def test_robot_that_is_found_late_and_started_again(
    session: RosSession, start_robot: Callable[..., PointRobotProcess], tmp_path: Path
) -> None:
    """The first process is started while the robot is awaited."""
    robots: list[PointRobotProcess] = []
    late = threading.Timer(1.0, lambda: robots.append(start_robot()))
    late.start()
    robot = RosRobot(session, describe(tmp_path))
    late.join()
    wait(robot, 0.2)
    robots[0].process.kill()
    again = start_robot()

    def drives() -> bool:
        robot.drive(0.1, 0.0)
        wait(robot, 0.05)
        return bool(again.send()["twist"][0] > 0.05)

    assert session.wait_for(drives, LIMIT_S)
    wait(robot, 0.2)
    assert robot.odometry().twist.v > 0.0
