"""Distances to the nearest obstacle on a world's floor, at a point and along a line."""

import heapq
import itertools
import math

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.occupancy_map import OccupancyMap
from btcore_sim.map_rasteriser import draw, rasterise
from btcore_sim.world_description import WorldDescription, WorldObject

Point = tuple[float, float]

BESIDE_HULL = 0.05
"""The clearance (m) beside a robot's hull on a way that its planner can use.

The planner keeps 3 cm, and the cells of its map are exact to half a cell.
"""

_NEIGHBOURS = [step for step in itertools.product((-1, 0, 1), repeat=2) if step != (0, 0)]
_DRAWS = 400  # attempts of a random search before it gives up


class ClearanceMap:
    """The clearance of every cell of a map: its distance (m) to the nearest cell that is not free.

    Occupied cells, unknown cells and keep-out areas are not free.
    """

    def __init__(self, map: OccupancyMap) -> None:
        self.map = map
        self._taken: NDArray[np.bool_] = ~map.free | map.keepout_mask()
        self._measure()

    @classmethod
    def of(cls, description: WorldDescription) -> "ClearanceMap":
        """Return the clearance map of *description* with all objects at their initial poses.

        Kinematic objects (people, dropped boxes) are left out.
        """
        return cls(rasterise(description, movable=True))

    def add_obstacle(self, *objects: WorldObject) -> None:
        """Add *objects* to the map as obstacles."""
        for item in objects:
            draw(item, self._taken, self.map.origin, self.map.resolution)
        self._measure()

    def with_obstacle(self, *objects: WorldObject) -> "ClearanceMap":
        """Return a copy of the map with *objects* added as obstacles."""
        copy = object.__new__(ClearanceMap)
        copy.map, copy._taken = self.map, self._taken.copy()
        copy.add_obstacle(*objects)
        return copy

    def clearance_at(self, x: float, y: float) -> float:
        """Return the clearance (m) of the cell at a point; 0 outside the map.

        Args:
            x: The x coordinate of the point in the map frame (m).
            y: The y coordinate of the point in the map frame (m).
        """
        row, col = self.map.cell(x, y)
        return float(self.clearances[row, col]) if self.map.inside(x, y) else 0.0

    def clearance_along(self, start: Point, end: Point) -> float:
        """Return the smallest clearance (m) along a straight line; 0 if the line leaves the map.

        Args:
            start: The first point of the line, (x, y) in the map frame (m).
            end: The last point of the line, (x, y) in the map frame (m).
        """
        # Two samples per cell, so that the line skips no cell.
        count = max(2, math.ceil(2 * math.dist(start, end) / self.map.resolution))
        part = np.linspace(0.0, 1.0, count)[:, None]
        places = self.map.indices(np.asarray(start) * (1.0 - part) + np.asarray(end) * part)
        shape = np.asarray(self.clearances.shape)
        if ((places < 0) | (places >= shape)).any():
            return 0.0
        return float(self.clearances[places[:, 0], places[:, 1]].min())

    def connected(self, points: list[Point], clearance: float) -> bool:
        """Return whether a body that needs *clearance* can go from each point to every other point.

        Args:
            points: Positions (m).
            clearance: The clearance that the body needs everywhere, at the points too (m).

        Returns:
            Whether all points are in one connected region of cells with that clearance.
        """
        _, regions = cv2.connectedComponents((self.clearances >= clearance).astype(np.uint8), connectivity=4)
        labels = {int(regions[self.map.cell(*point)]) for point in points}
        return len(labels) <= 1 and 0 not in labels  # 0 is the label of cells without enough clearance

    def reachable(self, start: Point, clearance: float) -> NDArray[np.bool_]:
        """Return the cells that a body can reach from *start* over cells with *clearance*.

        Near a start with less clearance, the clearance of the start is sufficient. No cell is reachable from
        a start that is not free.

        Args:
            start: The position of the body (m).
            clearance: The clearance that the body needs (m).

        Returns:
            A mask of the shape of `clearances`.
        """
        passable = self.clearances >= clearance
        start_clearance = self.clearance_at(*start)
        if start_clearance <= 0.0:
            return np.zeros_like(passable)
        (row, col), reach = self.map.cell(*start), math.ceil(2 * clearance / self.map.resolution)
        near = np.s_[max(row - reach, 0) : row + reach + 1, max(col - reach, 0) : col + reach + 1]
        passable[near] |= self.clearances[near] >= min(clearance, start_clearance)
        _, regions = cv2.connectedComponents(passable.astype(np.uint8), connectivity=4)
        mask: NDArray[np.bool_] = regions == regions[row, col]
        return mask

    def way(self, start: Point, end: Point, clearance: float) -> list[Point] | None:
        """Return the shortest way from *start* to *end* over the cells that are `reachable` from *start*.

        Args:
            start: The first point (m).
            end: The last point (m).
            clearance: The clearance that the way needs (m).

        Returns:
            The middles of the cells on the way, or None if there is no way.
        """
        open_cells = self.reachable(start, clearance)
        first, last = self.map.cell(*start), self.map.cell(*end)
        if not (self.map.inside(*end) and open_cells[last]):
            return None
        height, width = open_cells.shape
        # Dijkstra's algorithm from the end, so that the links of the cells lead from the start to the end.
        lengths = {last: 0.0}
        links: dict[tuple[int, int], tuple[int, int]] = {}
        queue = [(0.0, last)]
        while queue:
            length, cell = heapq.heappop(queue)
            if cell == first:
                break
            if length > lengths[cell]:
                continue
            for rows, cols in _NEIGHBOURS:
                neighbour = cell[0] + rows, cell[1] + cols
                if not (0 <= neighbour[0] < height and 0 <= neighbour[1] < width and open_cells[neighbour]):
                    continue
                new_length = length + math.hypot(rows, cols)
                if new_length < lengths.get(neighbour, math.inf):
                    lengths[neighbour], links[neighbour] = new_length, cell
                    heapq.heappush(queue, (new_length, neighbour))
        cells = [first]
        while cells[-1] != last:
            cells.append(links[cells[-1]])
        return [self.map.center(*cell) for cell in cells]

    def random_point(
        self, random: np.random.Generator, clearance: float, among: NDArray[np.bool_] | None = None
    ) -> Point | None:
        """Return the middle of a random cell with enough clearance.

        Args:
            random: The source of the random choice.
            clearance: The smallest accepted clearance (m).
            among: A mask of the cells to choose from, of the shape of `clearances`; None = all cells.

        Returns:
            The point (x, y in m), or None if none of the cells has enough clearance.
        """
        enough = self.clearances >= clearance
        cells = np.flatnonzero(enough if among is None else enough & among)
        if not len(cells):
            return None
        row, col = divmod(int(cells[random.integers(len(cells))]), self.clearances.shape[1])
        return self.map.center(row, col)

    def random_visible_point(
        self, random: np.random.Generator, start: Point, clearance: float, nearest: float, farthest: float
    ) -> Point | None:
        """Return a random point that can be reached from *start* on a straight line.

        Args:
            random: The source of the random distances and directions.
            start: The start of the line (m).
            clearance: The clearance that the whole line needs (m).
            nearest: The smallest distance of the point (m).
            farthest: The greatest distance of the point (m).

        Returns:
            The point (m), or None if 400 attempts found none.
        """
        for _ in range(_DRAWS):
            away, angle = random.uniform(nearest, farthest), random.uniform(-math.pi, math.pi)
            end = (start[0] + away * math.cos(angle), start[1] + away * math.sin(angle))
            if self.clearance_at(*end) >= clearance and self.clearance_along(start, end) >= clearance:
                return end
        return None

    def _measure(self) -> None:
        open_floor = (~self._taken).astype(np.uint8)
        middles = cv2.distanceTransform(open_floor, cv2.DIST_L2, cv2.DIST_MASK_PRECISE).astype(np.float64)
        # OpenCV measures to the middle of the nearest taken cell; its edge is half a cell nearer.
        self.clearances: NDArray[np.float64] = np.maximum(middles - 0.5, 0.0) * self.map.resolution
        """The clearance (m) of every cell, shape `(rows, columns)` like the map's."""
