"""The map that is drawn from scans."""

import numpy as np

from btcore_navigation.mapping.log_odds_grid import LogOddsGrid, trim_map
from btcore_navigation.mapping.pose_arrays import pose_to_row
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.mapping.conftest import ROOM, Box, key_scan_at


def grid_of(*poses: Pose2D, keepout: tuple[Box, ...] = ()) -> LogOddsGrid:
    grid = LogOddsGrid(0.05, 0.27, keepout)
    for seed, pose in enumerate(poses):
        grid.add(key_scan_at(ROOM, pose, seed), pose_to_row(pose))
    return grid


ABOUT = [Pose2D(0.1 * turn, 0.0, turn * 0.8) for turn in range(9)]


def at(map: OccupancyMap, x: float, y: float) -> int:
    return int(map.cells[map.cell(x, y)])


def test_walls_are_occupied_floor_is_free_and_the_rest_unknown() -> None:
    map = grid_of(*ABOUT).map()
    assert at(map, 0.0, 0.0) == at(map, -2.0, 1.0) == at(map, 2.5, -1.0) == 0
    assert at(map, 1.5, 1.0) == -1  # inside of a box
    assert at(map, 0.0, 2.4) == at(map, 3.5, 0.0) == -1
    for x, y in ((0.0, -2.0), (3.0, 0.3), (-3.0, 0.7), (-0.5, 2.0)):
        row, col = map.cell(x, y)
        assert (map.cells[row - 1 : row + 2, col - 1 : col + 2] == 100).any(), (x, y)


def test_nearly_all_occupied_cells_are_walls() -> None:
    map = grid_of(*ABOUT).map()
    places = map.centers(*np.nonzero(map.occupied))
    off = [
        min(np.hypot(max(x0 - x, 0, x - x1), max(y0 - y, 0, y - y1)) for x0, y0, x1, y1 in ROOM)
        for x, y in places
    ]
    assert np.mean(np.array(off) <= 0.1) >= 0.99


def test_a_cell_hit_by_a_single_scan_is_not_yet_occupied() -> None:
    assert not grid_of(ABOUT[0]).map().occupied.any()
    assert grid_of(ABOUT[0], ABOUT[0]).map().occupied.any()


def test_a_removed_obstacle_is_cleared_by_scans_through_it() -> None:
    grid, here = LogOddsGrid(0.05, 0.27), Pose2D(0.0, 0.0, 0.0)
    box = (1.0, -0.6, 1.4, -0.2)
    for seed in range(3):
        grid.add(key_scan_at((*ROOM, box), here, seed), pose_to_row(here))
    face = [(0.95, -0.4), (1.02, -0.4), (1.07, -0.4)]
    assert any(at(grid.map(), *place) == 100 for place in face)
    for seed in range(10):
        grid.add(key_scan_at(ROOM, here, seed), pose_to_row(here))
    assert all(at(grid.map(), *place) == 0 for place in face)


def test_the_grid_grows_to_every_side_and_keeps_its_cells() -> None:
    grid = grid_of(*ABOUT)
    before = grid.map()
    for x, y in ((40.0, 0.0), (-40.0, 3.0), (0.0, 40.0), (7.0, -40.0)):
        grid.add(key_scan_at(ROOM, Pose2D(0.0, 0.0, 0.0)), np.array((x, y, 0.3)))
    after = grid.map()
    places = before.centers(*np.nonzero(before.occupied))
    cells = after.indices(places)
    assert (after.cells[cells[:, 0], cells[:, 1]] == 100).all()


def test_trimming_moves_nothing() -> None:
    whole = grid_of(*ABOUT, keepout=((0.4, 0.2, 0.8, 0.6),)).map()
    small = trim_map(whole)
    assert small.cells.size < whole.cells.size
    assert small.keepout == whole.keepout
    places = whole.centers(*np.nonzero(whole.occupied))
    cells = small.indices(places)
    assert (small.cells[cells[:, 0], cells[:, 1]] == 100).all()
