"""Frontiers: borders between free floor and unknown space, and poses to look at them (Yamauchi, 1997)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from btcore_navigation.costmap import LETHAL, Costmap
from btcore_navigation.costmap_layers import INSCRIBED
from btcore_navigation.grid_search import (
    COST_FACTOR,
    COST_NEUTRAL,
    IMPASSABLE,
    Cell,
    grid_costs,
    reachable_cells,
)
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D

__all__ = ["Frontier", "find_frontiers", "frontier_mask", "is_unknown_nearby"]

MIN_LENGTH = 0.35
"""The minimum length (m) of a frontier; a shorter frontier is usually the shadow of a chair's leg."""
MAX_VIEW_DISTANCE = 0.8
"""The maximum distance (m) between a frontier and the goal from which the robot looks at it."""
CLEARANCE = 0.1
"""The distance (m) between the robot at a goal and unknown cells, which may hide a wall."""
MARGIN = 0.1
"""The distance (m) between a goal and cells at which the robot would touch an obstacle of the map.

The noise of the laser moves the walls of a new map by a cell or two while the robot drives to the goal.
"""
EXCLUSION_RADIUS = 0.5
"""The radius (m) around an excluded position within which nothing counts as a frontier."""
WALL_CELLS = 2
"""The distance (cells) from occupied cells within which unknown cells count as the inside of a wall."""
NEARBY_DISTANCE = 0.3
"""The distance (m) in x and in y within which `is_unknown_nearby` looks for unknown space."""
_LENGTH_BONUS = 0.3  # m of travel that a metre of frontier is worth
_MAX_BONUS = 2.0  # m
_VIEW_RADIUS = 0.6  # m around a frontier's position that the robot looks at


@dataclass(frozen=True, slots=True)
class Frontier:
    """A frontier, and a pose from which the robot can look at it.

    *goal* is this pose. *position* (x, y in m) is the frontier's cell whose goal is cheapest to reach.
    *length* (m) is the length of the frontier. *travel_cost* (m) is the length of the way to the goal,
    increased near obstacles.
    """

    position: tuple[float, float]
    goal: Pose2D
    length: float
    travel_cost: float

    @property
    def cost(self) -> float:
        """The cost (m) by which frontiers are compared: *travel_cost*, less a bonus for a long frontier."""
        return self.travel_cost - min(_MAX_BONUS, _LENGTH_BONUS * self.length)


def frontier_mask(map: OccupancyMap, excluded: Sequence[tuple[float, float]] = ()) -> NDArray[np.bool_]:
    """Return the mask of free cells of *map* next to unknown cells.

    Args:
        map: The map, with free, unknown and occupied cells.
        excluded: Positions (x, y in m); cells within `EXCLUSION_RADIUS` of them are left out.
    """
    size = 2 * WALL_CELLS + 1
    # Unknown cells next to occupied cells are the inside of a wall, not unexplored space.
    walls = cv2.dilate((map.occupied | map.keepout_mask()).astype(np.uint8), np.ones((size, size), np.uint8))
    unknown = (map.unknown & (walls == 0)).astype(np.uint8)
    frontier_cells = map.free & (cv2.dilate(unknown, np.ones((3, 3), np.uint8)) > 0)
    mask = frontier_cells.astype(np.uint8)
    for x, y in excluded:
        row, col = map.cell(x, y)
        cv2.circle(mask, (col, row), round(EXCLUSION_RADIUS / map.resolution), 0, -1)
    result: NDArray[np.bool_] = mask > 0
    return result


