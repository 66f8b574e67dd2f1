"""The checks of the `Robot` protocol: a robot without physics passes them, and violations are found."""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from btcore_robot.robot import (
    CMD_VEL,
    BaseInfo,
    BatteryState,
    CameraImage,
    CameraInfo,
    HeadInfo,
    HeadPosition,
    LaserInfo,
    LaserScan,
    Odometry,
    Phase,
    Pose2D,
    Robot,
    SonarReading,
    TorsoInfo,
    TransformStamped,
    Twist2D,
)
from btcore_robot.testing import check_robot

SECOND = 1_000_000_000
STEP = SECOND // 100


class PlainSchedule:
    """Tasks that run when the test advances the time."""

    def __init__(self) -> None:
        self.now = 0
        self.tasks: list[list[Any]] = []

    def add_task(
        self, hertz: float, rank: Phase, task: Callable[[int], None], *, first: int | None = None
    ) -> Callable[[], None]:
        period = round(SECOND / hertz)
        entry = [self.now + period if first is None else first, rank, period, task]
        self.tasks.append(entry)
        return lambda: self.tasks.remove(entry)

    def run(self, now: int) -> None:
        self.now = now
        for entry in sorted(self.tasks, key=lambda entry: entry[:2]):
            while entry[0] <= now:
                entry[0] += entry[2]
                entry[3](now)


class PlainRobot(Robot):
    """A point that follows commands exactly, with a laser in an empty room and a simulated clock."""

    def __init__(self) -> None:
        self.time = 0
        self.tasks = PlainSchedule()
        self.level = 50.0
        self.height = 0.0
        self.goal = Twist2D(0.0, 0.0)
        self.commanded_at = -SECOND
        self.rank = CMD_VEL
        self.twist = Twist2D(0.0, 0.0)
        self.pose = Pose2D(0.0, 0.0, 0.0)
        self.gaze = (0.0, 0.0)

    @property
    def clock(self) -> "PlainRobot":
        return self

    def now(self) -> int:
        return self.time

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        while self.time < deadline and not wake.is_set():
            self.time = min(deadline, self.time + STEP)
            self.step(STEP / SECOND)
            self.tasks.run(self.time)
        return wake.is_set()

    def step(self, seconds: float) -> None:
        goal = self.commanded_velocity()
        self.level -= (0.5 * math.hypot(goal.v, goal.w) + 0.01) * seconds
        v_step, w_step = self.base_info.v_rate * seconds, self.base_info.w_rate * seconds
        v = self.twist.v + min(max(goal.v - self.twist.v, -v_step), v_step)
        w = self.twist.w + min(max(goal.w - self.twist.w, -w_step), w_step)
        self.twist = Twist2D(v, w)
        x, y, yaw = self.pose.x, self.pose.y, self.pose.yaw
        self.pose = Pose2D(
            x + v * seconds * math.cos(yaw), y + v * seconds * math.sin(yaw), yaw + w * seconds
        )

    @property
    def schedule(self) -> PlainSchedule:
        return self.tasks

    @property
    def base_info(self) -> BaseInfo:
        return BaseInfo(-0.5, 0.5, 1.0, 1.0, 2.0, 0.5, 0.2)

    @property
    def laser_info(self) -> LaserInfo:
        return LaserInfo(4, -1.5, 1.0, 0.1, 10.0, 10.0, 0.0, "laser")

    @property
    def head_info(self) -> HeadInfo | None:
        return HeadInfo(-1.0, 1.0, -0.5, 0.5, 1.0)

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        if priority < self.rank and self.time - self.commanded_at <= SECOND // 2:
            return
        self.rank, self.commanded_at = priority, self.time
        self.goal = Twist2D(
            min(max(v, self.base_info.v_min), self.base_info.v_max),
            min(max(w, -self.base_info.w_max), self.base_info.w_max),
        )

    def stop(self) -> None:
        self.rank = CMD_VEL
        self.goal, self.commanded_at = Twist2D(0.0, 0.0), self.time

    def commanded_velocity(self) -> Twist2D:
        lapsed = self.time - self.commanded_at > self.base_info.command_timeout * SECOND
        return Twist2D(0.0, 0.0) if lapsed else self.goal

    def scan(self) -> LaserScan | None:
        info = self.laser_info
        ranges = np.array([1.0, np.inf, -np.inf, 2.0], dtype=np.float32)
        return LaserScan(
            ranges,
            self.time,
            info.angle_min,
            info.angle_increment,
            info.range_min,
            info.range_max,
            info.frame,
        )

    def odometry(self) -> Odometry:
        return Odometry(self.pose, self.twist, self.time)

    def move_head(self, pan: float, tilt: float) -> None:
        self.gaze = (min(max(pan, -1.0), 1.0), min(max(tilt, -0.5), 0.5))

    def head(self) -> HeadPosition | None:
        return HeadPosition(*self.gaze, self.time)

    @property
    def camera_info(self) -> CameraInfo | None:
        return CameraInfo(3, 2, 2.0, 2.0, 1.0, 0.5, 0.1, 10.0, 10.0, "camera")

    def camera(self) -> CameraImage | None:
        depth = np.array([[1.0, 2.0, np.inf], [0.5, 9.0, np.inf]], dtype=np.float32)
        return CameraImage(np.zeros((2, 3, 3), dtype=np.uint8), self.time, "camera", depth)

    def frames(self) -> Sequence[TransformStamped]:
        level = (0.0, 0.0, 0.0, 1.0)
        return [
            TransformStamped("base_link", "base_footprint", (0.0, 0.0, 0.1), level, self.time),
            TransformStamped("laser", "base_link", (0.2, 0.0, 0.0), level, self.time),
            TransformStamped("sonar", "base_link", (-0.2, 0.0, 0.0), level, self.time),
            TransformStamped("camera", "laser", (0.0, 0.0, 0.3), (-0.5, 0.5, -0.5, 0.5), self.time),
        ]

    def sonars(self) -> Sequence[SonarReading]:
        return [SonarReading(math.inf, self.time, 0.5, 0.02, 1.0, "sonar")]

    def battery(self) -> BatteryState | None:
        return BatteryState(self.level, self.time)

    def recharge(self) -> None:
        self.level = 100.0

    @property
    def torso_info(self) -> TorsoInfo | None:
        return TorsoInfo(0.0, 0.3, 0.1)

    def lift(self, height: float) -> None:
        self.height = min(max(height, 0.0), 0.3)

    def torso_height(self) -> float | None:
        return self.height


