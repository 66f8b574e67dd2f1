"""The way round what stands on a path, found in the robot's surroundings."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from btcore_robot.navigation.clearance import ClearanceGrid
from btcore_robot.robot import Pose2D

_COARSE = 2  # cells of the clearance for one of the search
_ROOM = 0.55  # m of clearance from which on more is no better
_NEAR = 0.4  # m about the robot in which it may squeeze out of where it is
_LIKED = 0.6  # what a cell of the last way costs of what it would
_AROUND = np.ones((5, 5), dtype=np.uint8)
_PASS = 0.02  # m of clearance that squeezing out may cost
_LONGEST, _EXTRA = 1.5, 0.5  # times the distance, and m: what is longer is for the planner to decide


def detour(
    clearance: ClearanceGrid,
    start: Pose2D,
    targets: NDArray[np.float64],
    radius: float,
    last: NDArray[np.float64] | None = None,
) -> tuple[int, NDArray[np.float64]] | None:
    """A way from *start*, *radius* (m) away from obstacles, to the first of *targets* that has a short one.

    *targets* (m, shape ``(k, 2)``) are in the order in which they are wanted; the answer is the index of one
    and the points (m, shape ``(n, 2)``) of the way there, all in the frame of *clearance*, whose grid bounds
    the search. The inside of a box of which one face is seen looks free, but has no way, or no short one.
    Where the *last* way went (points as close as cells) is cheaper, so that noise doesn't make the robot
    waver between two sides. None if there is no such way.
    """
    resolution = clearance.resolution * _COARSE
    distances = clearance.distances[_COARSE // 2 :: _COARSE, _COARSE // 2 :: _COARSE]
    first = _cell(clearance, start.x, start.y, resolution)
    height, width = distances.shape
    if not (0 <= first[0] < height and 0 <= first[1] < width):
        return None
    here = float(distances[first])
    costs = 1.0 + 6.0 * np.maximum(_ROOM - distances, 0.0) / (_ROOM - radius)
    costs[distances < radius] = -1.0
    if here < radius:
        reach = int(_NEAR / resolution)
        low_row, low_col = max(first[0] - reach, 0), max(first[1] - reach, 0)
        near = (slice(low_row, first[0] + reach + 1), slice(low_col, first[1] + reach + 1))
        costs[near][distances[near] >= here - _PASS] = 20.0
    if last is not None and len(last):
        cols = ((last[:, 0] - clearance.origin[0]) / resolution).astype(np.intp)
        rows = ((last[:, 1] - clearance.origin[1]) / resolution).astype(np.intp)
        inside = (rows > 0) & (rows < height - 1) & (cols > 0) & (cols < width - 1)
        trodden = np.zeros((height, width), dtype=np.uint8)
        trodden[rows[inside], cols[inside]] = 1
        costs[(cv2.dilate(trodden, _AROUND) > 0) & (costs > 0.0)] *= _LIKED
    ends = [_cell(clearance, x, y, resolution) for x, y in targets.tolist()]
    ends = [end if 0 <= end[0] < height and 0 <= end[1] < width else first for end in ends]
    search = MCP_Geometric(costs)
    search.find_costs([first], list(set(ends)))
    for index, end in enumerate(ends):
        try:
            cells = np.array(search.traceback(end), dtype=np.float64)
        except ValueError:
            continue
        points = _smooth(cells) * resolution + np.array(clearance.origin)
        points[0] = (start.x, start.y)
        far = math.hypot(targets[index, 0] - start.x, targets[index, 1] - start.y)
        if end != first and np.hypot(*np.diff(points, axis=0).T).sum() <= _LONGEST * far + _EXTRA:
            return index, points
    return None


def _smooth(cells: NDArray[np.float64]) -> NDArray[np.float64]:
    """The middles (x, y in cells) of *cells* (row, column), averaged over five: they make a staircase."""
    blurred = cells
    if len(cells) > 4:
        blurred = np.asarray(cv2.blur(cells, (1, 5), borderType=cv2.BORDER_REPLICATE), dtype=np.float64)
        blurred[0], blurred[-1] = cells[0], cells[-1]
    return blurred[:, ::-1] + 0.5


def _cell(clearance: ClearanceGrid, x: float, y: float, resolution: float) -> tuple[int, int]:
    return int((y - clearance.origin[1]) // resolution), int((x - clearance.origin[0]) // resolution)
