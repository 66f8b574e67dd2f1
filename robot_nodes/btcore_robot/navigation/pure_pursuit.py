"""Pure pursuit: the point of a path to steer for, and the arc that leads there."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D

_WINDOW = 1.5  # m of the path ahead in which the robot is looked for, so that a loop isn't cut short


@dataclass(frozen=True, slots=True)
class Carrot:
    """A point to steer for: where it is from the robot, *distance* (m) and *angle* (rad)."""

    distance: float
    angle: float

    @property
    def curvature(self) -> float:
        """The curvature (1/m) of the arc that leads there, tangent to the heading: 2·sin(angle)/distance."""
        return 2.0 * math.sin(self.angle) / max(self.distance, 1e-6)


class PurePursuit:
    """A path of *points* (m, shape ``(n, 2)``, n ≥ 1) that a robot follows from where it finds itself."""

    def __init__(self, points: NDArray[np.float64]) -> None:
        steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
        kept = np.concatenate(([True], steps > 1e-6))
        self.points = points[kept]
        self._x = np.ascontiguousarray(self.points[:, 0])
        self._y = np.ascontiguousarray(self.points[:, 1])
        self._along = np.concatenate(([0.0], np.cumsum(steps[steps > 1e-6])))
        self.length = float(self._along[-1])
        """How long the path is (m)."""
        self.passed: float | None = None
        """How far (m) along the path the robot is."""
        self.off = 0.0
        """How far (m) beside the path the robot is."""
        self.aside = 0.0
        """The same with a sign: + to the left of the path, - to its right."""
        self.heading: float | None = None
        """Where (rad) the path goes at the robot's place; None of a path that is one point."""

    @property
    def left(self) -> float:
        """How far (m) it is along the path to its end."""
        return self.length - (self.passed or 0.0)

    def locate(self, pose: Pose2D) -> None:
        """Find the place on the path next to *pose*, first anywhere, then not far from the last one."""
        low, high = 0, len(self._x)
        if self.passed is not None:
            low = max(int(np.searchsorted(self._along, self.passed - 0.2)) - 1, 0)
            high = min(int(np.searchsorted(self._along, self.passed + _WINDOW)) + 1, high)
        squares = (self._x[low:high] - pose.x) ** 2 + (self._y[low:high] - pose.y) ** 2
        nearest = low + int(squares.argmin())
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
                    self.passed = float(self._along[start]) + share
                    self.aside = math.copysign(off, east * (pose.y - y) - north * (pose.x - x))
                    self.heading = math.atan2(north, east)
        if best == math.inf:
            best = self.aside = math.sqrt(float(squares.min()))
            self.passed = float(self._along[nearest])
        self.off = best

    def carrot(self, pose: Pose2D, ahead: float) -> Carrot:
        """The point *ahead* (m) along the path, or its end, as seen from *pose*; `locate` first."""
        place = min((self.passed or 0.0) + ahead, self.length)
        east = float(np.interp(place, self._along, self._x)) - pose.x
        north = float(np.interp(place, self._along, self._y)) - pose.y
        angle = wrap_angle(math.atan2(north, east) - pose.yaw)
        return Carrot(math.hypot(east, north), angle)

    def ahead(self, reach: float, step: float) -> NDArray[np.float64]:
        """Points every *step* (m) from the robot's place on, *reach* (m) far, shape ``(n, 2)``."""
        passed = self.passed or 0.0
        places = np.arange(passed, min(passed + reach, self.length) + step / 2, step)
        return np.stack((np.interp(places, self._along, self._x), np.interp(places, self._along, self._y)), 1)

    def rest(self, ahead: float) -> NDArray[np.float64]:
        """The path's points from *ahead* (m) after the robot's place on, shape ``(n, 2)``, maybe n = 0."""
        return self.points[self._along > (self.passed or 0.0) + ahead]
