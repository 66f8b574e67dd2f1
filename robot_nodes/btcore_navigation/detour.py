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
    previous: NDArray[np.float64] | None = None,
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
        previous: The previous detour (m, shape `(n, 2)`), at least a point per cell. Its cells are cheaper,
            so that noise doesn't make the robot alternate between two sides of the obstacle.

    Returns:
        The index of the target and the points (m, shape `(n, 2)`) of the way; None if no target has a
        short way: at most 1.5 times the straight distance plus 0.5 m.
    """
    resolution = clearance.resolution * _CELL_STRIDE
    distances = clearance.distances[_CELL_STRIDE // 2 :: _CELL_STRIDE, _CELL_STRIDE // 2 :: _CELL_STRIDE]
    first = _cell(clearance, distances.shape, start.x, start.y)
    cells = [_cell(clearance, distances.shape, x, y) for x, y in targets.tolist()]
    ends = {cell for cell in cells if cell is not None and cell != first}
    if first is None or not ends:
        return None
    costs = _costs(distances, first, radius, resolution)
    if previous is not None and len(previous):
        costs[_is_on_way(previous, clearance, distances.shape) & (costs > 0.0)] *= _PREVIOUS_WAY_FACTOR
    search = MCP_Geometric(costs)
    search.find_costs([first], list(ends))
    for index, end in enumerate(cells):
        if end not in ends:
            continue
        try:
            way = np.array(search.traceback(end), dtype=np.float64)
        except ValueError:  # the target can't be reached
            continue
        points = _smooth(way) * resolution + np.array(clearance.origin)
        points[0] = (start.x, start.y)
        distance = math.hypot(targets[index, 0] - start.x, targets[index, 1] - start.y)
        if np.hypot(*np.diff(points, axis=0).T).sum() <= _MAX_RATIO * distance + _MAX_EXTRA:
            return index, points
    return None


def _costs(
    distances: NDArray[np.float32], first: tuple[int, int], radius: float, resolution: float
) -> NDArray[np.float32]:
    """Return the costs of the cells for a way from the cell *first*."""
    start_clearance = float(distances[first])
    full = round(radius + _FULL_CLEARANCE, 6)
    costs: NDArray[np.float32] = 1.0 + _CLEARANCE_COST * np.maximum(full - distances, 0.0) / (full - radius)
    costs[distances < radius] = -1.0  # MCP_Geometric takes a negative cost for impassable
    if start_clearance < radius:  # let the robot escape
        reach = int(_ESCAPE_REACH / resolution)
        low_row, low_col = max(first[0] - reach, 0), max(first[1] - reach, 0)
        around = (slice(low_row, first[0] + reach + 1), slice(low_col, first[1] + reach + 1))
        costs[around][distances[around] >= start_clearance - _ESCAPE_LOSS] = _ESCAPE_COST
    return costs


def _is_on_way(
    way: NDArray[np.float64], clearance: ClearanceGrid, shape: tuple[int, ...]
) -> NDArray[np.bool_]:
    """Return whether each cell is on *way*, or near it."""
    (height, width), resolution = shape, clearance.resolution * _CELL_STRIDE
    cols = ((way[:, 0] - clearance.origin[0]) / resolution).astype(np.intp)
    rows = ((way[:, 1] - clearance.origin[1]) / resolution).astype(np.intp)
    inside = (rows > 0) & (rows < height - 1) & (cols > 0) & (cols < width - 1)
    marked = np.zeros((height, width), dtype=np.uint8)
    marked[rows[inside], cols[inside]] = 1
    return np.asarray(cv2.dilate(marked, _PREVIOUS_WAY_BRUSH) > 0)


def _smooth(cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the centres (x, y in cells) of *cells* (row, column), averaged over five to smooth steps."""
    blurred = cells
    if len(cells) > 4:
        blurred = np.asarray(cv2.blur(cells, (1, 5), borderType=cv2.BORDER_REPLICATE), dtype=np.float64)
        blurred[0], blurred[-1] = cells[0], cells[-1]
    return blurred[:, ::-1] + 0.5


def _cell(clearance: ClearanceGrid, shape: tuple[int, ...], x: float, y: float) -> tuple[int, int] | None:
    """Return the cell (row, column) of the search that contains a point; None if it is outside of *shape*."""
    resolution = clearance.resolution * _CELL_STRIDE
    row, col = int((y - clearance.origin[1]) // resolution), int((x - clearance.origin[0]) // resolution)
    return (row, col) if 0 <= row < shape[0] and 0 <= col < shape[1] else None
