"""Where free floor ends because nobody has looked further: places worth going to (Yamauchi, 1997)."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from skimage.graph import MCP_Geometric

from btcore_robot.navigation.costmap import LETHAL, Costmap
from btcore_robot.navigation.costmap_layers import INSCRIBED
from btcore_robot.navigation.grid_search import (
    COST_FACTOR,
    COST_NEUTRAL,
    IMPASSABLE,
    Cell,
    grid_costs,
    reachable_cells,
)
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D

LEAST = 0.35
"""The least length (m) of a frontier: what is shorter is rarely more than the shadow of a chair's leg."""
IN_SIGHT = 0.8
"""How far (m) from a frontier the place may be that the robot goes to in order to look."""
ASIDE = 0.1
"""How much farther (m) from what is unknown than its radius it stops, as that may be a wall."""
LEFT_OUT = 0.5
"""How far (m) about a place that was given up nothing counts as a frontier."""
BEHIND_A_WALL = 2
"""How many cells from something occupied what is unknown is the inside of it."""
_WORTH = 0.3  # m of way for a metre of frontier
_MOST_WORTH = 2.0  # m
_ABOUT = 0.6  # m about a frontier's place that the robot looks at


@dataclass(frozen=True, slots=True)
class Frontier:
    """A frontier: its cell that is nearest to the robot is at *place* (m), *goal* is from where to look.

    *length* (m) is the frontier's, *way* (m, dearer near obstacles) that of the drive there.
    """

    place: tuple[float, float]
    goal: Pose2D
    length: float
    way: float

    @property
    def price(self) -> float:
        """What counts against going there first (m)."""
        return self.way - min(_MOST_WORTH, _WORTH * self.length)


def frontier_mask(map: OccupancyMap, left_out: Sequence[tuple[float, float]] = ()) -> NDArray[np.bool_]:
    """The free cells of *map* beside unknown ones, but those near the places *left_out* (m)."""
    size = 2 * BEHIND_A_WALL + 1
    walls = cv2.dilate((map.occupied | map.keepout_mask()).astype(np.uint8), np.ones((size, size), np.uint8))
    unseen = (map.unknown & (walls == 0)).astype(np.uint8)
    beside = map.free & (cv2.dilate(unseen, np.ones((3, 3), np.uint8)) > 0)
    found = beside.astype(np.uint8)
    for x, y in left_out:
        row, col = map.cell(x, y)
        cv2.circle(found, (col, row), round(LEFT_OUT / map.resolution), 0, -1)
    mask: NDArray[np.bool_] = found > 0
    return mask


def find_frontiers(
    map: OccupancyMap,
    costmap: Costmap,
    here: Pose2D,
    left_out: Sequence[tuple[float, float]] = (),
    *,
    radius: float = 0.30,
) -> list[Frontier]:
    """The frontiers that a robot of *radius* (m) at *here* can look at, the one to go to first being first.

    *costmap* has the cells of *map*.
    """
    count, labels, stats, _ = cv2.connectedComponentsWithStats(
        frontier_mask(map, left_out).astype(np.uint8), connectivity=8
    )
    least = LEAST / map.resolution
    lengths = np.maximum(stats[:, cv2.CC_STAT_WIDTH], stats[:, cv2.CC_STAT_HEIGHT])
    worthy = [label for label in range(1, count) if lengths[label] >= least]
    start = costmap.cell(here.x, here.y)
    if not worthy or not costmap.inside(here.x, here.y):
        return []
    costs = _open_around(costmap, here, start, radius)
    reached = reachable_cells(costs, start)
    costs[~reached] = IMPASSABLE
    field, _ = MCP_Geometric(costs).find_costs([start])
    from_unknown = cv2.distanceTransform((~map.unknown).astype(np.uint8), cv2.DIST_L2, 5)
    stands_in = reached & (from_unknown * map.resolution >= radius + ASIDE)
    away, nearest = _nearest(stands_in if stands_in.any() else reached)
    found = []
    for label in worthy:
        cells = np.argwhere(labels == label)
        sees = away[cells[:, 0], cells[:, 1]] * map.resolution <= IN_SIGHT
        if not sees.any():
            continue
        cells = cells[sees]
        stands = nearest[cells[:, 0], cells[:, 1]]
        ways = field[stands[:, 0], stands[:, 1]]
        best = int(np.argmin(ways))
        place, stand = cells[best], stands[best]
        x, y = map.center(int(stand[0]), int(stand[1]))
        found.append(
            Frontier(
                map.center(int(place[0]), int(place[1])),
                Pose2D(x, y, _towards_unknown(map, place, stand)),
                float(lengths[label]) * map.resolution,
                float(ways[best]) / COST_NEUTRAL * map.resolution,
            )
        )
    return sorted(found, key=lambda one: (one.price, one.place))


def still_there(map: OccupancyMap, place: tuple[float, float]) -> bool:
    """Whether there is still something unknown to look at, about *place* (m)."""
    row, col = map.cell(*place)
    reach = round(_ABOUT / 2 / map.resolution)
    low_row, low_col = max(0, row - 3 * reach), max(0, col - 3 * reach)
    part = OccupancyMap(
        map.cells[low_row : row + 3 * reach + 1, low_col : col + 3 * reach + 1],
        map.resolution,
        (map.origin[0] + low_col * map.resolution, map.origin[1] + low_row * map.resolution),
        map.keepout,
    )
    beside = frontier_mask(part)
    near_row, near_col = row - low_row, col - low_col
    around = beside[
        max(0, near_row - reach) : near_row + reach + 1, max(0, near_col - reach) : near_col + reach + 1
    ]
    return int(np.count_nonzero(around)) * map.resolution >= LEAST / 3


def _open_around(costmap: Costmap, here: Pose2D, start: Cell, radius: float) -> NDArray[np.float64]:
    """What cells cost that are known; where the robot stands it may, however near to something that is."""
    costs = grid_costs(costmap.costs, allow_unknown=False)
    window = costmap.square(here, 2 * radius)
    part = costs[window.slices]
    part[(part < 0) & (costmap.costs[window.slices] < LETHAL)] = COST_NEUTRAL + COST_FACTOR * INSCRIBED
    costs[start] = max(costs[start], COST_NEUTRAL)
    return costs


def _nearest(mask: NDArray[np.bool_]) -> tuple[NDArray[np.float32], NDArray[np.intp]]:
    """How far (cells) each cell is from the nearest one of *mask*, and which: ``(height, width, 2)``."""
    away, labels = cv2.distanceTransformWithLabels(
        (~mask).astype(np.uint8), cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL
    )
    # The label of a cell is that of the cell of the mask that is nearest to it.
    cells = np.argwhere(mask)
    by_label = np.zeros((int(labels.max()) + 1, 2), dtype=np.intp)
    by_label[labels[cells[:, 0], cells[:, 1]]] = cells
    return np.asarray(away, dtype=np.float32), by_label[labels]


def _towards_unknown(map: OccupancyMap, place: NDArray[np.intp], stand: NDArray[np.intp]) -> float:
    """The heading (rad) from the cell *stand* to what is unknown about *place*."""
    reach = round(_ABOUT / map.resolution)
    low = np.maximum(place - reach, 0)
    unseen = np.argwhere(map.unknown[low[0] : place[0] + reach + 1, low[1] : place[1] + reach + 1]) + low
    target = unseen.mean(axis=0) if len(unseen) else place
    return math.atan2(float(target[0] - stand[0]), float(target[1] - stand[1]))
