"""Turning to where there is room: the closed loop of the book's third chapter, as a leaf."""

import math
from typing import Annotated

import numpy as np

from btcore import In, StatefulAction, Status
from btcore_robot.control.bumpgo_turns import clearances, freest
from btcore_robot.leaves.drive import TURN_SPEED
from btcore_robot.robot import LaserScan, Robot

WHOLE_TURN = round(2 * math.pi / TURN_SPEED * 1e9)
"""How long (ns) a turn all round takes."""


class TurnToFree(StatefulAction):
    """Turn at 0.5 rad/s, to the side of the freest direction, until *clear* metres are free ahead: SUCCESS.

    FAILURE when a whole turn finds no such place. Free is what no laser ray within 30° to either side denies.
    Without a scan it stands and is RUNNING.
    """

    clear: Annotated[In[float], "How far (m) it has to be free ahead."] = 2.0

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.side = 0.0
        self.began = 0

    def on_start(self) -> Status:
        """Forget the side of the last time."""
        self.side = 0.0
        return self.on_running()

    def on_running(self) -> Status:
        """Look, and turn on or end."""
        scan = self.robot.scan()
        if scan is None or not len(scan.ranges):
            self.robot.drive(0.0, 0.0)
            return Status.RUNNING
        now = self.robot.clock.now()
        if not self.side:
            self.side = math.copysign(1.0, freest(scan))
            self.began = now
        if free_ahead(scan) >= self.clear:
            return Status.SUCCESS
        if now - self.began > WHOLE_TURN:
            return Status.FAILURE
        self.robot.drive(0.0, self.side * TURN_SPEED)
        return Status.RUNNING


def free_ahead(scan: LaserScan) -> float:
    """How far (m) it is free ahead."""
    return float(clearances(scan)[np.argmin(np.abs(scan.angles()))])
