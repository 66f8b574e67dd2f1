"""The parts of the controller: smoothed scan, clearance, pursuit, detours, checkers of progress and goal."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from btcore_navigation.clearance import ClearanceGrid, smooth_scan
from btcore_navigation.costmap import LocalCostmap
from btcore_navigation.detour import find_detour
from btcore_navigation.goal_checks import GoalChecker, ProgressChecker
from btcore_navigation.pure_pursuit import PurePursuit
from btcore_robot.robot import LaserScan, Pose2D

SECOND = 1_000_000_000
STEP = math.radians(220.0) / 665


def scan_of(ranges: np.ndarray) -> LaserScan:
    return LaserScan(np.array(ranges, np.float32), 0, -math.radians(110.0), STEP, 0.05, 25.0, "laser")


def wall_ahead(distance: float, rays: int = 666):
    angles = -math.radians(110.0) + STEP * np.arange(rays)
    return np.where(np.abs(angles) < 1.2, distance / np.cos(angles), np.inf)


def test_smoothing_reduces_the_noise_of_a_wall() -> None:
    truth = wall_ahead(1.0)
    noisy = truth + 0.06 * np.random.default_rng(1).standard_normal(666)
    ahead = np.abs(-math.radians(110.0) + STEP * np.arange(666)) < 0.8
    error = smooth_scan(scan_of(noisy)).ranges[ahead] - truth[ahead]
    assert error.std() < 0.03
    assert error.min() > -0.1 > (noisy[ahead] - truth[ahead]).min()


def test_smoothing_keeps_a_table_leg_and_removes_a_single_reading() -> None:
    ranges = np.full(666, 3.0)
    ranges[300:303] = 1.2
    ranges[400] = 1.2
    after = smooth_scan(scan_of(ranges)).ranges
    assert after[301] == pytest.approx(1.2)
    assert after[400] == pytest.approx(3.0)


def test_smoothing_keeps_readings_without_an_echo_and_below_the_minimum() -> None:
    ranges = np.full(666, np.inf)
    ranges[100:120] = -np.inf
    ranges[300] = np.nan
    after = smooth_scan(scan_of(ranges)).ranges
    assert (after[100:120] == -np.inf).all()
    assert (after[200:] == np.inf).all()


@pytest.fixture
def make_grid() -> Callable[..., Any]:
    """Return the function that makes a grid with a wall 1 m ahead, and the obstacles of a costmap."""

    def make(costmap: LocalCostmap | None = None):
        grid = ClearanceGrid(costmap or LocalCostmap())
        grid.update(scan_of(wall_ahead(1.0)), Pose2D(0.0, 0.0, 0.0))
        return grid

    return make


def test_clearance_is_the_distance_to_the_readings_of_the_scan(make_grid: Callable[..., Any]) -> None:
    grid = make_grid()
    assert grid.distance_at(0.0, 0.0) == pytest.approx(1.0, abs=0.03)
    assert grid.distance_at(0.6, 0.3) == pytest.approx(0.4, abs=0.03)
    assert grid.distances_at(np.array([0.0]), np.array([0.0])).tolist() == [pytest.approx(1.0, abs=0.03)]


def test_clearance_off_the_grid_is_0(make_grid: Callable[..., Any]) -> None:
    grid = make_grid()
    x, y = grid.origin
    half_a_cell, end = grid.resolution / 2, 2 * abs(x)
    points = [(x - half_a_cell, 0.0), (0.0, y - half_a_cell), (x + end + half_a_cell, 0.0), (9.0, 9.0)]
    assert grid.distances_at(*np.array(points).T).tolist() == [0.0] * len(points)
    assert [grid.distance_at(*point) for point in points] == [0.0] * len(points)


def test_obstacles_of_the_costmap_count_unless_the_scan_sees_through_them(
    make_grid: Callable[..., Any],
) -> None:
    costmap = LocalCostmap()
    for x in (-0.5, 0.5):
        row, col = costmap.cell(x, 0.0)
        costmap.obstacles.values[row, col] = costmap.costs[row, col] = 254
    grid = make_grid(costmap)
    assert grid.distance_at(-0.5, 0.0) < 0.05
    assert grid.distance_at(0.5, 0.0) == pytest.approx(0.5, abs=0.04)


def test_a_keep_out_area_counts_even_if_the_scan_sees_through_it(make_grid: Callable[..., Any]) -> None:
    costmap = LocalCostmap()
    row, col = costmap.cell(0.5, 0.0)
    costmap.costs[row, col] = 254
    assert make_grid(costmap).distance_at(0.5, 0.0) < 0.05


def test_a_carrot_lies_ahead_on_the_path_and_has_the_curvature_to_it() -> None:
    pursuit = PurePursuit(np.array([(0.0, 0.0), (1.0, 0.0), (1.0, 1.0)]))
    pose = Pose2D(0.5, 0.1, 0.0)
    pursuit.locate(pose)
    assert (pursuit.cross_track_distance, pursuit.remaining) == (pytest.approx(0.1), pytest.approx(1.5))
    carrot = pursuit.carrot(pose, 0.4)
    assert carrot.distance == pytest.approx(math.hypot(0.4, 0.1))
    assert carrot.curvature == pytest.approx(2 * -0.1 / (0.4**2 + 0.1**2))


def test_a_path_that_crosses_itself_is_not_cut_short() -> None:
    loop = np.array([(0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (1.5, 2.0), (1.5, -2.0)])
    pursuit = PurePursuit(loop)
    for x in np.arange(0.0, 1.6, 0.1):
        pursuit.locate(Pose2D(float(x), 0.0, 0.0))
    assert pursuit.travelled == pytest.approx(1.5)


def test_a_path_with_a_single_point_has_no_remaining_length() -> None:
    pursuit = PurePursuit(np.array([(1.0, 0.0)]))
    pursuit.locate(Pose2D(0.0, 0.0, 0.0))
    assert (pursuit.remaining, pursuit.cross_track_distance) == (0.0, 1.0)


def test_a_detour_keeps_its_clearance_and_an_enclosed_target_has_none(make_grid: Callable[..., Any]) -> None:
    grid = make_grid()
    rows = np.arange(160)[:, None] * grid.resolution + grid.origin[1]
    cols = np.arange(160)[None, :] * grid.resolution + grid.origin[0]
    grid.distances = np.hypot(cols - 0.7, rows + 0.05).astype(np.float32)
    found = find_detour(grid, Pose2D(0.0, 0.0, 0.0), np.array([(0.7, 0.0), (1.4, 0.0), (1.6, 0.0)]), 0.32)
    assert found is not None
    index, way = found
    assert index == 1
    assert np.hypot(way[:, 0] - 0.7, way[:, 1] + 0.05).min() > 0.28
    ring = np.abs(np.hypot(cols - 1.4, rows)) - 0.6
    grid.distances = np.abs(ring).astype(np.float32)
    assert find_detour(grid, Pose2D(0.0, 0.0, 0.0), np.array([(1.4, 0.0)]), 0.32) is None


def test_a_detour_stays_on_the_side_of_the_previous_detour(make_grid: Callable[..., Any]) -> None:
    grid = make_grid()
    rows = np.arange(160)[:, None] * grid.resolution + grid.origin[1]
    cols = np.arange(160)[None, :] * grid.resolution + grid.origin[0]
    grid.distances = np.hypot(cols - 0.7, rows + 0.05).astype(np.float32)
    target = np.array([(1.4, 0.0)])
    over = find_detour(grid, Pose2D(0.0, 0.0, 0.0), target, 0.32)
    assert over is not None
    grid.distances = np.hypot(cols - 0.7, rows - 0.05).astype(np.float32)
    again = find_detour(grid, Pose2D(0.0, 0.0, 0.0), target, 0.32, over[1])
    anew = find_detour(grid, Pose2D(0.0, 0.0, 0.0), target, 0.32)
    assert over[1][:, 1].max() > 0.2
    assert again is not None
    assert again[1][:, 1].max() > 0.2
    assert anew is not None
    assert anew[1][:, 1].min() < -0.2


def test_progress_is_a_distance_or_a_turn_within_the_allowed_time() -> None:
    progress = ProgressChecker(0.5, 0.5, 10.0)
    assert progress.check(Pose2D(0.0, 0.0, 0.0), 0)
    assert progress.check(Pose2D(0.3, 0.0, 0.0), 10 * SECOND)
    assert not progress.check(Pose2D(0.3, 0.0, 0.0), 11 * SECOND)
    assert progress.check(Pose2D(0.3, 0.0, 0.6), 12 * SECOND)
    assert progress.check(Pose2D(0.3, 0.0, 0.6), 22 * SECOND)
    assert progress.check(Pose2D(0.9, 0.0, 0.6), 23 * SECOND)


def test_paused_time_does_not_count_as_lack_of_progress() -> None:
    progress = ProgressChecker(0.5, 0.5, 10.0)
    progress.check(Pose2D(0.0, 0.0, 0.0), 0)
    progress.pause(5 * SECOND)
    assert progress.check(Pose2D(0.0, 0.0, 0.0), 14 * SECOND)
    assert not progress.check(Pose2D(0.0, 0.0, 0.0), 16 * SECOND)


@pytest.mark.parametrize(("stateful", "reached"), [(True, True), (False, False)])
def test_a_stateful_goal_checker_remembers_that_the_place_was_reached(stateful: bool, reached: bool) -> None:
    checker = GoalChecker(0.25, 0.25, stateful)
    goal = Pose2D(1.0, 0.0, 0.0)
    assert not checker.check(Pose2D(0.8, 0.0, 1.0), goal)
    assert checker.check(Pose2D(0.7, 0.0, 0.1), goal) is reached
