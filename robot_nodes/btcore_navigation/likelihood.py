"""The likelihood field: how well the end points of laser beams match the occupied cells of the map."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_navigation.parameters import AmclParameters
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserInfo, LaserScan

FloatImage = NDArray[np.float32]

SURFACE_TOLERANCE = 0.2
"""A beam that ends nearer (m) than this to a surface fits it, if the laser's noise is small at its range."""
NOISE_FACTOR = 3.0
"""A beam also fits a surface if it ends nearer than this multiple of the standard deviation of its range."""


def surface_tolerances(ranges: NDArray[np.float64], laser: LaserInfo | None) -> NDArray[np.float64]:
    """Return the distance (m) from a surface up to which each beam fits it, by the noise of the laser.

    Args:
        ranges: The ranges of the beams (m).
        laser: The laser; None for a laser whose noise is small at all ranges.
    """
    if laser is None:
        return np.full(ranges.shape, SURFACE_TOLERANCE)
    tolerances: NDArray[np.float64] = np.maximum(SURFACE_TOLERANCE, NOISE_FACTOR * laser.deviation(ranges))
    return tolerances


def with_margin(field_map: OccupancyMap, margin: float) -> OccupancyMap:
    """Return the map with unknown cells up to *margin* (m) around it.

    The outer walls of a building are at the edge of its map, and noise lets beams end behind them.
    """
    cells = math.ceil(margin / field_map.resolution)
    x, y = field_map.origin
    border = cells * field_map.resolution
    unknown = np.pad(field_map.cells, cells, constant_values=-1)
    return OccupancyMap(unknown, field_map.resolution, (x - border, y - border))


def obstacle_distances(field_map: OccupancyMap, cap: float = math.inf) -> FloatImage:
    """Return the distance (m) from the centre of each cell to the centre of the nearest occupied cell.

    Args:
        field_map: The map with the occupied cells.
        cap: The maximum distance (m) in the result. If the map has no occupied cell, all distances are *cap*.

    Returns:
        The distances, float32 in the shape of the map's cells.
    """
    free = np.where(field_map.occupied, 0, 255).astype(np.uint8)
    if free.all():  # distanceTransform needs at least one zero pixel
        return np.full(free.shape, cap, dtype=np.float32)
    image: FloatImage = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(np.float32)
    image *= np.float32(field_map.resolution)
    return np.minimum(image, np.float32(cap))


def beam_endpoints(
    scan: LaserScan, most: int, least_range: float, greatest_range: float
) -> NDArray[np.float64]:
    """Return the end points of evenly spaced beams in the laser's frame (m), shape `(k, 2)`.

    Of the scan's n beams, every `(n - 1) // (most - 1)`-th beam is chosen.

    Args:
        scan: The scan. Beams without an echo (±inf, NaN) are left out.
        most: The approximate number of beams to choose.
        least_range: Beams shorter than this (m) are left out.
        greatest_range: Beams of this length (m) or longer are left out.
    """
    step = max(1, (len(scan.ranges) - 1) // max(1, most - 1))
    ranges = scan.ranges[::step].astype(np.float64)
    # A comparison with NaN is False, so that NaN is left out too.
    seen = np.flatnonzero((ranges >= least_range) & (ranges < greatest_range))
    angles = scan.angle_min + scan.angle_increment * step * seen
    ends = np.empty((len(seen), 2))
    ends[:, 0], ends[:, 1] = np.cos(angles), np.sin(angles)
    ends *= ranges[seen, None]
    return ends


class LikelihoodField:
    """The contribution of a beam to a particle's weight, as a table over the beam's end point.

    `pz = z_hit · exp(-z²/2σ²) + z_rand / range_max`. z is the distance (m) from the end point to the
    nearest occupied cell, at most `laser_likelihood_max_dist`, which is also z off the map. σ is `sigma_hit`.
    A particle's weight is `1 + Σ pz³` over the beams: a sum of cubes as in nav2_amcl, not a product.

    Args:
        parameters: The parameters `z_hit`, `z_rand`, `sigma_hit` and `laser_likelihood_max_dist`.
        range_max: The maximum length (m) of a beam.
    """

    def __init__(self, field_map: OccupancyMap, parameters: AmclParameters, range_max: float) -> None:
        max_distance = parameters.laser_likelihood_max_dist
        distances = obstacle_distances(field_map, max_distance).astype(np.float64)
        # The margin of one cell stands for all points beyond the map.
        z = np.pad(distances, 1, constant_values=max_distance)
        hits = parameters.z_hit * np.exp(-(z**2) / (2.0 * parameters.sigma_hit**2))
        pz = hits + parameters.z_rand / range_max
        self._image = (pz**3).astype(np.float32).ravel()
        self._width = np.int32(z.shape[1])
        self._last = (np.float32(z.shape[1] - 1), np.float32(z.shape[0] - 1))
        self._scale = 1.0 / field_map.resolution
        self._origin = field_map.origin

    def weights(self, particles: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return `1 + Σ pz³` for each particle, shape `(n,)`.

        Args:
            particles: The particles' poses: x, y (m) and yaw (rad), shape `(n, 3)`.
            points: The beams' ends in the robot's frame (m), shape `(k, 2)`.
        """
        # This runs for every beam of every particle: float32, in place, sine and cosine once per particle.
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
