"""Goals behind obstacles that the map does not have, in a world of two rooms with two doors."""

import re
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

from btcore.clock import NS_PER_S, SimClock
from btcore_navigation import navigator
from btcore_navigation.action import GoalHandle, GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigator import (
    MAX_STALL_S,
    GoalProgress,
    NavigateGoal,
    Navigator,
    navigation_nodes,
)
from btcore_navigation.stack import Navigation
from btcore_robot.robot import Pose2D, Waypoints
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription, WorldObject

TREES = Path(__file__).parents[3] / "trees"
NAV2 = str(Path(__file__).parents[1] / "third_party_trees" / "navigate_of_2020.xml")
"""A tree of Nav2, whose planner clears the global costmap in a RecoveryNode of its own."""

WALLS = (
    (-1.1, -2.6, 6.1, -2.5),
    (-1.1, 2.5, 6.1, 2.6),
    (-1.1, -2.5, -1.0, 2.5),
    (6.0, -2.5, 6.1, 2.5),
    (3.0, -2.5, 3.1, -2.1),
    (3.0, -1.0, 3.1, 1.0),
    (3.0, 2.1, 3.1, 2.5),
)
"""Least x and y, greatest x and y (m)."""
SOUTH_DOOR, NORTH_DOOR = (3.05, -1.55, 0.9), (3.05, 1.55, 0.9)
RECHARGE = Pose2D(4.8, 0.3, 0.0)
ON_RECHARGE = (RECHARGE.x, RECHARGE.y, 0.6)
GREY = (200, 200, 200, 255)

Crate = tuple[float, float, float]
"""The position x, y and the side length (m)."""


