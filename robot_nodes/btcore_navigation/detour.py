"""Search for a detour: a short way around an obstacle on the path, near the robot."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from btcore_navigation.clearance import ClearanceGrid
from btcore_robot.robot import Pose2D

_CELL_STRIDE = 2  # a cell of the search is this many cells of the clearance grid wide
_FULL_CLEARANCE = 0.23  # m more than the required clearance: from there more clearance is no cheaper
_CLEARANCE_COST = 6.0  # in addition to the cost 1 of a cell, if the cell has only the required clearance
_ESCAPE_REACH = 0.4  # m around the robot within which a detour may have too little clearance
_ESCAPE_COST = 20.0  # cost of a cell with too little clearance; a free cell costs 1 to 7
_ESCAPE_LOSS = 0.02  # m of clearance that the robot may lose while it drives out of a narrow place
_PREVIOUS_WAY_FACTOR = 0.6  # factor on the cost of cells on the previous way
_PREVIOUS_WAY_BRUSH = np.ones((5, 5), dtype=np.uint8)
# A detour may be 1.5 times as long as the straight line plus 0.5 m; longer ways are left to the planner.
_MAX_RATIO, _MAX_EXTRA = 1.5, 0.5


def find_detour(
    clearance: ClearanceGrid,
    start: Pose2D,
    targets: NDArray[np.float64],
    radius: float,
    last: NDArray[np.float64] | None = None,
) -> tuple[int, NDArray[np.float64]] | None:
    """Find a short way from *start* to the first reachable target.

    Several targets are tried, because a target may look free although no short way leads there: for instance
    a target inside a box whose front hides the other sides from the laser.

    Args:
        clearance: The grid of distances to obstacles. The search stays on this grid, and all points are in
            the grid's frame.
        start: The robot's pose, at which the detour begins.
        targets: Points (m, shape `(k, 2)`) in order of preference.
        radius: The distance (m) to keep from obstacles.
        last: The previous detour (m, shape `(n, 2)`), at least a point per cell. Its cells are cheaper, so
            that noise doesn't make the robot alternate between two sides of the obstacle.

    Returns:
        The index of the target and the points (m, shape `(n, 2)`) of the way; None if no target has a
        short way: at most 1.5 times the straight distance plus 0.5 m.
    """
    resolution = clearance.resolution * _CELL_STRIDE
    distances = clearance.distances[_CELL_STRIDE // 2 :: _CELL_STRIDE, _CELL_STRIDE // 2 :: _CELL_STRIDE]
    first = _cell(clearance, start.x, start.y, resolution)
    height, width = distances.shape
    if not (0 <= first[0] < height and 0 <= first[1] < width):
        return None
    start_clearance = float(distances[first])
    full = round(radius + _FULL_CLEARANCE, 6)
    costs = 1.0 + _CLEARANCE_COST * np.maximum(full - distances, 0.0) / (full - radius)
    costs[distances < radius] = -1.0  # MCP_Geometric takes a negative cost for impassable
    if start_clearance < radius:
        reach = int(_ESCAPE_REACH / resolution)
        low_row, low_col = max(first[0] - reach, 0), max(first[1] - reach, 0)
        around = (slice(low_row, first[0] + reach + 1), slice(low_col, first[1] + reach + 1))
        costs[around][distances[around] >= start_clearance - _ESCAPE_LOSS] = _ESCAPE_COST
    if last is not None and len(last):
        cols = ((last[:, 0] - clearance.origin[0]) / resolution).astype(np.intp)
        rows = ((last[:, 1] - clearance.origin[1]) / resolution).astype(np.intp)
        inside = (rows > 0) & (rows < height - 1) & (cols > 0) & (cols < width - 1)
        previous = np.zeros((height, width), dtype=np.uint8)
        previous[rows[inside], cols[inside]] = 1
        costs[(cv2.dilate(previous, _PREVIOUS_WAY_BRUSH) > 0) & (costs > 0.0)] *= _PREVIOUS_WAY_FACTOR
    ends = [_cell(clearance, x, y, resolution) for x, y in targets.tolist()]
    ends = [end if 0 <= end[0] < height and 0 <= end[1] < width else first for end in ends]
    search = MCP_Geometric(costs)
    search.find_costs([first], list(set(ends)))
    for index, end in enumerate(ends):
        try:
            cells = np.array(search.traceback(end), dtype=np.float64)
        except ValueError:  # the target can't be reached
            continue
        points = _smooth(cells) * resolution + np.array(clearance.origin)
        points[0] = (start.x, start.y)
        distance = math.hypot(targets[index, 0] - start.x, targets[index, 1] - start.y)
        if end != first and np.hypot(*np.diff(points, axis=0).T).sum() <= _MAX_RATIO * distance + _MAX_EXTRA:
            return index, points
    return None


def _smooth(cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the centres (x, y in cells) of *cells* (row, column), averaged over five to smooth steps."""
    blurred = cells
    if len(cells) > 4:
        blurred = np.asarray(cv2.blur(cells, (1, 5), borderType=cv2.BORDER_REPLICATE), dtype=np.float64)
        blurred[0], blurred[-1] = cells[0], cells[-1]
    return blurred[:, ::-1] + 0.5


def _cell(clearance: ClearanceGrid, x: float, y: float, resolution: float) -> tuple[int, int]:
    return int((y - clearance.origin[1]) // resolution), int((x - clearance.origin[0]) // resolution)
