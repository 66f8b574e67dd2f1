"""A leaf that turns towards free space: the closed control loop of the book's third chapter."""

import math
from typing import Annotated

import numpy as np

from btcore import In, StatefulAction, Status
from btcore_robot.control.bumpgo_turns import clearances, freest_direction
from btcore_robot.leaves.drive import TURN_SPEED
from btcore_robot.robot import LaserScan, Robot

FULL_TURN_TIME = round(2 * math.pi / TURN_SPEED * 1e9)
"""The time (ns) of a full turn."""


class TurnToFree(StatefulAction):
    """Turn at 0.5 rad/s towards the freest direction until *clear* metres are free ahead, then SUCCESS.

    FAILURE when a full turn finds no free direction. A direction is free as far as no laser ray within 30° to
    either side hits something. Without a scan the robot stands and the node is RUNNING.
    """

    clear: Annotated[In[float], "The distance (m) that has to be free ahead."] = 2.0

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.side = 0.0
        self.started = 0

    def on_start(self) -> Status:
        """Reset the side and start."""
        self.side = 0.0
        return self.on_running()

    def on_running(self) -> Status:
        """Check the scan; turn or end."""
        scan = self.robot.scan()
        if scan is None or not len(scan.ranges):
            self.robot.drive(0.0, 0.0)
            return Status.RUNNING
        now = self.robot.clock.now()
        if not self.side:
            self.side = math.copysign(1.0, freest_direction(scan))
            self.started = now
        if clearance_ahead(scan) >= self.clear:
            return Status.SUCCESS
        if now - self.started > FULL_TURN_TIME:
            return Status.FAILURE
        self.robot.drive(0.0, self.side * TURN_SPEED)
        return Status.RUNNING


def clearance_ahead(scan: LaserScan) -> float:
    """Return the free distance (m) ahead."""
    return float(clearances(scan)[np.argmin(np.abs(scan.angles()))])
