"""Drawing of a world's occupancy map from its objects, as a perfect mapping run would make it.

The map has what the robot's laser detects: it does not have glass, which is a keep-out area instead, so that
the robot avoids the glass and laser and map agree. It does not have doors, so that paths lead through them.
"""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.occupancy_map import OccupancyMap
from btcore_sim.world import world_extent
from btcore_sim.world_description import Rectangle, WorldDescription, WorldObject

__all__ = ["rasterise"]

LASER_HEIGHT = 0.0945
"""Height of Tiago's laser above the floor (m). The map shows the objects that this plane cuts."""

ROBOT_HEIGHT = 1.45
"""Height of Tiago with its torso lifted (m). Lower objects outside the laser's plane are keep-out areas."""

RESOLUTION = 0.05
"""Side length (m) of a cell of the maps that are part of the package."""

_MARGIN = 2  # cells around the outermost object
_UNDERFOOT = 0.02  # m: the robot can drive over objects of at most this height


def rasterise(
    description: WorldDescription,
    resolution: float = RESOLUTION,
    *,
    movable: bool = False,
) -> OccupancyMap:
    """Return the map of the static objects that cut the laser's plane.

    A cell is occupied if its middle is less than half a cell from an object, free if it can be reached from
    the start area or the start pose over cells that are not occupied, and otherwise unknown. A way through
    glass does not count. The keep-out areas are the world's own, glass, and the outlines of objects below the
    robot's height that do not cut the plane (table tops).

    For a world that was made from a map, the result is that map, with its own resolution and size, on which
    the objects that were added to the world are drawn.

    Args:
        description: The world.
        resolution: The side length of a cell (m).
        movable: Whether to draw movable objects too, at their initial poses.
    """
    if description.walls is not None:
        return _drawn_on(description.walls.map, description, movable)
    x0, y0, x1, y1 = world_extent(description)
    origin = _snapped(x0, resolution), _snapped(y0, resolution)
    width = math.ceil((x1 - origin[0]) / resolution - 1e-9) + _MARGIN
    rows = math.ceil((y1 - origin[1]) / resolution - 1e-9) + _MARGIN
    occupied = np.zeros((rows, width), dtype=np.bool_)
    glass = np.zeros((rows, width), dtype=np.bool_)
    for item in description.objects:
        if item.meets(LASER_HEIGHT) and (item.is_static or (movable and item.mass > 0.0)):
            draw(item, glass if item.is_glass else occupied, origin, resolution)
    cells = np.where(occupied, 100, -1).astype(np.int8)
    keepout = description.keepout + overhangs(description, resolution)
    map = OccupancyMap(cells, round(resolution, 9), origin, keepout)
    cells[_reached(map, glass, description)] = 0
    return map


def _drawn_on(map: OccupancyMap, description: WorldDescription, movable: bool) -> OccupancyMap:
    """Return *map* with the objects of *description* as occupied cells."""
    drawn = np.zeros(map.cells.shape, dtype=np.bool_)
    for item in description.objects:
        if item.meets(LASER_HEIGHT) and (item.is_static or (movable and item.mass > 0.0)):
            draw(item, drawn, map.origin, map.resolution)
    cells = np.where(drawn, 100, map.cells).astype(np.int8)
    keepout = description.keepout + overhangs(description, map.resolution)
    return OccupancyMap(cells, map.resolution, map.origin, keepout)


def overhangs(description: WorldDescription, resolution: float = RESOLUTION) -> tuple[Rectangle, ...]:
    """Return the outlines of the static objects that the robot can hit but its laser does not detect.

    Args:
        resolution: The length (m) up to which the outlines of prisms and of glass are exact.

    Returns:
        The axis-aligned bounding rectangles (m) of boxes and cylinders, and for each prism and each turned
        pane of glass the rectangles that cover it.
    """
    outlines: list[Rectangle] = []
    for item in description.objects:
        low, high = item.position[2], item.position[2] + item.size[2]
        unseen = item.is_glass or not item.meets(LASER_HEIGHT)
        if not (item.is_static and unseen and low < ROBOT_HEIGHT and high > _UNDERFOOT):
            continue
        if item.kind == "prism" or (item.is_glass and item.yaw):
            outlines += _covering(item, resolution)
        else:
            outlines.append(item.outline())
    return tuple((round(x0, 6), round(y0, 6), round(x1, 6), round(y1, 6)) for x0, y0, x1, y1 in outlines)


