"""The differential base: who may command it, how fast it may go, and what the wheels say it did."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import NS_PER_S, BaseInfo, Odometry, Pose2D, Twist2D
from btcore_sim.robot_description import OdometryFacts

SOURCE_TIMEOUT = NS_PER_S // 2
"""How long (ns) a source's last word keeps lower priorities out (twist_mux's time-out in Tiago's files)."""

STANDING = Twist2D(0.0, 0.0)


class CommandMultiplexer:
    """Several sources of velocity, one base: the highest priority wins, for 0.5 s after its last word."""

    def __init__(self) -> None:
        self._heard: dict[int, int] = {}

    def admits(self, priority: int, now: int) -> bool:
        """Whether a command of *priority*, given at *now* (ns), gets through."""
        self._heard[priority] = now
        return not any(p > priority and now - stamp <= SOURCE_TIMEOUT for p, stamp in self._heard.items())

    def clear(self) -> None:
        """Forget who spoke."""
        self._heard.clear()


class DifferentialDrive:
    """Turns velocity commands into wheel speeds within the base's limits.

    A command over a limit is scaled down as a whole, and speed changes along the straight line between two
    commands in (v, w): both keep the turning radius, as Tiago's controller does.
    """

    def __init__(self, facts: BaseInfo, wheel_radius: float, separation: float) -> None:
        self.facts = facts
        self._wheel_radius = wheel_radius
        self._separation = separation
        self._timeout = round(facts.command_timeout * NS_PER_S)
        self._asked = STANDING
        self._goal = STANDING
        self._stamp = 0
        self.twist = STANDING
        """The velocity that the wheels are asked for now."""

    def command(self, v: float, w: float, now: int) -> None:
        """Take a command (m/s, rad/s) given at *now* (ns)."""
        self._asked = Twist2D(v, w)
        self._goal = self.limited(v, w)
        self._stamp = now

    def commanded_twist(self, now: int) -> Twist2D:
        """The last command as it was given, while it holds at *now* (ns); standing once it has lapsed."""
        return self._asked if now - self._stamp <= self._timeout else STANDING

    def limited(self, v: float, w: float) -> Twist2D:
        """The command scaled to the base's speed limits."""
        facts = self.facts
        scale = 1.0
        if v > facts.v_max:
            scale = facts.v_max / v
        elif v < facts.v_min:
            scale = facts.v_min / v
        if abs(w) * scale > facts.w_max:
            scale = facts.w_max / abs(w)
        return Twist2D(v * scale, w * scale)

    def step(self, now: int, seconds: float, *, obeys: bool = True) -> Twist2D:
        """Ramp for *seconds* (s) towards what is asked for, or towards standing.

        The latter when that is too old, or when the base no longer *obeys*.
        """
        twist = self.twist
        goal = self._goal if obeys and now - self._stamp <= self._timeout else STANDING
        if goal == twist:
            return twist
        dv, dw = goal.v - twist.v, goal.w - twist.w
        needed = max(abs(dv) / (self.facts.v_rate * seconds), abs(dw) / (self.facts.w_rate * seconds))
        self.twist = goal if needed <= 1.0 else Twist2D(twist.v + dv / needed, twist.w + dw / needed)
        return self.twist

    def wheel_rates(self) -> tuple[float, float]:
        """How fast (rad/s) the left and the right wheel turn for the present twist."""
        half = self.twist.w * self._separation / 2
        return (self.twist.v - half) / self._wheel_radius, (self.twist.v + half) / self._wheel_radius


class WheelErrorModel:
    """How wrong one run's wheels are: what *left* and *right* tell of a metre, and the slip in turns."""

    def __init__(self, facts: OdometryFacts, random: np.random.Generator) -> None:
        self._random = random
        self._facts = facts
        self.left, self.right = (float(scale) for scale in random.normal(1.0, facts.scale_sigma, 2))

    def turning(self) -> float:
        """What the wheels tell of a radian that the base turns, drawn anew for every reading."""
        return 1.0 + self._facts.slip + self._facts.slip_sigma * float(self._random.standard_normal())


@dataclass(slots=True)
class WheelOdometry:
    """Dead reckoning: the pose since the start, from how far each wheel has turned.

    Between two readings the base is taken to have driven along the arc's chord, whose direction is the
    heading half-way. With *errors* it is as wrong as real wheels are.
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
        """The odometry after the left and the right wheel have reached *angles* (rad) at *stamp* (ns)."""
        moved_left = (angles[0] - self.angles[0]) * self.wheel_radius
        moved_right = (angles[1] - self.angles[1]) * self.wheel_radius
        if self.errors is not None:
            moved_left *= self.errors.left
            moved_right *= self.errors.right
        moved, turned = (moved_left + moved_right) / 2, (moved_right - moved_left) / self.separation
        if self.errors is not None:
            turned *= self.errors.turning()
        self.x += moved * math.cos(self.yaw + turned / 2)
        self.y += moved * math.sin(self.yaw + turned / 2)
        self.yaw = wrap_angle(self.yaw + turned)
        seconds = (stamp - self.stamp) / NS_PER_S
        twist = Twist2D(moved / seconds, turned / seconds) if seconds > 0 else STANDING
        self.angles, self.stamp = angles, stamp
        return Odometry(Pose2D(self.x, self.y, self.yaw), twist, stamp)
