"""Pure pursuit: the point of a path to steer to, and the arc that leads there."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D

_MIN_DISTANCE = 1e-6  # m: points nearer to each other count as the same point
_WINDOW_BEHIND = 0.2  # m of the path behind the previous position in which the nearest point is searched
_WINDOW_AHEAD = 1.5  # m of the path ahead, likewise; a loop isn't cut short


@dataclass(frozen=True, slots=True)
class Carrot:
    """A point to steer to: *distance* (m) and *angle* (rad) as seen from the robot."""

    distance: float
    angle: float

    @property
    def curvature(self) -> float:
        """The curvature (1/m) of the arc to the point, tangent to the heading: 2·sin(angle)/distance."""
        return 2.0 * math.sin(self.angle) / max(self.distance, _MIN_DISTANCE)


class PurePursuit:
    """A path of *points* (m, shape `(n, 2)`, n ≥ 1) that a robot follows from its present position."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
        # Repeated points would give segments without a direction.
        kept = np.concatenate(([True], steps > _MIN_DISTANCE))
        self.points = points[kept]
        self._x = np.ascontiguousarray(self.points[:, 0])
        self._y = np.ascontiguousarray(self.points[:, 1])
        self._along = np.concatenate(([0.0], np.cumsum(steps[steps > _MIN_DISTANCE])))
        self.length = float(self._along[-1])
        """The length (m) of the path."""
        self.travelled: float | None = None
        """The distance (m) along the path to the robot's position; None before the first `locate`."""
        self.cross_track_distance = 0.0
        """The distance (m) from the robot to the path."""
        self.cross_track_error = 0.0
        """The distance (m) from the robot to the path: positive to its left, negative to its right."""
        self.heading: float | None = None
        """The direction (rad) of the path at the robot's position; None for a path of a single point."""

    @property
    def remaining(self) -> float:
        """The distance (m) along the path to its end."""
        return self.length - (self.travelled or 0.0)

    def locate(self, pose: Pose2D) -> None:
        """Find the position on the path nearest to *pose*.

        The first call searches the whole path; later calls search only near the previous position.
        """
        low, high = 0, len(self._x)
        if self.travelled is not None:
            low = max(int(np.searchsorted(self._along, self.travelled - _WINDOW_BEHIND)) - 1, 0)
            high = min(int(np.searchsorted(self._along, self.travelled + _WINDOW_AHEAD)) + 1, high)
        squares = (self._x[low:high] - pose.x) ** 2 + (self._y[low:high] - pose.y) ** 2
        nearest = low + int(squares.argmin())
        # The nearest position is on a segment that begins or ends at the nearest point.
        best = math.inf
        for start in (nearest - 1, nearest):
            if 0 <= start < len(self._x) - 1:
                x, y = float(self._x[start]), float(self._y[start])
                along = float(self._along[start + 1] - self._along[start])
                east, north = (float(self._x[start + 1]) - x) / along, (float(self._y[start + 1]) - y) / along
                share = min(max((pose.x - x) * east + (pose.y - y) * north, 0.0), along)
                off = math.hypot(x + share * east - pose.x, y + share * north - pose.y)
                if off < best:
                    best = off
                    self.travelled = float(self._along[start]) + share
                    self.cross_track_error = math.copysign(off, east * (pose.y - y) - north * (pose.x - x))
                    self.heading = math.atan2(north, east)
        if best == math.inf:
            best = self.cross_track_error = math.sqrt(float(squares.min()))
            self.travelled = float(self._along[nearest])
        self.cross_track_distance = best

    def carrot(self, pose: Pose2D, ahead: float) -> Carrot:
        """Return the point of the path to steer to, as seen from the robot; call `locate` first.

        Args:
            pose: The robot's pose, in the frame of the path.
            ahead: The distance (m) along the path from the robot's position on the path to the point. If the
                path ends before, the point is its end.
        """
        place = min((self.travelled or 0.0) + ahead, self.length)
        east = float(np.interp(place, self._along, self._x)) - pose.x
        north = float(np.interp(place, self._along, self._y)) - pose.y
        angle = wrap_angle(math.atan2(north, east) - pose.yaw)
        return Carrot(math.hypot(east, north), angle)

    def ahead(self, reach: float, step: float) -> NDArray[np.float64]:
        """Return points of the path ahead of the robot's position on the path; call `locate` first.

        Args:
            reach: The length (m) of the part of the path; `inf` for the rest of the path.
            step: The distance (m) between the points.

        Returns:
            The points (m), shape `(n, 2)`; the first point is the robot's position on the path.
        """
        travelled = self.travelled or 0.0
        places = np.arange(travelled, min(travelled + reach, self.length) + step / 2, step)
        return np.stack((np.interp(places, self._along, self._x), np.interp(places, self._along, self._y)), 1)
