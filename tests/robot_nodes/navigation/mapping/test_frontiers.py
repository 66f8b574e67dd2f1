"""The search for frontiers on incomplete maps."""

import math

import numpy as np
import pytest

from btcore_navigation.costmap import GlobalCostmap
from btcore_navigation.mapping.frontiers import find_frontiers, frontier_mask, is_unknown_nearby
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D

HERE = Pose2D(1.0, 2.0, 0.0)


def room_map(*, beyond: bool = False, door: float = 1.0) -> OccupancyMap:
    """Return a room of 4 m by 4 m with a door to the east, and the cells *beyond* the door."""
    cells = np.full((80, 160), -1, dtype=np.int8)
    cells[2:78, 2:78] = 0
    cells[[1, 78], 1:79] = 100
    cells[1:79, [1, 78]] = 100
    half = round(door / 2 / 0.05)
    cells[40 - half : 40 + half, 78:82] = 0
    if beyond:
        cells[10:70, 80:158] = 0
        cells[[9, 70], 79:159] = 100
        cells[9:71, 158] = 100
        cells[9 : 40 - half, 79] = cells[40 + half : 71, 79] = 100
    return OccupancyMap(cells, 0.05, (0.0, 0.0))


def test_the_end_of_the_known_floor_is_a_frontier_with_a_goal_facing_it() -> None:
    map = room_map()
    [found] = find_frontiers(map, GlobalCostmap(map), HERE)
    assert found.position[0] == pytest.approx(4.1, abs=0.1)
    assert found.position[1] == pytest.approx(2.0, abs=0.6)
    assert found.goal.x < found.position[0]
    assert math.hypot(found.goal.x - found.position[0], found.goal.y - found.position[1]) < 0.85
    assert abs(found.goal.yaw) < 0.9
    assert found.travel_cost == pytest.approx(math.hypot(found.goal.x - 1.0, found.goal.y - 2.0), rel=0.6)


def test_a_completely_known_map_has_no_frontier() -> None:
    map = room_map(beyond=True)
    assert not find_frontiers(map, GlobalCostmap(map), HERE)


def test_a_gap_that_is_too_narrow_for_the_robot_is_not_a_frontier() -> None:
    map = room_map(door=0.3)
    assert not find_frontiers(map, GlobalCostmap(map), HERE)


def test_excluded_frontiers_are_not_returned() -> None:
    map = room_map()
    [found] = find_frontiers(map, GlobalCostmap(map), HERE)
    assert not find_frontiers(map, GlobalCostmap(map), HERE, [found.position, (4.1, 2.0)])


def test_the_nearer_of_two_frontiers_comes_first() -> None:
    map = room_map()
    map.cells[40:56, 0:3] = 0
    map.cells[40:56, 0] = -1
    west, east = find_frontiers(map, GlobalCostmap(map), HERE)
    assert west.position[0] < 0.3 < east.position[0]
    assert west.travel_cost < east.travel_cost


def test_frontiers_behind_unknown_cells_are_unreachable() -> None:
    map = room_map(beyond=True)
    map.cells[30:50, 76:84] = -1
    map.cells[10:70, 150:158] = -1
    found = find_frontiers(map, GlobalCostmap(map), HERE)
    assert found
    assert all(frontier.position[0] < 4.5 for frontier in found)


def test_the_inside_of_a_wall_is_not_a_frontier() -> None:
    map = room_map(beyond=True)
    map.cells[20:60, 77] = -1
    map.cells[20:60, 78] = 100
    assert not frontier_mask(map).any()


def test_a_mapped_frontier_has_no_unknown_cells_nearby() -> None:
    before, after = room_map(), room_map(beyond=True)
    [found] = find_frontiers(before, GlobalCostmap(before), HERE)
    assert is_unknown_nearby(before, found.position)
    assert not is_unknown_nearby(after, found.position)
