"""The cheapest way over a grid, from cell to cell in eight directions.

A step costs its length in cells times the mean of the two cells' costs. The search is Dijkstra's, by
scikit-image. `Bounds` tells it where no cheapest way can lead, so that a way is found again, from a little
further on and around what was seen meanwhile, in a tenth of the time; it stays the cheapest.
"""

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from btcore_robot.navigation.costmap_layers import INSCRIBED, UNKNOWN

Cell = tuple[int, int]
"""A row and a column."""

WALL: Final = -1.0
"""The cost of a cell that no way leads through."""

NEUTRAL: Final = 50.0
"""What a free cell costs (NavFn's COST_NEUTRAL), so that a long way round has its price."""
FACTOR: Final = 0.8
"""What a costmap's costs are weighed with (NavFn's COST_FACTOR)."""

_SLACKS: Final = (1.02, 1.1, 1.3)
_ASTRAY: Final = 1.3
"""A start over which the way is that much longer is not ahead: bounds from there are worth their time."""
_NEARBY: Final = 40 * NEUTRAL
_ROUNDING: Final = 1e-5  # of the bounds, which are float32


def _prices(unknown: float) -> NDArray[np.float64]:
    prices = NEUTRAL + FACTOR * np.arange(256, dtype=np.float64)
    prices[INSCRIBED:] = WALL
    prices[UNKNOWN] = unknown
    return prices


_WITH_UNKNOWN: Final = _prices(NEUTRAL + FACTOR * INSCRIBED)
_WITHOUT_UNKNOWN: Final = _prices(WALL)


def grid_costs(costs: NDArray[np.uint8], *, allow_unknown: bool = True) -> NDArray[np.float64]:
    """What being in the cells of a costmap costs, as in NavFn: 50 + 0.8·cost, a WALL from INSCRIBED up.

    Unknown cells cost as much as INSCRIBED ones would, or are a WALL.
    """
    return (_WITH_UNKNOWN if allow_unknown else _WITHOUT_UNKNOWN)[costs]


def connected(costs: NDArray[np.float64], start: Cell) -> NDArray[np.bool_]:
    """Which cells can be reached from *start*, which is no WALL."""
    _, labels = cv2.connectedComponents((costs >= 0).astype(np.uint8), connectivity=8)
    reached: NDArray[np.bool_] = labels == labels[start]
    return reached


class Bounds:
    """What a way to *goal* costs at least, whatever may be seen later.

    *floor* holds costs that no later cost is under; *start* is a cell that later starts lie ahead of. From
    any cell it costs at least ``to_goal`` to the goal and, from s, ``|from_start - from_start[s]|`` to it
    (triangle inequality), so a way over cells where the sum is above a known price is not the cheapest.
    A start from somewhere else makes it measure anew from there.
    """

    def __init__(self, floor: NDArray[np.float64], start: Cell, goal: Cell) -> None:
        self._floor = floor
        self._to_goal = _field(floor, goal)
        self._depart(start)

    def least(self, start: Cell) -> tuple[float, NDArray[np.float32]]:
        """What ways from *start* cost at least: any at all, and for each cell those that cross it."""
        way = float(self._from_start[start] + self._to_goal[start])
        if not (math.isfinite(way) and way <= self._detour):
            self._depart(start)
        across = np.abs(self._from_start - self._from_start[start])
        across += self._to_goal
        return float(self._to_goal[start]), across

    def _depart(self, start: Cell) -> None:
        self._from_start = _field(self._floor, start)
        self._detour = float(self._to_goal[start]) * _ASTRAY + _NEARBY


def find_cheapest_path(
    costs: NDArray[np.float64], start: Cell, goal: Cell, bounds: Bounds | None = None
) -> list[Cell] | None:
    """The cells of a cheapest way from *start* to *goal*, both among them; None where there is none.

    *costs* are those of `grid_costs`; *bounds* hold for them, and know of a way.
    """
    if bounds is not None:
        least, across = bounds.least(start)
        across[costs < 0] = np.inf
        for slack in _SLACKS:
            price = least * slack
            found = _within(costs, start, goal, across <= price * (1 + _ROUNDING))
            # A way that is cheaper than the price lies within, so the cheapest of all does.
            if found is not None and found[1] <= price:
                return found[0]
    found = _search(costs, start, goal)
    return found[0] if found is not None else None


def _within(
    costs: NDArray[np.float64], start: Cell, goal: Cell, kept: NDArray[np.bool_]
) -> tuple[list[Cell], float] | None:
    if not (kept[start] and kept[goal]):
        return None
    rows, cols = np.flatnonzero(kept.any(axis=1)), np.flatnonzero(kept.any(axis=0))
    row, col = int(rows[0]), int(cols[0])
    box = slice(row, int(rows[-1]) + 1), slice(col, int(cols[-1]) + 1)
    part = np.where(kept[box], costs[box], WALL)
    found = _search(part, (start[0] - row, start[1] - col), (goal[0] - row, goal[1] - col))
    if found is None:
        return None
    return [(one[0] + row, one[1] + col) for one in found[0]], found[1]


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
