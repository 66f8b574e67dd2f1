"""The layers of a costmap (the map, the laser's obstacles, the inflation), and windows of a grid."""

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.occupancy_map import OccupancyMap, Rectangle
from btcore_robot.robot import LaserScan, Pose2D

FREE = 0
"""The cost of a cell without obstacles around it."""
INSCRIBED = 253
"""The cost of a cell on which the robot's centre would certainly cause a collision."""
LETHAL = 254
"""The cost of an obstacle's cell."""
UNKNOWN = 255
"""The cost of a cell that was not observed."""

_NEVER = np.iinfo(np.int64).min
"""The time (ns) of the last mark of a cell that was never marked."""

_SHIFT = 4  # fractional bits of the coordinates with which OpenCV draws lines and polygons
_FIXED_POINT = 1 << _SHIFT


class GridWindow(NamedTuple):
    """A rectangle of cells of a grid; *high_row* and *high_col* are excluded."""

    low_row: int
    low_col: int
    high_row: int
    high_col: int

    @classmethod
    def clipped(
        cls, low_row: int, low_col: int, high_row: int, high_col: int, shape: tuple[int, int]
    ) -> "GridWindow":
        """Return the part of a window that is on a grid; an empty window if no cell is on the grid.

        Args:
            low_row: The first row of the window; it may be negative.
            low_col: The first column of the window; it may be negative.
            high_row: The row after the last row of the window.
            high_col: The column after the last column of the window.
            shape: The number of rows and columns of the grid.
        """
        window = cls(max(0, low_row), max(0, low_col), min(shape[0], high_row), min(shape[1], high_col))
        return cls(0, 0, 0, 0) if window.is_empty else window

    @property
    def slices(self) -> tuple[slice, slice]:
        """The index of this window in an array."""
        return slice(self.low_row, self.high_row), slice(self.low_col, self.high_col)

    @property
    def is_empty(self) -> bool:
        """Whether the window holds no cell."""
        return self.low_row >= self.high_row or self.low_col >= self.high_col

    def grown(self, cells: int, shape: tuple[int, int]) -> "GridWindow":
        """Return this window enlarged on every side, clipped to the grid.

        Args:
            cells: The number of cells to add on each side.
            shape: The number of rows and columns of the grid.
        """
        low_row, low_col = self.low_row - cells, self.low_col - cells
        return GridWindow.clipped(low_row, low_col, self.high_row + cells, self.high_col + cells, shape)

    def of(self, inner: "GridWindow") -> tuple[slice, slice]:
        """Return the index of the window *inner* in an array that covers this window."""
        return (
            slice(inner.low_row - self.low_row, inner.high_row - self.low_row),
            slice(inner.low_col - self.low_col, inner.high_col - self.low_col),
        )


