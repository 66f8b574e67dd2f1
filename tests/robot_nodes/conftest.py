"""A robot for the tests of leaves and navigation, without a simulator."""

import threading
from collections.abc import Iterator

import numpy as np
import pytest

from btcore.clock import NS_PER_S
from btcore_robot.components.component import Component, ComponentContext, Executor, LogMessage
from btcore_robot.robot import (
    CMD_VEL,
    BaseInfo,
    CameraImage,
    HeadInfo,
    HeadPosition,
    LaserInfo,
    LaserScan,
    Odometry,
    Pose2D,
    Robot,
    TransformStamped,
    Twist2D,
)
from btcore_robot.schedule import SimulatedSchedule


@pytest.fixture(scope="module", autouse=True)
def coarse_physics() -> Iterator[None]:
    """Load worlds with 120 physics steps per second, as random worlds have, instead of 240."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("btcore_sim.world_description.PHYSICS_RATE", 120)
        yield


class SteppedClock(SimulatedSchedule):
    """Simulated time that advances from task to task, or that the test sets."""

    @property
    def time(self) -> int:
        return self.now()

    @time.setter
    def time(self, stamp: int) -> None:
        self.wait_until(stamp, threading.Event())

    def sleep(self, seconds: float) -> None:
        self.time = self.now() + round(seconds * 1e9)


class RecordingRobot(Robot):
    """A robot that records its commands and returns the readings that the test sets. It does not move.

    Attributes:
        commands: The commanded velocities, each as v (m/s) and w (rad/s).
        head_commands: The commanded positions of the head, each as pan and tilt (rad).
        recharges: The number of recharges.
        newest_scan: The reading that `scan` returns; `see` sets it.
        newest_image: The reading that `camera` returns.
        head_position: The reading that `head` returns.
        head_limits: The limits of the head.
        pose: The pose of the odometry.
    """

    def __init__(self) -> None:
        self._clock = SteppedClock()
        self.commands: list[tuple[float, float]] = []
        self.head_commands: list[tuple[float, float]] = []
        self.recharges = 0
        self.newest_scan: LaserScan | None = None
        self.newest_image: CameraImage | None = None
        self.head_position: HeadPosition | None = None
        self.head_limits: HeadInfo | None = None
        self.pose = Pose2D(0.0, 0.0, 0.0)

    def see(self, *ranges: float, angle_min: float = 0.0, angle_increment: float = 0.1) -> None:
        """Set the newest scan to these ranges (m)."""
        info = self.laser_info
        self.newest_scan = LaserScan(
            np.array(ranges, dtype=np.float32),
            self._clock.time,
            angle_min,
            angle_increment,
            info.range_min,
            info.range_max,
            info.frame,
        )

    @property
    def clock(self) -> SteppedClock:
        return self._clock

    @property
    def schedule(self) -> SteppedClock:
        return self._clock

    @property
    def base_info(self) -> BaseInfo:
        return BaseInfo(-0.2, 1.0, 2.09, 1.0, 2.09, 0.25, 0.27)

    @property
    def laser_info(self) -> LaserInfo:
        return LaserInfo(1, 0.0, 0.1, 0.05, 25.0, 10.0, 0.0, "base_laser_link")

    @property
    def head_info(self) -> HeadInfo | None:
        return self.head_limits

    def frames(self) -> list[TransformStamped]:
        unrotated = (0.0, 0.0, 0.0, 1.0)
        return [
            TransformStamped(
                self.laser_info.frame, "base_footprint", (0.2, 0.0, 0.1), unrotated, self._clock.time
            ),
            TransformStamped("head_2_link", "base_footprint", (0.125, 0.0, 1.0), unrotated, self._clock.time),
        ]

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        self.commands.append((v, w))

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def commanded_velocity(self) -> Twist2D:
        return Twist2D(*self.commands[-1]) if self.commands else Twist2D(0.0, 0.0)

    def scan(self) -> LaserScan | None:
        return self.newest_scan

    def odometry(self) -> Odometry:
        return Odometry(self.pose, Twist2D(0.0, 0.0), self._clock.time)

    def move_head(self, pan: float, tilt: float) -> None:
        self.head_commands.append((pan, tilt))

    def head(self) -> HeadPosition | None:
        return self.head_position

    def camera(self) -> CameraImage | None:
        return self.newest_image

    def recharge(self) -> None:
        self.recharges += 1


@pytest.fixture
def robot() -> RecordingRobot:
    return RecordingRobot()


class ComponentRig:
    """A recording robot and an executor, for components; *lines* contains what they have logged."""

    def __init__(self, robot: RecordingRobot) -> None:
        self.robot = robot
        self.clock = robot.clock
        self.lines: list[LogMessage] = []
        self.context = ComponentContext(robot.clock, robot.schedule, self.lines.append, robot=robot)
        self.executor = Executor(robot.schedule, robot.clock)

    def add(self, *components: Component) -> None:
        for component in components:
            self.executor.add(component)

    @property
    def output(self) -> list[tuple[float, str, str]]:
        """The time (s), component and text of each line."""
        return [(line.stamp / NS_PER_S, line.name, line.text) for line in self.lines]
