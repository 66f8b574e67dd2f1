"""The likelihood field: how well the end points of laser beams fall on what the map calls occupied."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserScan

FloatImage = NDArray[np.float32]


def distances(field_map: OccupancyMap, cap: float = math.inf) -> FloatImage:
    """How far (m) each cell's middle is from that of the nearest occupied cell, at most *cap*."""
    free = np.where(field_map.occupied, 0, 255).astype(np.uint8)
    if free.all():
        return np.full(free.shape, cap, dtype=np.float32)
    found: FloatImage = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(np.float32)
    found *= np.float32(field_map.resolution)
    return np.minimum(found, np.float32(cap))


def beams(scan: LaserScan, most: int, least_range: float, greatest_range: float) -> NDArray[np.float64]:
    """Where beams end in the laser's frame (m), shape ``(k, 2)``: each of every ``(n - 1) // (most - 1)``th.

    Left out are beams without an echo (±inf, NaN), under *least_range* and from *greatest_range* on.
    """
    step = max(1, (len(scan.ranges) - 1) // max(1, most - 1))
    ranges = scan.ranges[::step].astype(np.float64)
    # A comparison with NaN is False.
    seen = np.flatnonzero((ranges >= least_range) & (ranges < greatest_range))
    angles = scan.angle_min + scan.angle_increment * step * seen
    return np.stack((np.cos(angles), np.sin(angles)), axis=1) * ranges[seen, None]


class LikelihoodField:
    """What a beam adds to a particle's weight, looked up by where it ends.

    ``pz = z_hit · exp(-z²/2σ²) + z_rand / range_max`` with z (m) from the end point to the nearest occupied
    cell, at most *max_distance*, which is also z off the map. A weight is ``1 + Σ pz³`` over the beams: the
    cube sum of nav2_amcl, not a product. The image of pz³ has a margin of one cell for all that is beyond it.
    """

    def __init__(
        self,
        field_map: OccupancyMap,
        *,
        sigma_hit: float = 0.2,
        z_hit: float = 0.5,
        z_rand: float = 0.5,
        max_distance: float = 2.0,
        range_max: float = 25.0,
    ) -> None:
        z = np.pad(distances(field_map, max_distance), 1, constant_values=max_distance).astype(np.float64)
        pz = z_hit * np.exp(-(z**2) / (2.0 * sigma_hit**2)) + z_rand / range_max
        self._image = (pz**3).astype(np.float32).ravel()
        self._width = np.int32(z.shape[1])
        self._last = (np.float32(z.shape[1] - 1), np.float32(z.shape[0] - 1))
        self._scale = 1.0 / field_map.resolution
        self._origin = field_map.origin

    def weights(self, particles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """``1 + Σ pz³`` of each of *particles* (x, y, yaw; ``(n, 3)``), shape ``(n,)``.

        *points* are the beams' ends in the robot's frame (m), shape ``(k, 2)``. A sine and a cosine are taken
        for each particle, not for each beam.
        """
        ends = (points * self._scale).astype(np.float32).T
        cos = np.cos(particles[:, 2]).astype(np.float32)[:, None]
        sin = np.sin(particles[:, 2]).astype(np.float32)[:, None]
        column = ((particles[:, 0] - self._origin[0]) * self._scale + 1.0).astype(np.float32)[:, None]
        row = ((particles[:, 1] - self._origin[1]) * self._scale + 1.0).astype(np.float32)[:, None]
        columns = cos * ends[0]
        columns -= sin * ends[1]
        columns += column
        rows = sin * ends[0]
        rows += cos * ends[1]
        rows += row
        places = self._cells(rows, self._last[1])
        places *= self._width
        places += self._cells(columns, self._last[0])
        total: NDArray[np.float64] = self._image.take(places).sum(axis=1, dtype=np.float64)
        total += 1.0
        return total

    @staticmethod
    def _cells(places: FloatImage, last: np.float32) -> NDArray[np.int32]:
        np.maximum(places, np.float32(0.0), out=places)
        np.minimum(places, last, out=places)
        return places.astype(np.int32)
