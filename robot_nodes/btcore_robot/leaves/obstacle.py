"""Leaves that look where the robot goes, with its laser."""

from typing import Annotated

import numpy as np

from btcore import In, StatefulAction, Status, condition
from btcore_robot.robot import NS_PER_S, LaserScan, Robot


@condition
def is_obstacle(
    robot: Robot,
    distance: Annotated[In[float], "How near (m) counts."] = 1.0,
    corridor: Annotated[In[float], "How wide (m) the robot looks; 0 is the middle beam alone."] = 0.0,
    timeout: Annotated[In[float], "A scan older than this (s) counts as an obstacle; 0: never."] = 0.0,
) -> bool:
    """SUCCESS when there is an obstacle ahead, nearer than *distance*.

    With a *corridor*, every echo ahead within half its width to either side counts; without one only the
    middle beam, as in the book. Before the first scan there is no obstacle, unless a *timeout* is set.
    """
    scan = robot.scan()
    if timeout > 0.0 and stale(scan, robot.clock.now(), timeout):
        return True
    if scan is None or not len(scan.ranges):
        return False
    if corridor > 0.0:
        return in_corridor(scan, distance, corridor)
    return bool(scan.ranges[len(scan.ranges) // 2] < distance)


class WaitForScan(StatefulAction):
    """Stand while the newest scan is older than *timeout*: RUNNING; SUCCESS as soon as there is a fresh one.

    As the first child of a ReactiveSequence it keeps a robot that has gone blind from driving on, whatever it
    was about to do.
    """

    timeout: Annotated[In[float], "How old (s) a scan may be."] = 0.5
    # With a fresh scan it is done at once, and so may stand before what lasts.
    may_complete_on_start = True

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def on_start(self) -> Status:
        """Look at the scan's age."""
        return self.on_running()

    def on_running(self) -> Status:
        """Look again; stand if it is too old."""
        if not stale(self.robot.scan(), self.robot.clock.now(), self.timeout):
            return Status.SUCCESS
        self.robot.drive(0.0, 0.0)
        return Status.RUNNING


def stale(scan: LaserScan | None, now: int, timeout: float) -> bool:
    """Whether at *now* (ns) there is no scan, or only one older than *timeout* (s)."""
    return scan is None or now - scan.stamp > timeout * NS_PER_S


def in_corridor(scan: LaserScan, distance: float, corridor: float) -> bool:
    """Whether a finite reading lies at 0 < x < *distance* and |y| ≤ *corridor*/2 in the laser's frame (m)."""
    points = scan.points()
    ahead, aside = points[:, 0], np.abs(points[:, 1])
    return bool(np.any((ahead > 0.0) & (ahead < distance) & (aside <= corridor / 2)))