class BareRobot(PlainRobot):
    """A robot without the methods for optional equipment."""

    torso_info, camera_info = Robot.torso_info, Robot.camera_info
    sonars, battery, recharge, lift, torso_height = (
        Robot.sonars,
        Robot.battery,
        Robot.recharge,
        Robot.lift,
        Robot.torso_height,
    )

    def camera(self) -> CameraImage | None:
        return None


@pytest.mark.parametrize("robot", [PlainRobot, BareRobot])
def test_a_plain_robot_passes(robot: type[PlainRobot]) -> None:
    check_robot(robot)


class SlowCamera(PlainRobot):
    @property
    def camera_info(self) -> CameraInfo | None:
        raise AssertionError("isinstance has read a property")


def test_isinstance_does_not_read_the_properties_of_a_robot() -> None:
    assert isinstance(SlowCamera(), Robot)


class EndlessCommands(PlainRobot):
    """A robot whose commands never expire."""

    def step(self, seconds: float) -> None:
        self.commanded_at = self.time
        super().step(seconds)


class InDegrees(PlainRobot):
    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        super().drive(v, math.radians(w), priority=priority)


class TurnsRight(PlainRobot):
    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        super().drive(v, -w, priority=priority)


class DrivesBackwards(PlainRobot):
    def step(self, seconds: float) -> None:
        x = self.pose.x
        super().step(seconds)
        self.pose = replace(self.pose, x=2 * x - self.pose.x)


class Unlimited(PlainRobot):
    def step(self, seconds: float) -> None:
        super().step(seconds)
        self.twist = replace(self.twist, w=3.0 * self.twist.w if abs(self.twist.w) > 0.9 else self.twist.w)


class RangesBeyondMaximum(PlainRobot):
    def scan(self) -> LaserScan | None:
        scan = super().scan()
        assert scan is not None
        return replace(scan, ranges=np.full(4, 99.0, dtype=np.float32))


class DoublePrecision(PlainRobot):
    def scan(self) -> LaserScan | None:
        scan = super().scan()
        assert scan is not None
        return replace(scan, ranges=scan.ranges.astype(np.float64))


class SameScan(PlainRobot):
    def scan(self) -> LaserScan | None:
        scan = super().scan()
        assert scan is not None
        return replace(scan, stamp=0)


class InMilliseconds(PlainRobot):
    def now(self) -> int:
        return self.time // 1_000_000

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        return super().wait_until(deadline * 100, wake)


class FixedHead(PlainRobot):
    def move_head(self, pan: float, tilt: float) -> None:
        pass


class UnlimitedHead(PlainRobot):
    def move_head(self, pan: float, tilt: float) -> None:
        self.gaze = (pan, tilt)


class Unstoppable(PlainRobot):
    def stop(self) -> None:
        pass

    @property
    def base_info(self) -> BaseInfo:
        return replace(super().base_info, command_timeout=1.0)

    def step(self, seconds: float) -> None:
        if self.rank == 100:
            self.commanded_at = self.time
        super().step(seconds)


class IgnoresPriority(PlainRobot):
    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        super().drive(v, w)


