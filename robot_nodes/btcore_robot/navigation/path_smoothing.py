"""Ways over a grid made straight and round, without touching what they go around.

Of a way's cells at most forty are kept as knots, and the cheapest chain of straight lines between knots is
found, each line priced by the cells under it. That chain is let go like a rubber band on the costs: it
shortens, slides down their slope and resists bending (an active contour, Kass et al. 1988, its inner forces
implicit and its outer ones explicit). Points are in cells, row and column, the middle of the first cell at
0, 0. Prices are as in `btcore_robot.navigation.grid_search`: length times costs.
"""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.costmap_layers import INSCRIBED
from btcore_robot.navigation.grid_search import FACTOR, NEUTRAL, Cell

DEARER: Final = 1.05
"""How many times the price of the way that it was made from a smooth one may have."""

_KNOTS: Final = 40
_KNOT_DISTANCE: Final = 6.0
"""Cells between knots at least."""
_SAMPLE: Final = 2.0
"""Cells between the places where lines between knots are priced."""
_TOUCH: Final = 1e-9
"""The part of a step up to which a cell counts as touched only: its corner."""

_STIFFNESSES: Final = (10.0, 1.0)
"""How much bending is resisted, from the most; the next where that is too dear."""
_ROUNDS: Final = 12
_PACE: Final = 0.02
"""Cells that a slope of one cost a cell moves a point in a round."""
_BLUR: Final = 1.5
"""The standard deviation (cells) of the blur without which costs have steps instead of slopes."""
_MARGIN: Final = 12
"""Cells beside a way that the band may see."""
_HELD: Final = 1e9
"""The weight of the ends, which stay."""


def smooth_path(costs: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """*way* (shape ``(n, 2)``), whose ends stay, made smooth: points at most a cell apart.

    *costs* is the grid that it was found on, walls below 0. The result is on the grid, in no wall, and costs
    at most `DEARER` times what *way* does, mostly less; if it can't be had, *way* itself comes back.
    """
    if len(way) < 3:
        return way
    limit = float(_step_prices(costs, way).sum())
    pulled = _spaced(_pulled(costs, way), 1.0)
    for stiffness in _STIFFNESSES:
        relaxed = _spaced(_relaxed(costs, pulled, stiffness), 1.0)
        if _price(costs, relaxed) <= limit * DEARER:
            return relaxed
    return pulled if _price(costs, pulled) <= limit else way


def anchored(
    costs: NDArray[np.float64],
    cells: Sequence[Cell],
    first: tuple[float, float],
    last: tuple[float, float],
) -> NDArray[np.float64]:
    """The way over the middles of *cells* that begins at *first*, in the first of them, and ends at *last*.

    From there it leads straight to the next cell's middle, or over its own cell's where a wall's corner is
    between.
    """
    way = np.array([first, *cells[1:-1], last], dtype=np.float64)
    if len(cells) > 1:
        for end, middle, at in ((way[-2:], cells[-1], -1), (way[:2], cells[0], 1)):
            if not np.isfinite(_price(costs, _spaced(end, 1.0))):
                way = np.insert(way, at, middle, axis=0)
    return way


def _pulled(costs: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """The cheapest chain of straight lines between points of *way*, from its first to its last."""
    along = _along(way)
    count = int(np.clip(np.ceil(along[-1] / _KNOT_DISTANCE), 1, _KNOTS)) + 1
    picked = np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], count) - 1e-9))
    picked[-1] = len(way) - 1
    knots = way[picked]
    first, second = np.triu_indices(len(knots), 1)
    prices = np.full((len(knots), len(knots)), np.inf)
    prices[first, second] = _line_prices(costs, knots[first], knots[second])
    steps = np.arange(len(knots) - 1)
    between = np.add.reduceat(_step_prices(costs, way), picked[:-1])
    # Where a line between neighbours cuts a corner, the way itself has room.
    blocked = ~np.isfinite(prices[steps, steps + 1])
    prices[steps, steps + 1] = np.where(blocked, between, prices[steps, steps + 1])
    best = np.full(len(knots), np.inf)
    best[0] = 0.0
    before = np.zeros(len(knots), dtype=np.intp)
    for index in range(1, len(knots)):
        totals = best[:index] + prices[:index, index]
        before[index] = np.argmin(totals)
        best[index] = totals[before[index]]
    pieces: list[NDArray[np.float64]] = [knots[-1:]]
    at = len(knots) - 1
    while at > 0:
        back = int(before[at])
        keep_way = back == at - 1 and blocked[back]
        pieces.append(way[picked[back] : picked[at]] if keep_way else knots[back : back + 1])
        at = back
    return np.concatenate(pieces[::-1])


