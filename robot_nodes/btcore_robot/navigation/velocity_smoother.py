"""How fast a server may drive, and velocity commands that keep to it."""

from dataclasses import dataclass

from btcore_robot.robot import NS_PER_S, BaseInfo, Robot, Twist2D

_FORGET = 0.3  # s after which what was asked for last is nothing to go on from


@dataclass(frozen=True, slots=True)
class Limits:
    """The fastest *v* (m/s) and *w* (rad/s), and how fast each may grow and shrink (m/s², rad/s²)."""

    v: float
    w: float
    v_up: float
    v_down: float
    w_up: float
    w_down: float

    def within(self, base: BaseInfo) -> "Limits":
        """The same, but no more than *base* can do: it would not follow."""
        return Limits(
            min(self.v, base.v_max),
            min(self.w, base.w_max),
            min(self.v_up, base.v_rate),
            min(self.v_down, base.v_rate),
            min(self.w_up, base.w_rate),
            min(self.w_down, base.w_rate),
        )


class VelocitySmoother:
    """Asks a robot for velocities, each no further from the one before than the limits allow."""

    def __init__(self, robot: Robot, limits: Limits) -> None:
        self._robot = robot
        self.limits = limits
        self.v = 0.0
        """The speed (m/s) asked for last."""
        self.w = 0.0
        """The turning rate (rad/s) asked for last."""
        self._stamp: int | None = None

    def wake(self, now: int) -> None:
        """Begin anew at *now* (ns) from what the robot does, unless the last command is fresh."""
        if self._stamp is None or now - self._stamp > _FORGET * NS_PER_S:
            twist = self._robot.odometry().twist
            self.v = _held(twist.v, -self.limits.v, self.limits.v)
            self.w = _held(twist.w, -self.limits.w, self.limits.w)
            self._stamp = None

    def speed(self, v: float, seconds: float) -> float:
        """The speed next to *v* (m/s) that may be asked for *seconds* after the last one."""
        limits = self.limits
        return _next(self.v, _held(v, -limits.v, limits.v), limits.v_up * seconds, limits.v_down * seconds)

    def ask(self, v: float, w: float, now: int, period: float) -> None:
        """Ask for the velocity next to *v*, *w* that may follow the last one, *period* (s) later at most."""
        seconds = period if self._stamp is None else min(max((now - self._stamp) / NS_PER_S, 0.0), period)
        limits = self.limits
        self.v = self.speed(v, seconds)
        self.w = _next(self.w, _held(w, -limits.w, limits.w), limits.w_up * seconds, limits.w_down * seconds)
        self._stamp = now
        self._robot.drive(self.v, self.w)

    def ease(self, now: int, period: float) -> None:
        """Come to rest, step by step, as long as nobody else drives."""
        if (self.v, self.w) != (0.0, 0.0):
            if self._robot.commanded_velocity() == Twist2D(self.v, self.w):
                self.ask(0.0, 0.0, now, period)
            else:
                self.v = self.w = 0.0

    def halt(self, now: int) -> None:
        """Ask for standing, at once: the base brakes as hard as it can."""
        self.v = self.w = 0.0
        self._stamp = now
        self._robot.drive(0.0, 0.0)


def _next(last: float, wanted: float, up: float, down: float) -> float:
    """*wanted*, or what comes nearest to it from *last* if size may grow by *up* and shrink by *down*."""
    if last < 0.0 or (last == 0.0 and wanted < 0.0):
        return -_next(-last, -wanted, up, down)
    if wanted >= last:
        return min(wanted, last + up)
    if wanted >= 0.0 or last > down:
        return max(wanted, last - down)
    return 0.0


def _held(value: float, low: float, high: float) -> float:
    return min(max(value, low), high)
