"""Search for the cheapest path over a grid, from cell to cell in eight directions.

A step costs its length in cells times the mean of the two cells' costs. The search is scikit-image's
Dijkstra. `CostBounds` excludes cells that no cheapest path can cross. When the robot has driven on and
obstacles have appeared, a new search to the same goal takes a tenth of the time with these bounds, and still
finds the cheapest path.
"""

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from btcore_navigation.costmap_layers import INSCRIBED, UNKNOWN

Cell = tuple[int, int]
"""The row and the column of a cell."""

IMPASSABLE: Final = -1.0
"""The cost of a cell that no path may cross; scikit-image's MCP takes negative costs for impassable."""

COST_NEUTRAL: Final = 50.0
"""The cost of a free cell (NavFn's COST_NEUTRAL); it is above 0, so that a longer way costs more."""
COST_FACTOR: Final = 0.8
"""The factor on a costmap's costs (NavFn's COST_FACTOR)."""

_SLACKS: Final = (1.02, 1.1, 1.3)  # times the least possible price: the searched area grows with each attempt
_OFF_COURSE: Final = 1.3
"""The factor on the price to the goal above which a start is off course: new bounds are then computed."""
_NEARBY: Final = 40 * COST_NEUTRAL  # price that is allowed in addition
_ROUNDING: Final = 1e-5  # relative error of the bounds, which are float32


def _prices(unknown: float) -> NDArray[np.float64]:
    prices = COST_NEUTRAL + COST_FACTOR * np.arange(256, dtype=np.float64)
    prices[INSCRIBED:] = IMPASSABLE
    prices[UNKNOWN] = unknown
    return prices


_WITH_UNKNOWN: Final = _prices(COST_NEUTRAL + COST_FACTOR * INSCRIBED)
_WITHOUT_UNKNOWN: Final = _prices(IMPASSABLE)


def grid_costs(costs: NDArray[np.uint8], *, allow_unknown: bool = True) -> NDArray[np.float64]:
    """Return the prices of a costmap's cells as in NavFn: 50 + 0.8·cost, IMPASSABLE from INSCRIBED up.

    Args:
        costs: The costs of the costmap.
        allow_unknown: Whether UNKNOWN cells get the price of cost 253; otherwise they are IMPASSABLE.
    """
    return (_WITH_UNKNOWN if allow_unknown else _WITHOUT_UNKNOWN)[costs]


def reachable_cells(costs: NDArray[np.float64], start: Cell) -> NDArray[np.bool_]:
    """Return the mask of cells that can be reached from a cell, through edges or corners.

    Args:
        costs: The prices of the cells, shape `(height, width)`; negative for impassable cells.
        start: The cell from which to start; it must be passable.

    Returns:
        The mask, in the shape of *costs*.
    """
    _, labels = cv2.connectedComponents((costs >= 0).astype(np.uint8), connectivity=8)
    mask: NDArray[np.bool_] = labels == labels[start]
    return mask


class CostBounds:
    """Lower bounds for the price of paths to *goal*; they stay valid when obstacles appear later.

    *lower_costs* are lower bounds of all later costs, cell by cell. *start* is the start of the first search;
    later starts are expected on the way from *start* to the goal. Two fields of prices are computed over
    *lower_costs*: `to_goal` from each cell to the goal, and `from_start` from *start* to each cell.

    A path from a cell c to the goal costs at least `to_goal[c]`. A path from a later start s to c costs at
    least `|from_start[c] - from_start[s]|` (triangle inequality). If the sum of both is above the price of
    a known path, the cheapest path does not cross c. For a start that is off course, `from_start` is
    computed again.
    """

    def __init__(self, lower_costs: NDArray[np.float64], start: Cell, goal: Cell) -> None:
        self._lower_costs = lower_costs
        self._to_goal = _field(lower_costs, goal)
        self._set_start(start)

    def least(self, start: Cell) -> tuple[float, NDArray[np.float32]]:
        """Return lower bounds for the price of paths from *start* to the goal.

        The number is the bound for all paths; the array has for each cell the bound for paths over this cell.
        """
        price = float(self._from_start[start] + self._to_goal[start])
        if not (math.isfinite(price) and price <= self._max_price):
            self._set_start(start)
        across = np.abs(self._from_start - self._from_start[start])
        across += self._to_goal
        return float(self._to_goal[start]), across

    def _set_start(self, start: Cell) -> None:
        self._from_start = _field(self._lower_costs, start)
        self._max_price = float(self._to_goal[start]) * _OFF_COURSE + _NEARBY


def find_cheapest_path(
    costs: NDArray[np.float64], start: Cell, goal: Cell, bounds: CostBounds | None = None
) -> list[Cell] | None:
    """Find the cheapest path from *start* to *goal*.

    Args:
        costs: The prices of the cells, from `grid_costs`.
        start: The first cell of the path.
        goal: The last cell of the path.
        bounds: Lower bounds for paths to *goal* that hold for *costs*; without them the whole grid is
            searched.

    Returns:
        The cells of the path, with *start* and *goal*; None if there is no path.
    """
    if bounds is not None:
        least, across = bounds.least(start)
        across[costs < 0] = np.inf
        for slack in _SLACKS:
            price = least * slack
            result = _within(costs, start, goal, across <= price * (1 + _ROUNDING))
            # Every path that is not dearer than the price lies within the mask, so also the cheapest path.
            if result is not None and result[1] <= price:
                return result[0]
    result = _search(costs, start, goal)
    return result[0] if result is not None else None


def _within(
    costs: NDArray[np.float64], start: Cell, goal: Cell, kept: NDArray[np.bool_]
) -> tuple[list[Cell], float] | None:
    """Return the cheapest path over the cells *kept*, with its price."""
    if not (kept[start] and kept[goal]):
        return None
    rows, cols = np.flatnonzero(kept.any(axis=1)), np.flatnonzero(kept.any(axis=0))
    row, col = int(rows[0]), int(cols[0])
    box = slice(row, int(rows[-1]) + 1), slice(col, int(cols[-1]) + 1)
    part = np.where(kept[box], costs[box], IMPASSABLE)
    result = _search(part, (start[0] - row, start[1] - col), (goal[0] - row, goal[1] - col))
    if result is None:
        return None
    return [(cell[0] + row, cell[1] + col) for cell in result[0]], result[1]


def _search(costs: NDArray[np.float64], start: Cell, goal: Cell) -> tuple[list[Cell], float] | None:
    search = MCP_Geometric(costs)
    field, _ = search.find_costs([start], [goal])
    price = float(field[goal])
    if not np.isfinite(price):
        return None
    return [(int(row), int(col)) for row, col in search.traceback(goal)], price


def _field(costs: NDArray[np.float64], start: Cell) -> NDArray[np.float32]:
    field, _ = MCP_Geometric(costs).find_costs([start])
    prices: NDArray[np.float32] = field.astype(np.float32)
    return prices