def find_frontiers(
    map: OccupancyMap,
    costmap: Costmap,
    here: Pose2D,
    excluded: Sequence[tuple[float, float]] = (),
    *,
    radius: float = 0.30,
) -> list[Frontier]:
    """Return the frontiers that the robot can look at, the best first.

    Args:
        map: The map whose frontiers are returned.
        costmap: A costmap with the same cells as *map*.
        here: The robot's pose in the frame of the map.
        excluded: Positions (x, y in m); cells within `EXCLUSION_RADIUS` of them are left out.
        radius: The robot's radius (m).
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        frontier_mask(map, excluded).astype(np.uint8), connectivity=8
    )
    min_length = MIN_LENGTH / map.resolution
    # The length of a frontier is the longer side of its bounding box.
    lengths = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    long_enough = [label for label in range(1, count) if lengths[label] >= min_length]
    start = costmap.cell(here.x, here.y)
    if not long_enough or not costmap.inside(here.x, here.y):
        return []
    costs = _costs_with_open_start(costmap, here, start, radius)
    reached = reachable_cells(costs, start)
    costs[~reached] = IMPASSABLE
    field, _ = MCP_Geometric(costs).find_costs([start])
    from_unknown = cv2.distanceTransform((~map.unknown).astype(np.uint8), cv2.DIST_L2, 5)
    from_obstacles = cv2.distanceTransform((costmap.costs < INSCRIBED).astype(np.uint8), cv2.DIST_L2, 5)
    # Goals keep a distance from unknown cells and from obstacles, unless no reachable cell does.
    suitable = reached & (from_unknown * map.resolution >= radius + CLEARANCE)
    suitable &= from_obstacles * map.resolution >= MARGIN
    distance, nearest = _nearest(suitable if suitable.any() else reached)
    frontiers = []
    for label in long_enough:
        cells = np.argwhere(labels == label)
        visible = distance[cells[:, 0], cells[:, 1]] * map.resolution <= MAX_VIEW_DISTANCE
        if not visible.any():
            continue
        cells = cells[visible]
        view_cells = nearest[cells[:, 0], cells[:, 1]]
        travel_costs = field[view_cells[:, 0], view_cells[:, 1]]
        cheapest = int(np.argmin(travel_costs))
        cell, view_cell = cells[cheapest], view_cells[cheapest]
        x, y = map.center(int(view_cell[0]), int(view_cell[1]))
        frontiers.append(
            Frontier(
                map.center(int(cell[0]), int(cell[1])),
                Pose2D(x, y, _towards_unknown(map, cell, view_cell)),
                float(lengths[label]) * map.resolution,
                float(travel_costs[cheapest]) / COST_NEUTRAL * map.resolution,
            )
        )
    return sorted(frontiers, key=lambda frontier: (frontier.cost, frontier.position))


def is_unknown_nearby(map: OccupancyMap, position: tuple[float, float]) -> bool:
    """Return whether unknown space borders on free floor near a position.

    Args:
        map: The map, with free, unknown and occupied cells.
        position: The position (x, y in m) in the frame map. Near means within `NEARBY_DISTANCE`.
    """
    row, col = map.cell(*position)
    reach = round(NEARBY_DISTANCE / map.resolution)
    # Whether a cell is in the mask depends on its neighbours, and on walls near them.
    size = reach + 1 + WALL_CELLS
    low_row, low_col = max(0, row - size), max(0, col - size)
    part = OccupancyMap(
        map.cells[low_row : row + size + 1, low_col : col + size + 1],
        map.resolution,
        (map.origin[0] + low_col * map.resolution, map.origin[1] + low_row * map.resolution),
        map.keepout,
    )
    frontier_cells = frontier_mask(part)
    near_row, near_col = row - low_row, col - low_col
    around = frontier_cells[
        max(0, near_row - reach) : near_row + reach + 1, max(0, near_col - reach) : near_col + reach + 1
    ]
    # A part of the minimum length, because the rest of a frontier that was observed is shorter.
    return int(np.count_nonzero(around)) * map.resolution >= MIN_LENGTH / 3


def _costs_with_open_start(costmap: Costmap, here: Pose2D, start: Cell, radius: float) -> NDArray[np.float64]:
    """Return the costs of the known cells; cells around the robot are passable unless they are lethal.

    The robot may stand closer to an obstacle than the planner allows, and must be able to leave.
    """
    costs = grid_costs(costmap.costs, allow_unknown=False)
    window = costmap.square(here, 2 * radius)
    part = costs[window.slices]
    part[(part < 0) & (costmap.costs[window.slices] < LETHAL)] = COST_NEUTRAL + COST_FACTOR * INSCRIBED
    costs[start] = max(costs[start], COST_NEUTRAL)
    return costs


def _nearest(mask: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """Return the distance (cells) of each cell from the nearest cell of *mask*, and the index of that cell.

    The indices have the shape `(height, width, 2)`.
    """
    distance, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    # OpenCV labels each cell with the label of the nearest cell of the mask.
    cells = np.argwhere(mask)
    by_label = np.zeros((int(labels.max()) + 1, 2), dtype=np.intp)
    by_label[labels[cells[:, 0], cells[:, 1]]] = cells
    return np.asarray(distance, dtype=np.float32), by_label[labels]


def _towards_unknown(map: OccupancyMap, position: NDArray[np.intp], view_cell: NDArray[np.intp]) -> float:
    """Return the heading (rad) from the cell *view_cell* to the unknown cells around the cell *position*."""
    reach = round(_VIEW_RADIUS / map.resolution)
    low = np.maximum(position - reach, 0)
    high = position + reach + 1
    unknown = np.argwhere(map.unknown[low[0] : high[0], low[1] : high[1]]) + low
    target = unknown.mean(axis=0) if len(unknown) else position
    return math.atan2(float(target[0] - view_cell[0]), float(target[1] - view_cell[1]))
