"""The smoothing of a path over a grid, without touching the obstacles that the path goes around.

At most 41 points of a path are kept as knots. The first step finds the cheapest chain of straight lines
between knots; the price of a line is the price of the cells under it. The second step relaxes this chain as
an active contour (Kass et al. 1988): the curve shortens, moves down the gradient of the costs and resists
bending. Internal forces are implicit, external forces explicit.

Points are in cells (row, column); the centre of the first cell is at 0, 0. A price is a length in cells times
the costs of the cells, as in `btcore_navigation.grid_search`.
"""

from collections.abc import Sequence
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_navigation.costmap_layers import INSCRIBED
from btcore_navigation.grid_search import COST_FACTOR, COST_NEUTRAL, Cell

MAX_COST_RATIO: Final = 1.05
"""The greatest price of a smooth path, as a multiple of the original path's price."""

_KNOTS: Final = 40
"""The greatest number of lines between neighbouring knots."""
_KNOT_DISTANCE: Final = 6.0
"""The least distance (cells) between knots."""
_SAMPLE: Final = 2.0
"""The distance (cells) between the points at which lines between knots are priced."""
_TOUCH: Final = 1e-9
"""A step with at most this share of its length in a cell only touches the cell at a corner."""

_STIFFNESSES: Final = (10.0, 1.0)
"""The resistance to bending, in order of preference; the second is tried if the first fails."""
_ITERATIONS: Final = 12
_STEP: Final = 0.02
"""The distance (cells) that a slope of one cost per cell moves a point in an iteration."""
_BLUR: Final = 1.5
"""The standard deviation (cells) of the blur; without a blur, costs have steps instead of slopes."""
_MARGIN: Final = 12
"""The width (cells) of the strip beside a path whose costs affect the curve."""
_FIXED_WEIGHT: Final = 1e9
"""The weight of the end points, which keeps them in place."""


def smooth_path(costs: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smooth a path and keep its end points.

    Args:
        costs: The grid of the path; impassable cells are negative.
        way: The path's points (row, column), shape `(n, 2)`.

    Returns:
        Points (row, column), shape `(m, 2)`, at most a cell apart, on the grid and in no impassable cell.
        The price is mostly lower than the price of *way*, and at most `MAX_COST_RATIO` times as high. If
        smoothing fails, the result is *way* itself.
    """
    if len(way) < 3:
        return way
    limit = float(_step_prices(costs, way).sum())
    pulled = resample(_straighten(costs, way), 1.0)
    for stiffness in _STIFFNESSES:
        relaxed = resample(_relax(costs, pulled, stiffness), 1.0)
        if _price(costs, relaxed) <= limit * MAX_COST_RATIO:
            return relaxed
    return pulled if _price(costs, pulled) <= limit else way


def anchor_path(
    costs: NDArray[np.float64],
    cells: Sequence[Cell],
    first: tuple[float, float],
    last: tuple[float, float],
) -> NDArray[np.float64]:
    """Return the path over the centres of *cells*, with exact end points.

    A straight line joins an end point to the next cell's centre. If this line would cut the corner of an
    impassable cell, the path passes over the centre of the end point's own cell.

    Args:
        costs: The grid of the path; impassable cells are negative.
        cells: The cells of the path.
        first: The first point (row, column), in the first cell.
        last: The last point (row, column), in the last cell.
    """
    way = np.array([first, *cells[1:-1], last], dtype=np.float64)
    if len(cells) > 1:
        for end, middle, at in ((way[-2:], cells[-1], -1), (way[:2], cells[0], 1)):
            if not np.isfinite(_price(costs, resample(end, 1.0))):
                way = np.insert(way, at, middle, axis=0)
    return way


def _straighten(costs: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the cheapest chain of straight lines between points of *way*, from the first to the last."""
    along = _distances(way)
    count = int(np.clip(np.ceil(along[-1] / _KNOT_DISTANCE), 1, _KNOTS)) + 1
    picked = np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], count) - 1e-9))
    picked[-1] = len(way) - 1
    knots = way[picked]
    first, second = np.triu_indices(len(knots), 1)
    prices = np.full((len(knots), len(knots)), np.inf)
    prices[first, second] = _line_prices(costs, knots[first], knots[second])
    steps = np.arange(len(knots) - 1)
    between = np.add.reduceat(_step_prices(costs, way), picked[:-1])
    # Where a line between neighbouring knots cuts a corner, the original path is free.
    blocked = ~np.isfinite(prices[steps, steps + 1])
    prices[steps, steps + 1] = np.where(blocked, between, prices[steps, steps + 1])
    # Dynamic programming over the knots in order: the cheapest price to each, and the knot before it.
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
    """Return the prices of straight lines; infinite through impassable cells."""
    lengths = np.hypot(*(ends - starts).T)
    counts = np.maximum(1, np.ceil(lengths / _SAMPLE)).astype(np.intp)
    offsets = np.concatenate(([0], np.cumsum(counts)[:-1]))
    places = (np.arange(counts.sum()) - np.repeat(offsets, counts) + 0.5) / np.repeat(counts, counts)
    points = np.repeat(starts, counts, axis=0)
    points += places[:, None] * np.repeat(ends - starts, counts, axis=0)
    prices: NDArray[np.float64] = np.add.reduceat(_costs_under(costs, points), offsets) / counts * lengths
    return prices


