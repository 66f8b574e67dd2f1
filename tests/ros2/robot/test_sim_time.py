"""A robot whose clock is the topic /clock."""

import time
from collections.abc import Callable
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("tf2_msgs")

from btcore_robot.testing import check_frames, check_info, check_scan, wait
from btcore_ros2.errors import RosError
from btcore_ros2.robot.description import RosRobotDescription, load_robot
from btcore_ros2.robot.ros_robot import RosRobot
from btcore_ros2.robot.sim_time import SimTime
from btcore_ros2.session import RosSession
from tests.ros2.robot.conftest import DESCRIPTION, PointRobotProcess

Start = Callable[..., PointRobotProcess]


def describe(folder: Path, text: str = DESCRIPTION) -> RosRobotDescription:
    path = folder / "point.yaml"
    path.write_text(text)
    return load_robot(path)


def drive_until_error(robot: RosRobot, seconds: float = 20.0) -> str:
    """Drive until waiting on the clock raises an error, and return its message."""
    end = time.monotonic() + seconds
    while time.monotonic() < end:
        robot.drive(0.1, 0.2)
        try:
            wait(robot, 0.1)
        except RosError as error:
            return str(error)
    raise AssertionError("no error within the limit")


def stopped(process: PointRobotProcess, session: RosSession) -> bool:
    """Return whether the last command that the robot receives is zero."""
    return session.wait_for(lambda: process.send()["commands"][-1][1:] == [0.0, 0.0], 10.0)


def test_jump_of_simulated_time(session: RosSession, start_robot: Start, tmp_path: Path) -> None:
    process = start_robot(sim_time=True)
    robot = RosRobot(session, describe(tmp_path))
    before = robot.clock.now()
    process.send(shift=-500_000_000)
    assert "/clock jumped back by 0." in drive_until_error(robot)
    assert robot.clock.now() >= before
    robot.close()
    assert stopped(process, session)


def test_simulated_time_that_stops(session: RosSession, start_robot: Start, tmp_path: Path) -> None:
    process = start_robot(sim_time=True)
    robot = RosRobot(session, describe(tmp_path))
    process.send(silent=["/clock"])
    assert "/clock: no message for 3." in drive_until_error(robot)


def test_simulated_time(
    session: RosSession, start_robot: Callable[..., PointRobotProcess], tmp_path: Path
) -> None:
    start_robot(sim_time=True, factor=2.0)
    robot = RosRobot(session, describe(tmp_path))
    assert isinstance(robot.clock, SimTime)
    check_info(robot)
    check_scan(robot)
    check_frames(robot)
    before, wall = robot.clock.now(), time.monotonic_ns()
    wait(robot, 2.0)
    assert robot.clock.now() - before > 1.5 * (time.monotonic_ns() - wall)
