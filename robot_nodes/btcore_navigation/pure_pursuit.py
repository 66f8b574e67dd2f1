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
    """A path of *points* (m, shape `(n, 2)`, n ≥ 1) that a robot follows from its present position.

    Attributes:
        points: The points, without repetitions.
        length: The length (m) of the path.
        travelled: The distance (m) along the path to the robot's position; None before the first `locate`.
        cross_track_error: The distance (m) from the robot to the path: positive to its left, negative to its
            right.
        heading: The direction (rad) of the path at the robot's position; None for a path of a single point.
    """

    def __init__(self, points: NDArray[np.float64]) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
        # Repeated points would give segments without a direction.
        kept = np.concatenate(([True], steps > _MIN_DISTANCE))
        self.points = points[kept]
        self._x = np.ascontiguousarray(self.points[:, 0])
        self._y = np.ascontiguousarray(self.points[:, 1])
        # The distance along the path to each point.
        self._distances = np.concatenate(([0.0], np.cumsum(steps[steps > _MIN_DISTANCE])))
        self.length = float(self._distances[-1])
        self.travelled: float | None = None
        self.cross_track_error = 0.0
        self.heading: float | None = None

    @property
    def cross_track_distance(self) -> float:
        """The distance (m) from the robot to the path."""
        return abs(self.cross_track_error)

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
            low = max(int(np.searchsorted(self._distances, self.travelled - _WINDOW_BEHIND)) - 1, 0)
            high = min(int(np.searchsorted(self._distances, self.travelled + _WINDOW_AHEAD)) + 1, high)
        squares = (self._x[low:high] - pose.x) ** 2 + (self._y[low:high] - pose.y) ** 2
        nearest = low + int(squares.argmin())
        # The nearest position is on a segment that begins or ends at the nearest point.
        best = math.inf
        for start in (nearest - 1, nearest):
            if 0 <= start < len(self._x) - 1:
                x, y = float(self._x[start]), float(self._y[start])
                before, after = float(self._distances[start]), float(self._distances[start + 1])
                length = after - before
                direction_x = (float(self._x[start + 1]) - x) / length
                direction_y = (float(self._y[start + 1]) - y) / length
                to_robot_x, to_robot_y = pose.x - x, pose.y - y
                in_segment = min(max(to_robot_x * direction_x + to_robot_y * direction_y, 0.0), length)
                distance = math.hypot(
                    x + in_segment * direction_x - pose.x, y + in_segment * direction_y - pose.y
                )
                if distance < best:
                    best = distance
                    self.travelled = before + in_segment
                    side = direction_x * to_robot_y - direction_y * to_robot_x  # positive: left of the path
                    self.cross_track_error = math.copysign(distance, side)
                    self.heading = math.atan2(direction_y, direction_x)
        if best == math.inf:
            self.cross_track_error = math.sqrt(float(squares.min()))
            self.travelled = float(self._distances[nearest])

    def carrot(self, pose: Pose2D, ahead: float) -> Carrot:
        """Return the point of the path to steer to, as seen from the robot; call `locate` first.

        Args:
            pose: The robot's pose, in the frame of the path.
            ahead: The distance (m) along the path from the robot's position on the path to the point. If the
                path ends before, the point is its end.
        """
        place = min((self.travelled or 0.0) + ahead, self.length)
        offset_x = float(np.interp(place, self._distances, self._x)) - pose.x
        offset_y = float(np.interp(place, self._distances, self._y)) - pose.y
        angle = wrap_angle(math.atan2(offset_y, offset_x) - pose.yaw)
        return Carrot(math.hypot(offset_x, offset_y), angle)

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
        x, y = np.interp(places, self._distances, self._x), np.interp(places, self._distances, self._y)
        return np.stack((x, y), 1)
