"""The map that key scans make: for every cell, how often it was hit, and how often seen through."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.mapping.key_scan import KeyScan
from btcore_robot.navigation.mapping.pose_arrays import Floats, transform_points
from btcore_robot.navigation.occupancy_map import OccupancyMap, Rectangle

HIT, FREE = 0.85, -0.4
"""The log-odds that a scan adds to a cell in which it hits something, and to one that it sees through."""
FEWEST_HITS = 2
"""What only one scan has hit may be noise."""
_ROOM = 5.0  # m by which the grid grows
_SHIFT = 4  # bits of a pixel's fraction, which OpenCV draws with


class LogOddsGrid:
    """A grid of cells of *resolution* (m) that grows with what `add` draws on it.

    A scan counts once in a cell, however many of its rays end there. A robot of *radius* (m) that stood
    somewhere has shown the floor there to be free. *keepout* goes on the map as it is.
    """

    def __init__(
        self, resolution: float = 0.05, radius: float = 0.27, keepout: tuple[Rectangle, ...] = ()
    ) -> None:
        self.resolution = resolution
        self.radius = radius
        self.keepout = keepout
        self.clear()
        if keepout:
            edges = np.array(keepout)
            self._make_room(edges[:, :2].min(axis=0), edges[:, 2:].max(axis=0))

    def clear(self) -> None:
        """Forget all scans, but not how large the grid has grown."""
        if not hasattr(self, "_odds"):
            self._low = (0, 0)
            self._odds = np.zeros((0, 0), dtype=np.float32)
            self._hits = np.zeros((0, 0), dtype=np.uint16)
            self._seen = np.zeros((0, 0), dtype=np.bool_)
        self._odds.fill(0.0)
        self._hits.fill(0)
        self._seen.fill(False)

    def add(self, scan: KeyScan, at: Floats) -> None:
        """Draw *scan*, taken with the robot at *at* (x, y, yaw)."""
        rim, ends = transform_points(scan.rim, at), transform_points(scan.ends, at)
        everything = np.vstack((rim, ends, at[None, :2] - self.radius, at[None, :2] + self.radius))
        self._make_room(everything.min(axis=0), everything.max(axis=0))
        low = np.array(self._low) * self.resolution
        pixels = (rim - low) / self.resolution - 0.5
        first = np.maximum(np.floor((everything.min(axis=0) - low) / self.resolution).astype(int) - 1, 0)
        last = np.ceil((everything.max(axis=0) - low) / self.resolution).astype(int) + 2
        window = slice(first[1], last[1]), slice(first[0], last[0])
        free = np.zeros(self._odds[window].shape, dtype=np.uint8)
        fixed = np.rint((pixels - first) * 2**_SHIFT).astype(np.int32)
        cv2.fillPoly(free, [fixed], 1, cv2.LINE_8, _SHIFT)
        here = (at[:2] - low) / self.resolution - 0.5 - first
        centre = np.rint(here * 2**_SHIFT).astype(int).tolist()
        reach = round(self.radius / self.resolution * 2**_SHIFT)
        cv2.circle(free, centre, reach, 1, -1, cv2.LINE_8, _SHIFT)
        hit = np.zeros(free.shape, dtype=np.bool_)
        cells = np.floor((ends - low) / self.resolution).astype(np.intp) - first
        hit[cells[:, 1], cells[:, 0]] = True
        passed = (free > 0) & ~hit
        self._odds[window] += np.float32(FREE) * passed + np.float32(HIT) * hit
        self._hits[window] += hit
        self._seen[window] |= passed | hit

    def draw(self, scans: Sequence[KeyScan], poses: Floats) -> None:
        """Draw all anew: *scans* at *poses*, ``(n, 3)``."""
        self.clear()
        for scan, at in zip(scans, poses, strict=True):
            self.add(scan, at)

    def map(self) -> OccupancyMap:
        """The map as far as it is known."""
        cells = np.full(self._odds.shape, -1, dtype=np.int8)
        cells[self._seen & (self._odds < 0.0)] = 0
        cells[(self._odds > 0.0) & (self._hits >= FEWEST_HITS)] = 100
        origin = (
            round(self._low[0] * self.resolution, 9),
            round(self._low[1] * self.resolution, 9),
        )
        return OccupancyMap(cells, self.resolution, origin, self.keepout)

    def _make_room(self, low: Floats, high: Floats) -> None:
        """Grow the grid until it holds the points from *low* to *high* (m), with a cell around them."""
        first = [math.floor(one / self.resolution) - 3 for one in low]
        last = [math.ceil(one / self.resolution) + 3 for one in high]
        height, width = self._odds.shape
        if not self._odds.size:
            self._low = (first[0], first[1])
        x0, y0 = self._low
        more = math.ceil(_ROOM / self.resolution)
        west, south = (more if first[0] < x0 else 0), (more if first[1] < y0 else 0)
        west, south = max(west, x0 - first[0]) * (west > 0), max(south, y0 - first[1]) * (south > 0)
        east = max(more, last[0] - x0 - width) if last[0] > x0 + width else 0
        north = max(more, last[1] - y0 - height) if last[1] > y0 + height else 0
        if west or south or east or north:
            sides = ((south, north), (west, east))
            self._odds = np.pad(self._odds, sides)
            self._hits = np.pad(self._hits, sides)
            self._seen = np.pad(self._seen, sides)
            self._low = (x0 - west, y0 - south)


def trimmed(map: OccupancyMap, margin: int = 4) -> OccupancyMap:
    """*map* without rows and columns at its edges that are unknown, but for *margin* cells."""
    known = map.cells != -1
    for xmin, ymin, xmax, ymax in map.keepout:
        for row, col in (map.cell(xmin, ymin), map.cell(xmax, ymax)):
            if 0 <= row < map.height and 0 <= col < map.width:
                known[row, col] = True
    if not known.any():
        return map
    rows: NDArray[np.intp] = np.flatnonzero(known.any(axis=1))
    cols: NDArray[np.intp] = np.flatnonzero(known.any(axis=0))
    low_row, low_col = max(0, int(rows[0]) - margin), max(0, int(cols[0]) - margin)
    cells = map.cells[low_row : int(rows[-1]) + 1 + margin, low_col : int(cols[-1]) + 1 + margin]
    origin = (
        round(map.origin[0] + low_col * map.resolution, 9),
        round(map.origin[1] + low_row * map.resolution, 9),
    )
    return OccupancyMap(np.ascontiguousarray(cells), map.resolution, origin, map.keepout)