def bounding_window(mask: NDArray[np.bool_], window: GridWindow) -> GridWindow:
    """Return the smallest window of a grid that contains all true cells of a mask; empty if there are none.

    Args:
        mask: The mask, of the shape of *window*.
        window: The window of the grid that *mask* covers.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    if not len(rows):
        return GridWindow(0, 0, 0, 0)
    cols = np.flatnonzero(mask.any(axis=0))
    row, col = window.low_row, window.low_col
    return GridWindow(
        row + int(rows[0]), col + int(cols[0]), row + int(rows[-1]) + 1, col + int(cols[-1]) + 1
    )


def static_costs(map: OccupancyMap, *, track_unknown: bool = True) -> NDArray[np.uint8]:
    """Return the costs of a map's cells, without inflation.

    Occupied cells (100) and keep-outs are LETHAL. All other known cells are FREE, also cells with a
    likelihood between 0 and 100.

    Args:
        map: The map to convert.
        track_unknown: Whether unknown cells outside keep-outs are UNKNOWN; otherwise they are FREE.

    Returns:
        The costs, uint8 of shape `(height, width)`, row 0 with the lowest y.
    """
    costs = np.full(map.cells.shape, FREE, dtype=np.uint8)
    if track_unknown:
        costs[map.unknown] = UNKNOWN
    costs[map.occupied | map.keepout_mask()] = LETHAL
    return costs


def draw_keepouts(
    costs: NDArray[np.uint8],
    resolution: float,
    origin: tuple[float, float],
    keepout: tuple[Rectangle, ...],
    frame: Pose2D,
) -> None:
    """Make keep-out rectangles LETHAL in a grid.

    Args:
        costs: The grid's costs, changed in place.
        resolution: The side length (m) of a cell.
        origin: The lower-left corner (m) of the grid.
        keepout: The rectangles, in the frame map.
        frame: The pose of the frame map in the grid's frame.
    """
    cos, sin = math.cos(frame.yaw), math.sin(frame.yaw)
    # The corners of all rectangles, shape (rectangles, 4).
    sides = np.array(keepout, dtype=np.float64).reshape(-1, 4)
    east, north = sides[:, (0, 2, 2, 0)], sides[:, (1, 1, 3, 3)]
    pixels = np.empty((*east.shape, 2))
    pixels[..., 0] = (frame.x + cos * east - sin * north - origin[0]) / resolution - 0.5
    pixels[..., 1] = (frame.y + sin * east + cos * north - origin[1]) / resolution - 0.5
    for outline in np.rint(pixels * _FIXED_POINT).astype(np.int32):
        cv2.fillConvexPoly(costs, outline, LETHAL, cv2.LINE_8, _SHIFT)


class InflationLayer:
    """Costs around lethal cells by Nav2's formula, for cells of *resolution* (m).

    At a distance d (m) between the centres of cells, the cost is 254 for d = 0, 253 for d ≤ *radius*, beyond
    that ⌊252·exp(-*scaling*·(d - *radius*))⌋, and 0 for d > *inflation_radius*.
    """

    def __init__(self, radius: float, inflation_radius: float, scaling: float, resolution: float) -> None:
        self.radius = radius
        self.inflation_radius = inflation_radius
        self.scaling = scaling
        self.resolution = resolution
        # Rounding must not cut a radius of whole cells: 0.3 / 0.05 is slightly less than 6.
        reach = max(inflation_radius, radius) / resolution + 1e-9
        self.cells = math.floor(reach)
        """The distance (cells) up to which an obstacle has costs around it."""
        # Squared distances between cells are whole numbers, so that a table holds the costs of all of them.
        squares = np.arange((self.cells + 1) ** 2 + 1)
        self._by_square = np.array(
            [self.cost(math.sqrt(square) * resolution) for square in squares], dtype=np.uint8
        )
        self._by_square[-1] = FREE

    def cost(self, distance: float) -> int:
        """Return the cost at *distance* (m) from the nearest lethal cell."""
        epsilon = 1e-9
        if distance == 0:
            return LETHAL
        if distance <= self.radius + epsilon:
            return INSCRIBED
        if distance > self.inflation_radius + epsilon:
            return FREE
        return math.floor((INSCRIBED - 1) * math.exp(-self.scaling * (distance - self.radius)) + epsilon)

    def inflate(self, base: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """Return *base* with costs around its LETHAL cells; only INSCRIBED and LETHAL replace UNKNOWN."""
        open_cells = (base != LETHAL).astype(np.uint8)
        distance = cv2.distanceTransform(open_cells, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        # float32 is accurate enough to round the squares to whole numbers.
        squares = np.minimum(distance, self.cells + 1.0)
        squares *= squares
        squares += 0.5
        around_obstacles = self._by_square[squares.astype(np.intp)]
        costs: NDArray[np.uint8] = np.maximum(base, around_obstacles)
        replaced = (base == UNKNOWN) & (around_obstacles >= INSCRIBED)
        costs[replaced] = around_obstacles[replaced]
        return costs


class ObstacleLayer:
    """The observations of a planar laser: LETHAL in cells with a hit, FREE where rays crossed later.

    Cells that no ray has reached have *default_value*: FREE, or UNKNOWN if the map's cost is used there. A
    finite reading from *min_range* to *max_range* (m) marks its end point. Every ray frees the cells that it
    crosses, up to *raytrace_range* (m): a finite reading up to the cell before its end point, a reading
    without an echo (+inf) over the whole range. Readings that are too near (-inf) or invalid (NaN) are
    ignored.
    """

    def __init__(
        self,
        shape: tuple[int, int],
        resolution: float,
        default_value: int,
        *,
        min_range: float,
        max_range: float,
        raytrace_range: float,
    ) -> None:
        self.default_value = default_value
        self.restart(shape)
        self.resolution = resolution
        self.min_range = min_range
        self.max_range = max_range
        self.raytrace_range = raytrace_range

    def restart(self, shape: tuple[int, int]) -> None:
        """Replace the grid by a grid of *shape* without observations."""
        self.values = np.full(shape, self.default_value, dtype=np.uint8)
        self._marked_at = np.full(shape, _NEVER, dtype=np.int64)
        """The stamp (ns) of the scan that marked each cell last."""

    def rebuild(self, shape: tuple[int, int], rows: int, cols: int, since: int) -> None:
        """Replace the grid by another grid of the same resolution, and keep the cells that were marked last.

        Args:
            shape: The number of rows and columns of the new grid.
            rows: The row of the present grid that is the first row of the new grid; it may be negative.
            cols: The column of the present grid that is the first column of the new grid.
            since: The stamp (ns) from which on marked cells stay LETHAL.
        """
        marked = np.argwhere((self.values == LETHAL) & (self._marked_at >= since))
        stamps = self._marked_at[marked[:, 0], marked[:, 1]]
        self.restart(shape)
        moved = marked - (rows, cols)
        on_grid = ((moved >= 0) & (moved < shape)).all(axis=1)
        new_rows, new_cols = moved[on_grid].T
        self.values[new_rows, new_cols] = LETHAL
        self._marked_at[new_rows, new_cols] = stamps[on_grid]

    def update_from_scan(self, scan: LaserScan, laser: Pose2D, origin: tuple[float, float]) -> None:
        """Clear and mark cells by a scan.

        Args:
            scan: The scan, smoothed or raw.
            laser: The laser's pose in the grid's frame.
            origin: The lower-left corner (m) of the grid.
        """
        ranges = scan.ranges.astype(np.float64)
        nearest = max(self.min_range, scan.range_min)
        echo = np.isfinite(ranges) & (ranges >= nearest) & (ranges < scan.range_max)
        silent = (ranges == np.inf) | (np.isfinite(ranges) & (ranges >= scan.range_max))
        # In pixels, as OpenCV counts them: the centre of the first cell is 0, 0.
        x = (laser.x - origin[0]) / self.resolution - 0.5
        y = (laser.y - origin[1]) / self.resolution - 0.5
        angles = scan.angles() + laser.yaw
        cos, sin = np.cos(angles), np.sin(angles)
        reach = min(self.raytrace_range, scan.range_max) / self.resolution
        hits = ranges[echo] / self.resolution
        free = np.zeros(len(ranges))
        free[echo] = np.minimum(hits - 1.0, reach)
        free[silent] = reach
        # First clear, then mark: a ray must not erase the end point of its neighbour.
        self._clear(x, y, cos, sin, free)
        near = hits <= self.max_range / self.resolution
        rows = np.floor(y + 0.5 + sin[echo][near] * hits[near]).astype(np.intp)
        cols = np.floor(x + 0.5 + cos[echo][near] * hits[near]).astype(np.intp)
        height, width = self.values.shape
        on_grid = (rows >= 0) & (rows < height) & (cols >= 0) & (cols < width)
        rows, cols = rows[on_grid], cols[on_grid]
        self.values[rows, cols] = LETHAL
        self._marked_at[rows, cols] = scan.stamp

    def reachable(self, laser: Pose2D, origin: tuple[float, float]) -> GridWindow:
        """Return the window of cells that a scan can change.

        Args:
            laser: The laser's pose in the grid's frame.
            origin: The lower-left corner (m) of the grid.
        """
        far = math.ceil(max(self.max_range, self.raytrace_range) / self.resolution) + 2
        row = math.floor((laser.y - origin[1]) / self.resolution)
        col = math.floor((laser.x - origin[0]) / self.resolution)
        return GridWindow.clipped(row - far, col - far, row + far, col + far, self.values.shape)

    def free_disc(self, place: Pose2D, radius: float, origin: tuple[float, float]) -> None:
        """Free the cells under the robot.

        Args:
            place: The robot's pose in the grid's frame.
            radius: A cell becomes FREE if its centre is at most this far (m) from *place*.
            origin: The lower-left corner (m) of the grid.
        """
        x = (place.x - origin[0]) / self.resolution - 0.5
        y = (place.y - origin[1]) / self.resolution - 0.5
        reach = radius / self.resolution
        low_row, low_col = math.floor(y - reach), math.floor(x - reach)
        high_row, high_col = math.ceil(y + reach) + 1, math.ceil(x + reach) + 1
        window = GridWindow.clipped(low_row, low_col, high_row, high_col, self.values.shape)
        rows = np.arange(window.low_row, window.high_row) - y
        cols = np.arange(window.low_col, window.high_col) - x
        self.values[window.slices][rows[:, None] ** 2 + cols**2 <= reach**2] = FREE

    def forget(
        self, window: GridWindow | None = None, *, outside: bool = False, before: int | None = None
    ) -> None:
        """Reset cells to the default value.

        Args:
            window: The window whose cells are reset; None resets all cells.
            outside: Whether to reset the cells outside *window* instead.
            before: The stamp (ns) from which on marked cells stay LETHAL; None resets them, too.
        """
        reset = np.full(self.values.shape, window is None or outside, dtype=np.bool_)
        if window is not None:
            reset[window.slices] = not outside
        if before is not None:
            reset &= (self.values != LETHAL) | (self._marked_at < before)
        self.values[reset] = self.default_value

    def shift(self, rows: int, cols: int) -> None:
        """Move the grid over the floor. Cells that leave the grid are lost; new cells get *default_value*.

        Args:
            rows: The number of cells to move the grid in the direction of y; negative against it.
            cols: The number of cells to move the grid in the direction of x; negative against it.
        """
        height, width = shape = self.values.shape
        old = GridWindow.clipped(rows, cols, height + rows, width + cols, shape)
        new = GridWindow.clipped(-rows, -cols, height - rows, width - cols, shape)
        values = np.full(shape, self.default_value, dtype=np.uint8)
        values[new.slices] = self.values[old.slices]
        marked_at = np.full(shape, _NEVER, dtype=np.int64)
        marked_at[new.slices] = self._marked_at[old.slices]
        self.values, self._marked_at = values, marked_at

    def _clear(
        self,
        x: float,
        y: float,
        cos: NDArray[np.float64],
        sin: NDArray[np.float64],
        free: NDArray[np.float64],
    ) -> None:
        crossing = free > 0
        reach = free[crossing]
        lines = np.empty((len(reach), 2, 2))
        lines[:, 0] = (x, y)
        lines[:, 1, 0] = x + cos[crossing] * reach
        lines[:, 1, 1] = y + sin[crossing] * reach
        if len(lines):
            lines *= _FIXED_POINT
            fixed: Any = np.rint(lines, out=lines).astype(np.int32)  # OpenCV also takes an array of lines
            cv2.polylines(self.values, fixed, False, FREE, 1, cv2.LINE_8, _SHIFT)
