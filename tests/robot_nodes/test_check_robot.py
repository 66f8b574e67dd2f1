"""The contract that every Robot passes: a plain robot without physics passes it, and each breach is found."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from robot_nodes.robot import (
    CMD_VEL,
    BaseFacts,
    HeadFacts,
    HeadPosition,
    LaserFacts,
    LaserScan,
    Odometry,
    Picture,
    Pose2D,
    Robot,
    Twist2D,
)
from robot_nodes.testing import check_robot

SECOND = 1_000_000_000
STEP = SECOND // 100


class PlainRobot(Robot):
    """A point that drives as asked, with a laser in an empty room, on a clock that it steps itself."""

    def __init__(self) -> None:
        self.time = 0
        self.asked = Twist2D(0.0, 0.0)
        self.heard = -SECOND
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
        return wake.is_set()

    def step(self, seconds: float) -> None:
        lapsed = self.time - self.heard > self.base.command_timeout * SECOND
        goal = Twist2D(0.0, 0.0) if lapsed else self.asked
        v_step, w_step = self.base.v_rate * seconds, self.base.w_rate * seconds
        v = self.twist.v + min(max(goal.v - self.twist.v, -v_step), v_step)
        w = self.twist.w + min(max(goal.w - self.twist.w, -w_step), w_step)
        self.twist = Twist2D(v, w)
        x, y, yaw = self.pose.x, self.pose.y, self.pose.yaw
        self.pose = Pose2D(
            x + v * seconds * math.cos(yaw), y + v * seconds * math.sin(yaw), yaw + w * seconds
        )

    @property
    def base(self) -> BaseFacts:
        return BaseFacts(-0.5, 0.5, 1.0, 1.0, 2.0, 0.5, 0.2)

    @property
    def laser(self) -> LaserFacts:
        return LaserFacts(4, -1.5, 1.0, 0.1, 10.0, 10.0, 0.0, "laser")

    @property
    def neck(self) -> HeadFacts | None:
        return HeadFacts(-1.0, 1.0, -0.5, 0.5, 1.0)

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        if priority < self.rank and self.time - self.heard <= SECOND // 2:
            return
        self.rank, self.heard = priority, self.time
        self.asked = Twist2D(
            min(max(v, self.base.v_min), self.base.v_max), min(max(w, -self.base.w_max), self.base.w_max)
        )

    def stop(self) -> None:
        self.rank = CMD_VEL
        self.asked, self.heard = Twist2D(0.0, 0.0), self.time

    def scan(self) -> LaserScan | None:
        facts = self.laser
        ranges = np.array([1.0, np.inf, -np.inf, 2.0], dtype=np.float32)
        return LaserScan(
            ranges,
            self.time,
            facts.angle_min,
            facts.angle_increment,
            facts.range_min,
            facts.range_max,
            facts.frame,
        )

    def odometry(self) -> Odometry:
        return Odometry(self.pose, self.twist, self.time)

    def look(self, pan: float, tilt: float) -> None:
        self.gaze = (min(max(pan, -1.0), 1.0), min(max(tilt, -0.5), 0.5))

    def head(self) -> HeadPosition | None:
        return HeadPosition(*self.gaze, self.time)

    def camera(self) -> Picture | None:
        return Picture(np.zeros((2, 3, 3), dtype=np.uint8), self.time, "camera")


def test_a_plain_robot_passes():
    check_robot(PlainRobot)


class Deaf(PlainRobot):
    """Its commands never lapse."""

    def step(self, seconds: float) -> None:
        self.heard = self.time
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


class FarSighted(PlainRobot):
    def scan(self) -> LaserScan | None:
        scan = super().scan()
        assert scan is not None
        return replace(scan, ranges=np.full(4, 99.0, dtype=np.float32))


class DoublePrecision(PlainRobot):
    def scan(self) -> LaserScan | None:
        scan = super().scan()
        assert scan is not None
        return replace(scan, ranges=scan.ranges.astype(np.float64))


class OneScan(PlainRobot):
    def scan(self) -> LaserScan | None:
        scan = super().scan()
        assert scan is not None
        return replace(scan, stamp=0)


class InMilliseconds(PlainRobot):
    def now(self) -> int:
        return self.time // 1_000_000

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        return super().wait_until(deadline * 100, wake)


class StiffNeck(PlainRobot):
    def look(self, pan: float, tilt: float) -> None:
        pass


class Owl(PlainRobot):
    def look(self, pan: float, tilt: float) -> None:
        self.gaze = (pan, tilt)


class Unstoppable(PlainRobot):
    def stop(self) -> None:
        pass

    @property
    def base(self) -> BaseFacts:
        return replace(super().base, command_timeout=1.0)

    def step(self, seconds: float) -> None:
        if self.rank == 100:
            self.heard = self.time
        super().step(seconds)


class LastWordWins(PlainRobot):
    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        super().drive(v, w)


class Restless(PlainRobot):
    def odometry(self) -> Odometry:
        return replace(super().odometry(), twist=Twist2D(0.1, 0.0))


@pytest.mark.parametrize(
    ("robot", "said"),
    [
        (Deaf, "older than the time-out"),
        (InDegrees, "rad/s were asked for"),
        (TurnsRight, "rad/s were asked for"),
        (DrivesBackwards, "moved the robot -0"),
        (Unlimited, "w_max is 1"),
        (FarSighted, r"over range_max a range is \+inf"),
        (DoublePrecision, "ranges are float32"),
        (OneScan, "new scans come"),
        (InMilliseconds, "is it in ns"),
        (StiffNeck, "the head was sent to pan"),
        (Owl, "stays within pan_max"),
        (Unstoppable, "was told to stop"),
        (LastWordWins, "won over one of priority 90"),
        (Restless, "without a command a robot stands"),
    ],
)
def test_a_breach_is_found_and_said(robot: type[PlainRobot], said: str):
    with pytest.raises(AssertionError, match=said):
        check_robot(robot)