def _relax(costs: NDArray[np.float64], way: NDArray[np.float64], stiffness: float) -> NDArray[np.float64]:
    """Return *way*, whose points are a cell apart, after some iterations as an active contour."""
    # A slow import: every command that loads the navigation's nodes would wait for it.
    from scipy.linalg import cho_solve_banded, cholesky_banded

    count = len(way)
    if count < 3:
        return way
    low = np.maximum(np.floor(way.min(axis=0)).astype(np.intp) - _MARGIN, 0)
    high = np.floor(way.max(axis=0)).astype(np.intp) + _MARGIN + 2
    part = costs[low[0] : high[0], low[1] : high[1]]
    height = np.where(part < 0, COST_NEUTRAL + COST_FACTOR * INSCRIBED, part).astype(np.float32)
    slopes = cv2.GaussianBlur(height, (0, 0), _BLUR)
    factor = cholesky_banded(_inner_forces(count, stiffness))
    points = way
    for _ in range(_ITERATIONS):
        rows, cols = np.rint(points - low).astype(np.intp).T
        rows = np.clip(rows, 1, slopes.shape[0] - 2)
        cols = np.clip(cols, 1, slopes.shape[1] - 2)
        up = slopes[rows + 1, cols] - slopes[rows - 1, cols]
        right = slopes[rows, cols + 1] - slopes[rows, cols - 1]
        targets = points - _STEP / 2 * np.stack((up, right), axis=1)
        targets[[0, -1]] = way[[0, -1]] * (1.0 + _FIXED_WEIGHT)
        points = cho_solve_banded((factor, False), targets)
    points[[0, -1]] = way[[0, -1]]
    return points


def _inner_forces(count: int, stiffness: float) -> NDArray[np.float64]:
    """Return I + tension·D₁ᵀD₁ + stiffness·D₂ᵀD₂ (differences D₁, D₂) for *count* points as upper bands."""
    tension = COST_NEUTRAL * _STEP
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
    bands[2, [0, -1]] += _FIXED_WEIGHT
    return bands


def resample(way: NDArray[np.float64], distance: float) -> NDArray[np.float64]:
    """Return points along *way*, with its ends, that are *distance* (cells) apart or slightly less."""
    along = _distances(way)
    places = np.linspace(0.0, along[-1], max(2, int(np.ceil(along[-1] / distance)) + 1))
    return np.stack((np.interp(places, along, way[:, 0]), np.interp(places, along, way[:, 1])), axis=1)


def _price(costs: NDArray[np.float64], way: NDArray[np.float64]) -> float:
    """Return the exact price of *way*, whose points are at most a cell apart; infinite through a wall."""
    starts, steps = way[:-1], np.diff(way, axis=0)
    cells = np.floor(way + 0.5)
    # Such a short step crosses at most a single line between rows and a single line between columns.
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
    return float((_costs_under(costs, points[inside]) * lengths[inside]).sum())


def _step_prices(costs: NDArray[np.float64], way: NDArray[np.float64]) -> NDArray[np.float64]:
    cells = _costs_under(costs, way)
    prices: NDArray[np.float64] = np.hypot(*np.diff(way, axis=0).T) * (cells[1:] + cells[:-1]) / 2
    return prices


def _costs_under(costs: NDArray[np.float64], points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the costs of the cells under *points*; infinite in impassable cells and off the grid."""
    cells = np.floor(points + 0.5).astype(np.intp)
    inside = np.clip(cells, 0, np.array(costs.shape) - 1)
    under: NDArray[np.float64] = costs[inside[:, 0], inside[:, 1]]
    under[(under < 0) | (cells != inside).any(axis=1)] = np.inf
    return under


def _distances(way: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))))
