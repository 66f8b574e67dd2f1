"""The planner: cheapest paths, smoothing, tolerances and errors."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import dijkstra

from btcore_navigation.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap, GlobalCostmap
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.grid_search import (
    IMPASSABLE,
    CostBounds,
    find_cheapest_path,
    grid_costs,
    reachable_cells,
)
from btcore_navigation.path import NavPath, empty_path
from btcore_navigation.path_smoothing import MAX_COST_RATIO, smooth_path
from btcore_navigation.planner import Planner, PlannerError
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserScan, Pose2D

ROOMS = """
########################################
#                  #                   #
#                  #                   #
#                  #                   #
#                  #                   #
#                                      #
#                                      #
#                                      #
#                                      #
#                                      #
#                  #                   #
#                  #                   #
#                  #                   #
#                  ######         ######
#         ##       #                   #
#         ##       #                   #
#         ##       #         ###########
#                  #         #         #
#                  #         #         #
#                  #         #         #
#                  #         #         #
#                  #         #         #
#                  #         #         #
########################################
"""
"""Rooms with 0.2 m for each character, the highest y first; the room in the lower right is closed."""

WEST, NORTH, EAST, CLOSED = (
    Pose2D(*place, 0.5) for place in ((1.0, 1.0), (5.5, 3.9), (4.9, 0.7), (6.9, 0.7))
)


def drawn(text: str, scale: int = 4) -> OccupancyMap:
    """Return a map in which each character stands for 4 by 4 cells of 0.05 m."""
    marks = {"#": 100, " ": 0, "?": -1}
    rows = [[marks[mark] for mark in line] for line in text.strip("\n").splitlines()[::-1]]
    cells = np.array(rows, dtype=np.int8).repeat(scale, axis=0).repeat(scale, axis=1)
    return OccupancyMap(cells, 0.05, (0.0, 0.0))


@pytest.fixture(scope="module")
def rooms() -> GlobalCostmap:
    return GlobalCostmap(drawn(ROOMS))


def dense(path: NavPath) -> np.ndarray:
    """Return points along a path, at most 1 cm apart."""
    pieces = [
        first + (second - first) * np.linspace(0, 1, 8)[:, None] for first, second in pairwise(path.points)
    ]
    return np.concatenate(pieces)


def path_cost(costs: np.ndarray, cells: list[tuple[int, int]]) -> float:
    return sum(
        math.dist(first, second) * (costs[first] + costs[second]) / 2 for first, second in pairwise(cells)
    )


def least_costs(costs: np.ndarray, start: tuple[int, int]) -> np.ndarray:
    """Return the cheapest price of every cell, by an independent Dijkstra search on a graph of the cells."""
    height, width = costs.shape
    numbers = np.arange(height * width).reshape(height, width)
    sources, targets, weights = [], [], []
    for rows, cols in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, height - rows), slice(max(0, -cols), width - max(0, cols)))
        there = (slice(rows, height), slice(max(0, cols), width + min(0, cols)))
        open_cells = (costs[here] >= 0) & (costs[there] >= 0)
        sources.append(numbers[here][open_cells])
        targets.append(numbers[there][open_cells])
        weights.append(math.hypot(rows, cols) * ((costs[here] + costs[there]) / 2)[open_cells])
    graph = coo_matrix(
        (np.concatenate(weights), (np.concatenate(sources), np.concatenate(targets))),
        shape=(costs.size, costs.size),
    )
    found = dijkstra(graph.tocsr(), directed=False, indices=numbers[start])
    return found.reshape(costs.shape)


@st.composite
def grids(draw: st.DrawFn) -> tuple[np.ndarray, tuple[int, int], tuple[int, int]]:
    """Return costs with two free cells, a start and a goal."""
    shape = draw(st.integers(2, 14)), draw(st.integers(2, 14))
    kinds = st.sampled_from([0, 0, 0, 0, 30, 119, 216, 252, INSCRIBED, LETHAL, UNKNOWN])
    costs = draw(arrays(np.uint8, shape, elements=kinds, fill=st.nothing()))
    cells = st.tuples(st.integers(0, shape[0] - 1), st.integers(0, shape[1] - 1))
    start, goal = draw(cells), draw(cells)
    costs[start] = costs[goal] = 0
    return costs, start, goal


# -- the search


def test_the_costs_of_cells_are_navfns() -> None:
    costs = np.array([[0, 1, 100, 252, INSCRIBED, LETHAL, UNKNOWN]], dtype=np.uint8)
    assert grid_costs(costs)[0] == pytest.approx([50, 50.8, 130, 251.6, IMPASSABLE, IMPASSABLE, 252.4])
    assert grid_costs(costs, allow_unknown=False)[0, -1] == IMPASSABLE


@given(grids(), st.booleans())
def test_the_found_path_is_the_cheapest_path(grid: Any, allow_unknown: bool) -> None:
    values, start, goal = grid
    costs = grid_costs(values, allow_unknown=allow_unknown)
    least = least_costs(costs, start)
    found = find_cheapest_path(costs, start, goal)
    assert np.array_equal(reachable_cells(costs, start), np.isfinite(least))
    if math.isinf(least[goal]):
        assert found is None
    else:
        assert found is not None
        assert (found[0], found[-1]) == (start, goal)
        assert all(costs[cell] >= 0 for cell in found)
        assert path_cost(costs, found) == pytest.approx(least[goal])


@given(grids(), st.data())
def test_bounds_of_a_floor_with_fewer_obstacles_find_the_cheapest_path(
    grid: tuple[np.ndarray, tuple[int, int], tuple[int, int]], data: Any
) -> None:
    values, first, goal = grid
    kept = data.draw(arrays(np.bool_, values.shape, elements=st.booleans(), fill=st.nothing()))
    floor = grid_costs(np.where(kept & (values != UNKNOWN), values, 0).astype(np.uint8))
    costs = grid_costs(values)
    bounds = CostBounds(floor, first, goal)
    cells = st.tuples(*(st.integers(0, side - 1) for side in values.shape))
    for start in data.draw(st.lists(cells, min_size=1, max_size=4)):
        least = least_costs(costs, start)[goal] if costs[start] >= 0 else math.inf
        if math.isfinite(least):
            found = find_cheapest_path(costs, start, goal, bounds)
            assert found is not None
            assert path_cost(costs, found) == pytest.approx(least)


def test_bounds_of_an_enclosed_start_can_be_used_for_another_start() -> None:
    floor = grid_costs(np.array([[0, LETHAL, 0, 0, 0]], dtype=np.uint8))
    bounds = CostBounds(floor, (0, 0), (0, 4))
    assert find_cheapest_path(floor, (0, 2), (0, 4), bounds) == [(0, 2), (0, 3), (0, 4)]
    assert find_cheapest_path(floor, (0, 0), (0, 4), bounds) is None


# -- smoothness


@given(grids())
def test_a_smoothed_path_avoids_walls_and_costs_hardly_more(
    grid: tuple[np.ndarray, tuple[int, int], tuple[int, int]],
) -> None:
    values, start, goal = grid
    costs = grid_costs(values.repeat(3, axis=0).repeat(3, axis=1))
    start, goal = (3 * start[0] + 1, 3 * start[1] + 1), (3 * goal[0] + 1, 3 * goal[1] + 1)
    cells = find_cheapest_path(costs, start, goal)
    assume(cells is not None and len(cells) > 2)
    way = np.array(cells, dtype=np.float64)
    found = smooth_path(costs, way)
    assert (found[0].tolist(), found[-1].tolist()) == (way[0].tolist(), way[-1].tolist())
    steps = np.diff(found, axis=0)
    lengths = np.hypot(*steps.T)
    if not np.array_equal(found, way):
        assert lengths.max() <= 1 + 1e-9
    between = found[:-1, None] + steps[:, None] * ((np.arange(16) + 0.5) / 16)[:, None]
    under = np.floor(between + 0.5).astype(int)
    prices = costs[under[..., 0], under[..., 1]]
    assert (prices < 0).mean() < 0.01  # a corner may be grazed for a tenth of a cell
    grazed = 0.2 * costs.max()  # the error of a cost that is computed by samples
    assert (prices.mean(axis=1) * lengths).sum() <= 1.03 * MAX_COST_RATIO * path_cost(costs, cells) + grazed


def test_a_path_over_an_open_floor_is_a_straight_line() -> None:
    planner = Planner(GlobalCostmap(OccupancyMap(np.zeros((120, 200), dtype=np.int8), 0.05, (0.0, 0.0))))
    start, goal = Pose2D(1.0, 1.0, 0.0), Pose2D(9.0, 4.0, 2.0)
    path = planner.plan(start, goal, 0)
    assert path.length() == pytest.approx(math.hypot(8.0, 3.0), rel=0.002)
    assert path.poses[:-1, 2] == pytest.approx(math.atan2(3.0, 8.0), abs=0.1)


def test_a_path_turns_gently_and_keeps_away_from_corners(rooms: GlobalCostmap) -> None:
    path = Planner(rooms).plan(WEST, EAST, 0)
    turns = np.diff(path.poses[:-1, 2])
    assert np.abs((turns + math.pi) % (2 * math.pi) - math.pi).max() < 0.25
    assert np.median(rooms.costs_at(path.points)) == 0


def test_a_smoothed_path_is_shorter_than_the_path_of_cells(rooms: GlobalCostmap) -> None:
    costs = grid_costs(rooms.costs)
    cells = find_cheapest_path(costs, rooms.cell(WEST.x, WEST.y), rooms.cell(EAST.x, EAST.y))
    assert cells is not None
    on_cells = sum(math.dist(first, second) for first, second in pairwise(cells)) * 0.05
    straight = math.hypot(EAST.x - WEST.x, EAST.y - WEST.y)
    assert straight < Planner(rooms).plan(WEST, EAST, 0).length() < on_cells


# -- paths


@given(st.lists(st.tuples(st.floats(0.1, 7.9), st.floats(0.1, 4.7)), min_size=2, max_size=2))
def test_a_path_keeps_the_robots_radius_from_obstacles(places: list[tuple[float, float]]) -> None:
    costmap = GlobalCostmap(drawn(ROOMS))
    start, goal = (Pose2D(x, y, 0.0) for x, y in places)
    assume(costmap.cost(start.x, start.y) < INSCRIBED)
    try:
        path = Planner(costmap).plan(start, goal, 0)
    except PlannerError:
        reached = reachable_cells(grid_costs(costmap.costs), costmap.cell(start.x, start.y))
        assert not reached[costmap.cell(goal.x, goal.y)]
        return
    assert costmap.costs_at(dense(path)).max() < INSCRIBED


def test_a_goal_in_the_corner_of_its_cell_is_not_approached_through_a_wall(rooms: GlobalCostmap) -> None:
    goal = Pose2D(3.59765625, 2.96875, 0.0)  # the straight line from the next cell's centre is blocked
    path = Planner(rooms).plan(Pose2D(5.0, 1.0, 0.0), goal, 0)
    assert path.goal == goal
    assert rooms.costs_at(dense(path)).max() < INSCRIBED


def test_a_path_begins_at_the_robot_and_ends_with_the_goals_pose(rooms: GlobalCostmap) -> None:
    path = Planner(rooms).plan(WEST, EAST, 17)
    assert path.points[0].tolist() == [WEST.x, WEST.y]
    assert path.goal == EAST
    assert (path.stamp, path.frame) == (17, "map")
    steps = np.diff(path.points, axis=0)
    assert path.poses[:-1, 2] == pytest.approx(np.arctan2(steps[:, 1], steps[:, 0]))
    assert np.hypot(*steps.T).max() <= 0.0501


def test_a_path_to_a_goal_at_the_robots_place_ends_at_the_goal(rooms: GlobalCostmap) -> None:
    path = Planner(rooms).plan(WEST, Pose2D(1.01, 1.0, -2.0), 0)
    assert path.goal == Pose2D(1.01, 1.0, -2.0)
    assert path.length() == pytest.approx(0.01)


def test_replanning_from_a_later_pose_keeps_the_path(rooms: GlobalCostmap) -> None:
    planner = Planner(rooms)
    path = planner.plan(WEST, EAST, 0)
    whole = path.length()
    for index in range(5, len(path) - 5, 10):
        again = planner.plan(path[index], EAST, index)
        assert again.length() == pytest.approx(whole - path.distances()[index], rel=0.03, abs=0.05)


def test_the_same_request_gives_the_same_path(rooms: GlobalCostmap) -> None:
    planner = Planner(rooms)
    answers = [planner.plan(WEST, EAST, 0) for _ in range(3)]
    assert all(answers[0].has_same_poses(answer) for answer in answers[1:])
    assert answers[0].has_same_poses(Planner(rooms).plan(WEST, EAST, 9))


def test_an_observed_obstacle_is_avoided_until_it_is_cleared() -> None:
    costmap = GlobalCostmap(drawn(ROOMS))
    planner = Planner(costmap)
    before = planner.plan(WEST, NORTH, 0)
    at = before[len(before) // 3]
    aim = math.atan2(*(before.points[len(before) // 3 + 20] - before.points[len(before) // 3])[::-1])
    ranges = np.full(21, 0.8, dtype=np.float32)
    scan = LaserScan(ranges, 0, -0.1, 0.01, 0.05, 25.0, "laser")
    costmap.observe(scan, Pose2D(at.x, at.y, aim))
    costmap.update(0)
    hit = at.x + 0.8 * math.cos(aim), at.y + 0.8 * math.sin(aim)
    assert costmap.costs_at(before.points).max() >= INSCRIBED
    for _ in range(3):
        around = planner.plan(WEST, NORTH, 1)
        assert costmap.costs_at(dense(around)).max() < INSCRIBED
        assert np.hypot(*(around.points - hit).T).min() > 0.3
    costmap.clear()
    assert planner.plan(WEST, NORTH, 2).has_same_poses(before)


def test_a_path_crosses_unknown_cells_only_if_allowed() -> None:
    bridge = drawn("###########\n" + "#   ??    #\n" * 4 + "###########")
    start, goal = Pose2D(0.5, 0.6, 0.0), Pose2D(1.6, 0.6, 0.0)
    assert Planner(GlobalCostmap(bridge)).plan(start, goal, 0).goal == goal
    with pytest.raises(PlannerError, match="the map does not connect it") as fault:
        Planner(GlobalCostmap(bridge), allow_unknown=False).plan(start, goal, 0)
    assert fault.value.code == Nav2ErrorCode.NO_VALID_PATH


# -- through poses


def test_a_path_through_poses_passes_each_in_turn(rooms: GlobalCostmap) -> None:
    path = Planner(rooms).plan_through([WEST, NORTH, EAST], 5)
    reached = [path.nearest(pose.x, pose.y) for pose in (WEST, NORTH, EAST)]
    assert reached == [0, reached[1], len(path) - 1]
    assert 0 < reached[1] < len(path) - 1
    assert path[reached[1]] == NORTH
    assert path.goal == EAST


@pytest.mark.parametrize("poses", [[], [WEST]])
def test_a_path_through_fewer_than_two_poses_raises(rooms: GlobalCostmap, poses: list[Pose2D]) -> None:
    with pytest.raises(PlannerError) as fault:
        Planner(rooms).plan_through(poses, 0)
    assert fault.value.code == Nav2ErrorCode.NO_VIAPOINTS_GIVEN


def test_a_leg_that_fails_is_reported_with_the_code_of_its_action(rooms: GlobalCostmap) -> None:
    with pytest.raises(
        PlannerError, match=r"leg 2 of 2: no path to \(6\.90, 0\.70\): the map does not connect it"
    ) as fault:
        Planner(rooms).plan_through([WEST, NORTH, CLOSED], 0)
    assert fault.value.code == Nav2ErrorCode.THROUGH_NO_VALID_PATH


# -- refusals


@pytest.mark.parametrize(
    ("start", "goal", "code"),
    [
        (WEST, Pose2D(3.9, 1.0, 0.0), Nav2ErrorCode.GOAL_OCCUPIED),
        (
            WEST,
            Pose2D(3.6, 1.0, 0.0),
            Nav2ErrorCode.GOAL_OCCUPIED,
        ),  # 0.2 m from that wall: no room for the robot
        (WEST, CLOSED, Nav2ErrorCode.NO_VALID_PATH),
        (WEST, Pose2D(8.01, 1.0, 0.0), Nav2ErrorCode.GOAL_OUTSIDE_MAP),
        (WEST, Pose2D(math.nan, 1.0, 0.0), Nav2ErrorCode.GOAL_OUTSIDE_MAP),
        (Pose2D(-0.01, 1.0, 0.0), EAST, Nav2ErrorCode.START_OUTSIDE_MAP),
        (Pose2D(3.9, 0.1, 0.0), EAST, Nav2ErrorCode.START_OCCUPIED),
    ],
)
def test_an_invalid_start_or_goal_raises_with_its_code(
    rooms: GlobalCostmap, start: Pose2D, goal: Pose2D, code: Nav2ErrorCode
) -> None:
    with pytest.raises(PlannerError) as fault:
        Planner(rooms).plan(start, goal, 0)
    assert fault.value.code == code
    assert str(fault.value)


def test_an_observed_obstacle_that_blocks_the_way_or_the_goal_is_named_with_its_place() -> None:
    costmap = GlobalCostmap(drawn(ROOMS))
    planner = Planner(costmap, place_name=lambda pose: "the charger")
    assert planner.plan(EAST, NORTH, 0).goal == NORTH
    angles = np.arange(-0.8, 0.8, 0.01)
    ranges = (1.12 / np.cos(angles)).astype(np.float32)
    closed = LaserScan(ranges, 0, -0.8, 0.01, 0.05, 25.0, "laser")
    costmap.observe(closed, Pose2D(5.8, 1.0, math.pi / 2))
    costmap.update(0)
    with pytest.raises(
        PlannerError, match=r"^no path to the charger: blocked at \(5\.\d\d, 2\.1\d\)$"
    ) as fault:
        planner.plan(EAST, NORTH, 1)
    assert fault.value.code == Nav2ErrorCode.NO_VALID_PATH
    in_the_gap = Pose2D(5.8, 2.0, 0.0)
    with pytest.raises(
        PlannerError, match=r": an obstacle at \(5\.\d\d, 2\.1\d\) is not on the map$"
    ) as fault:
        planner.plan(EAST, in_the_gap, 1)
    assert fault.value.code == Nav2ErrorCode.GOAL_OCCUPIED
    planner.check_goal(in_the_gap)


@pytest.mark.parametrize(
    ("goal", "code"),
    [
        (Pose2D(3.9, 1.0, 0.0), Nav2ErrorCode.GOAL_OCCUPIED),
        (Pose2D(8.01, 1.0, 0.0), Nav2ErrorCode.GOAL_OUTSIDE_MAP),
    ],
)
def test_a_goal_that_the_map_excludes_is_refused_without_a_plan(
    rooms: GlobalCostmap, goal: Pose2D, code: Nav2ErrorCode
) -> None:
    with pytest.raises(PlannerError) as fault:
        Planner(rooms).check_goal(goal)
    assert fault.value.code == code


def test_a_goal_in_a_keepout_is_occupied() -> None:
    map = drawn(ROOMS)
    kept = OccupancyMap(map.cells, map.resolution, map.origin, ((5.0, 3.5, 6.0, 4.5),))
    with pytest.raises(PlannerError, match="is in an obstacle") as fault:
        Planner(GlobalCostmap(kept)).plan(WEST, NORTH, 0)
    assert fault.value.code == Nav2ErrorCode.GOAL_OCCUPIED


def test_a_path_without_poses_has_no_goal_and_no_length() -> None:
    path = empty_path(3)
    assert (len(path), path.goal, path.length(), path.nearest(0, 0), path.stamp) == (0, None, 0.0, -1, 3)


# -- starts near obstacles


@pytest.mark.parametrize("gap", [0.28, 0.2, 0.12])
def test_a_path_leads_away_from_a_start_too_near_to_a_wall(rooms: GlobalCostmap, gap: float) -> None:
    start = Pose2D(3.8 - gap, 1.0, 0.0)
    assert rooms.cost(start.x, start.y) == INSCRIBED
    path = Planner(rooms).plan(start, EAST, 0)
    costs = rooms.costs_at(dense(path))
    near = np.hypot(*(dense(path) - (start.x, start.y)).T) <= 0.35
    assert costs[near].max() == INSCRIBED
    assert costs[~near].max() < INSCRIBED


def test_a_lethal_cell_under_the_robot_does_not_block_it() -> None:
    costs = np.zeros((60, 60), dtype=np.uint8)
    costs[30, 30] = LETHAL
    path = Planner(Costmap(costs, 0.05, (0.0, 0.0))).plan(Pose2D(1.525, 1.525, 0.0), Pose2D(2.5, 2.5, 0.0), 0)
    assert path.length() == pytest.approx(math.hypot(0.975, 0.975), rel=0.01)


# -- tolerance


def test_with_a_tolerance_the_path_ends_at_the_nearest_reachable_place(rooms: GlobalCostmap) -> None:
    goal = Pose2D(3.9, 1.0, 1.5)
    path = Planner(rooms, tolerance=0.5).plan(WEST, goal, 0)
    end = path.goal
    assert end is not None
    assert end.yaw == 1.5
    assert rooms.cost(end.x, end.y) < INSCRIBED
    rows, cols = np.nonzero(reachable_cells(grid_costs(rooms.costs), rooms.cell(WEST.x, WEST.y)))
    nearest = np.hypot((cols + 0.5) * 0.05 - goal.x, (rows + 0.5) * 0.05 - goal.y).min()
    assert math.hypot(end.x - goal.x, end.y - goal.y) == pytest.approx(nearest)


def test_with_a_tolerance_a_reachable_goal_is_reached(rooms: GlobalCostmap) -> None:
    assert Planner(rooms, tolerance=0.5).plan(WEST, EAST, 0).goal == EAST


def test_a_tolerance_without_a_reachable_place_raises_the_same_error(rooms: GlobalCostmap) -> None:
    for goal, code in (
        (Pose2D(3.9, 1.0, 0.0), Nav2ErrorCode.GOAL_OCCUPIED),
        (CLOSED, Nav2ErrorCode.NO_VALID_PATH),
    ):
        with pytest.raises(PlannerError) as fault:
            Planner(rooms, tolerance=0.1).plan(WEST, goal, 0)
        assert fault.value.code == code


# -- attributes of a path


def test_the_length_nearest_pose_and_equality_of_paths() -> None:
    poses = np.array([(0, 0, 0), (1, 0, 0), (2, 0, math.pi / 2), (2, 2, 0)], dtype=np.float64)
    path = NavPath(poses, 0)
    assert path.length() == 4.0
    assert path.distances().tolist() == [0, 1, 2, 4]
    assert path.nearest(1.2, 0.3) == 1
    assert path.remaining(1.0, 0.5) == 3.5
    assert path[-1] == Pose2D(2.0, 2.0, 0.0)
    assert path.has_same_poses(NavPath(poses.copy(), 99))
    assert not path.has_same_poses(NavPath(poses, 0, "odom"))
    assert path == NavPath(poses.copy(), 0)
    assert path not in (NavPath(poses, 99), NavPath(poses[:-1], 0))