class LateSchedule(PlainRobot):
    @property
    def schedule(self) -> PlainSchedule:
        schedule = PlainSchedule()
        schedule.now = self.time
        return schedule


class EndlessSchedule(PlainSchedule):
    def add_task(self, *given: Any, **named: Any) -> Callable[[], None]:
        super().add_task(*given, **named)
        return lambda: None


class EndlessTasks(PlainRobot):
    def __init__(self) -> None:
        super().__init__()
        self.tasks = EndlessSchedule()


class NoLaserFrame(PlainRobot):
    def frames(self) -> Sequence[TransformStamped]:
        return [frame for frame in super().frames() if frame.child != "laser"]


class DisconnectedFrames(PlainRobot):
    def frames(self) -> Sequence[TransformStamped]:
        return [
            replace(frame, parent=frame.parent.replace("base_link", "torso")) for frame in super().frames()
        ]


class TwoParents(PlainRobot):
    def frames(self) -> Sequence[TransformStamped]:
        return [*super().frames(), replace(super().frames()[1], parent="base_footprint")]


class UnknownMovingFrame(PlainRobot):
    def moving_frames(self) -> Sequence[TransformStamped]:
        return [replace(super().frames()[1], child="arm")]


class LongQuaternion(PlainRobot):
    def frames(self) -> Sequence[TransformStamped]:
        return [replace(frame, quaternion=(1.0, 0.0, 0.0, 1.0)) for frame in super().frames()]


class TransposedCameraInfo(PlainRobot):
    @property
    def camera_info(self) -> CameraInfo | None:
        return CameraInfo(2, 3, 2.0, 2.0, 1.0, 0.5, 0.1, 10.0, 10.0, "camera")


class ZeroDepth(PlainRobot):
    def camera(self) -> CameraImage | None:
        picture = super().camera()
        assert picture is not None
        return replace(picture, depth=np.zeros((2, 3), dtype=np.float32))


class SonarBeyondMaximum(PlainRobot):
    def sonars(self) -> Sequence[SonarReading]:
        return [replace(sonar, range=1.0001) for sonar in super().sonars()]


class UnlimitedTorso(PlainRobot):
    def lift(self, height: float) -> None:
        self.height = height


class ForgetsCommands(PlainRobot):
    def commanded_velocity(self) -> Twist2D:
        return Twist2D(0.0, 0.0)

    def step(self, seconds: float) -> None:
        self.commanded_velocity = super().commanded_velocity  # type: ignore[method-assign]
        super().step(seconds)
        del self.commanded_velocity


class ConstantBattery(PlainRobot):
    def battery(self) -> BatteryState | None:
        return BatteryState(50.0, self.time)


class PartialRecharge(PlainRobot):
    def recharge(self) -> None:
        self.level = 80.0


class ReportsMotion(PlainRobot):
    def odometry(self) -> Odometry:
        return replace(super().odometry(), twist=Twist2D(0.1, 0.0))


@pytest.mark.parametrize(
    ("robot", "message"),
    [
        (EndlessCommands, "older than command_timeout"),
        (InDegrees, "rad/s were commanded"),
        (TurnsRight, "rad/s were commanded"),
        (DrivesBackwards, "moved the robot -0"),
        (Unlimited, "w_max is 1 rad/s"),
        (RangesBeyondMaximum, r"over range_max a range is \+inf"),
        (DoublePrecision, "ranges are float32"),
        (SameScan, "new scans come"),
        (InMilliseconds, "is it in ns"),
        (FixedHead, "the head was sent to pan"),
        (UnlimitedHead, "stays within pan_max"),
        (Unstoppable, r"stop\(\) was called"),
        (IgnoresPriority, "won over one of priority 90"),
        (ReportsMotion, "without a command a robot stands"),
        (LateSchedule, "a task at 20 Hz ran 0 times"),
        (EndlessTasks, "a task was ended, but it runs on"),
        (NoLaserFrame, "'laser' is not among the frames"),
        (DisconnectedFrames, "the chain of parents of frame 'laser' ends at 'torso'"),
        (TwoParents, "it has one parent"),
        (UnknownMovingFrame, "the moving frame 'arm' in 'base_link' is not among the frames"),
        (LongQuaternion, "has length 1.414"),
        (TransposedCameraInfo, "as high and wide as camera_info says"),
        (ZeroDepth, "depth is in metres"),
        (SonarBeyondMaximum, "over its range_max"),
        (UnlimitedTorso, "the torso was sent to 1.30 m"),
        (ForgetsCommands, r"w = 0.3 was commanded"),
        (ConstantBattery, "did not discharge the battery"),
        (PartialRecharge, "was recharged, and is at 80 %"),
    ],
)
def test_a_violation_of_the_contract_is_reported(robot: type[PlainRobot], message: str) -> None:
    with pytest.raises(AssertionError, match=message):
        check_robot(robot)
