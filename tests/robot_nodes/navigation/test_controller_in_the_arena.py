"""FollowPath and the behaviours drive the simulated Tiago."""

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import pytest

from btcore_navigation.controller import FollowPathGoal
from tests.robot_nodes.navigation.conftest import NavigationRig, polyline_path

pytest.importorskip("pybullet")

from btcore_navigation.action import GoalStatus
from btcore_navigation.behaviours import BackUpGoal, SpinGoal
from btcore_robot.robot import Pose2D
from btcore_sim.robot_description import load_robot_description
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

START = (-4.8, -4.8)


@pytest.fixture
def arena() -> Iterator[Callable[..., Any]]:
    """Return the function `arena()`: a Tiago among the arena's boxes, facing east."""
    worlds = []

    def make(
        at: tuple[float, float, float] = (*START, 0.0),
        slip: float = 0.02,
        slip_sigma: float = 0.03,
        seed: int = 0,
    ):
        description = replace(load_world_description("arena_boxes"), pose=Pose2D(*at))
        worlds.append(World(description, seed=seed))
        # There is no localiser here: with the slip of Tiago's wheels, the path would drift into the boxes.
        tiago = load_robot_description()
        milder = replace(tiago, odometry=replace(tiago.odometry, slip=slip, slip_sigma=slip_sigma))
        rig = NavigationRig(SimulatedRobot(worlds[-1], milder))
        rig.map_at(at)
        return rig

    yield make
    for world in worlds:
        world.close()


def touched_nothing(body: SimulatedRobot) -> bool:
    return (body.contacts.collisions, body.contacts.grazes) == (0, 0)


def test_an_s_shaped_path_between_boxes_is_followed_without_contact(arena: Callable[..., Any]) -> None:
    rig = arena()
    beside = []
    handle = rig.follow_path.send_goal(
        FollowPathGoal(polyline_path(START, (-1.5, -4.8), (-1.5, -1.5), (1.0, -1.5)))
    )

    def done():
        beside.append(abs(handle.feedback.position_error) if handle.feedback else 0.0)
        return handle.done

    rig.run(80.0, done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert touched_nothing(rig.robot)
    assert max(beside) < 0.2


def test_a_box_on_a_path_with_a_corner_is_passed(arena: Callable[..., Any]) -> None:
    rig = arena(slip=0.04, slip_sigma=0.015, seed=1)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path(START, (-3.15, -4.4), (-3.15, -1.5))))
    rig.run(40.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert touched_nothing(rig.robot)


@pytest.mark.parametrize(
    ("begin", "end"),
    [
        pytest.param((-5.0, -3.35), (-1.5, -3.35), id="a crate, not quite in the middle"),
        pytest.param((0.0, -1.8), (0.0, 1.8), id="a crate, corner first"),
        pytest.param((-5.0, 3.2), (-1.4, 3.2), id="a cabinet, 0.9 m wide"),
    ],
)
def test_an_obstacle_on_a_straight_path_is_passed(
    arena: Callable[..., Any], begin: tuple[float, float], end: tuple[float, float]
) -> None:
    yaw = math.atan2(end[1] - begin[1], end[0] - begin[0])
    rig = arena(at=(*begin, yaw), slip=0.0, slip_sigma=0.0)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path(begin, end, yaw=yaw)))
    rig.run(40.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert touched_nothing(rig.robot)


def test_tiago_spins_and_backs_up(arena: Callable[..., Any]) -> None:
    rig = arena()
    spin = rig.spin.send_goal(SpinGoal(1.57))
    rig.run(10.0, lambda: spin.done)
    rig.run(0.5)
    assert spin.status == GoalStatus.SUCCEEDED
    assert rig.robot.true_pose().yaw == pytest.approx(1.57, abs=0.15)
    before = rig.robot.true_pose()
    back = rig.back_up.send_goal(BackUpGoal(0.3, 0.15))
    rig.run(10.0, lambda: back.done)
    rig.run(0.5)
    assert back.status == GoalStatus.SUCCEEDED
    assert before.y - rig.robot.true_pose().y == pytest.approx(0.3, abs=0.04)
    assert touched_nothing(rig.robot)