def _covering(item: WorldObject, resolution: float) -> list[Rectangle]:
    """Return rectangles that cover *item*: rows of cells, of which equal rows are one rectangle.

    The rectangles end a quarter of a cell inside the outer cells, so that they touch no further cells.
    """
    x0, y0, x1, y1 = item.outline()
    origin = _snapped(x0, resolution), _snapped(y0, resolution)
    shape = (
        math.ceil((y1 - origin[1]) / resolution) + _MARGIN,
        math.ceil((x1 - origin[0]) / resolution) + _MARGIN,
    )
    cells = np.zeros(shape, dtype=np.bool_)
    draw(item, cells, origin, resolution)
    rectangles: list[Rectangle] = []
    above: dict[tuple[int, int], int] = {}
    for row in range(shape[0] + 1):
        filled = cells[row] if row < shape[0] else np.zeros(shape[1], dtype=np.bool_)
        edges = np.flatnonzero(np.diff(filled, prepend=False, append=False)).tolist()
        runs = set(zip(edges[::2], edges[1::2], strict=True))
        for (begin, end), first in list(above.items()):
            if (begin, end) not in runs:
                del above[begin, end]
                left, right = (origin[0] + edge * resolution for edge in (begin + 0.25, end - 0.25))
                bottom, top = (origin[1] + edge * resolution for edge in (first + 0.25, row - 0.25))
                rectangles.append((left, bottom, right, top))
        for run in sorted(runs):
            above.setdefault(run, row)
    return rectangles


def _snapped(edge: float, resolution: float) -> float:
    """Return the multiple of *resolution* that is `_MARGIN` cells below *edge* (m).

    Walls at multiples of the resolution then fill whole cells.
    """
    return round((math.floor(edge / resolution + 1e-9) - _MARGIN) * resolution, 9)


def draw(item: WorldObject, cells: NDArray[np.bool_], origin: tuple[float, float], resolution: float) -> None:
    """Set the cells whose middles are less than half a cell from *item*.

    Args:
        item: The object to draw.
        cells: The cells, shape `(rows, columns)`, row 0 at the origin's y; changed in place.
        origin: The lower left corner of the cells (m).
        resolution: The side length of a cell (m).
    """
    for piece in item.pieces():
        x0, y0, x1, y1 = piece.outline()
        first_row, last_row = (math.floor((y - origin[1]) / resolution) for y in (y0, y1))
        first_col, last_col = (math.floor((x - origin[0]) / resolution) for x in (x0, x1))
        rows = np.arange(max(first_row - 1, 0), min(last_row + 2, len(cells)))
        cols = np.arange(max(first_col - 1, 0), min(last_col + 2, len(cells[0])))
        x = np.asarray(origin[0] + (cols + 0.5) * resolution, dtype=np.float64)
        y = np.asarray(origin[1] + (rows[:, None] + 0.5) * resolution, dtype=np.float64)
        near = piece.distances(x, y) < resolution / 2 - 1e-6
        cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] |= near


def _reached(map: OccupancyMap, glass: NDArray[np.bool_], description: WorldDescription) -> NDArray[np.bool_]:
    """Return the cells that are connected (by their sides) with the start area or the start pose.

    A start pose of the run replaces that of the world, but not the world's area, where the waypoints are.
    """
    empty = ~map.occupied & ~glass
    _, regions = cv2.connectedComponents(empty.astype(np.uint8), connectivity=4)
    x0, y0, x1, y1 = description.area
    (row, col), (last_row, last_col) = map.cell(x0, y0), map.cell(x1, y1)
    starts = np.unique(regions[max(row, 0) : max(last_row + 1, 0), max(col, 0) : max(last_col + 1, 0)])
    if description.pose is not None and map.inside(description.pose.x, description.pose.y):
        starts = np.append(starts, regions[map.cell(description.pose.x, description.pose.y)])
    mask: NDArray[np.bool_] = empty & np.isin(regions, starts)
    return mask
