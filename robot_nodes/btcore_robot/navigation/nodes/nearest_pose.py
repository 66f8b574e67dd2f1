"""Search for the robot's pose on a path that may cross itself, starting at the previous result."""

import math

import numpy as np

from btcore_robot.navigation.path import NavPath
from btcore_robot.rigid_transform import wrap_angles
from btcore_robot.robot import Pose2D


class NearestPoseSearch:
    """A search for the pose of a path nearest to the robot; on the same path it never goes backwards."""

    def __init__(self) -> None:
        self.known: NavPath | None = None
        self.at = 0

    def nearest(self, path: NavPath, here: Pose2D, reach: float, turn: float = 0.0) -> int:
        """Return the index of the pose of *path* that is nearest to *here*.

        Args:
            path: A path with at least one pose.
            here: The robot's pose in the frame of the path.
            reach: The maximum distance (m) along the path from the previous result; negative or infinite:
                search the whole path, forwards and backwards.
            turn: The distance (m) that counts as much as a heading error of 1 rad.

        """
        whole = reach < 0.0 or math.isinf(reach)
        if whole or path != self.known:
            self.known, self.at = path, 0
        along = path.distances()
        last = len(along) if whole else int(np.searchsorted(along, along[self.at] + reach, "right"))
        poses = path.poses[self.at : max(last, self.at + 1)]
        heading_error = wrap_angles(poses[:, 2] - here.yaw)
        distance = np.hypot(np.hypot(poses[:, 0] - here.x, poses[:, 1] - here.y), turn * heading_error)
        nearest = self.at + int(np.argmin(distance))
        # A search of the whole path does not restrict the next search.
        self.at = 0 if whole else nearest
        return nearest
