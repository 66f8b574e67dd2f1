"""The way round what stands on a path, found in the robot's surroundings."""

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from robot_nodes.navigation.clearance import Clearance
from robot_nodes.robot import Pose2D

_COARSE = 2  # cells of the clearance for one of the search
_ROOM = 0.55  # m of clearance from which on more is no better
_NEAR = 0.4  # m about the robot in which it may squeeze out of where it is
_LIKED = 0.6  # what a cell of the last way costs of what it would
_AROUND = np.ones((5, 5), dtype=np.uint8)
_PASS = 0.02  # m of clearance that squeezing out may cost


def detour(
    clearance: Clearance,
    start: Pose2D,
    target: tuple[float, float],
    radius: float,
    last: NDArray[np.float64] | None = None,
) -> NDArray[np.float64] | None:
    """Points (m, shape ``(n, 2)``) of a way from *start* to *target* that keeps *radius* (m) from obstacles.

    All in the frame of *clearance*, whose grid bounds the search. Where the *last* way went (points as close
    as cells) is cheaper, so that noise doesn't make the robot waver between two sides. None if there is no
    such way.
    """
    resolution = clearance.resolution * _COARSE
    distances = clearance.distances[_COARSE // 2 :: _COARSE, _COARSE // 2 :: _COARSE]
    first = _cell(clearance, start.x, start.y, resolution)
    end = _cell(clearance, *target, resolution)
    height, width = distances.shape
    if not all(0 <= row < height and 0 <= col < width for row, col in (first, end)):
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
    if costs[end] < 0.0:
        return None
    search = MCP_Geometric(costs)
    search.find_costs([first], [end])
    try:
        cells = np.array(search.traceback(end), dtype=np.float64)
    except ValueError:
        return None
    if len(cells) > 4:
        # Cells make a staircase; an average over five of them makes a way of it.
        first_cell, last_cell = cells[0], cells[-1]
        cells = np.asarray(cv2.blur(cells, (1, 5), borderType=cv2.BORDER_REPLICATE), dtype=np.float64)
        cells[0], cells[-1] = first_cell, last_cell
    points: NDArray[np.float64] = (cells[:, ::-1] + 0.5) * resolution + np.array(clearance.origin)
    points[0] = (start.x, start.y)
    return points


def _cell(clearance: Clearance, x: float, y: float, resolution: float) -> tuple[int, int]:
    return int((y - clearance.origin[1]) // resolution), int((x - clearance.origin[0]) // resolution)
