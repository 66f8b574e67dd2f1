"""The scene messages of the navigation in the simulated house: news once, everything for a new viewer."""

import math
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("pybullet")

from btcore_navigation.controller import FollowPathGoal
from btcore_navigation.scene import MAX_PARTICLES
from btcore_navigation.stack import Navigation
from btcore_robot.robot import Pose2D
from btcore_scene import MovingScene, Poses
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

TREES = Path(__file__).parents[3] / "trees"
SECOND = 1_000_000_000


class HouseRig:
    """A robot that navigates in the house, and its messages."""

    def __init__(self) -> None:
        description = load_world_description("house")
        self.world = World(description, seed=1)
        self.body = SimulatedRobot(self.world)
        self.navigation = Navigation(self.body, rasterise(description), np.random.default_rng([1, 4]), TREES)
        self.scenes: list[MovingScene] = []

    def run(self, seconds: float) -> list[MovingScene]:
        """Return the messages of each tenth of a second."""
        scenes = []
        for _ in range(round(seconds * 10)):
            self.world.wait_until(self.world.now() + SECOND // 10, threading.Event())
            scenes.append(self.navigation.moving_scene())
        return scenes


@pytest.fixture
def rig() -> Iterator[HouseRig]:
    rig = HouseRig()
    yield rig
    rig.world.close()


def items(scenes: list[MovingScene], field: str, name: str) -> list:
    """Return the items called *name* in a field of *scenes*."""
    return [item for scene in scenes for item in getattr(scene, field) if item.name == name]


def poses(entry: Poses) -> np.ndarray:
    return np.frombuffer(entry.rows, dtype="<f4").reshape(-1, 3)


def test_the_static_scene_has_the_map_and_the_keep_out_areas(rig: HouseRig) -> None:
    static = rig.navigation.static_scene()
    (grid,) = static.grids
    known = rig.navigation.map
    assert (grid.name, grid.kind, grid.size) == ("map", "occupancy", (known.width, known.height))
    cells = np.frombuffer(grid.cells, dtype=np.int8).reshape(known.height, known.width)
    assert (cells == known.cells).all()
    assert [area.corners for area in static.areas] == list(known.keepout)
    assert not items(rig.run(3.0), "grids", "map")


def test_path_and_goal_are_sent_once_and_removed_when_the_goal_has_ended(rig: HouseRig) -> None:
    rig.navigation.static_scene()
    assert [len(poses(path)) for path in items(rig.run(0.2), "poses", "path")] == [0]
    handle = rig.navigation.go_to(Pose2D(1.07, -12.38, 0.5))
    scenes = rig.run(2.0)
    path = poses(items(scenes, "poses", "path")[-1])
    assert math.hypot(*path[0, :2]) < 0.6
    assert path[-1] == pytest.approx([1.07, -12.38, 0.5], abs=1e-3)
    assert [poses(goal).tolist() for goal in items(scenes, "poses", "goal")] == [
        [pytest.approx([1.07, -12.38, 0.5])]
    ]
    assert scenes[-1].notes["localisation"] == "sure"
    assert scenes[-1].notes["goal"].startswith("(1.1, -12.4), 1")
    handle.cancel()
    after = rig.run(0.5)
    assert len(poses(items(after, "poses", "path")[-1])) == len(poses(items(after, "poses", "goal")[-1])) == 0
    assert after[-1].notes["goal"] == "–"


def test_a_path_that_is_followed_without_a_navigator_is_sent(rig: HouseRig) -> None:
    rig.run(1.0)
    servers = rig.navigation.servers
    path = servers.compute_path.planner.plan(Pose2D(0.0, 0.0, 0.0), Pose2D(1.0, 0.5, 0.0), 0)
    servers.follow_path.send_goal(FollowPathGoal(path))
    scenes = rig.run(1.0)
    (line,) = items(scenes, "poses", "path")
    assert poses(line)[-1][:2] == pytest.approx([1.0, 0.5])
    (ring,) = items(scenes, "poses", "goal")
    assert poses(ring)[0][:2] == pytest.approx([1.0, 0.5])
    assert scenes[-1].notes["goal"].startswith("(1.0, 0.5), ")
    assert scenes[-1].notes["goal"].endswith(" m to go")


def test_costmaps_are_sent_when_they_changed_at_limited_rates_and_poses_and_particles_are_sent(
    rig: HouseRig,
) -> None:
    rig.navigation.static_scene()
    rig.navigation.go_to(Pose2D(1.07, -12.38, 0.0))
    scenes = rig.run(6.0)
    large, small = items(scenes, "grids", "global_costmap"), items(scenes, "grids", "local_costmap")
    assert 2 <= len(large) <= 3
    assert 18 <= len(small) <= 24
    costs = rig.navigation.global_costmap
    assert large[-1].size == (costs.map.width, costs.map.height)
    assert small[-1].frame == "odom"
    here = rig.body.odometry().pose
    assert small[-1].origin == pytest.approx([here.x - 1.5, here.y - 1.5], abs=0.2)
    assert {253, 254} <= set(small[-1].cells) | set(large[-1].cells)

    scenes += rig.run(9.0)
    true = rig.body.true_pose()
    estimate = poses(items(scenes, "poses", "estimate")[-1])[0]
    by_wheels = poses(items(scenes, "poses", "odometry")[-1])[0]
    off = math.hypot(estimate[0] - true.x, estimate[1] - true.y)
    drifted = math.hypot(by_wheels[0] - true.x, by_wheels[1] - true.y)
    assert off < 0.1 < drifted
    odom = scenes[-1].frames[0]
    assert odom[:2] == ("odom", "map")
    clouds = items(scenes, "poses", "particles")
    assert 3 < len(clouds) < len(scenes)
    assert all(10 < len(poses(cloud)) <= MAX_PARTICLES for cloud in clouds)
    middle = np.median(poses(clouds[-1])[:, :2], axis=0)
    assert math.hypot(middle[0] - true.x, middle[1] - true.y) < 1.0


def test_a_new_viewer_gets_all_data_again(rig: HouseRig) -> None:
    rig.navigation.static_scene()
    rig.navigation.go_to(Pose2D(1.07, -12.38, 0.0))
    rig.run(2.0)
    assert not rig.navigation.moving_scene().grids
    rig.navigation.static_scene()
    again = rig.navigation.moving_scene()
    assert {grid.name for grid in again.grids} == {"global_costmap", "local_costmap"}
    assert {pose.name for pose in again.poses} == {"path", "goal", "particles", "estimate", "odometry"}


def test_a_kidnapped_robot_is_shown_as_lost_and_turns_to_find_its_pose(rig: HouseRig) -> None:
    rig.navigation.static_scene()
    rig.navigation.go_to(Pose2D(1.07, -12.38, 0.0))
    rig.run(2.0)
    rig.body.kidnap(Pose2D(3.275, -0.375, 1.0))
    states, turns = [], []
    for _ in range(60):
        states.append(rig.run(0.1)[-1].notes["localisation"])
        if rig.navigation.localiser.is_searching:
            turns.append(rig.body.ramped_twist()[1])
    assert any("lost" in state for state in states)
    assert states[-1] == "sure"
    assert max(turns) > 0.3
