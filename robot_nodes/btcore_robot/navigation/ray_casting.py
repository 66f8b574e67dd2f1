"""Whether a scan can have been taken at a pose: each beam against what the map lets it see."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.likelihood import distances
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

WITHIN = 0.25
"""A beam that ends this close (m) to something mapped has met it."""
SHORT, SHORT_A_METRE = 0.25, 0.05
"""A beam that ends this much (m), and this much more for each metre of its length, before where the map says
it must end has met somebody who is not on the map: a heading may be off by some 0.05 rad."""
BEYOND = 0.4
"""A beam that ends this far (m) behind where the map says it must end has gone through something."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """The shares (0 … 1) of the beams that met what is mapped, and of those that went through it.

    The rest ended before: somebody stands there who is not on the map, or the pose is wrong. Nobody in the
    way lets a beam go through a wall: *through* is what tells a lost robot from one in a crowd.
    """

    met: float
    through: float

    @property
    def score(self) -> float:
        """How well a pose explains a scan: what met, less what went through."""
        return self.met - self.through


class RayCaster:
    """How far one sees on a map from a pose."""

    def __init__(self, field_map: OccupancyMap, reach: float = 25.0) -> None:
        self._distance = np.pad(distances(field_map, reach), 1, constant_values=reach)
        # Beyond the map nothing is in the way; the next step from there is a whole reach.
        self._flat = self._distance.ravel()
        self._resolution = field_map.resolution
        self._origin = (
            field_map.origin[0] - field_map.resolution,
            field_map.origin[1] - field_map.resolution,
        )

    def _at(self, x: Floats, y: Floats) -> Floats:
        column = np.clip((x - self._origin[0]) / self._resolution, 0.0, self._distance.shape[1] - 1)
        row = np.clip((y - self._origin[1]) / self._resolution, 0.0, self._distance.shape[0] - 1)
        places = row.astype(np.intp) * self._distance.shape[1] + column.astype(np.intp)
        found: Floats = self._flat[places].astype(np.float64)
        return found

    def seen(self, x: Floats, y: Floats, dx: Floats, dy: Floats, reach: Floats) -> Floats:
        """How far (m), up to *reach*, rays from points in unit directions go until something occupied.

        All of one shape. Each step goes as far as nothing can be (sphere tracing).
        """
        gone = np.zeros_like(x)
        active = np.arange(x.size)
        px, py, ux, uy, limit = (a.ravel() for a in np.broadcast_arrays(x, y, dx, dy, reach))
        flat = gone.ravel()
        least = 0.6 * self._resolution
        while len(active):
            length = flat[active]
            clear = self._at(px[active] + length * ux[active], py[active] + length * uy[active])
            # Distances are from middle to middle: a face may be 0.7 of a cell nearer at either end.
            open_ = clear > 0.5 * self._resolution
            length = length + np.where(open_, np.maximum(clear - 1.4 * self._resolution, least), 0.0)
            done = ~open_ | (length >= limit[active])
            flat[active] = np.minimum(length, limit[active])
            active = active[~done]
        return flat.reshape(x.shape)

    def _cast(
        self, poses: Sequence[Pose2D], eye: tuple[float, float], points: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Each beam from each of *poses* (first axis): its length, how far one sees, x and y of its end."""
        x, y, cos, sin = (
            np.array(column)[:, None]
            for column in zip(*((p.x, p.y, math.cos(p.yaw), math.sin(p.yaw)) for p in poses), strict=True)
        )
        rays = points - eye
        lengths = np.hypot(rays[:, 0], rays[:, 1])
        rays = rays / lengths[:, None]
        dx, dy = cos * rays[:, 0] - sin * rays[:, 1], sin * rays[:, 0] + cos * rays[:, 1]
        from_x = x + cos * eye[0] - sin * eye[1] + np.zeros_like(dx)
        from_y = y + sin * eye[0] + cos * eye[1] + np.zeros_like(dx)
        # How much farther one could see is of no interest.
        reach = np.broadcast_to(lengths * (1.0 + SHORT_A_METRE) + SHORT, dx.shape)
        return lengths, self.seen(from_x, from_y, dx, dy, reach), from_x + lengths * dx, from_y + lengths * dy

    def unhindered(self, pose: Pose2D, eye: tuple[float, float], points: Floats) -> NDArray[np.bool_]:
        """Which of the beams go, from *pose*, as far as the map lets them, or farther; shape ``(k,)``."""
        lengths, seen, _, _ = self._cast([pose], eye, points)
        mask: NDArray[np.bool_] = seen[0] < lengths * (1.0 + SHORT_A_METRE) + SHORT
        return mask

    def agreement(self, poses: Sequence[Pose2D], eye: tuple[float, float], points: Floats) -> list[Agreement]:
        """How beams that end at *points* agree with the map from each of *poses*.

        *points* ``(k, 2)`` and *eye*, where the laser is, are in the robot's frame (m).
        """
        if not len(points) or not poses:
            return [Agreement(0.0, 0.0) for _ in poses]
        lengths, seen, end_x, end_y = self._cast(poses, eye, points)
        through = lengths - seen > BEYOND
        ends = self._at(end_x, end_y)
        met = (ends <= WITHIN) & ~through
        return [
            Agreement(float(m), float(t)) for m, t in zip(met.mean(axis=1), through.mean(axis=1), strict=True)
        ]
