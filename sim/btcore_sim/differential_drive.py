"""A differential drive: speed limits, and odometry from the wheels."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from btcore.clock import NS_PER_S
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import BaseInfo, Odometry, Pose2D, Twist2D
from btcore_sim.robot_description import OdometryInfo

STANDING = Twist2D(0.0, 0.0)


class DifferentialDrive:
    """The conversion of velocity commands to wheel speeds within the base's limits.

    For a command above a limit, v and w are multiplied by the same factor, which keeps the turning radius.
    After a new command, v and w change in proportion, so that both reach the new values at the same time.
    Tiago's controller does the same.
    """

    def __init__(self, info: BaseInfo, wheel_radius: float, separation: float) -> None:
        self.info = info
        self._wheel_radius = wheel_radius
        self._separation = separation
        self._timeout = round(info.command_timeout * NS_PER_S)
        self._command = STANDING
        self._goal = STANDING
        self._stamp = 0
        self.twist = STANDING
        """The velocity that is commanded to the wheels now, after limits and ramps."""

    def command(self, v: float, w: float, now: int) -> None:
        """Accept a velocity command.

        Args:
            v: Linear velocity (m/s).
            w: Angular velocity (rad/s).
            now: The simulated time (ns).
        """
        self._command = Twist2D(v, w)
        self._goal = self.limited(v, w)
        self._stamp = now

    def commanded_twist(self, now: int) -> Twist2D:
        """Return the last command without limits, or zero if it has timed out at *now* (ns)."""
        return self._command if now - self._stamp <= self._timeout else STANDING

    def limited(self, v: float, w: float) -> Twist2D:
        """Return a command, scaled down to the base's speed limits.

        Args:
            v: Linear velocity (m/s).
            w: Angular velocity (rad/s).
        """
        info = self.info
        scale = 1.0
        if v > info.v_max:
            scale = info.v_max / v
        elif v < info.v_min:
            scale = info.v_min / v
        if abs(w) * scale > info.w_max:
            scale = info.w_max / abs(w)
        return Twist2D(v * scale, w * scale)

    def step(self, now: int, seconds: float, *, accepts_commands: bool = True) -> Twist2D:
        """Ramp the velocity towards the last command, or towards standing if the command has timed out.

        Args:
            now: The simulated time (ns).
            seconds: The duration of the step (s).
            accepts_commands: False to stop the base whatever the command is, as with an empty battery.

        Returns:
            The new velocity (m/s, rad/s).
        """
        twist = self.twist
        goal = self._goal if accepts_commands and now - self._stamp <= self._timeout else STANDING
        if goal == twist:
            return twist
        dv, dw = goal.v - twist.v, goal.w - twist.w
        # The number of steps of this duration that the change takes with the slower of the two accelerations.
        needed = max(abs(dv) / (self.info.v_rate * seconds), abs(dw) / (self.info.w_rate * seconds))
        self.twist = goal if needed <= 1.0 else Twist2D(twist.v + dv / needed, twist.w + dw / needed)
        return self.twist

    def wheel_rates(self) -> tuple[float, float]:
        """Return the speeds (rad/s) of the left and the right wheel for the present velocity."""
        half = self.twist.w * self._separation / 2
        return (self.twist.v - half) / self._wheel_radius, (self.twist.v + half) / self._wheel_radius


class WheelErrorModel:
    """The odometry errors of one run: the scale of each wheel, and the slip when the base turns.

    *left* and *right* are the distances (m) that the wheels measure for one metre. They are drawn once from a
    normal distribution, because a wrong wheel radius is a systematic error.
    """

    def __init__(self, info: OdometryInfo, random: np.random.Generator) -> None:
        self._random = random
        self._info = info
        self.left, self.right = (float(scale) for scale in random.normal(1.0, info.scale_sigma, 2))

    def turn_factor(self) -> float:
        """Return the angle (rad) that the wheels measure for a turn of 1 rad, drawn anew on every call."""
        return 1.0 + self._info.slip + self._info.slip_sigma * float(self._random.standard_normal())


@dataclass(slots=True)
class WheelOdometry:
    """Dead reckoning: the pose since the start, from the angles of the wheels.

    Between two readings the base is assumed to drive along the chord of the arc, whose direction is the
    heading half-way (second-order Runge-Kutta). *wheel_radius* and *separation* are in m. *angles* (rad) are
    the angles of the left and the right wheel at the last reading. *errors* adds the errors of real wheels.
    """

    wheel_radius: float
    separation: float
    angles: Sequence[float]
    errors: WheelErrorModel | None = None
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    stamp: int = 0

    def update(self, angles: Sequence[float], stamp: int) -> Odometry:
        """Integrate one reading of the wheels.

        Args:
            angles: The angles of the left and the right wheel (rad).
            stamp: The time of the reading (ns).

        Returns:
            The new odometry.
        """
        moved_left = (angles[0] - self.angles[0]) * self.wheel_radius
        moved_right = (angles[1] - self.angles[1]) * self.wheel_radius
        if self.errors is not None:
            moved_left *= self.errors.left
            moved_right *= self.errors.right
        moved, turned = (moved_left + moved_right) / 2, (moved_right - moved_left) / self.separation
        if self.errors is not None:
            turned *= self.errors.turn_factor()
        self.x += moved * math.cos(self.yaw + turned / 2)
        self.y += moved * math.sin(self.yaw + turned / 2)
        self.yaw = wrap_angle(self.yaw + turned)
        seconds = (stamp - self.stamp) / NS_PER_S
        twist = Twist2D(moved / seconds, turned / seconds) if seconds > 0 else STANDING
        self.angles, self.stamp = angles, stamp
        return Odometry(Pose2D(self.x, self.y, self.yaw), twist, stamp)
