"""The map of a world, drawn from what stands in it: what a laser would find on a perfect mapping run."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_sim.scene import Rectangle, Scene, SceneObject
from btcore_sim.world import scene_extent

LASER_HEIGHT = 0.0945
"""m above the floor; what this plane cuts is on a map."""

ROBOT_HEIGHT = 1.45
"""m, of Tiago with its torso lifted; what hangs lower, and not in the laser's plane, is kept out of."""

RESOLUTION = 0.05
"""m a cell, of the maps that come along."""

_MARGIN = 2  # cells around the outermost thing
_UNDERFOOT = 0.02  # m; what ends below, a robot drives over


def rasterise(
    scene: Scene, resolution: float = RESOLUTION, *, height: float = LASER_HEIGHT, movable: bool = False
) -> OccupancyMap:
    """The map of what always stays where it is (and of the *movable* where it begins) and meets *height* (m).

    A cell is occupied when its middle is less than half a cell from a thing, free when it can be reached
    from where the robot starts over cells that are not occupied, else unknown. Keep-outs are the scene's own
    and the outlines of what hangs within a robot's height but out of the plane, as table tops do.
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
    """The outlines of what stays where it is and a robot would hit, but a laser at *height* (m) can't see."""
    found = []
    for thing in scene.things:
        low, high = thing.position[2], thing.position[2] + thing.size[2]
        if thing.still and not thing.meets(height) and low < ROBOT_HEIGHT and high > _UNDERFOOT:
            x0, y0, x1, y1 = thing.outline()
            found.append((round(x0, 6), round(y0, 6), round(x1, 6), round(y1, 6)))
    return tuple(found)


def _snapped(edge: float, resolution: float) -> float:
    """A corner on the grid of *resolution*, so that walls drawn on that grid fill whole cells."""
    return round((math.floor(edge / resolution + 1e-9) - _MARGIN) * resolution, 9)


def draw(
    thing: SceneObject, cells: NDArray[np.bool_], origin: tuple[float, float], resolution: float
) -> None:
    """Set those *cells* (row 0 at *origin*'s y) whose middles are less than half a cell from *thing*."""
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
    """Which cells can be walked to, side by side, from the start, or from anywhere in the start's area."""
    empty = ~map.occupied
    _, regions = cv2.connectedComponents(empty.astype(np.uint8), connectivity=4)
    x0, y0, x1, y1 = scene.area
    (row, col), (last_row, last_col) = map.cell(x0, y0), map.cell(x1, y1)
    begun = np.unique(regions[max(row, 0) : max(last_row + 1, 0), max(col, 0) : max(last_col + 1, 0)])
    mask: NDArray[np.bool_] = empty & np.isin(regions, begun)
    return mask
