"""Leaves that mind the battery, with the figures of the book's patrol (chapter 6.3)."""

import math
from typing import Annotated

from btcore import Blackboard, Condition, In, StatefulAction, Status
from btcore_robot.robot import NS_PER_S, Robot

LEVEL = "battery_level"
"""The entry of the blackboard that holds the estimate (0–100)."""
FULL = 100.0
DRAIN = 0.5
"""How much a metre, or a radian, a second takes from the level each second."""
DRAIN_AT_REST = 0.01
"""How much is lost each second in any case."""
CHARGING_TICKS = 50
"""How many ticks Recharge is RUNNING."""


class BatteryChecker(Condition):
    """SUCCESS while the battery's level, as estimated from the velocities asked for, is *low* or more.

    The estimate is the entry ``battery_level`` of the blackboard. Where there is none it begins with what
    the robot tells of its battery, and with 100 where that tells nothing. Every tick takes off what the time
    since the last one costs at the velocity that holds now; so while it isn't ticked, the whole gap is
    reckoned at the velocity found afterwards, as in the book.
    """

    low: Annotated[In[float], "Under this level (0–100) it fails."] = 10.0

    def __init__(self, robot: Robot, blackboard: Blackboard) -> None:
        self.robot = robot
        self.board = blackboard
        self.looked = robot.clock.now()

    def tick(self) -> Status:
        """Bring the estimate up to now, and compare it."""
        now = self.robot.clock.now()
        seconds = (now - self.looked) / NS_PER_S
        self.looked = now
        asked = self.robot.commanded_velocity()
        drained = (DRAIN * math.hypot(asked.v, asked.w) + DRAIN_AT_REST) * seconds
        level = max(0.0, estimate(self.board, self.robot) - drained)
        self.board[LEVEL] = level
        return Status.FAILURE if level < self.low else Status.SUCCESS


class Recharge(StatefulAction):
    """Charge: RUNNING for 50 ticks (5 s at 10 Hz), then the battery and its estimate are full.

    A halt interrupts it, and the next start goes on where it was.
    """

    def __init__(self, robot: Robot, blackboard: Blackboard) -> None:
        self.robot = robot
        self.board = blackboard
        self.ticks = 0

    def on_start(self) -> Status:
        """Charge for one tick."""
        return self.on_running()

    def on_running(self) -> Status:
        """Charge for one more tick."""
        self.ticks += 1
        if self.ticks <= CHARGING_TICKS:
            return Status.RUNNING
        self.ticks = 0
        self.robot.recharge()
        self.board[LEVEL] = FULL
        return Status.SUCCESS


def estimate(board: Blackboard, robot: Robot) -> float:
    """The level (0–100) on the blackboard; where nobody has written one, the battery's own."""
    entry = board.find(LEVEL)
    if entry is not None and isinstance(entry.value, int | float):
        return float(entry.value)
    battery = robot.battery()
    return FULL if battery is None else battery.level