class TwoRoomsRig:
    """A simulated robot that drives to the charger; the map does not have the crates."""

    def __init__(self, *crates: Crate, tree: str = "") -> None:
        objects = []
        for number, (x0, y0, x1, y1) in enumerate(WALLS):
            size, place = (x1 - x0, y1 - y0, 1.5), ((x0 + x1) / 2, (y0 + y1) / 2, 0.0)
            objects.append(WorldObject(f"wall_{number}", "box", size, place, 0.0, 0.0, GREY))
        for number, (x, y, side) in enumerate(crates):
            size, place = (side, side, 0.8), (x, y, 0.0)
            objects.append(
                WorldObject(f"crate_{number}", "box", size, place, 0.0, 0.0, GREY, is_kinematic=True)
            )
        start = Pose2D(0.0, 0.0, 0.0)
        description = WorldDescription(
            "two_rooms", "", tuple(objects), (-1, -2.5, 6, 2.5), 0.0, start, GREY, physics_rate=120
        )
        self.world = World(description, seed=1)
        self.body = SimulatedRobot(self.world)
        self.navigation = Navigation(
            self.body,
            rasterise(description),
            np.random.default_rng([1, 4]),
            TREES,
            waypoints=Waypoints({"recharge": RECHARGE}),
        )
        self.handle = self.navigation.navigate_to_pose.send_goal(NavigateGoal((RECHARGE,), tree))

    def run(self, seconds: float) -> float:
        """Advance the time until the goal has ended; return the time (s) since the start."""
        end = self.world.now() + round(seconds * NS_PER_S)
        while self.world.now() < end and not self.handle.done:
            self.world.wait_until(self.world.now() + NS_PER_S // 10, threading.Event())
        return self.world.now() / NS_PER_S

    def remove(self, crate: int) -> None:
        """Move a crate out of the rig."""
        self.world.move_kinematic_body(self.world.kinematic_bodies("crate_")[crate], 30.0, 30.0, 0.0)


CreateRig = Callable[..., TwoRoomsRig]


@pytest.fixture
def create_rig() -> Iterator[CreateRig]:
    rigs = []

    def make(*crates: Crate, tree: str = "") -> TwoRoomsRig:
        rigs.append(TwoRoomsRig(*crates, tree=tree))
        return rigs[-1]

    yield make
    for rig in rigs:
        assert rig.body.contacts.collisions == rig.body.contacts.grazes == 0
        rig.world.close()


@pytest.mark.parametrize(
    ("tree", "crates", "code", "cause"),
    [
        (
            "",
            (ON_RECHARGE,),
            Nav2ErrorCode.GOAL_OCCUPIED,
            r"the goal recharge is .* an obstacle at \(4\.\d\d, 0\.\d\d\) is not on the map",
        ),
        (
            NAV2,
            (SOUTH_DOOR, NORTH_DOOR),
            Nav2ErrorCode.NO_VALID_PATH,
            r"no path to recharge: blocked at \(2\.\d\d, -?1\.\d\d\)",
        ),
    ],
    ids=["recharge_under_a_crate", "two_closed_doors"],
)
def test_blocked_goal_ends_with_place_of_obstacle(
    create_rig: CreateRig,
    tree: str,
    crates: tuple[tuple[float, float, float], tuple[float, float, float]] | tuple[tuple[float, float, float]],
    code: Nav2ErrorCode,
    cause: str,
) -> None:
    rig = create_rig(*crates, tree=tree)
    assert rig.run(150.0) < 90.0
    assert rig.handle.status is GoalStatus.ABORTED
    assert rig.handle.result.code == code
    (outcome,) = rig.navigation.outcomes()
    assert outcome.cause == rig.handle.result.message
    assert outcome.cause.startswith(f"{code.name}: ")
    assert re.search(cause, outcome.cause)
    assert rig.body.distance < 8.0
    assert rig.navigation.moving_scene().notes["failed goals"].endswith(outcome.cause)


@pytest.mark.parametrize(
    ("crates", "tree"), [((ON_RECHARGE,), ""), ((SOUTH_DOOR, NORTH_DOOR), NAV2)], ids=["default", "nav2"]
)
def test_a_goal_is_reached_when_the_obstacle_goes_away(
    create_rig: CreateRig,
    crates: tuple[tuple[float, float, float], tuple[float, float, float]] | tuple[tuple[float, float, float]],
    tree: str,
) -> None:
    rig = create_rig(*crates, tree=tree)
    rig.run(25.0)
    assert not rig.handle.done
    rig.remove(0)
    rig.run(90.0)
    assert rig.handle.status is GoalStatus.SUCCEEDED


def test_navigator_ends_goal_of_tree_that_never_ends(
    create_rig: CreateRig, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(navigator, "MAX_STALL_S", 10.0)
    file = tmp_path / "tree.xml"
    file.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="T"><RetryUntilSuccessful num_attempts="-1">'
        '<PipelineSequence><RateController hz="1.0"><ComputePathToPose goal="{goal}" path="{path}"/>'
        '</RateController><FollowPath path="{path}"/></PipelineSequence>'
        "</RetryUntilSuccessful></BehaviorTree></root>",
        encoding="utf-8",
    )
    rig = create_rig(ON_RECHARGE, tree=str(file))
    assert rig.run(100.0) < 70.0
    assert rig.handle.result.code == Nav2ErrorCode.GOAL_OCCUPIED
    assert re.search(r"not on the map; the robot has come no closer than .* m for", rig.handle.result.message)


def test_failed_plan_through_poses_is_the_first_part_of_the_cause(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(navigator, "MAX_STALL_S", 10.0)
    file = tmp_path / "tree.xml"
    file.write_text('<root BTCPP_format="4"><BehaviorTree ID="T"><Sleep msec="60000"/></BehaviorTree></root>')
    goals: dict[str, GoalHandle[object, object, object]] = {}
    servers: Any = SimpleNamespace(
        goal_tolerance=0.25,
        is_recovering=False,
        last_goals=lambda: dict(goals),
        pose=lambda: None,
        odometry=lambda: None,
    )
    clock = SimClock()
    server = Navigator(servers, file, navigation_nodes(()), clock=clock, through=True)
    handle = server.send_goal(NavigateGoal((RECHARGE,)))
    server.step(clock.now())
    goals["compute_path_through_poses"] = plan = GoalHandle[object, object, object](None)
    plan.abort(int(Nav2ErrorCode.GOAL_OCCUPIED), "the goal is occupied")
    clock.advance(11.0)
    server.step(clock.now())
    assert handle.result is not None
    assert handle.result.message.endswith("the goal is occupied; the robot has come no closer for 11 s")


# -- progress


SPEED = 0.2


@pytest.fixture
def progress() -> GoalProgress:
    progress = GoalProgress(0.25, SPEED)
    progress.begin(0)
    return progress


def stalled(progress: GoalProgress, seconds: float) -> bool:
    return progress.stalled(round(seconds * NS_PER_S)) > 0.0


def test_patience_is_the_time_without_progress_and_the_time_for_the_path(progress: GoalProgress) -> None:
    progress.update(4.0, 0)
    progress.update(1.6, 50 * NS_PER_S)  # less than 2.5 m
    limit = MAX_STALL_S + 4.0 / SPEED
    assert not stalled(progress, limit)
    assert progress.stalled(round((limit + 1.0) * NS_PER_S)) == pytest.approx(limit + 1.0)
    progress.update(1.5, 70 * NS_PER_S)
    assert not stalled(progress, 70.0 + MAX_STALL_S + 1.5 / SPEED)


def test_a_detour_takes_its_time_but_the_way_back_adds_none(progress: GoalProgress) -> None:
    progress.update(4.0, 0)
    progress.update(20.0, 10 * NS_PER_S)
    progress.update(5.0, 90 * NS_PER_S)
    progress.update(19.0, 100 * NS_PER_S)
    assert not stalled(progress, MAX_STALL_S + 20.0 / SPEED)
    assert stalled(progress, MAX_STALL_S + 20.0 / SPEED + 0.1)


def test_time_in_which_the_robot_has_to_stand_does_not_count(progress: GoalProgress) -> None:
    progress.update(4.0, 0)
    progress.pause(100 * NS_PER_S)
    assert not stalled(progress, 100.0 + MAX_STALL_S + 4.0 / SPEED)
    assert stalled(progress, 100.1 + MAX_STALL_S + 4.0 / SPEED)


def test_a_robot_at_its_goal_may_stay_there(progress: GoalProgress) -> None:
    progress.update(0.2, 0)
    progress.update(0.2, 500 * NS_PER_S)
    assert not stalled(progress, 550.0)
