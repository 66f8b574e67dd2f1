"""The quality that a mapper knows of its map: good where its scans agree with it, poor where they do not."""

import numpy as np
import pytest
from numpy.typing import NDArray

from btcore_navigation.mapping.log_odds_grid import LogOddsGrid
from btcore_navigation.mapping.map_quality import (
    MAX_LOOP_ERROR,
    MAX_THROUGH_SHARE,
    MIN_FIT,
    MapQuality,
    map_quality,
)
from btcore_navigation.mapping.mapper import Mapper
from btcore_navigation.mapping.pose_graph import PoseGraph
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.mapping.conftest import Box, MappingRig

MAZE: tuple[Box, ...] = (
    (-0.6, -0.6, 3.0, -0.54), (-0.6, 2.94, 3.0, 3.0), (-0.6, -0.6, -0.54, 3.0), (2.94, -0.6, 3.0, 3.0),
    (0.6, -0.6, 0.66, 1.8), (1.8, 0.6, 1.86, 3.0),
)  # fmt: skip
"""A maze of three corridors of 1.1 m between walls of 6 cm."""
WAY = ((0.0, 2.4), (1.2, 2.4), (1.2, 0.0), (2.4, 0.0), (2.4, 2.4))


@pytest.fixture(scope="module")
def maze() -> Mapper:
    """Return the mapper of a robot that has driven through the maze and back."""
    mapper: Mapper = MappingRig(MAZE, Pose2D(0.0, 0.0, 0.0)).along(*WAY, *WAY[-2::-1], step=0.3).mapper
    return mapper


def test_a_right_map_is_good(maze: Mapper) -> None:
    quality = maze.quality()
    assert quality is not None
    assert quality.fit > 0.995
    assert quality.residual_m < 0.03
    assert quality.through_walls < 0.05
    assert quality.loops == maze.loops_closed
    assert quality.warning() == ""


def quality_at(maze: Mapper, poses: NDArray[np.float64]) -> MapQuality:
    """Return the quality of the map that the scans of *maze* give at other poses."""
    grid, graph = LogOddsGrid(0.05, 0.27), PoseGraph(poses[0])
    grid.draw(maze.scans, poses)
    graph.poses = poses
    return map_quality(grid.map(), maze.scans, graph)


@pytest.mark.parametrize("shift", [(0.2, 0.1, 0.03), (0.4, 0.0, 0.0)])
def test_rays_pass_through_walls_of_map_drawn_twice(maze: Mapper, shift: tuple[float, float, float]) -> None:
    """The way back is drawn at a wrong place, as after a drift that no loop has corrected."""
    poses = maze.poses.copy()
    poses[len(poses) // 2 :] += shift
    quality = quality_at(maze, poses)
    assert quality.through_walls > 2 * MAX_THROUGH_SHARE
    assert f"{quality.through_walls:.1%} of the laser's rays pass through its walls" in quality.warning()


def test_rays_do_not_end_on_the_walls_of_a_map_with_wrong_poses(maze: Mapper) -> None:
    steps = np.random.default_rng(0).normal(0.0, 1.0, maze.poses.shape) * (0.03, 0.03, 0.01)
    quality = quality_at(maze, maze.poses + np.cumsum(steps, axis=0))
    assert quality.fit < MIN_FIT - 0.02
    assert quality.residual_m > 0.04
    assert f"only {quality.fit:.1%} of the laser's rays end on its walls" in quality.warning()


def test_a_loop_that_disagrees_with_the_poses_is_reported(maze: Mapper) -> None:
    graph = PoseGraph(maze.poses[0])
    graph.poses = maze.poses
    step = np.array((2.0 * MAX_LOOP_ERROR, 0.0, 0.0))
    graph.add_loop_edge(0, 0, step, np.eye(3))
    quality = map_quality(maze.map(), maze.scans, graph)
    assert (quality.loops, quality.loop_error_m) == (1, 2.0 * MAX_LOOP_ERROR)
    assert "a closed loop disagrees with it by 0.60 m" in quality.warning()
