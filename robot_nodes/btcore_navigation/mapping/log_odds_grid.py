"""An occupancy grid drawn from key scans: the log-odds of each cell and its number of hits."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_navigation.mapping.key_scan import KeyScan
from btcore_navigation.mapping.pose_arrays import Floats, transform_points
from btcore_robot.occupancy_map import OccupancyMap, Rectangle

HIT, FREE = 0.85, -0.4
"""The log-odds that a scan adds to a cell in which a ray ends, and to a cell that rays pass through."""
MIN_HITS = 2
"""The minimum number of scans that hit an occupied cell; a single hit may be noise."""
_GROWTH = 5.0  # m by which the grid grows at least
_MARGIN = 4  # unknown rows and columns that a trimmed map keeps at each edge
_SHIFT = 4  # bits for the fractions of pixel coordinates in OpenCV's drawing functions


class LogOddsGrid:
    """A grid of cells that grows as `add` draws scans on it.

    A scan counts once per cell, however many of its rays end there. The floor under the robot counts as free.

    Args:
        resolution: The side (m) of a cell.
        radius: The robot's radius (m).
        keepout: Rectangles that are added to the map unchanged.
    """

    def __init__(self, resolution: float, radius: float, keepout: tuple[Rectangle, ...] = ()) -> None:
        self.resolution = resolution
        self.radius = radius
        self.keepout = keepout
        self._low_cell = (0, 0)
        self._log_odds = np.zeros((0, 0), dtype=np.float32)
        self._hits = np.zeros((0, 0), dtype=np.uint16)
        self._observed = np.zeros((0, 0), dtype=np.bool_)
        if keepout:
            edges = np.array(keepout)
            self._make_room(edges[:, :2].min(axis=0), edges[:, 2:].max(axis=0))

    def clear(self) -> None:
        """Forget all scans but keep the size of the grid."""
        self._log_odds.fill(0.0)
        self._hits.fill(0)
        self._observed.fill(False)

    def add(self, scan: KeyScan, at: Floats) -> None:
        """Draw a scan; enlarge the grid if necessary.

        Args:
            scan: The scan to draw.
            at: The robot's pose at the time of the scan, in the frame map: x, y (m) and yaw (rad), shape
                `(3,)`.
        """
        free_outline, ends = transform_points(scan.free_outline, at), transform_points(scan.ends, at)
        extent = np.vstack((free_outline, ends, at[None, :2] - self.radius, at[None, :2] + self.radius))
        self._make_room(extent.min(axis=0), extent.max(axis=0))
        low = np.array(self._low_cell) * self.resolution
        pixels = (free_outline - low) / self.resolution - 0.5
        first = np.maximum(np.floor((extent.min(axis=0) - low) / self.resolution).astype(int) - 1, 0)
        last = np.ceil((extent.max(axis=0) - low) / self.resolution).astype(int) + 2
        window = slice(first[1], last[1]), slice(first[0], last[0])
        free = np.zeros(self._log_odds[window].shape, dtype=np.uint8)
        # The outline of the free floor is filled first; cells in which rays end are then taken out of it.
        fixed = np.rint((pixels - first) * 2**_SHIFT).astype(np.int32)
        cv2.fillPoly(free, [fixed], 1, cv2.LINE_8, _SHIFT)
        centre_cell = (at[:2] - low) / self.resolution - 0.5 - first
        centre = np.rint(centre_cell * 2**_SHIFT).astype(int).tolist()
        radius = round(self.radius / self.resolution * 2**_SHIFT)
        cv2.circle(free, centre, radius, 1, -1, cv2.LINE_8, _SHIFT)
        hit = np.zeros(free.shape, dtype=np.bool_)
        cells = np.floor((ends - low) / self.resolution).astype(np.intp) - first
        hit[cells[:, 1], cells[:, 0]] = True
        seen_through = (free > 0) & ~hit
        self._log_odds[window] += np.float32(FREE) * seen_through + np.float32(HIT) * hit
        self._hits[window] += hit
        self._observed[window] |= seen_through | hit

    def draw(self, scans: Sequence[KeyScan], poses: Floats) -> None:
        """Clear the grid and draw scans.

        Args:
            scans: The scans to draw.
            poses: The robot's pose at the time of each scan, in the frame map: x, y (m) and yaw (rad), shape
                `(n, 3)`.

        Raises:
            ValueError: The numbers of scans and poses differ.
        """
        self.clear()
        for scan, pose in zip(scans, poses, strict=True):
            self.add(scan, pose)

    def map(self) -> OccupancyMap:
        """Return the map of all cells; cells without an observation are unknown."""
        cells = np.full(self._log_odds.shape, -1, dtype=np.int8)
        cells[self._observed & (self._log_odds < 0.0)] = 0
        # A probably occupied cell with too few hits stays unknown.
        cells[(self._log_odds > 0.0) & (self._hits >= MIN_HITS)] = 100
        # Rounded, so that the origin in the map's YAML file has no floating-point noise.
        x, y = (round(cell * self.resolution, 9) for cell in self._low_cell)
        return OccupancyMap(cells, self.resolution, (x, y), self.keepout)

    def _make_room(self, low: Floats, high: Floats) -> None:
        """Grow the grid until it holds the points from *low* to *high* (m) and a margin of cells."""
        first = [math.floor(coordinate / self.resolution) - 3 for coordinate in low]
        last = [math.ceil(coordinate / self.resolution) + 3 for coordinate in high]
        height, width = self._log_odds.shape
        if not self._log_odds.size:
            self._low_cell = (first[0], first[1])
        x0, y0 = self._low_cell
        more = math.ceil(_GROWTH / self.resolution)
        # Growing by a large step makes it rare that the arrays are copied.
        west = max(more, x0 - first[0]) if first[0] < x0 else 0
        south = max(more, y0 - first[1]) if first[1] < y0 else 0
        east = max(more, last[0] - x0 - width) if last[0] > x0 + width else 0
        north = max(more, last[1] - y0 - height) if last[1] > y0 + height else 0
        if west or south or east or north:
            sides = ((south, north), (west, east))
            self._log_odds = np.pad(self._log_odds, sides)
            self._hits = np.pad(self._hits, sides)
            self._observed = np.pad(self._observed, sides)
            self._low_cell = (x0 - west, y0 - south)


def trim_map(map: OccupancyMap) -> OccupancyMap:
    """Return a map with only four unknown rows and columns at each edge.

    Args:
        map: The map to trim. A map without known cells and keep-outs is returned unchanged.
    """
    known = map.cells != -1
    for xmin, ymin, xmax, ymax in map.keepout:
        for row, col in (map.cell(xmin, ymin), map.cell(xmax, ymax)):
            if 0 <= row < map.height and 0 <= col < map.width:
                known[row, col] = True
    if not known.any():
        return map
    rows: NDArray[np.intp] = np.flatnonzero(known.any(axis=1))
    cols: NDArray[np.intp] = np.flatnonzero(known.any(axis=0))
    low_row, low_col = max(0, int(rows[0]) - _MARGIN), max(0, int(cols[0]) - _MARGIN)
    cells = map.cells[low_row : int(rows[-1]) + 1 + _MARGIN, low_col : int(cols[-1]) + 1 + _MARGIN]
    x = round(map.origin[0] + low_col * map.resolution, 9)
    y = round(map.origin[1] + low_row * map.resolution, 9)
    return OccupancyMap(np.ascontiguousarray(cells), map.resolution, (x, y), map.keepout)
