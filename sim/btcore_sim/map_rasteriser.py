"""Drawing of a world's occupancy map from its objects, as a perfect mapping run would make it."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_sim.scene import Rectangle, Scene, SceneObject
from btcore_sim.world import scene_extent

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
    scene: Scene, resolution: float = RESOLUTION, *, height: float = LASER_HEIGHT, movable: bool = False
) -> OccupancyMap:
    """Return the map of the static objects that cut the laser's plane.

    A cell is occupied if its middle is less than half a cell from an object, free if it can be reached from
    the robot's start over cells that are not occupied, and otherwise unknown. The keep-out areas are the
    scene's own, and the outlines of objects below the robot's height that do not cut the plane (table tops).

    Args:
        scene: The world.
        resolution: The side length of a cell (m).
        height: The height of the laser's plane (m).
        movable: Whether to draw movable objects too, at their initial poses.
    """
    x0, y0, x1, y1 = scene_extent(scene)
    origin = _snapped(x0, resolution), _snapped(y0, resolution)
    width = math.ceil((x1 - origin[0]) / resolution - 1e-9) + _MARGIN
    rows = math.ceil((y1 - origin[1]) / resolution - 1e-9) + _MARGIN
    occupied = np.zeros((rows, width), dtype=np.bool_)
    for thing in scene.things:
        if thing.meets(height) and (thing.still or (movable and thing.mass > 0.0)):
            draw(thing, occupied, origin, resolution)
    cells = np.where(occupied, 100, -1).astype(np.int8)
    map = OccupancyMap(cells, round(resolution, 9), origin, scene.keepout + overhangs(scene, height))
    cells[_reached(map, scene)] = 0
    return map


def overhangs(scene: Scene, height: float = LASER_HEIGHT) -> tuple[Rectangle, ...]:
    """Return the outlines of the static objects that the robot can hit but its laser does not detect.

    Args:
        scene: The world.
        height: The height of the laser above the floor (m).

    Returns:
        The axis-aligned bounding rectangles of the objects (m).
    """
    outlines = []
    for thing in scene.things:
        low, high = thing.position[2], thing.position[2] + thing.size[2]
        if thing.still and not thing.meets(height) and low < ROBOT_HEIGHT and high > _UNDERFOOT:
            x0, y0, x1, y1 = thing.outline()
            outlines.append((round(x0, 6), round(y0, 6), round(x1, 6), round(y1, 6)))
    return tuple(outlines)


def _snapped(edge: float, resolution: float) -> float:
    """Return the multiple of *resolution* that is `_MARGIN` cells below *edge* (m).

    Walls at multiples of the resolution then fill whole cells.
    """
    return round((math.floor(edge / resolution + 1e-9) - _MARGIN) * resolution, 9)


def draw(
    thing: SceneObject, cells: NDArray[np.bool_], origin: tuple[float, float], resolution: float
) -> None:
    """Set the cells whose middles are less than half a cell from *thing*.

    Args:
        thing: The object to draw.
        cells: The cells, shape `(rows, columns)`, row 0 at the origin's y; changed in place.
        origin: The lower left corner of the cells (m).
        resolution: The side length of a cell (m).
    """
    x0, y0, x1, y1 = thing.outline()
    first_row, last_row = (math.floor((y - origin[1]) / resolution) for y in (y0, y1))
    first_col, last_col = (math.floor((x - origin[0]) / resolution) for x in (x0, x1))
    rows = np.arange(max(first_row - 1, 0), min(last_row + 2, len(cells)))
    cols = np.arange(max(first_col - 1, 0), min(last_col + 2, len(cells[0])))
    x = origin[0] + (cols + 0.5) * resolution - thing.position[0]
    y = origin[1] + (rows[:, None] + 0.5) * resolution - thing.position[1]
    if thing.kind == "cylinder":
        away = np.hypot(x, y) - thing.size[0] / 2
    else:
        cos, sin = math.cos(thing.yaw), math.sin(thing.yaw)
        along = np.abs(cos * x + sin * y) - thing.size[0] / 2
        across = np.abs(cos * y - sin * x) - thing.size[1] / 2
        away = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    cells[rows[0] : rows[-1] + 1, cols[0] : cols[-1] + 1] |= away < resolution / 2 - 1e-6


def _reached(map: OccupancyMap, scene: Scene) -> NDArray[np.bool_]:
    """Return the cells that are connected (by their sides) with the start pose or the start area."""
    empty = ~map.occupied
    _, regions = cv2.connectedComponents(empty.astype(np.uint8), connectivity=4)
    x0, y0, x1, y1 = scene.area
    (row, col), (last_row, last_col) = map.cell(x0, y0), map.cell(x1, y1)
    starts = np.unique(regions[max(row, 0) : max(last_row + 1, 0), max(col, 0) : max(last_col + 1, 0)])
    mask: NDArray[np.bool_] = empty & np.isin(regions, starts)
    return mask
