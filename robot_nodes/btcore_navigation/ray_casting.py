"""Ray casting: compare each laser beam with the distance to the first occupied cell in its direction."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.likelihood import obstacle_distances, surface_tolerances, with_margin
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserInfo, Pose2D

Floats = NDArray[np.float64]

CELL_MARGIN = 0.05
"""A beam has hit an occupied cell if it ends at most this far (m) outside the tolerance of a surface.

The distance is measured to the centre of the cell.
"""
SHORT, SHORT_A_METRE = 0.25, 0.05
"""Limits for beams that end before the first occupied cell in their direction.

A beam that is at least SHORT (m) plus SHORT_A_METRE times its length too short has hit something that is not
on the map. SHORT_A_METRE tolerates an error of the heading of about 0.05 rad.
"""
BEYOND = 0.2
"""A beam went through the first occupied cell in its direction if it ends behind the cell.

It ends behind the cell by at least this distance (m) more than the tolerance of a surface.
"""
_OUTSIDE = 1.0  # m around the map in which the ends of beams are compared with it


@dataclass(frozen=True, slots=True)
class ScanAgreement:
    """The agreement of a scan with the map at a pose, as shares (0 … 1) of its beams.

    *hit_share* is the share of beams that end on occupied cells. *through_share* is the share of beams that
    end behind an occupied cell, as if they went through a wall. The remaining beams end earlier: a person or
    an object that is not on the map is in the way, or the pose is wrong. People can shorten a beam, but never
    lengthen it. A high *through_share* therefore shows that the pose is wrong, even in a crowd.
    """

    hit_share: float
    through_share: float

    @property
    def score(self) -> float:
        """How well the pose explains the scan (-1 … 1, 1 is best): *hit_share* minus *through_share*."""
        return self.hit_share - self.through_share


class RayCaster:
    """Ray casting on an occupancy map. *reach* (m) is the longest step along a ray.

    *laser* is the laser whose beams are compared with the map.
    """

    def __init__(self, field_map: OccupancyMap, reach: float, laser: LaserInfo | None = None) -> None:
        self._laser = laser
        field_map = with_margin(field_map, _OUTSIDE)
        self._distance = np.pad(obstacle_distances(field_map, reach), 1, constant_values=reach)
        # Beyond the map nothing is in the way: a ray that gets there takes a step of the full range.
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
        distances: Floats = self._flat[places].astype(np.float64)
        return distances

    def visible_range(self, x: Floats, y: Floats, dx: Floats, dy: Floats, reach: Floats) -> Floats:
        """Return the distances (m) from points to the first occupied cell in given directions.

        The method is sphere tracing: each step is as long as the distance to the nearest occupied cell.

        Args:
            x: The x coordinates (m) of the points.
            y: The y coordinates (m) of the points.
            dx: The x components of the unit directions.
            dy: The y components of the unit directions.
            reach: The greatest distances (m) of interest; all arrays have the same shape.

        Returns:
            The distances, in the shape of *x*; *reach* where no occupied cell is nearer.
        """
        active = np.arange(x.size)
        px, py, ux, uy, limit = (a.ravel() for a in np.broadcast_arrays(x, y, dx, dy, reach))
        flat = np.zeros(x.size)
        least = 0.6 * self._resolution
        while len(active):
            length = flat[active]
            clear = self._at(px[active] + length * ux[active], py[active] + length * uy[active])
            # Distances are between cells' centres; at either end a corner may be 0.7 of a cell nearer.
            open_ = clear > 0.5 * self._resolution
            length = length + np.where(open_, np.maximum(clear - 1.4 * self._resolution, least), 0.0)
            done = ~open_ | (length >= limit[active])
            flat[active] = np.minimum(length, limit[active])
            active = active[~done]
        return flat.reshape(x.shape)

    def _cast(
        self, poses: Sequence[Pose2D], laser: tuple[float, float], points: Floats
    ) -> tuple[Floats, Floats, Floats, Floats]:
        """Return the beams' lengths, and by pose (first axis) their visible ranges and ends (x, y)."""
        x, y, cos, sin = (
            np.array(column)[:, None]
            for column in zip(*((p.x, p.y, math.cos(p.yaw), math.sin(p.yaw)) for p in poses), strict=True)
        )
        rays = points - laser
        lengths = np.hypot(rays[:, 0], rays[:, 1])
        rays = rays / lengths[:, None]
        dx, dy = cos * rays[:, 0] - sin * rays[:, 1], sin * rays[:, 0] + cos * rays[:, 1]
        from_x = x + cos * laser[0] - sin * laser[1] + np.zeros_like(dx)
        from_y = y + sin * laser[0] + cos * laser[1] + np.zeros_like(dx)
        # No ray needs to go farther than the comparison with the beam's length.
        reach = np.broadcast_to(lengths * (1.0 + SHORT_A_METRE) + SHORT, dx.shape)
        visible = self.visible_range(from_x, from_y, dx, dy, reach)
        return lengths, visible, from_x + lengths * dx, from_y + lengths * dy

    def unobstructed_beams(
        self, pose: Pose2D, laser: tuple[float, float], points: Floats
    ) -> NDArray[np.bool_]:
        """Return the mask, shape `(k,)`, of beams that end at or behind the first occupied cell.

        SHORT and SHORT_A_METRE give the tolerance. All other beams have hit something that is not on the map.

        Args:
            pose: The robot's pose in the map.
            laser: The laser's position in the robot's frame (m).
            points: The ends of the beams in the robot's frame (m), shape `(k, 2)`.
        """
        lengths, visible, _, _ = self._cast([pose], laser, points)
        mask: NDArray[np.bool_] = visible[0] < lengths * (1.0 + SHORT_A_METRE) + SHORT
        return mask

    def agreement(
        self, poses: Sequence[Pose2D], laser: tuple[float, float], points: Floats
    ) -> list[ScanAgreement]:
        """Return the agreement of beams with the map for each of several poses.

        Args:
            poses: The robot's poses in the map.
            laser: The laser's position in the robot's frame (m).
            points: The ends of the beams in the robot's frame (m), shape `(k, 2)`.
        """
        if not len(points) or not poses:
            return [ScanAgreement(0.0, 0.0) for _ in poses]
        lengths, visible, end_x, end_y = self._cast(poses, laser, points)
        tolerances = surface_tolerances(lengths, self._laser)
        through = lengths - visible > tolerances + BEYOND
        hits = (self._at(end_x, end_y) <= tolerances + CELL_MARGIN) & ~through
        shares = np.stack((hits.mean(axis=1), through.mean(axis=1)), axis=1).tolist()
        return [ScanAgreement(hit_share, through_share) for hit_share, through_share in shares]
