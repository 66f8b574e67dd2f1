"""Costmaps: costs, readings that mark and clear, keepouts, and clearing on request."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.ndimage import distance_transform_edt

from btcore_navigation.costmap import FREE, INSCRIBED, LETHAL, UNKNOWN, Costmap, GlobalCostmap, LocalCostmap
from btcore_navigation.costmap_layers import InflationLayer, ObstacleLayer
from btcore_navigation.mapping.exploration import OBSTACLE_MEMORY_NS, GrowingCostmap
from btcore_navigation.parameters import GlobalCostmapParameters
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserScan, Pose2D

HERE = Pose2D(2.025, 2.025, 0.0)
"""The middle of a cell of the maps below."""


def floor(side: float = 4.0, cells: int = 0, **keys: tuple) -> OccupancyMap:
    """Return a square map in which all cells have the value *cells*."""
    count = round(side / 0.05)
    return OccupancyMap(np.full((count, count), cells, dtype=np.int8), 0.05, (0.0, 0.0), **keys)


def scan(*ranges: float, start: float = 0.0, step: float = 0.01, frame: str = "laser") -> LaserScan:
    """Return a scan that begins at the direction *start* (rad), of a laser with a range of 0.05 … 25 m."""
    return LaserScan(np.array(ranges, dtype=np.float32), 0, start, step, 0.05, 25.0, frame)


def wall_at(distance: float) -> LaserScan:
    """Return the scan of a wall ahead, 0.5 rad to both sides."""
    angles = np.arange(-0.5, 0.5, 0.01)
    return scan(*(distance / np.cos(angles)), start=-0.5)


# -- inflation


@pytest.mark.parametrize(
    ("distance", "cost"),
    [
        (0.0, 254), (0.05, 253), (0.25, 253), (0.30, 253), (0.35, 216), (0.40, 186), (0.45, 160), (0.50, 138),
        (0.55, 119), (0.60, 0),
    ],
)  # fmt: skip
def test_costs_fall_with_the_distance_by_nav2s_formula(distance: float, cost: int) -> None:
    cells = floor().cells.copy()
    cells[40, 40] = 100
    costmap = GlobalCostmap(OccupancyMap(cells, 0.05, (0.0, 0.0)))
    assert costmap.cost(2.025 + distance, 2.025) == cost
    assert costmap.cost(2.025, 2.025 - distance) == cost
    assert InflationLayer(0.30, 0.55, 3.0, 0.05).cost(distance) == cost


def test_diagonal_distances_are_measured_between_the_centres_of_cells() -> None:
    cells = floor().cells.copy()
    cells[40, 40] = 100
    costmap = GlobalCostmap(OccupancyMap(cells, 0.05, (0.0, 0.0)))
    # 5, 5 cells: 0.3536 m; 7, 7 cells: 0.4950 m; 6, 10: 0.5831 m
    assert costmap.costs[45, 45] == math.floor(252 * math.exp(-3 * (0.05 * math.hypot(5, 5) - 0.3)))
    assert costmap.costs[33, 47] == math.floor(252 * math.exp(-3 * (0.05 * math.hypot(7, 7) - 0.3)))
    assert costmap.costs[46, 50] == FREE


@given(
    occupied=arrays(np.bool_, (30, 40), elements=st.sampled_from([False] * 19 + [True])),
    radius=st.sampled_from([0.1, 0.2, 0.3]),
    inflation_radius=st.sampled_from([0.2, 0.55, 1.0]),
    scaling=st.sampled_from([1.0, 3.0, 10.0]),
)
def test_inflation_is_the_formula_on_exact_distances(
    occupied: np.ndarray, radius: float, inflation_radius: float, scaling: float
) -> None:
    inflation = InflationLayer(radius, inflation_radius, scaling, 0.05)
    found = inflation.inflate(np.where(occupied, LETHAL, FREE).astype(np.uint8))
    if occupied.any():
        squares = np.rint(distance_transform_edt(~occupied) ** 2)
        wanted = np.vectorize(lambda square: inflation.cost(0.05 * math.sqrt(square)))(squares)
        assert np.array_equal(found, wanted)
    else:
        assert not found.any()


def test_unknown_cells_stay_unknown_except_within_the_inscribed_radius() -> None:
    cells = floor(cells=-1).cells.copy()
    cells[40, 40] = 100
    costmap = GlobalCostmap(OccupancyMap(cells, 0.05, (0.0, 0.0)))
    assert costmap.costs[40, 40] == LETHAL
    assert costmap.costs[40, 46] == INSCRIBED
    assert costmap.costs[40, 47] == UNKNOWN


def test_unknown_cells_can_be_treated_as_free() -> None:
    assert not GlobalCostmap(floor(cells=-1), GlobalCostmapParameters(track_unknown_space=False)).costs.any()


def test_occupancies_below_100_are_free() -> None:
    assert not GlobalCostmap(floor(cells=99)).costs.any()


# -- the obstacle layer: marking and clearing


def test_a_reading_marks_the_cell_of_its_end_point() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(scan(1.0), HERE)
    assert not costmap.costs.any()  # observations wait for the update
    costmap.update(0)
    assert np.argwhere(costmap.costs == LETHAL).tolist() == [[40, 60]]
    assert costmap.cost(2.575, 2.025) == 160  # inflated at once


def test_a_reading_is_placed_by_the_lasers_pose() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(scan(1.0, start=math.pi / 4), Pose2D(2.025, 1.025, math.pi / 4))
    costmap.update(0)
    assert np.argwhere(costmap.costs == LETHAL).tolist() == [[40, 40]]


@pytest.mark.parametrize("reading", [math.inf, -math.inf, math.nan, 0.04, 25.0, 2.6])
def test_readings_that_mark_no_obstacle(reading: float) -> None:
    # No echo, too near, broken, under the minimum, at the maximum, over the range of obstacles.
    costmap = GlobalCostmap(floor(8.0))
    costmap.observe(scan(reading), HERE)
    costmap.update(0)
    assert not costmap.costs.any()


def test_readings_mark_obstacles_from_the_minimum_range_on() -> None:
    costmap = GlobalCostmap(floor(), GlobalCostmapParameters(obstacle_min_range=0.5))
    costmap.observe(scan(0.45), HERE)
    costmap.update(0)
    assert not costmap.costs.any()
    costmap.observe(scan(0.5), HERE)
    costmap.update(0)
    assert (costmap.costs == LETHAL).any()


@pytest.mark.parametrize(
    ("reading", "cleared_to"), [(math.inf, 3.0), (25.0, 3.0), (8.0, 3.0), (2.0, 1.9), (0.5, 0.4)]
)
def test_a_ray_clears_unknown_cells_up_to_its_end_or_its_range(reading: float, cleared_to: float) -> None:
    costmap = GlobalCostmap(floor(8.0, cells=-1))
    costmap.observe(scan(reading), HERE)
    costmap.update(0)
    freed = np.flatnonzero(costmap.obstacles.values[40] == FREE)
    assert freed[0] == 40
    assert freed[-1] == pytest.approx(40 + cleared_to / 0.05, abs=1)
    assert np.array_equal(freed, np.arange(freed[0], freed[-1] + 1))


@pytest.mark.parametrize("reading", [-math.inf, math.nan, 0.01])
def test_invalid_readings_clear_nothing(reading: float) -> None:
    costmap = GlobalCostmap(floor(cells=-1))
    costmap.observe(scan(reading), HERE)
    costmap.update(0)
    assert (costmap.costs == UNKNOWN).all()


def test_a_removed_obstacle_is_cleared_by_readings_behind_it() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(wall_at(1.0), HERE)
    costmap.update(0)
    assert costmap.cost(3.025, 2.025) == LETHAL
    costmap.observe(wall_at(1.7), HERE)
    costmap.update(0)
    assert costmap.cost(3.025, 2.025) == FREE
    assert costmap.cost(3.725, 2.025) == LETHAL


def test_an_obstacle_out_of_sight_stays() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(wall_at(1.0), HERE)
    costmap.update(0)
    before = costmap.costs.copy()
    costmap.observe(wall_at(1.5), Pose2D(2.025, 2.025, math.pi))
    costmap.update(0)
    assert np.array_equal(costmap.costs[:, 45:], before[:, 45:])


def test_obstacles_of_the_map_are_not_cleared_by_scans() -> None:
    cells = floor().cells.copy()
    cells[30:50, 60] = 100
    costmap = GlobalCostmap(OccupancyMap(cells, 0.05, (0.0, 0.0)))
    before = costmap.costs.copy()
    costmap.observe(wall_at(math.inf), HERE)
    costmap.update(0)
    assert np.array_equal(costmap.costs, before)


def test_the_newest_scan_of_each_laser_is_used() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(scan(0.5), HERE)
    costmap.observe(scan(1.0), HERE)
    costmap.observe(scan(1.0, frame="rear"), Pose2D(2.025, 2.025, math.pi))
    costmap.update(0)
    assert np.argwhere(costmap.costs == LETHAL).tolist() == [[40, 20], [40, 60]]


def test_readings_within_the_robot_are_ignored() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(scan(0.25), HERE)
    costmap.update(0, HERE)
    assert not costmap.costs.any()


def test_scans_from_outside_the_map_and_across_its_edge_do_no_harm() -> None:
    costmap = GlobalCostmap(floor())
    costmap.observe(wall_at(2.0), Pose2D(3.9, 2.0, 0.0))
    costmap.update(0, Pose2D(3.9, 2.0, 0.0))
    costmap.observe(wall_at(1.0), Pose2D(-50.0, 90.0, 0.0))
    costmap.update(0, Pose2D(-50.0, 90.0, 0.0))
    assert not costmap.costs.any()


@given(
    scans=st.lists(
        st.tuples(st.floats(0, 4), st.floats(0, 4), st.floats(-3, 3), st.integers(0, 2**32 - 1)),
        min_size=1,
        max_size=6,
    )
)
def test_incremental_costs_equal_recomputed_costs(scans: list[tuple[float, float, float, int]]) -> None:
    cells = floor().cells.copy()
    cells[20, 10:60] = 100
    cells[50:, 30] = -1
    costmap = GlobalCostmap(OccupancyMap(cells, 0.05, (0.0, 0.0), ((3.0, 3.0, 3.4, 3.2),)))
    for x, y, yaw, seed in scans:
        ranges = np.random.default_rng(seed).uniform(0.1, 4.0, 60)
        costmap.observe(scan(*ranges, start=-1.5, step=0.05), Pose2D(x, y, yaw))
        costmap.update(0, Pose2D(x, y, yaw))
    pieced = costmap.costs.copy()
    costmap.clear_except(Pose2D(2.0, 2.0, 0.0), 100.0)  # clears nothing, computes all costs again
    assert np.array_equal(pieced, costmap.costs)
    assert (costmap.lower_bound[costmap.costs != UNKNOWN] <= costmap.costs[costmap.costs != UNKNOWN]).all()


def test_the_version_changes_only_if_the_costs_change() -> None:
    costmap = GlobalCostmap(floor())
    seen = costmap.version
    costmap.observe(scan(1.0), HERE)
    costmap.update(7)
    assert (costmap.version > seen, costmap.stamp) == (True, 7)
    seen = costmap.version
    costmap.observe(scan(1.0), HERE)
    costmap.update(8)
    assert (costmap.version, costmap.stamp) == (seen, 8)


# -- keep-outs


def test_a_keepout_is_an_obstacle_that_no_ray_clears() -> None:
    costmap = GlobalCostmap(floor(keepout=((2.5, 1.5, 3.0, 2.5),)))
    assert costmap.cost(2.525, 2.025) == LETHAL
    assert costmap.cost(2.225, 2.025) == INSCRIBED
    assert costmap.cost(2.125, 2.025) == 186
    costmap.observe(wall_at(math.inf), Pose2D(1.025, 2.025, 0.0))
    costmap.update(0)
    costmap.clear()
    assert costmap.cost(2.525, 2.025) == LETHAL


def test_the_local_costmap_transforms_keepouts_from_the_map() -> None:
    costmap = LocalCostmap(keepout=((0.5, -0.2, 0.8, 0.2),))
    costmap.update(0, Pose2D(0.0, 0.0, 0.0))
    assert not costmap.costs.any()
    costmap.update(0, Pose2D(0.0, 0.0, 0.0), Pose2D(0.0, 0.0, math.pi / 2))
    assert costmap.cost(0.0, 0.65) == LETHAL
    assert costmap.cost(0.65, 0.0) == FREE
    costmap.clear()
    assert costmap.cost(0.0, 0.65) == LETHAL


# -- clearing on request


@pytest.fixture
def littered() -> GlobalCostmap:
    """Return a costmap with a wall of the map at x = 0.5 and observed obstacles at x = 1, 2 and 3."""
    cells = floor().cells.copy()
    cells[:, 10] = 100
    costmap = GlobalCostmap(OccupancyMap(cells, 0.05, (0.0, 0.0)))
    for x in (1.0, 2.0, 3.0):
        costmap.observe(scan(0.5, start=math.pi / 2), Pose2D(x + 0.025, 1.5, 0.0))
        costmap.update(0)
    assert places(costmap) == [1.0, 2.0, 3.0]
    return costmap


def places(costmap: Costmap) -> list[float]:
    """Return the positions of observed obstacles along y = 2."""
    return [x for x in (1.0, 2.0, 3.0) if costmap.cost(x + 0.025, 2.0) == LETHAL]


def test_clear_removes_observed_obstacles_and_keeps_the_map(littered: GlobalCostmap) -> None:
    littered.clear()
    assert places(littered) == []
    assert littered.cost(0.525, 2.0) == LETHAL
    assert np.array_equal(littered.costs, GlobalCostmap(littered.map).costs)


def test_clear_keeps_obstacles_that_were_observed_recently_and_that_no_ray_has_freed_since() -> None:
    costmap = GlobalCostmap(floor())
    for stamp, x in enumerate((1.0, 2.0, 3.0)):
        costmap.observe(replace(scan(0.5, start=math.pi / 2), stamp=stamp), Pose2D(x + 0.025, 1.5, 0.0))
        costmap.update(stamp)
    costmap.observe(scan(1.0, start=math.pi / 2), Pose2D(3.025, 1.5, 0.0))
    costmap.update(3)
    costmap.clear(before=1)
    assert places(costmap) == [2.0]
    costmap.clear()
    assert places(costmap) == []


def test_clear_removes_pending_observations(littered: GlobalCostmap) -> None:
    littered.observe(scan(0.5), HERE)
    littered.clear()
    littered.update(0)
    assert np.array_equal(littered.costs, GlobalCostmap(littered.map).costs)


def test_clear_around_clears_a_square_of_the_given_side(littered: GlobalCostmap) -> None:
    littered.clear_around(Pose2D(2.0, 2.0, 0.0), 1.0)
    assert places(littered) == [1.0, 3.0]


def test_clear_except_keeps_a_square_of_the_given_side(littered: GlobalCostmap) -> None:
    littered.clear_except(Pose2D(2.0, 2.0, 0.0), 1.0)
    assert places(littered) == [2.0]


def test_clear_around_a_place_outside_the_map_does_nothing(littered: GlobalCostmap) -> None:
    before = littered.costs.copy()
    littered.clear_around(Pose2D(40.0, 2.0, 0.0), 1.0)
    assert np.array_equal(littered.costs, before)


# -- the local costmap


def test_the_local_costmap_is_a_square_about_the_robot_in_odom() -> None:
    costmap = LocalCostmap()
    costmap.update(0, Pose2D(7.03, -3.02, 1.0))
    assert (costmap.frame, costmap.costs.shape) == ("odom", (60, 60))
    assert costmap.cell(7.03, -3.02) == (30, 30)
    assert costmap.inside(8.4, -1.6)
    assert not costmap.inside(8.6, -3.0)


def test_obstacles_stay_in_place_while_the_robot_moves_and_are_forgotten_outside() -> None:
    costmap = LocalCostmap()
    costmap.observe(scan(1.0), Pose2D(0.0, 0.0, 0.0))
    costmap.update(0, Pose2D(0.0, 0.0, 0.0))
    for x in (0.0, 0.13, 0.26, 0.4):
        costmap.update(0, Pose2D(x, -x, 0.0))
        assert costmap.cost(1.01, 0.01) == LETHAL
        assert np.count_nonzero(costmap.costs == LETHAL) == 1
    costmap.update(0, Pose2D(0.0, 3.0, 0.0))
    costmap.update(0, Pose2D(0.4, 0.0, 0.0))
    assert not costmap.costs.any()


def test_a_jump_of_the_robot_clears_the_local_costmap() -> None:
    costmap = LocalCostmap()
    costmap.observe(scan(1.0), Pose2D(0.0, 0.0, 0.0))
    costmap.update(0, Pose2D(0.0, 0.0, 0.0))
    costmap.update(0, Pose2D(100.0, 100.0, 0.0))
    assert not costmap.costs.any()
    costmap.update(0, Pose2D(0.0, 0.0, 0.0))
    assert not costmap.costs.any()


# -- looking up


def test_costs_of_many_points_are_looked_up_and_lethal_outside_the_grid() -> None:
    costs = np.arange(12, dtype=np.uint8).reshape(3, 4)
    costmap = Costmap(costs, 0.5, (-1.0, 1.0))
    points = np.array(
        [[(-0.75, 1.25), (0.75, 1.25)], [(0.75, 2.25), (1.01, 2.25)], [(-1.01, 1.5), (0, 0.99)]]
    )
    assert costmap.costs_at(points).tolist() == [[0, 3], [11, LETHAL], [LETHAL, LETHAL]]
    assert [costmap.cost(*point) for point in points.reshape(-1, 2)] == [0, 3, 11, LETHAL, LETHAL, LETHAL]
    assert costs.tolist() == np.arange(12).reshape(3, 4).tolist()


def test_the_disc_under_the_robot_has_all_cells_up_to_its_radius() -> None:
    layer = ObstacleLayer((9, 9), 1.0, UNKNOWN, min_range=0.0, max_range=2.5, raytrace_range=3.0)
    layer.free_disc(Pose2D(4.5, 4.5, 0.0), 2.0, (0.0, 0.0))
    rows, columns = np.indices((9, 9))
    assert np.array_equal(layer.values == FREE, (rows - 4) ** 2 + (columns - 4) ** 2 <= 4)


# -- a map that grows


def test_a_growing_costmap_remembers_recent_obstacles_at_their_places_on_the_new_map() -> None:
    costmap = GrowingCostmap(floor())
    costmap.observe(wall_at(1.0), HERE)
    costmap.update(0)
    assert costmap.cost(3.025, 2.025) == LETHAL
    grown = OccupancyMap(np.zeros((100, 120), dtype=np.int8), 0.05, (-1.0, -0.5))
    costmap.redraw(grown)
    assert costmap.costs.shape == (100, 120)
    assert costmap.cost(3.025, 2.025) == LETHAL
    assert costmap.cost(2.125, 2.025) == FREE
    small = floor(2.5)
    costmap.redraw(small)
    assert (costmap.costs == FREE).all()
    costmap.observe(wall_at(0.4), HERE)
    costmap.update(OBSTACLE_MEMORY_NS + 1)
    costmap.redraw(small)
    assert (costmap.costs == FREE).all()
