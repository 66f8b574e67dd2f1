"""The floor of a world as whoever walks on it sees it: how much room there is, where, and along a line."""

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_sim.map_rasteriser import draw, rasterise
from btcore_sim.scene import Scene, SceneObject

Point = tuple[float, float]

_DRAWS = 400


class ClearanceMap:
    """The room (m) around every cell of a map: how far it is to what is occupied, unknown or kept out of."""

    def __init__(self, map: OccupancyMap) -> None:
        self.map = map
        self._taken: NDArray[np.bool_] = ~map.free | map.keepout_mask()
        self._measure()

    @classmethod
    def of(cls, scene: Scene) -> "ClearanceMap":
        """The floor of *scene*, where all things are where they begin and kinematic ones are not there."""
        return cls(rasterise(scene, movable=True))

    def add_obstacle(self, thing: SceneObject) -> None:
        """From now on *thing* stands there."""
        draw(thing, self._taken, self.map.origin, self.map.resolution)
        self._measure()

    def with_obstacle(self, thing: SceneObject) -> "ClearanceMap":
        """This floor with *thing* on it; itself it stays as it is."""
        other = object.__new__(ClearanceMap)
        other.map, other._taken = self.map, self._taken.copy()
        other.add_obstacle(thing)
        return other

    def clearance_at(self, x: float, y: float) -> float:
        """How far (m) the cell at the point is from what is not free; 0 outside."""
        row, col = self.map.cell(x, y)
        return float(self.clearances[row, col]) if self.map.inside(x, y) else 0.0

    def clearance_along(self, start: Point, end: Point) -> float:
        """The least room (m) along the straight line."""
        count = max(2, math.ceil(2 * math.dist(start, end) / self.map.resolution))
        part = np.linspace(0.0, 1.0, count)[:, None]
        places = self.map.indices(np.asarray(start) * (1.0 - part) + np.asarray(end) * part)
        shape = np.asarray(self.clearances.shape)
        if ((places < 0) | (places >= shape)).any():
            return 0.0
        return float(self.clearances[places[:, 0], places[:, 1]].min())

    def connected(self, points: list[Point], room: float) -> bool:
        """Whether who needs *room* (m) to every side can go between all *points*; each has to have it too."""
        _, regions = cv2.connectedComponents((self.clearances >= room).astype(np.uint8), connectivity=4)
        found = {int(regions[self.map.cell(*point)]) for point in points}
        return len(found) <= 1 and 0 not in found

    def random_point(self, random: np.random.Generator, room: float) -> Point | None:
        """The middle of a random cell with *room* (m); None when there is none."""
        cells = np.flatnonzero(self.clearances >= room)
        if not len(cells):
            return None
        row, col = divmod(int(cells[random.integers(len(cells))]), self.clearances.shape[1])
        return self.map.center(row, col)

    def random_visible_point(
        self, random: np.random.Generator, start: Point, room: float, nearest: float, farthest: float
    ) -> Point | None:
        """A random place between *nearest* and *farthest* (m), the straight way to which has *room* (m)."""
        for _ in range(_DRAWS):
            away, angle = random.uniform(nearest, farthest), random.uniform(-math.pi, math.pi)
            end = (start[0] + away * math.cos(angle), start[1] + away * math.sin(angle))
            if self.clearance_at(*end) >= room and self.clearance_along(start, end) >= room:
                return end
        return None

    def _measure(self) -> None:
        open_floor = (~self._taken).astype(np.uint8)
        middles = cv2.distanceTransform(open_floor, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(np.float64)
        # To the nearest taken cell's edge, half a cell before its middle.
        self.clearances: NDArray[np.float64] = np.maximum(middles - 0.5, 0.0) * self.map.resolution
        """The room (m) of every cell, of the map's shape."""
