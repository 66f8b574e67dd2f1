"""A ROS 2 robot in another process, and its description."""

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from tests.ros2.conftest import LIMIT_S

if TYPE_CHECKING:
    from btcore_ros2.robot.description import RosRobotDescription
    from btcore_ros2.robot.ros_robot import RosRobot
    from btcore_ros2.session import RosSession

AGREEMENT_S = 60
"""Equal times differ by less than this (s), also on a slow machine. The tests shift clocks by more."""
HERE = Path(__file__).parent


# The limits of the topics are long, because a busy machine may stop the process of the robot for a while.
DESCRIPTION = """\
name: point
start_timeout: 60
base: {v_min: -0.3, v_max: 0.5, w_max: 1.0, v_rate: 1.0, w_rate: 2.0, command_timeout: 0.5, radius: 0.2}
scan: {topic: /scan, timeout: 20.0, rate: 10, sigma: 0.01}
odometry: {topic: /odom, timeout: 20.0}
velocity: {type: Twist, topics: {/cmd_vel: 10, /key_vel: 90}}
frames: {tf: /tf}
joint_states: {topic: /joint_states}
"""

PARTS = """\
head:
  topic: /head_controller/joint_trajectory
  joints: [head_1_joint, head_2_joint]
  pan_limits: [-1.3, 1.3]
  tilt_limits: [-1.0, 0.7]
  speed: 3.0
torso: {topic: /torso_controller/joint_trajectory, joint: torso_lift_joint, limits: [0.0, 0.35], speed: 0.3}
camera: {image: {topic: /image}, info: /camera_info, depth: {topic: /depth}, near: 0.1, far: 8.0, rate: 10}
sonars: [/sonar]
"""


class PointRobotProcess:
    """A process of point_robot.py. `send` sets attributes of the robot, and returns its state."""

    def __init__(self, **settings: Any) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "point_robot.py"), json.dumps(settings)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        assert self.process.stdout is not None
        assert self.process.stdout.readline() == "ready\n"

    def send(self, **values: Any) -> dict[str, Any]:
        assert self.process.stdin is not None
        assert self.process.stdout is not None
        self.process.stdin.write(json.dumps(values) + "\n")
        self.process.stdin.flush()
        state: dict[str, Any] = json.loads(self.process.stdout.readline())
        return state

    def close(self) -> None:
        """End the process, and remove the robot from the graph."""
        try:
            self.process.communicate('{"end": true}\n', timeout=LIMIT_S)
        except (subprocess.TimeoutExpired, BrokenPipeError):
            self.process.kill()
            self.process.communicate()


def describe(folder: Path, text: str = DESCRIPTION) -> "RosRobotDescription":
    """Return the description with *text*, from a file in *folder*."""
    from btcore_ros2.robot.description import load_robot

    path = folder / "point.yaml"
    path.write_text(text)
    return load_robot(path)


def drive_until_error(robot: "RosRobot") -> str:
    """Drive until waiting on the clock raises an error, and return its message."""
    from btcore_robot.testing import wait
    from btcore_ros2.errors import RosError

    end = time.monotonic() + LIMIT_S
    while time.monotonic() < end:
        robot.drive(0.1, 0.2)
        try:
            wait(robot, 0.1)
        except RosError as error:
            return str(error)
    raise AssertionError("no error within the limit")


def stopped(process: PointRobotProcess, session: "RosSession") -> bool:
    """Return whether the last command that the robot receives is zero."""

    def is_last() -> bool:
        return [command[1:] for command in process.send()["commands"][-1:]] == [[0.0, 0.0]]

    return session.wait_for(is_last, LIMIT_S)


@pytest.fixture
def start_robot() -> Iterator[Callable[..., PointRobotProcess]]:
    """A function that starts a robot with settings; it ends with the test."""
    started: list[PointRobotProcess] = []

    def start(**settings: Any) -> PointRobotProcess:
        started.append(PointRobotProcess(**settings))
        return started[-1]

    yield start
    for process in started:
        process.close()


@pytest.fixture
def fresh_robot(point_robot: PointRobotProcess) -> PointRobotProcess:
    """The robot of the module, with the settings with which it was started."""
    point_robot.send(silent=[], offset=1_000_000.0, commands=[])
    point_robot.send(repeating=[], disorder=False)
    return point_robot


@pytest.fixture(scope="module")
def point_robot() -> Iterator[PointRobotProcess]:
    """A robot for all tests of a module."""
    process = PointRobotProcess()
    yield process
    process.close()
