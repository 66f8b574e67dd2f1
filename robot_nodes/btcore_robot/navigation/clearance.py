"""How far it is to the nearest obstacle, by the newest scan and by what a costmap remembers beside it."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.costmap import LETHAL, LocalCostmap
from btcore_robot.navigation.scan_filter import smooth_scan
from btcore_robot.robot import LaserScan, Pose2D
from btcore_robot.transforms import ExtrapolationError, TransformTree

_THREE = np.ones((1, 3), dtype=np.uint8)
_GONE = 0.05  # m by which a ray must pass what the costmap remembers before that is taken for gone


class ClearanceGrid:
    """A grid of distances (m) about the robot, in the frame of the costmap.

    Scans are smoothed before they count. What the costmap has marked and the scan sees through is left out;
    keep-outs and what the laser can't see stay.
    """

    def __init__(self, size: float = 4.0, resolution: float = 0.025) -> None:
        self.resolution = resolution
        """The side (m) of a cell."""
        self._side = round(size / resolution)
        self.origin = (0.0, 0.0)
        """The lower-left corner (m)."""
        self.distances: NDArray[np.float32] = np.zeros((self._side, self._side), dtype=np.float32)
        """How far (m) each cell's middle is from the nearest obstacle's, row 0 with the lowest y."""
        self.stamp: int | None = None
        """When the scan was taken (ns) that this is made of."""

    def update(self, scan: LaserScan, laser: Pose2D, costmap: LocalCostmap) -> None:
        """See *scan*, taken with the laser at *laser* in the costmap's frame."""
        half = self._side * self.resolution / 2
        self.origin = (laser.x - half, laser.y - half)
        ranges = smooth_scan(scan).ranges
        ranges = np.where(ranges == -np.inf, np.float32(scan.range_min), ranges)
        angles = scan.angles()
        near = ranges < 1.5 * half
        x = laser.x + np.cos(angles[near] + laser.yaw) * ranges[near]
        y = laser.y + np.sin(angles[near] + laser.yaw) * ranges[near]
        free = np.ones((self._side, self._side), dtype=np.uint8)
        self._mark(free, x, y)
        self._mark(free, *self._remembered(scan, ranges, laser, costmap))
        distances = cv2.distanceTransform(free, cv2.DIST_L2, cv2.DIST_MASK_5)
        self.distances = np.minimum(distances * self.resolution, half, dtype=np.float32)
        self.stamp = scan.stamp

    def at(self, x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float32]:
        """The distances (m) at points of the costmap's frame, in their shape; 0 off the grid."""
        cols = ((x - self.origin[0]) / self.resolution).astype(np.intp)
        rows = ((y - self.origin[1]) / self.resolution).astype(np.intp)
        outside = (cols < 0) | (cols >= self._side) | (rows < 0) | (rows >= self._side)
        if not outside.any():
            found: NDArray[np.float32] = self.distances[rows, cols]
            return found
        found = self.distances[np.where(outside, 0, rows), np.where(outside, 0, cols)]
        return np.where(outside, np.float32(0.0), found)

    def here(self, x: float, y: float) -> float:
        """The distance (m) at one point; 0 off the grid."""
        col = math.floor((x - self.origin[0]) / self.resolution)
        row = math.floor((y - self.origin[1]) / self.resolution)
        if 0 <= col < self._side and 0 <= row < self._side:
            return float(self.distances[row, col])
        return 0.0

    def _mark(self, free: NDArray[np.uint8], x: NDArray[np.floating], y: NDArray[np.floating]) -> None:
        cols = np.floor((x - self.origin[0]) / self.resolution).astype(np.intp)
        rows = np.floor((y - self.origin[1]) / self.resolution).astype(np.intp)
        inside = (cols >= 0) & (cols < self._side) & (rows >= 0) & (rows < self._side)
        free[rows[inside], cols[inside]] = 0

    def _remembered(
        self, scan: LaserScan, ranges: NDArray[np.float32], laser: Pose2D, costmap: LocalCostmap
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The points (m) of the costmap's lethal cells that the scan doesn't see through, four a cell.

        The scan's *ranges* are smoothed: of what is marked, a lone reading that was too short is gone soon.
        """
        rows, cols = np.nonzero(costmap.costs == LETHAL)
        x = costmap.origin[0] + (cols + 0.5) * costmap.resolution
        y = costmap.origin[1] + (rows + 0.5) * costmap.resolution
        east, north = x - laser.x, y - laser.y
        bearings = np.arctan2(north, east) - (laser.yaw + scan.angle_min)
        rays = np.rint((bearings % (2 * math.pi)) / scan.angle_increment).astype(np.intp)
        in_view = rays < len(ranges)
        through = cv2.erode(ranges[None, :], _THREE, borderType=cv2.BORDER_REPLICATE)[0]
        gone = in_view & (through[np.where(in_view, rays, 0)] > np.hypot(east, north) + _GONE)
        # Keep-outs are no obstacles that a laser could see through.
        kept = ~gone | (costmap.obstacles.values[rows, cols] != LETHAL)
        x, y = x[kept], y[kept]
        quarter = costmap.resolution / 4
        return (
            np.concatenate((x - quarter, x - quarter, x + quarter, x + quarter)),
            np.concatenate((y - quarter, y + quarter, y - quarter, y + quarter)),
        )


def laser_pose(tree: TransformTree, frame: str, scan: LaserScan) -> Pose2D:
    """Where the laser was in *frame* when it took *scan*, or is now if that isn't known any more or yet.

    Raises TransformError where *tree* doesn't know the laser's place at all.
    """
    try:
        return tree.lookup(frame, scan.frame, scan.stamp).to_pose()
    except ExtrapolationError:
        return tree.lookup(frame, scan.frame).to_pose()
