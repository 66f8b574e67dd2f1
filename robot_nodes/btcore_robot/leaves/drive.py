"""Leaves that drive. They send a velocity command on every tick, because a base stops without new commands.

Speeds and times are those of bump-and-go and the patrol in chapters 6.2 and 6.3 of the book *A Concise
Introduction to Robot Programming with ROS2*. Back commands 0.3 m/s backwards; a Tiago's base limits this to
0.2 m/s. TurnToFree is the closed control loop of the book's chapter 3.
"""

import math
from typing import Annotated, ClassVar

from btcore import FAILURE, RUNNING, SUCCESS, In, NodeSpec, StatefulAction, Status
from btcore.clock import NS_PER_S
from btcore_robot.control.bumpgo_fsm import freest_direction, is_free_ahead
from btcore_robot.robot import Robot

FORWARD_SPEED = 0.3
"""The speed (m/s) of Forward."""
BACK_SPEED = -0.3
"""The speed (m/s) of Back."""
TURN_SPEED = 0.5
"""The angular speed (rad/s) of Turn, to the left."""
MANOEUVRE_TIME = 3 * NS_PER_S
"""The duration (ns) of Back and Turn."""
PATROL_TIME = 15 * NS_PER_S
"""The duration (ns) of Patrol: at 0.5 rad/s more than a full turn."""

FULL_TURN_TIME = round(2 * math.pi / TURN_SPEED * NS_PER_S)
"""The time (ns) of a full turn."""


class _DrivingAction(StatefulAction):
    """An action that sends a command in each tick, which replaces the last command."""

    spec = NodeSpec(hands_over=True)


class Forward(_DrivingAction):
    """Drives forward at 0.3 m/s. Always RUNNING."""

    spec = NodeSpec(results=frozenset(), state_fields=())

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def on_start(self) -> Status:
        """Send the first command."""
        return self.on_running()

    def on_running(self) -> Status:
        """Send the next command."""
        self.robot.drive(FORWARD_SPEED, 0.0)
        return RUNNING


class _Manoeuvre(_DrivingAction):
    """Drives at *v* (m/s) and *w* (rad/s) for *duration* (ns) after the first tick, then SUCCESS."""

    v: ClassVar[float] = 0.0
    w: ClassVar[float] = 0.0
    duration: ClassVar[int] = MANOEUVRE_TIME

    spec = NodeSpec(results=frozenset({SUCCESS}), state_fields=("started",), may_complete_on_start=False)

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
        return SUCCESS if elapsed >= self.duration else RUNNING


class Back(_Manoeuvre):
    """Drives backwards at 0.3 m/s (or as fast as the base can) for 3 s, then SUCCESS."""

    v = BACK_SPEED


class Turn(_Manoeuvre):
    """Turns left at 0.5 rad/s for 3 s, then SUCCESS."""

    w = TURN_SPEED


class Patrol(_Manoeuvre):
    """Looks around at a waypoint: turns left at 0.5 rad/s for 15 s, then SUCCESS."""

    w = TURN_SPEED
    duration = PATROL_TIME


class TurnToFree(_DrivingAction):
    """Turns at 0.5 rad/s towards the freest direction until *clear* metres are free ahead, then SUCCESS.

    FAILURE when a full turn finds no free direction. The free distance in a direction is the smallest range
    of the laser rays within 30° to either side. The lane of the robot, 0.8 m wide, must be free as well, up
    to 1 m ahead: near the robot it is wider than 30° to either side. Without a scan the robot stands and the
    node is RUNNING.
    """

    clear: Annotated[In[float], "The distance (m) that has to be free ahead."] = 2.0

    spec = NodeSpec(state_fields=("side", "started"))

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.side = 0.0
        self.started = 0

    def on_start(self) -> Status:
        """Forget the side of the last turn, and check the scan."""
        self.side = 0.0
        return self.on_running()

    def on_running(self) -> Status:
        """Check the scan; turn or end."""
        scan = self.robot.scan()
        if scan is None or not len(scan.ranges):
            self.robot.drive(0.0, 0.0)
            return RUNNING
        now = self.robot.clock.now()
        if not self.side:
            self.side = math.copysign(1.0, freest_direction(scan))
            self.started = now
        if is_free_ahead(scan, self.clear):
            return SUCCESS
        if now - self.started > FULL_TURN_TIME:
            return FAILURE
        self.robot.drive(0.0, self.side * TURN_SPEED)
        return RUNNING