def _line_prices(
    costs: NDArray[np.float64], starts: NDArray[np.float64], ends: NDArray[np.float64]
) -> NDArray[np.float64]:
    """What straight lines cost, infinite through a wall."""
    lengths = np.hypot(*(ends - starts).T)
    counts = np.maximum(1, np.ceil(lengths / _SAMPLE)).astype(np.intp)
    offsets = np.concatenate(([0], np.cumsum(counts)[:-1]))
    places = (np.arange(counts.sum()) - np.repeat(offsets, counts) + 0.5) / np.repeat(counts, counts)
    points = np.repeat(starts, counts, axis=0)
    points += places[:, None] * np.repeat(ends - starts, counts, axis=0)
    prices: NDArray[np.float64] = np.add.reduceat(_under(costs, points), offsets) / counts * lengths
    return prices


def _relaxed(costs: NDArray[np.float64], way: NDArray[np.float64], stiffness: float) -> NDArray[np.float64]:
    """*way*, its points a cell apart, after some rounds as a rubber band."""
    # Every `btcore` that knows the navigation's nodes would wait for this import; few smooth a way.
    from scipy.linalg import cho_solve_banded, cholesky_banded

    count = len(way)
    if count < 3:
        return way
    low = np.maximum(np.floor(way.min(axis=0)).astype(np.intp) - _MARGIN, 0)
    high = np.floor(way.max(axis=0)).astype(np.intp) + _MARGIN + 2
    part = costs[low[0] : high[0], low[1] : high[1]]
    height = np.where(part < 0, NEUTRAL + FACTOR * INSCRIBED, part).astype(np.float32)
    slopes = cv2.GaussianBlur(height, (0, 0), _BLUR)
    factor = cholesky_banded(_inner_forces(count, stiffness))
    points = way
    for _ in range(_ROUNDS):
        rows, cols = np.rint(points - low).astype(np.intp).T
        rows = np.clip(rows, 1, slopes.shape[0] - 2)
        cols = np.clip(cols, 1, slopes.shape[1] - 2)
        up = slopes[rows + 1, cols] - slopes[rows - 1, cols]
        right = slopes[rows, cols + 1] - slopes[rows, cols - 1]
        wanted = points - _PACE / 2 * np.stack((up, right), axis=1)
        wanted[[0, -1]] = way[[0, -1]] * (1.0 + _HELD)
        points = cho_solve_banded((factor, False), wanted)
    points[[0, -1]] = way[[0, -1]]
    return points


def _inner_forces(count: int, stiffness: float) -> NDArray[np.float64]:
    """I + tension·D₁ᵀD₁ + stiffness·D₂ᵀD₂ for *count* points as upper bands, D₁ and D₂ being differences."""
    tension = NEUTRAL * _PACE
    bands = np.zeros((3, count))
    bands[2] = 1.0
    bands[2, :-1] += tension
    bands[2, 1:] += tension
    bands[1, 1:] -= tension
    bands[2, :-2] += stiffness
    bands[2, 1:-1] += 4 * stiffness
    bands[2, 2:] += stiffness
    bands[1, 1:-1] -= 2 * stiffness
    bands[1, 2:] -= 2 * stiffness
    bands[0, 2:] += stiffness
    bands[2, [0, -1]] += _HELD
    return bands


def _spaced(way: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Points along *way*, *distance* apart or a little less, its ends among them."""
    along = _along(way)
    places = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / distance)) + 1))
    return np.stack((np.interp(places, along, way[:, 0]), np.interp(places, along, way[:, 1])), axis=1)


def _price(costs: NDArray[np.float64], way: NDArray[np.float64]) -> float:
    """What *way*, its points at most a cell apart, costs cell by cell; infinite through a wall."""
    starts, steps = way[:-1], np.diff(way, axis=0)
    cells = np.floor(way + 0.5)
    # A step that short crosses at most one line between rows and one between columns.
    crossed = cells[1:] != cells[:-1]
    lines = np.maximum(cells[1:], cells[:-1]) - 0.5
    cuts = np.ones((len(steps), 4))
    cuts[:, 0] = 0.0
    np.divide(lines - starts, steps, out=cuts[:, 1:3], where=crossed)
    cuts.sort(axis=1)
    parts = np.diff(cuts, axis=1)
    middles = (cuts[:, 1:] + cuts[:, :-1]) / 2
    inside = parts > _TOUCH
    points = starts[:, None] + middles[..., None] * steps[:, None]
    lengths = parts * np.hypot(*steps.T)[:, None]
    return float((_under(costs, points[inside]) * lengths[inside]).sum())


def _step_prices(costs: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    cells = _under(costs, way)
    prices: NDArray[np.float64] = np.hypot(*np.diff(way, axis=0).T) * (cells[1:] + cells[:-1]) / 2
    return prices


def _under(costs: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """The costs of the cells under *points*, infinite in walls and off the grid."""
    cells = np.floor(points + 0.5).astype(np.intp)
    inside = np.clip(cells, 0, np.array(costs.shape) - 1)
    under: NDArray[np.float64] = costs[inside[:, 0], inside[:, 1]]
    under[(under < 0) | (cells != inside).any(axis=1)] = np.inf
    return under


def _along(way: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
