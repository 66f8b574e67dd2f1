"""Distances to the nearest obstacle, from the newest scan and from the obstacles that a costmap remembers.

`smooth_scan` filters the noise of a scan for code that looks for the nearest obstacle. A reading of Tiago's
laser has a noise of 6 cm (σ), and the nearest of some hundred readings is 15 to 20 cm too near. Without a
filter, walls in a costmap grow towards the robot, and doors close.
"""

import math
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_navigation.costmap import LETHAL, LocalCostmap
from btcore_robot.robot import LaserScan, Pose2D
from btcore_robot.transforms import ExtrapolationError, TransformTree

_NO_ECHO_RANGE = 30.0  # m: stands for a ray without an echo
_MEDIAN_RAYS = 5  # rays; fewer than three equal readings among them count as noise
_RAYS_BESIDE = 4  # rays on either side that are averaged: 5 cm in total at a distance of 1 m
_MAX_STEP = 0.2  # m: neighbours farther apart than this belong to different surfaces

_THREE_RAYS = np.ones((1, 3), dtype=np.uint8)
_ALLOWED_LOSS = 0.01  # m of clearance that the robot may lose where it is too near an obstacle already
_PASSING_DISTANCE = 0.05  # m by which a ray must pass a remembered obstacle that counts as gone


def smooth_scan(scan: LaserScan) -> LaserScan:
    """Return *scan* without lone readings, each reading averaged with its neighbours on the same surface.

    Readings that are too near (-inf) stay, and invalid readings (NaN) become readings without an echo. Only
    objects that three adjacent rays hit remain: a table leg of 3 cm remains up to a distance of 1.5 m.
    """
    ranges = scan.ranges
    is_too_near = ranges == -np.inf
    row = np.where(np.isfinite(ranges), np.minimum(ranges, _NO_ECHO_RANGE), _NO_ECHO_RANGE).astype(np.float32)
    row[is_too_near] = scan.range_min
    # The median removes lone readings; the mean over readings of the same surface then reduces the noise.
    row = np.asarray(cv2.medianBlur(row[None, :], _MEDIAN_RAYS)[0], dtype=np.float32)
    padded = np.concatenate((row[:1].repeat(_RAYS_BESIDE), row, row[-1:].repeat(_RAYS_BESIDE)))
    # Row i has the readings beside reading i: a view, as by sliding_window_view, which is slower.
    shape, strides = (len(row), 2 * _RAYS_BESIDE + 1), padded.strides * 2
    neighbours: NDArray[np.float32] = np.ndarray(shape, np.float32, padded, strides=strides)
    on_surface = (np.abs(neighbours - row[:, None]) < _MAX_STEP).astype(np.float32)
    flat = np.einsum("ij,ij->i", neighbours, on_surface) / np.einsum("ij->i", on_surface)
    # The mean may be slightly below _NO_ECHO_RANGE where a long reading is among the neighbours.
    flat[flat > _NO_ECHO_RANGE - 1.0] = np.inf
    flat[is_too_near] = -np.inf
    return replace(scan, ranges=flat)


class ScanSmoother:
    """Smooths scans by `smooth_scan`; users of the same scan share the result."""

    def __init__(self) -> None:
        self._last: tuple[LaserScan, LaserScan] | None = None

    def smooth(self, scan: LaserScan) -> LaserScan:
        """Return the smoothed *scan*; the result for the last scan is kept."""
        if self._last is None or self._last[0] is not scan:
            self._last = (scan, smooth_scan(scan))
        return self._last[1]


