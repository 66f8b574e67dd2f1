"""Leaves that drive: one velocity command on every tick, since a base forgets a command soon.

Speeds and times are those of the book's bump-and-go and patrol (*A Concise Introduction to Robot Programming
with ROS2*, chapters 6.2 and 6.3). Back asks for more than a Tiago's base gives backwards, which is 0.2 m/s.
"""

from typing import ClassVar

from btcore import StatefulAction, Status
from btcore_robot.robot import Robot

FORWARD_SPEED = 0.3
"""How fast (m/s) Forward drives."""
BACK_SPEED = -0.3
"""How fast (m/s) Back drives."""
TURN_SPEED = 0.5
"""How fast (rad/s) Turn turns, to the left."""
MANOEUVRE = 3_000_000_000
"""How long (ns) Back and Turn take."""
PATROL = 15_000_000_000
"""How long (ns) Patrol takes: at 0.5 rad/s a good turn and a quarter."""


class Forward(StatefulAction):
    """Drive forward at 0.3 m/s. Always RUNNING."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def on_start(self) -> Status:
        """Drive."""
        return self.on_running()

    def on_running(self) -> Status:
        """Drive on."""
        self.robot.drive(FORWARD_SPEED, 0.0)
        return Status.RUNNING


class _Manoeuvre(StatefulAction):
    """Drive at (*v*, *w*) until *lasts* after the tick that began it; then SUCCESS."""

    v: ClassVar[float] = 0.0
    w: ClassVar[float] = 0.0
    lasts: ClassVar[int] = MANOEUVRE

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.began = 0

    def on_start(self) -> Status:
        """Note the time, and drive."""
        self.began = self.robot.clock.now()
        return self.on_running()

    def on_running(self) -> Status:
        """Drive, and see whether it is time to end."""
        self.robot.drive(self.v, self.w)
        elapsed = self.robot.clock.now() - self.began
        return Status.SUCCESS if elapsed >= self.lasts else Status.RUNNING


class Back(_Manoeuvre):
    """Drive backwards at 0.3 m/s (or as fast as the base can) for 3 s, then SUCCESS."""

    v = BACK_SPEED


class Turn(_Manoeuvre):
    """Turn left at 0.5 rad/s for 3 s, then SUCCESS."""

    w = TURN_SPEED


class Patrol(_Manoeuvre):
    """Look around at a waypoint: turn left at 0.5 rad/s for 15 s, then SUCCESS."""

    w = TURN_SPEED
    lasts = PATROL
