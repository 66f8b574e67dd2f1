"""Scan matching: the pose near a guess at which the laser's beams end on the surfaces of the map."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.likelihood import obstacle_distances, surface_tolerances, with_margin
from btcore_navigation.ray_casting import RayCaster
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import LaserInfo, Pose2D

Floats = NDArray[np.float64]

FAR = 1.0
"""The distance (m) from which a surface no longer attracts a point: the point is then not on the map."""
BEAM_DEVIATION = 0.1
"""The standard deviation (m) of a beam in a match: the laser's noise and the size of the map's cells."""
_CONVERGED = 1e-4  # a step shorter than this (m, rad) is the last


@dataclass(frozen=True, slots=True)
class Match:
    """The result of a match: the *pose*, and the *share* (0 … 1) of the beams that end on a surface there."""

    pose: Pose2D
    share: float


@dataclass(frozen=True, slots=True)
class _BeamsBehind:
    """Beams that end behind the surfaces which they hit.

    *beams* are their indices, shape `(n,)`. The surface of a beam is a line: *normals*, shape `(n, 2)`, point
    towards the laser, and the signed distance of a point from the line is its product with the normal, plus
    one of *offsets* (m), shape `(n,)`.
    """

    beams: NDArray[np.intp]
    normals: Floats
    offsets: Floats

    def distances(self, x: Floats, y: Floats) -> Floats:
        """Return the signed distances (m) of the beams' ends *x*, *y* (m) from their surfaces."""
        return self.normals[:, 0] * x + self.normals[:, 1] * y + self.offsets


