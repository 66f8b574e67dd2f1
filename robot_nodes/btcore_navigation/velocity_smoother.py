"""Velocity and acceleration limits, and a sender of velocity commands within these limits."""

from dataclasses import dataclass

from btcore.clock import NS_PER_S
from btcore_robot.robot import BaseInfo, Robot, Twist2D
from btcore_robot.time_limits import MAX_ODOMETRY_AGE_S, is_stale

_COMMAND_LIFETIME_S = 0.3  # s; after this time the last command is no longer a basis for the next


@dataclass(frozen=True, slots=True)
class VelocityLimits:
    """Limits of the speed *v* (m/s) and the turning rate *w* (rad/s).

    `…_up` is the greatest acceleration and `…_down` the greatest deceleration (m/s², rad/s²).
    """

    v: float
    w: float
    v_up: float
    v_down: float
    w_up: float
    w_down: float

    def within(self, base: BaseInfo) -> "VelocityLimits":
        """Return new limits: for each value the lower of this limit and the limit of *base*."""
        return VelocityLimits(
            min(self.v, base.v_max),
            min(self.w, base.w_max),
            min(self.v_up, base.v_rate),
            min(self.v_down, base.v_rate),
            min(self.w_up, base.w_rate),
            min(self.w_down, base.w_rate),
        )


class VelocitySmoother:
    """A sender of velocity commands whose changes stay within the limits.

    Args:
        robot: The robot.
        limits: The limits.
        period: The time (s) between two commands. If more time has passed, the command changes only as much
            as it may change in this time.
    """

    def __init__(self, robot: Robot, limits: VelocityLimits, period: float) -> None:
        self._robot = robot
        self._period = period
        self.limits = limits
        self.v = 0.0
        """The last commanded speed (m/s)."""
        self.w = 0.0
        """The last commanded turning rate (rad/s)."""
        self._stamp: int | None = None

    def resume(self, now: int) -> None:
        """Start at *now* (ns) from the robot's present velocity, unless the last command is recent.

        Without recent odometry the robot counts as standing.
        """
        if self._stamp is None or now - self._stamp > _COMMAND_LIFETIME_S * NS_PER_S:
            odometry = self._robot.odometry()
            twist = Twist2D(0.0, 0.0) if is_stale(odometry, now, MAX_ODOMETRY_AGE_S) else odometry.twist
            self.v = _clamp(twist.v, -self.limits.v, self.limits.v)
            self.w = _clamp(twist.w, -self.limits.w, self.limits.w)
            self._stamp = None

    def reachable_speed(self, v: float) -> float:
        """Return the speed (m/s) nearest to the target *v* (m/s) that can be reached within a period."""
        return self._speed_after(v, self._period)

    def _speed_after(self, v: float, seconds: float) -> float:
        limits = self.limits
        return _next(self.v, _clamp(v, -limits.v, limits.v), limits.v_up * seconds, limits.v_down * seconds)

    def send_command(self, v: float, w: float, now: int) -> None:
        """Command the velocity nearest to the target that is reachable since the last command.

        Args:
            v: The target speed (m/s).
            w: The target turning rate (rad/s).
            now: The time (ns).
        """
        seconds = self._period
        if self._stamp is not None:
            seconds = min(max((now - self._stamp) / NS_PER_S, 0.0), seconds)
        limits = self.limits
        self.v = self._speed_after(v, seconds)
        self.w = _next(self.w, _clamp(w, -limits.w, limits.w), limits.w_up * seconds, limits.w_down * seconds)
        self._stamp = now
        self._robot.drive(self.v, self.w)

    def slow_to_stop(self, now: int) -> None:
        """Brake step by step at *now* (ns), unless another source commands the robot. Call it repeatedly."""
        if (self.v, self.w) != (0.0, 0.0):
            if self._robot.commanded_velocity() == Twist2D(self.v, self.w):
                self.send_command(0.0, 0.0, now)
            else:
                self.v = self.w = 0.0

    def halt(self, now: int) -> None:
        """Command a velocity of zero at once; the base brakes as hard as it can."""
        self.v = self.w = 0.0
        self._stamp = now
        self._robot.drive(0.0, 0.0)


def _next(last: float, target: float, up: float, down: float) -> float:
    """Return the value nearest to *target* if *last* may grow by *up* or shrink by *down* in magnitude."""
    # Driving backwards is the mirror image of driving forward.
    if last < 0.0 or (last == 0.0 and target < 0.0):
        return -_next(-last, -target, up, down)
    if target >= last:
        return min(target, last + up)
    if target >= 0.0 or last > down:
        return max(target, last - down)
    return 0.0  # a change of direction passes through standing


def _clamp(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
