"""Paths: the poses that a planner hands to a controller."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.robot import Pose2D


@dataclass(frozen=True, slots=True, eq=False)
class NavPath:
    """Poses to pass one after another.

    *poses* is float64 of shape ``(n, 3)``: x, y (m) and yaw (rad) in *frame*; *stamp* (ns) is the moment it
    was planned. A path of no poses is the answer of a plan that failed. Paths are equal when they have the
    same poses and were planned at the same moment: who cuts one again gets an equal one.
    """

    poses: NDArray[np.float64]
    stamp: int
    frame: str = "map"

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, NavPath):
            return NotImplemented
        return self is other or (self.stamp == other.stamp and self.same(other))

    def __hash__(self) -> int:
        return hash((self.stamp, self.frame, len(self.poses)))

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Pose2D:
        """The pose at *index*; a negative one counts from the end."""
        x, y, yaw = self.poses[index]
        return Pose2D(float(x), float(y), float(yaw))

    @property
    def points(self) -> NDArray[np.float64]:
        """The places (m) without headings, shape ``(n, 2)``."""
        return self.poses[:, :2]

    @property
    def goal(self) -> Pose2D | None:
        """The last pose, or None of an empty path."""
        return self[-1] if len(self.poses) else None

    def length(self) -> float:
        """How long the way is (m)."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum()) if len(self.poses) > 1 else 0.0

    def distances(self) -> NDArray[np.float64]:
        """How far (m) along the way each pose is from the first, shape ``(n,)``."""
        if not len(self.poses):
            return np.zeros(0)
        steps = np.hypot(*np.diff(self.points, axis=0).T)
        return np.concatenate(([0.0], np.cumsum(steps)))

    def nearest(self, x: float, y: float) -> int:
        """The index of the pose nearest to the point *x*, *y* (m), the first of equals; -1 if empty."""
        if not len(self.poses):
            return -1
        return int(np.argmin(np.hypot(self.poses[:, 0] - x, self.poses[:, 1] - y)))

    def remaining(self, x: float, y: float) -> float:
        """How long (m) the way is from the point *x*, *y* over the nearest pose to the end; 0 if empty."""
        index = self.nearest(x, y)
        if index < 0:
            return 0.0
        along = self.distances()
        off = math.hypot(self.poses[index, 0] - x, self.poses[index, 1] - y)
        return float(off + along[-1] - along[index])

    def same(self, other: "NavPath") -> bool:
        """Whether the poses are the same, whenever they were planned."""
        return self.frame == other.frame and np.array_equal(self.poses, other.poses)


def empty_path(stamp: int, frame: str = "map") -> NavPath:
    """A path of no poses."""
    return NavPath(np.zeros((0, 3)), stamp, frame)


def through(points: NDArray[np.float64], goal: Pose2D, stamp: int, frame: str = "map") -> NavPath:
    """A path through *points* (m, shape ``(n, 2)``, the last one the goal's place).

    Each pose looks to the next point; the last one has the heading of *goal*.
    """
    poses = np.empty((len(points), 3))
    poses[:, :2] = points
    ahead = np.diff(points, axis=0)
    poses[:-1, 2] = np.arctan2(ahead[:, 1], ahead[:, 0])
    poses[-1, 2] = goal.yaw
    return NavPath(poses, stamp, frame)


def joined(paths: list[NavPath], stamp: int) -> NavPath:
    """*paths*, each of which begins where the one before ends, as one; such a place is there once."""
    kept = [path.poses if index == 0 else path.poses[1:] for index, path in enumerate(paths)]
    return NavPath(np.concatenate(kept), stamp, paths[0].frame)
