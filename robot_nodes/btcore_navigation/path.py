"""Paths: the sequences of poses that a planner passes to a controller."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import wrap_angles
from btcore_robot.robot import MAP_FRAME, Pose2D


@dataclass(frozen=True, slots=True, eq=False)
class NavPath:
    """A sequence of poses.

    *poses* is float64 of shape `(n, 3)`: x, y (m) and yaw (rad) in *frame*; *stamp* (ns) is the time of
    planning. A path without poses stands for a plan that failed. Paths are equal if they have the same frame,
    poses and stamp, so that truncating the same path twice gives equal paths.
    """

    poses: NDArray[np.float64]
    stamp: int
    frame: str = MAP_FRAME

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, NavPath):
            return NotImplemented
        return self is other or (self.stamp == other.stamp and self.has_same_poses(other))

    def __hash__(self) -> int:
        return hash((self.stamp, self.frame, len(self.poses)))

    def __len__(self) -> int:
        return len(self.poses)

    def __getitem__(self, index: int) -> Pose2D:
        """Return the pose at *index*; a negative index counts from the end."""
        x, y, yaw = self.poses[index]
        return Pose2D(float(x), float(y), float(yaw))

    @property
    def points(self) -> NDArray[np.float64]:
        """The positions (m) without headings, shape `(n, 2)`."""
        return self.poses[:, :2]

    @property
    def goal(self) -> Pose2D | None:
        """The last pose; None for an empty path."""
        return self[-1] if len(self.poses) else None

    def length(self) -> float:
        """Return the length (m) of the path."""
        return float(np.hypot(*np.diff(self.points, axis=0).T).sum()) if len(self.poses) > 1 else 0.0

    def distances(self) -> NDArray[np.float64]:
        """Return the distance (m) of each pose from the first, along the path; shape `(n,)`."""
        if not len(self.poses):
            return np.zeros(0)
        steps = np.hypot(*np.diff(self.points, axis=0).T)
        return np.concatenate(([0.0], np.cumsum(steps)))

    def nearest(self, x: float, y: float) -> int:
        """Return the index of the pose nearest to a point; -1 for an empty path.

        Of several nearest poses the first is used.

        Args:
            x: The point's x coordinate (m) in the path's frame.
            y: The point's y coordinate (m) in the path's frame.
        """
        if not len(self.poses):
            return -1
        return int(np.argmin(np.hypot(self.poses[:, 0] - x, self.poses[:, 1] - y)))

    def remaining(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the end of the path; 0 for an empty path.

        The distance is measured straight to the path's nearest pose, and from there along the path.

        Args:
            x: The point's x coordinate (m) in the path's frame.
            y: The point's y coordinate (m) in the path's frame.
        """
        index = self.nearest(x, y)
        if index < 0:
            return 0.0
        along = self.distances()
        off = math.hypot(self.poses[index, 0] - x, self.poses[index, 1] - y)
        return float(off + along[-1] - along[index])

    def has_same_poses(self, other: "NavPath") -> bool:
        """Return whether *other* has the same poses, with any stamp."""
        return self.frame == other.frame and np.array_equal(self.poses, other.poses)


def empty_path(stamp: int) -> NavPath:
    """Return a path without poses, planned at *stamp* (ns), in the frame `map`."""
    return NavPath(np.zeros((0, 3)), stamp, MAP_FRAME)


def path_through(points: NDArray[np.float64], goal: Pose2D, stamp: int, frame: str) -> NavPath:
    """Return a path through points; each pose points to the next point.

    Args:
        points: The positions (m), shape `(n, 2)`; the last is the position of the goal.
        goal: The pose whose heading the last pose gets.
        stamp: The time of planning (ns).
        frame: The frame of the points.
    """
    poses = np.empty((len(points), 3))
    poses[:, :2] = points
    ahead = np.diff(points, axis=0)
    poses[:-1, 2] = np.arctan2(ahead[:, 1], ahead[:, 0])
    poses[-1, 2] = goal.yaw
    return NavPath(poses, stamp, frame)


def join_paths(paths: list[NavPath], stamp: int) -> NavPath:
    """Return several paths joined into a single path, in the frame of the first path.

    The first pose of each later path is left out, because it repeats the last pose of the previous path.

    Args:
        paths: The paths in order, at least one, all in the same frame.
        stamp: The time (ns) of planning of the joined path.
    """
    kept = [path.poses if index == 0 else path.poses[1:] for index, path in enumerate(paths)]
    return NavPath(np.concatenate(kept), stamp, paths[0].frame)


class NearestPoseSearch:
    """A search for the pose of a path nearest to the robot.

    While the path stays the same, the result never moves backwards, unless the whole path is searched.

    Attributes:
        known: The path of the last search, or None.
        at: The index of the pose that the last search found.
    """

    def __init__(self) -> None:
        self.known: NavPath | None = None
        self.at = 0

    def nearest(self, path: NavPath, here: Pose2D, reach: float, turn: float = 0.0) -> int:
        """Return the index of the pose of *path* that is nearest to *here*.

        Args:
            path: A path with at least one pose.
            here: The robot's pose in the frame of the path.
            reach: The maximum distance (m) along the path from the previous result. If negative or infinite,
                the whole path is searched, forwards and backwards.
            turn: The distance (m) that counts as much as a heading error of 1 rad.
        """
        is_unlimited = reach < 0.0 or math.isinf(reach)
        if is_unlimited or path != self.known:
            self.known, self.at = path, 0
        along = path.distances()
        last = len(along) if is_unlimited else int(np.searchsorted(along, along[self.at] + reach, "right"))
        poses = path.poses[self.at : max(last, self.at + 1)]
        heading_error = wrap_angles(poses[:, 2] - here.yaw)
        distance = np.hypot(np.hypot(poses[:, 0] - here.x, poses[:, 1] - here.y), turn * heading_error)
        nearest = self.at + int(np.argmin(distance))
        # A search of the whole path does not restrict the next search.
        self.at = 0 if is_unlimited else nearest
        return nearest
