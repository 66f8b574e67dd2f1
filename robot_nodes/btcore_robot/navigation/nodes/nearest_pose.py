"""Where the robot is on a path that crosses itself: sought from where it was found last."""

import math

import numpy as np

from btcore_robot.navigation.path import NavPath
from btcore_robot.rigid_transform import wrap_angles
from btcore_robot.robot import Pose2D


class NearestPoseSearch:
    """Finds the pose of a path that the robot is nearest to; of the same path, never one further back."""

    def __init__(self) -> None:
        self.known: NavPath | None = None
        self.at = 0

    def nearest(self, path: NavPath, here: Pose2D, reach: float, turn: float = 0.0) -> int:
        """The index of the pose of *path* nearest to *here*, at most *reach* (m) along it from the last one.

        A *reach* that is negative or infinite means all of the path, forward and back. *turn* (m/rad) is
        how much a heading that is off counts. The path isn't empty.
        """
        whole = reach < 0.0 or math.isinf(reach)
        if whole or path != self.known:
            self.known, self.at = path, 0
        along = path.distances()
        last = len(along) if whole else int(np.searchsorted(along, along[self.at] + reach, "right"))
        poses = path.poses[self.at : max(last, self.at + 1)]
        off = wrap_angles(poses[:, 2] - here.yaw)
        distance = np.hypot(np.hypot(poses[:, 0] - here.x, poses[:, 1] - here.y), turn * off)
        found = self.at + int(np.argmin(distance))
        self.at = 0 if whole else found
        return found
