"""Leaves that check for obstacles ahead with the laser."""

from typing import Annotated

import numpy as np

from btcore import RUNNING, SUCCESS, In, NodeSpec, StatefulAction, Status, condition
from btcore_robot.robot import LaserScan, Robot
from btcore_robot.time_limits import MAX_SCAN_AGE_S, is_stale


@condition
def is_obstacle(
    robot: Robot,
    distance: Annotated[In[float], "The distance (m) below which an echo is an obstacle."] = 1.0,
    corridor: Annotated[In[float], "The width (m) of the corridor to check; 0: the middle beam alone."] = 0.0,
    timeout: Annotated[In[float], "A scan older than this (s) counts as an obstacle; 0: never."] = 0.0,
) -> bool:
    """SUCCESS when there is an obstacle ahead, nearer than *distance*, else FAILURE.

    With a *corridor*, every echo ahead within half its width to either side counts. Without a corridor only
    the middle beam of the laser counts, as in the book *A Concise Introduction to Robot Programming with
    ROS2*. Before the first scan there is no obstacle, unless a *timeout* is set.
    """
    scan = robot.scan()
    if timeout > 0.0 and is_stale(scan, robot.clock.now(), timeout):
        return True
    if scan is None or not len(scan.ranges):
        return False
    if corridor > 0.0:
        return in_corridor(scan, distance, corridor)
    return bool(scan.ranges[len(scan.ranges) // 2] < distance)


class WaitForScan(StatefulAction):
    """Stops the robot until the newest scan is recent: RUNNING while older than *timeout*, then SUCCESS.

    A missing scan counts as too old. As the first child of a ReactiveSequence the node stops a robot without
    laser data, and the later children are not ticked.
    """

    timeout: Annotated[In[float], "The maximum age (s) of a scan."] = MAX_SCAN_AGE_S
    # With a recent scan the node succeeds on its first tick, so it may be the first child of a reactive node.
    # It is endless, because no scan may arrive.
    spec = NodeSpec(
        results=frozenset({SUCCESS}),
        state_fields=(),
        hands_over=True,  # each command replaces the last one
        may_complete_on_start=True,
        is_endless=True,
    )

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def on_start(self) -> Status:
        """Check the age of the scan."""
        return self.on_running()

    def on_running(self) -> Status:
        """Check the age of the scan; stop the robot if the scan is too old."""
        if not is_stale(self.robot.scan(), self.robot.clock.now(), self.timeout):
            return SUCCESS
        self.robot.drive(0.0, 0.0)
        return RUNNING


def in_corridor(scan: LaserScan, distance: float, corridor: float) -> bool:
    """Return whether an echo is at `0 < x < distance` and `|y| ≤ corridor / 2` in the laser's frame (m)."""
    points = scan.points()
    ahead, sideways = points[:, 0], np.abs(points[:, 1])
    return bool(np.any((ahead > 0.0) & (ahead < distance) & (sideways <= corridor / 2)))
