"""Leaves that drive. They send a velocity command on every tick, because a base stops without new commands.

Speeds and times are those of the book's bump-and-go and patrol (*A Concise Introduction to Robot Programming
with ROS2*, chapters 6.2 and 6.3). Back commands 0.3 m/s backwards; a Tiago's base limits this to 0.2 m/s.
"""

from typing import ClassVar

from btcore import StatefulAction, Status
from btcore_robot.robot import Robot

FORWARD_SPEED = 0.3
"""The speed (m/s) of Forward."""
BACK_SPEED = -0.3
"""The speed (m/s) of Back."""
TURN_SPEED = 0.5
"""The angular speed (rad/s) of Turn, to the left."""
MANOEUVRE_TIME = 3_000_000_000
"""The duration (ns) of Back and Turn."""
PATROL_TIME = 15_000_000_000
"""The duration (ns) of Patrol: at 0.5 rad/s more than a full turn."""


class Forward(StatefulAction):
    """Drive forward at 0.3 m/s. Always RUNNING."""

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def on_start(self) -> Status:
        """Send the first command."""
        return self.on_running()

    def on_running(self) -> Status:
        """Send the next command."""
        self.robot.drive(FORWARD_SPEED, 0.0)
        return Status.RUNNING


class _Manoeuvre(StatefulAction):
    """Drive at *v* (m/s) and *w* (rad/s) for *duration* (ns) after the first tick, then SUCCESS."""

    v: ClassVar[float] = 0.0
    w: ClassVar[float] = 0.0
    duration: ClassVar[int] = MANOEUVRE_TIME

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.started = 0

    def on_start(self) -> Status:
        """Store the time and send the first command."""
        self.started = self.robot.clock.now()
        return self.on_running()

    def on_running(self) -> Status:
        """Send the next command and check the time."""
        self.robot.drive(self.v, self.w)
        elapsed = self.robot.clock.now() - self.started
        return Status.SUCCESS if elapsed >= self.duration else Status.RUNNING


class Back(_Manoeuvre):
    """Drive backwards at 0.3 m/s (or as fast as the base can) for 3 s, then SUCCESS."""

    v = BACK_SPEED


class Turn(_Manoeuvre):
    """Turn left at 0.5 rad/s for 3 s, then SUCCESS."""

    w = TURN_SPEED


class Patrol(_Manoeuvre):
    """Look around at a waypoint: turn left at 0.5 rad/s for 15 s, then SUCCESS."""

    w = TURN_SPEED
    duration = PATROL_TIME
