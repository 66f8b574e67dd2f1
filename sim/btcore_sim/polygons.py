"""Outlines on the floor: validation, division into triangles, and the outlines of walls along a line."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
"""x and y (m)."""

Floats = NDArray[np.float64]

MAX_POINTS = 200
"""The greatest number of points of an outline. The validation takes a time that grows with its square."""

MIN_SIDE = 0.001
"""The smallest distance (m) between consecutive points."""

MAX_TURN = math.radians(150)
"""The greatest turn (rad) at a corner of a wall; a sharper corner would be a long spike."""

_FLAT = 1e-9  # m²: twice the area of a triangle whose corners are on a line


class OutlineError(Exception):
    """Points do not form an outline. The message names the points."""


def signed_area(points: Sequence[Point]) -> float:
    """Return the area (m²) of a polygon; negative if its points are clockwise."""
    x, y = np.asarray(points, dtype=np.float64).T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def polygon_triangles(points: Sequence[Point]) -> list[tuple[Point, ...]]:
    """Return triangles that together cover a polygon, by cutting off its ears.

    Args:
        points: The corners of the polygon (m), in either direction; consecutive corners may be on a line.

    Returns:
        The triangles, each with counter-clockwise corners. Neighbouring triangles share whole sides.

    Raises:
        OutlineError: The points do not form a polygon, or the polygon intersects itself.
    """
    _check_line(points, closed=True)
    left = list(points) if signed_area(points) > 0.0 else list(reversed(points))
    triangles: list[tuple[Point, ...]] = []
    while len(left) > 2:
        corners = [(left[k - 1], left[k], left[(k + 1) % len(left)]) for k in range(len(left))]
        ear = next((k for k, corner in enumerate(corners) if _is_ear(corner, left)), None)
        if ear is not None:
            triangles.append(corners[ear])
        else:
            # Only corners on a line with their neighbours are left, which are no corners of the outline.
            ear = next((k for k, corner in enumerate(corners) if abs(_cross(*corner)) <= _FLAT), None)
        if ear is None:
            raise OutlineError("the outline is too narrow at a place: move the points apart")
        del left[ear]
    if not triangles:
        raise OutlineError("all points are on one line: the outline needs an area")
    return triangles


def wall_quads(points: Sequence[Point], thickness: float, closed: bool) -> list[tuple[Point, ...]]:
    """Return a convex quadrilateral for every section of a wall along a line, joined by mitres.

    Args:
        points: The corners of the wall's middle line (m).
        thickness: The thickness of the wall (m).
        closed: Whether the wall continues from the last point to the first.

    Returns:
        The outlines, each with four counter-clockwise corners. Neighbouring sections share a side.

    Raises:
        OutlineError: The line intersects itself, a corner is too sharp, or a section is too short for the
            thickness of the wall.
    """
    _check_line(points, closed=closed)
    line = np.asarray(points, dtype=np.float64)
    along = np.roll(line, -1, axis=0) - line if closed else np.diff(line, axis=0)
    along /= np.linalg.norm(along, axis=1)[:, None]
    normals = np.stack((-along[:, 1], along[:, 0]), axis=1)
    before, after = (
        (np.roll(normals, 1, axis=0), normals)
        if closed
        else (
            np.concatenate((normals[:1], normals)),
            np.concatenate((normals, normals[-1:])),
        )
    )
    bend = np.einsum("nk,nk->n", before, after)
    for index in np.flatnonzero(bend < math.cos(MAX_TURN)):
        raise OutlineError(
            f"the wall turns by more than {math.degrees(MAX_TURN):g}° at points[{index}]: use two walls"
        )
    # The mitre point is at the distance of half the thickness from both sections that meet there.
    offsets = thickness / 2 * (before + after) / (1.0 + bend)[:, None]
    left, right = line + offsets, line - offsets
    quads: list[tuple[Point, ...]] = []
    for first in range(len(along)):
        last = (first + 1) % len(line)
        for side in (left, right):
            if np.dot(side[last] - side[first], along[first]) <= 0.0:
                raise OutlineError(
                    f"points[{first}] and points[{last}] are too close together for a thickness of "
                    f"{thickness:g} m"
                )
        corners = (right[first], right[last], left[last], left[first])
        quads.append(tuple((float(x), float(y)) for x, y in corners))
    return quads


def boundary(parts: Sequence[Sequence[Point]]) -> list[tuple[Point, Point]]:
    """Return the sides of *parts* that only one part has: the outline of their union.

    Args:
        parts: Polygons with counter-clockwise corners. Neighbouring polygons share whole sides.
    """
    sides = [(part[k - 1], part[k]) for part in parts for k in range(len(part))]
    present = set(sides)
    return [(start, end) for start, end in sides if (end, start) not in present]


def distance_to_parts(parts: Sequence[Sequence[Point]], x: Floats, y: Floats) -> Floats:
    """Return the distances (m) from points to the nearest of *parts*; 0 inside.

    Args:
        parts: Convex polygons with counter-clockwise corners (m).
        x: The x coordinates of the points (m), of any shape.
        y: The y coordinates of the points (m), of a shape that broadcasts with *x*.
    """
    nearest: Floats = np.full(np.broadcast(x, y).shape, np.inf)
    for part in parts:
        np.minimum(nearest, _distance(part, x, y), out=nearest)
    return nearest


def _distance(part: Sequence[Point], x: Floats, y: Floats) -> Floats:
    away: Floats = np.full(np.broadcast(x, y).shape, np.inf)
    inside = np.ones(away.shape, dtype=np.bool_)
    for (x0, y0), (x1, y1) in zip(part, [*part[1:], part[0]], strict=True):
        dx, dy = x1 - x0, y1 - y0
        along = np.clip(((x - x0) * dx + (y - y0) * dy) / (dx * dx + dy * dy), 0.0, 1.0)
        np.minimum(away, np.hypot(x - x0 - along * dx, y - y0 - along * dy), out=away)
        inside &= dx * (y - y0) - dy * (x - x0) >= 0.0
    away[inside] = 0.0
    return away


def _check_line(points: Sequence[Point], *, closed: bool) -> None:
    """Raise an `OutlineError` if a line does not have enough points, has too many, or meets itself."""
    least = 3 if closed else 2
    if not least <= len(points) <= MAX_POINTS:
        raise OutlineError(f"there are {len(points)} points, but {least} to {MAX_POINTS} are expected")
    start = np.asarray(points, dtype=np.float64)
    end = np.roll(start, -1, axis=0)
    if not closed:
        start, end = start[:-1], end[:-1]
    count = len(start)
    for index in np.flatnonzero(np.linalg.norm(end - start, axis=1) < MIN_SIDE):
        raise OutlineError(
            f"points[{index}] and points[{(index + 1) % len(points)}] are the same point: remove one of them"
        )
    meet = _meeting(start, end)
    number = np.arange(count)
    apart = number[None, :] - number[:, None]
    neighbours = (apart == 1) | ((apart == count - 1) & closed)
    # Neighbouring sides always have a point in common; they overlap if one goes back along the other.
    along = end - start
    turns = _cross_of(along[:, None], along[None, :])
    back = (np.abs(turns) <= _FLAT) & (along @ along.T < 0.0)
    wrong = np.triu(np.where(neighbours, back, meet), 1)
    for first, second in np.argwhere(wrong):
        ends = [f"points[{k}]–points[{(k + 1) % len(points)}]" for k in (int(first), int(second))]
        raise OutlineError(f"the sides {ends[0]} and {ends[1]} meet, but an outline must not touch itself")


def _meeting(start: Floats, end: Floats) -> NDArray[np.bool_]:
    """Return for all pairs of line segments whether they have a common point, shape `(n, n)`."""

    def sides(points: Floats) -> Floats:
        """Return on which side of segment i each point j lies: +1, 0 (on its line) or -1."""
        cross = _cross_of((end - start)[:, None], points[None, :] - start[:, None])
        return np.where(np.abs(cross) <= _FLAT, 0.0, np.sign(cross))

    across = sides(start) * sides(end) <= 0.0
    low, high = np.minimum(start, end), np.maximum(start, end)
    overlap = np.all((low[:, None] <= high[None, :]) & (low[None, :] <= high[:, None]), axis=2)
    meeting: NDArray[np.bool_] = across & across.T & overlap
    return meeting


def _cross_of(first: Floats, second: Floats) -> Floats:
    cross: Floats = first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0]
    return cross


def _cross(a: Point, b: Point, c: Point) -> float:
    """Return twice the signed area (m²) of a triangle; positive if its corners are counter-clockwise."""
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])


def _is_ear(corner: tuple[Point, Point, Point], points: Sequence[Point]) -> bool:
    """Return whether the triangle at a corner of a counter-clockwise polygon is inside the polygon."""
    a, b, c = corner
    return _cross(a, b, c) > _FLAT and not any(
        _cross(a, b, point) >= -_FLAT and _cross(b, c, point) >= -_FLAT and _cross(c, a, point) >= -_FLAT
        for point in points
        if point not in corner
    )
