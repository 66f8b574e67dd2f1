"""Leaves for the battery: check its level and charge it.

Their numbers are from the patrol in the book *A Concise Introduction to Robot Programming with ROS2*
(chapter 6.3).
"""

import math
from typing import Annotated

from btcore import FAILURE, RUNNING, SUCCESS, Blackboard, Condition, In, NodeSpec, StatefulAction, Status
from btcore.clock import NS_PER_S
from btcore_robot.robot import Robot

LEVEL_KEY = "battery_level"
"""The blackboard entry of the estimated level (0–100)."""
FULL = 100.0
DRAIN = 0.5
"""The level (0–100) that one second uses per m/s or rad/s of commanded velocity."""
DRAIN_AT_REST = 0.01
"""The level (0–100) that one second uses in addition, also at rest."""
CHARGING_TICKS = 50
"""The number of ticks for which Recharge is RUNNING."""


class BatteryChecker(Condition):
    """SUCCESS while the battery's estimated level is *low* or more.

    The estimate (0–100) is the blackboard entry `battery_level`. A missing entry starts with the level that
    the robot reports, or with 100 if the robot does not report a level. Each tick lowers the estimate by the
    charge that the time since the last tick uses at the currently commanded velocity. After a period without
    ticks, the whole period counts with this velocity, as in the book *A Concise Introduction to Robot
    Programming with ROS2*.
    """

    low: Annotated[In[float], "The level (0–100) below which the check fails."] = 10.0

    spec = NodeSpec(state_fields=("last_check",), writes=("battery_level",))

    def __init__(self, robot: Robot, blackboard: Blackboard) -> None:
        self.robot = robot
        self.board = blackboard
        self.last_check = robot.clock.now()

    def tick(self) -> Status:
        """Update the estimate and compare it with *low*."""
        now = self.robot.clock.now()
        seconds = (now - self.last_check) / NS_PER_S
        self.last_check = now
        command = self.robot.commanded_velocity()
        # The book's formula adds m/s and rad/s.
        drained = (DRAIN * math.hypot(command.v, command.w) + DRAIN_AT_REST) * seconds
        level = max(0.0, estimated_level(self.board, self.robot) - drained)
        self.board[LEVEL_KEY] = level
        return FAILURE if level < self.low else SUCCESS


class Recharge(StatefulAction):
    """Charges the battery: RUNNING for 50 ticks (5 s at 10 Hz), then battery and estimate are full.

    A halt interrupts charging; the next start continues it.
    """

    spec = NodeSpec(
        results=frozenset({SUCCESS}),
        state_fields=("ticks",),
        writes=("battery_level",),
        may_complete_on_start=False,
    )

    def __init__(self, robot: Robot, blackboard: Blackboard) -> None:
        self.robot = robot
        self.board = blackboard
        self.ticks = 0

    def on_start(self) -> Status:
        """Charge for one tick, and for one more if the charging was interrupted right before its end."""
        self.ticks += 1
        return RUNNING

    def on_running(self) -> Status:
        """Charge for one more tick."""
        self.ticks += 1
        if self.ticks <= CHARGING_TICKS:
            return RUNNING
        self.ticks = 0
        self.robot.recharge()
        self.board[LEVEL_KEY] = FULL
        return SUCCESS


def estimated_level(board: Blackboard, robot: Robot) -> float:
    """Return the level (0–100) on the blackboard or, if there is none, the level that the robot reports."""
    entry = board.find(LEVEL_KEY)
    if entry is not None and isinstance(entry.value, int | float):
        return float(entry.value)
    battery = robot.battery()
    return FULL if battery is None else battery.level