class SignedDistanceField:
    """The signed distance (m) to the nearest surface of an occupied cell, negative inside obstacles.

    The likelihood field has its maximum inside a wall and pulls a pose forward by the laser's noise; this
    field doesn't. Each cell stores the distance and the gradient at its centre, for a linear interpolation in
    the cell. *laser* is the laser whose beams are matched; its noise determines which beams fit a surface.
    *visibility* finds the surface of a beam that noise lets end behind a thin wall: without such beams, the
    others would pull the pose towards the wall.
    """

    def __init__(
        self, field_map: OccupancyMap, laser: LaserInfo | None = None, visibility: RayCaster | None = None
    ) -> None:
        self._laser = laser
        self._visibility = visibility
        field_map = with_margin(field_map, FAR)
        half = field_map.resolution / 2.0
        outside = obstacle_distances(field_map, FAR)
        inverted = OccupancyMap(
            np.where(field_map.occupied, 0, 100).astype(np.int8), field_map.resolution, field_map.origin
        )
        inside = obstacle_distances(inverted, FAR)
        signed = np.where(field_map.occupied, half - inside, outside - half).astype(np.float64)
        # A margin of one cell stands for all points beyond the map.
        signed = np.pad(signed, 1, constant_values=FAR)
        along_y, along_x = np.gradient(signed, field_map.resolution)
        self._table = np.stack((signed, along_x, along_y), axis=-1).astype(np.float32).reshape(-1, 3)
        self._shape = signed.shape
        self._resolution = field_map.resolution
        self._origin = (
            field_map.origin[0] - field_map.resolution,
            field_map.origin[1] - field_map.resolution,
        )

    def at(self, x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
        """Return the signed distance (m) and its gradient along x and y, at points of the map.

        Args:
            x: The points' x coordinates (m) in the frame map, in one dimension.
            y: The points' y coordinates (m), of the same shape.
        """
        u = (x - self._origin[0]) / self._resolution
        v = (y - self._origin[1]) / self._resolution
        column = _limit(u, 0.0, self._shape[1] - 1).astype(np.intp)
        row = _limit(v, 0.0, self._shape[0] - 1).astype(np.intp)
        distance, along_x, along_y = self._table[row * self._shape[1] + column].T.astype(np.float64)
        off_x = _limit(u - column - 0.5, -0.5, 0.5) * self._resolution
        off_y = _limit(v - row - 0.5, -0.5, 0.5) * self._resolution
        return distance + along_x * off_x + along_y * off_y, along_x, along_y

    def match(
        self,
        guess: Pose2D,
        points: Floats,
        laser: tuple[float, float],
        *,
        deviation: tuple[float, float],
        scales: tuple[float, ...] = (0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.1, 0.1),
    ) -> Match:
        """Return the pose near *guess* at which *points* lie on surfaces.

        The method is Gauss-Newton; a beam weighs less the farther it ends from a surface (Geman and McClure).

        Args:
            guess: The robot's pose to start from.
            points: The ends of the beams in the robot's frame (m, shape `(k, 2)`).
            laser: The laser's position in the robot's frame (m). Surfaces that face away from the laser are
                ignored.
            deviation: The standard deviation (m, rad) of the guess. It keeps the guess in directions that the
                beams don't determine, such as the position along a corridor.
            scales: For each Gauss-Newton step, the distance (m) from a surface at which a beam has a quarter
                of the full weight.
        """
        x, y, yaw = guess.x, guess.y, guess.yaw
        position, heading = 1.0 / deviation[0] ** 2, 1.0 / deviation[1] ** 2
        prior = np.array((position, position, heading)) * BEAM_DEVIATION**2
        start = np.array((x, y, yaw))
        behind: _BeamsBehind | None = None
        for scale in scales:
            cos, sin = math.cos(yaw), math.sin(yaw)
            ahead = cos * points[:, 0] - sin * points[:, 1]
            aside = sin * points[:, 0] + cos * points[:, 1]
            distance, along_x, along_y = self.at(x + ahead, y + aside)
            laser_x, laser_y = cos * laser[0] - sin * laser[1], sin * laser[0] + cos * laser[1]
            # A surface that faces away from the laser lies behind another surface.
            seen = along_x * (ahead - laser_x) + along_y * (aside - laser_y) <= 0.0
            if behind is None:
                origin, ends = (x + laser_x, y + laser_y), np.stack((x + ahead, y + aside), axis=1)
                behind = self._beams_behind(origin, ends, ~seen)
            if len(behind.beams):
                beams = behind.beams
                along_x[beams], along_y[beams] = behind.normals.T
                distance[beams] = behind.distances(x + ahead[beams], y + aside[beams])
                seen[beams] = True
            slopes = np.stack((along_x, along_y, along_y * ahead - along_x * aside))
            weight = seen * (scale**2 / (scale**2 + distance**2)) ** 2
            weighted = slopes * weight
            normal = weighted @ slopes.T
            normal[np.arange(3), np.arange(3)] += prior + 1e-9  # never singular, even without a beam
            step = np.linalg.solve(normal, weighted @ distance + prior * (np.array((x, y, yaw)) - start))
            x, y, yaw = x - float(step[0]), y - float(step[1]), yaw - float(step[2])
            if np.abs(step).max() < _CONVERGED:
                break
        return Match(Pose2D(x, y, wrap_angle(yaw)), self.fit(Pose2D(x, y, yaw), points))

    def _beams_behind(
        self, origin: tuple[float, float], ends: Floats, unseen: NDArray[np.bool_]
    ) -> "_BeamsBehind":
        """Return the beams that end behind the surface which they hit, by no more than the laser's noise.

        *unseen* is the mask of the beams whose nearest surface faces away from the laser.
        """
        beams = np.flatnonzero(unseen)
        if self._visibility is None or not len(beams):
            return _BeamsBehind(beams[:0], ends[:0], np.zeros(0))
        rays = ends[beams] - origin
        lengths = np.hypot(rays[:, 0], rays[:, 1])
        dx, dy = (rays / lengths[:, None]).T
        from_x, from_y = np.full(len(beams), origin[0]), np.full(len(beams), origin[1])
        visible = self._visibility.visible_range(from_x, from_y, dx, dy, lengths)
        near = lengths - visible <= surface_tolerances(lengths, self._laser)
        hit_x, hit_y = from_x + visible * dx, from_y + visible * dy
        distance, along_x, along_y = self.at(hit_x, hit_y)
        faces = along_x * dx + along_y * dy < 0.0
        chosen = near & faces
        normals = np.stack((along_x, along_y), axis=1)[chosen]
        offsets = distance[chosen] - normals[:, 0] * hit_x[chosen] - normals[:, 1] * hit_y[chosen]
        return _BeamsBehind(beams[chosen], normals, offsets)

    def fit(self, pose: Pose2D, points: Floats) -> float:
        """Return the share (0 … 1) of *points* that fit a surface, by `surface_tolerances`.

        Args:
            pose: The robot's pose in the map.
            points: The ends of the beams in the robot's frame (m, shape `(k, 2)`).
        """
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        x = pose.x + cos * points[:, 0] - sin * points[:, 1]
        y = pose.y + sin * points[:, 0] + cos * points[:, 1]
        distance, _, _ = self.at(x, y)
        if not len(points):
            return 0.0
        # The laser's distance from the robot's centre matters little to the noise.
        tolerances = surface_tolerances(np.hypot(points[:, 0], points[:, 1]), self._laser)
        return np.count_nonzero(np.abs(distance) <= tolerances) / len(points)


def _limit(values: Floats, low: float, high: float) -> Floats:
    """Return *values*, limited to the interval from *low* to *high*; for few values faster than np.clip."""
    limited: Floats = np.minimum(np.maximum(values, low), high)
    return limited