class ClearanceGrid:
    """A grid of distances (m) to obstacles around the robot, in the frame of the local costmap.

    Obstacles are the end points of the smoothed scan, and the obstacles that the costmap remembers. An
    obstacle of the costmap through which the scan sees is ignored; keep-outs and obstacles outside the
    laser's view are kept.

    Args:
        costmap: The source of the frame, of remembered obstacles and of the radius of the robot.
    """

    def __init__(self, costmap: LocalCostmap) -> None:
        self._costmap = costmap
        self.frame = costmap.frame
        """The frame of the grid."""
        self.required = costmap.inflation.radius
        """The distance (m) that the centre of the robot keeps from obstacles while it drives."""
        self.resolution = 0.025
        """The side length (m) of a cell."""
        self._side = round(4.0 / self.resolution)  # cells in 4 m
        self.origin = (0.0, 0.0)
        """The lower-left corner (x, y in m)."""
        self.distances: NDArray[np.float32] = np.zeros((self._side, self._side), dtype=np.float32)
        """The distance (m) from each cell's centre to the centre of the nearest occupied cell.

        Row 0 has the lowest y. The distances are at most half the grid's side.
        """
        self.stamp: int | None = None
        """The stamp (ns) of the scan from which the grid was made."""
        self.smoother = ScanSmoother()
        """The filter of the scans; costmaps of the same robot may use it too."""

    def update(self, scan: LaserScan, laser: Pose2D) -> None:
        """Compute the grid again.

        Args:
            scan: The newest scan.
            laser: The laser's pose in the grid's frame when it took the scan.
        """
        half = self._side * self.resolution / 2
        self.origin = (laser.x - half, laser.y - half)
        ranges = self.smoother.smooth(scan).ranges
        ranges = np.where(ranges == -np.inf, np.float32(scan.range_min), ranges)
        angles = scan.angles()
        # The corners of the grid are √2 times *half* away.
        is_near = ranges < 1.5 * half
        x = laser.x + np.cos(angles[is_near] + laser.yaw) * ranges[is_near]
        y = laser.y + np.sin(angles[is_near] + laser.yaw) * ranges[is_near]
        free = np.ones((self._side, self._side), dtype=np.uint8)
        self._mark(free, x, y)
        self._mark(free, *self._remembered_points(scan, ranges, laser))
        distances = np.asarray(cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5), dtype=np.float32)
        distances *= self.resolution
        self.distances = np.minimum(distances, half, out=distances)
        self.stamp = scan.stamp

    def distances_at(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
        """Return the distance (m) from each point to the nearest obstacle; 0 off the grid.

        Args:
            x: The points' x coordinates (m) in the grid's frame.
            y: The points' y coordinates (m), of the same shape.

        Returns:
            The distances, of the same shape.
        """
        rows, cols, is_inside = self._cells(x, y)
        if is_inside.all():
            distances: NDArray[np.float32] = self.distances[rows, cols]
            return distances
        distances = self.distances[np.where(is_inside, rows, 0), np.where(is_inside, cols, 0)]
        return np.where(is_inside, distances, np.float32(0.0))

    def required_from(self, present: float) -> float:
        """Return the required distance (m) of a robot with the distance *present* (m).

        A robot that is too near an obstacle already may move, but not much nearer.
        """
        return min(self.required, present - _ALLOWED_LOSS)

    def distance_at(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the nearest obstacle; 0 off the grid.

        Args:
            x: The point's x coordinate (m) in the grid's frame.
            y: The point's y coordinate (m) in the grid's frame.
        """
        col = math.floor((x - self.origin[0]) / self.resolution)
        row = math.floor((y - self.origin[1]) / self.resolution)
        if 0 <= col < self._side and 0 <= row < self._side:
            return float(self.distances[row, col])
        return 0.0

    def _cells(
        self, x: NDArray[np.floating], y: NDArray[np.floating]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], NDArray[np.bool_]]:
        """Return the rows and the columns of points, and whether they are on the grid."""
        cols = np.floor((x - self.origin[0]) / self.resolution).astype(np.intp)
        rows = np.floor((y - self.origin[1]) / self.resolution).astype(np.intp)
        # As unsigned numbers, negative indices are above every side.
        return rows, cols, (cols.view(np.uintp) < self._side) & (rows.view(np.uintp) < self._side)

    def _mark(self, free: NDArray[np.uint8], x: NDArray[np.floating], y: NDArray[np.floating]) -> None:
        rows, cols, is_inside = self._cells(x, y)
        free[rows[is_inside], cols[is_inside]] = 0

    def _remembered_points(
        self, scan: LaserScan, ranges: NDArray[np.float32], laser: Pose2D
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the x and y (m) of four points per lethal cell that the scan doesn't see through.

        *ranges* are the smoothed readings, so that the mark of a single short reading disappears soon.
        """
        costmap = self._costmap
        rows, cols = np.nonzero(costmap.costs == LETHAL)
        x = costmap.origin[0] + (cols + 0.5) * costmap.resolution
        y = costmap.origin[1] + (rows + 0.5) * costmap.resolution
        east, north = x - laser.x, y - laser.y
        bearings = np.arctan2(north, east) - (laser.yaw + scan.angle_min)
        rays = np.rint((bearings % (2 * math.pi)) / scan.angle_increment).astype(np.intp)
        in_view = rays < len(ranges)
        # The least of three neighbouring rays, so that a single ray past an edge doesn't clear a cell.
        through = cv2.erode(ranges[None, :], _THREE_RAYS, borderType=cv2.BORDER_REPLICATE)[0]
        gone = in_view & (through[np.where(in_view, rays, 0)] > np.hypot(east, north) + _PASSING_DISTANCE)
        # A keep-out is not an obstacle, so that a ray that passes it proves nothing.
        kept = ~gone | (costmap.obstacles.values[rows, cols] != LETHAL)
        x, y = x[kept], y[kept]
        # The costmap's cells are twice as wide as those of this grid: four points mark the whole cell.
        quarter = costmap.resolution / 4
        return (
            np.concatenate((x - quarter, x - quarter, x + quarter, x + quarter)),
            np.concatenate((y - quarter, y + quarter, y - quarter, y + quarter)),
        )


def laser_pose(tree: TransformTree, frame: str, scan: LaserScan) -> Pose2D:
    """Return the laser's pose in *frame* at the time of *scan*, or else the laser's newest pose.

    Args:
        tree: The tree with the transforms between the laser's frame and *frame*.
        frame: The frame in which the pose is returned.
        scan: The scan; its frame is the laser's frame.

    Returns:
        The pose at the scan's stamp, or the newest pose if the transforms of that moment are gone or pending.

    Raises:
        TransformError: *tree* has no transform between the two frames.
    """
    try:
        return tree.lookup(frame, scan.frame, scan.stamp).to_pose()
    except ExtrapolationError:
        return tree.lookup(frame, scan.frame).to_pose()
