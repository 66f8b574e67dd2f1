"""The whole navigation in the simulator, in a flat of two rooms and a closet without a door."""

import math
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pybullet")

from btcore.clock import NS_PER_S
from btcore_navigation import sensor_watch, stack
from btcore_navigation.action import GoalStatus
from btcore_navigation.costmap import INSCRIBED
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigator import NavigateGoal
from btcore_navigation.parameters import NavigationParameters, WaypointFollowerParameters
from btcore_navigation.planner import ComputePathGoal
from btcore_navigation.stack import SEARCH_TURN, Navigation
from btcore_navigation.waypoint_follower import FollowWaypointsGoal, WaypointFollower
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import Phase, Pose2D
from btcore_sim.faults import Fault
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription, WorldObject

TREES = Path(__file__).parents[3] / "trees"
GREY = (200, 200, 200, 255)

WALLS = {
    "south": (-3.1, -2.6, 5.1, -2.5),
    "north": (-3.1, 2.5, 5.1, 2.6),
    "west": (-3.1, -2.5, -3.0, 2.5),
    "east": (5.0, -2.5, 5.1, 2.5),
    "between_south": (1.0, -2.5, 1.1, -0.6),
    "between_north": (1.0, 0.6, 1.1, 2.5),
    "closet_west": (3.4, 1.0, 3.5, 2.5),
    "closet_south": (3.5, 1.0, 5.0, 1.1),
    "crate": (-1.5, -2.2, -1.0, -1.7),
    "cupboard": (-3.0, 1.6, -2.4, 2.5),
    "chest": (3.6, -2.5, 4.2, -2.0),
}
"""Least x and y, greatest x and y (m)."""


def box(name: str, x0: float, y0: float, x1: float, y1: float) -> WorldObject:
    size, middle = (x1 - x0, y1 - y0, 1.5), ((x0 + x1) / 2, (y0 + y1) / 2, 0.0)
    return WorldObject(name, "box", size, middle, 0.0, 0.0, GREY)


class FlatRig:
    """A simulated robot that navigates in the flat; *faults* have the format of the command line."""

    def __init__(
        self,
        *faults: Fault,
        seed: int = 1,
        start: Pose2D | None = None,
        parameters: NavigationParameters | None = None,
        map: OccupancyMap | None = None,
    ) -> None:
        objects = tuple(box(name, *sides) for name, sides in WALLS.items())
        at = start or Pose2D(0.0, 0.0, 0.0)
        description = WorldDescription(
            "flat", "", objects, (-3, -2.5, 5, 2.5), 0.0, at, GREY, physics_rate=120
        )
        self.world = World(description, seed=seed)
        self.body = SimulatedRobot(self.world, faults=faults)
        random = np.random.default_rng([seed, 4])
        known = rasterise(description) if map is None else map
        self.navigation = Navigation(self.body, known, random, TREES, parameters)
        self.speeds: list[float] = []

    def run(self, seconds: float, until: Callable[..., Any] = lambda: False) -> float:
        """Advance the time until a condition is true; return the seconds that this took."""
        began, self.speeds = self.world.now(), []
        end = began + round(seconds * NS_PER_S)
        while self.world.now() < end and not until():
            self.world.wait_until(self.world.now() + NS_PER_S // 20, threading.Event())
            self.speeds.append(self.body.ramped_twist()[0])
        return (self.world.now() - began) / NS_PER_S

    def distance_to(self, x: float, y: float) -> float:
        """Return the true distance (m) of the robot from a place."""
        true = self.body.true_pose()
        return math.hypot(true.x - x, true.y - y)


CreateRig = Callable[..., FlatRig]


@pytest.fixture
def create_rig() -> Iterator[CreateRig]:
    rigs = []

    def make(*faults: Fault, **options) -> FlatRig:
        rigs.append(FlatRig(*faults, **options))
        return rigs[-1]

    yield make
    for rig in rigs:
        assert rig.body.contacts.collisions == rig.body.contacts.grazes == 0
        rig.world.close()


def test_a_goal_in_the_other_room_is_reached_with_feedback_on_the_way(create_rig: CreateRig) -> None:
    rig = create_rig()
    handle = rig.navigation.go_to(Pose2D(2.2, -0.5, 1.0))
    rig.run(5.0)
    feedback = handle.feedback
    assert feedback.navigation_time == pytest.approx(5.0, abs=0.1)
    assert feedback.distance_remaining == pytest.approx(2.3 - rig.body.distance, abs=0.3)
    assert feedback.number_of_recoveries == 0
    assert feedback.current_pose.x == pytest.approx(rig.body.true_pose().x, abs=0.1)
    rig.run(40.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(2.2, -0.5) < 0.35
    assert rig.body.true_pose().yaw == pytest.approx(1.0, abs=0.35)
    assert [outcome.status for outcome in rig.navigation.outcomes()] == ["SUCCEEDED"]
    assert rig.navigation.outcomes()[0].goal == Pose2D(2.2, -0.5, 1.0)


def test_a_new_goal_replaces_the_current_goal_without_a_stop(create_rig: CreateRig) -> None:
    rig = create_rig()
    first = rig.navigation.go_to(Pose2D(3.2, 0.0, 0.0))
    rig.run(6.0)
    assert rig.body.ramped_twist()[0] > 0.25
    second = rig.navigation.go_to(Pose2D(3.2, -0.7, 0.0))
    rig.run(3.0)
    assert first.status is GoalStatus.CANCELED
    assert min(rig.speeds) > 0.2
    rig.run(40.0, lambda: second.done)
    assert second.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(3.2, -0.7) < 0.35
    assert [outcome.status for outcome in rig.navigation.outcomes()] == ["CANCELED", "SUCCEEDED"]


def test_goal_that_is_sent_just_before_arrival_at_another_goal_is_reached(create_rig: CreateRig) -> None:
    rig = create_rig()
    first = rig.navigation.go_to(Pose2D(0.8, 0.0, 0.0))
    rig.run(20.0, lambda: rig.distance_to(0.8, 0.0) < 0.26 or first.done)
    second = rig.navigation.go_to(Pose2D(0.0, 0.8, 0.0))
    rig.run(40.0, lambda: second.done)
    assert second.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(0.0, 0.8) < 0.35


def test_a_cancelled_goal_stops_the_robot_and_halts_the_tree(create_rig: CreateRig) -> None:
    rig = create_rig()
    handle = rig.navigation.go_to(Pose2D(4.0, 0.0, 0.0))
    rig.run(5.0)
    handle.cancel()
    rig.run(1.0)
    assert handle.status is GoalStatus.CANCELED
    assert rig.body.ramped_twist() == pytest.approx((0.0, 0.0), abs=0.02)
    assert not rig.navigation.servers.follow_path.is_busy
    assert {node.status.name for node in rig.navigation.navigate_to_pose.tree.nodes} == {"IDLE"}
    driven = rig.body.distance
    rig.run(2.0)
    assert rig.body.distance == pytest.approx(driven, abs=0.01)
    assert [outcome.status for outcome in rig.navigation.outcomes()] == ["CANCELED"]


def test_a_goal_that_was_occupied_when_last_observed_is_still_reached(create_rig: CreateRig) -> None:
    rig = create_rig()
    rig.run(0.5)
    seen = rig.body.scan()
    ranges = np.where(np.abs(seen.angles()) < 0.2, 1.0, np.nan).astype(np.float32)
    costs = rig.navigation.global_costmap
    costs.observe(replace(seen, ranges=ranges), Pose2D(2.0, -1.0, 0.0))
    costs.update(rig.world.now(), Pose2D(0.0, 0.0, 0.0))
    assert costs.cost(3.0, -1.0) >= INSCRIBED
    handle = rig.navigation.go_to(Pose2D(3.0, -1.0, 0.0))
    rig.run(40.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(3.0, -1.0) < 0.35


def test_search_on_wrong_map_ends_and_new_goal_searches_again(
    create_rig: CreateRig, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The laser's outage of 10 s is not part of the search: without scans nothing is known about the pose."""
    monkeypatch.setattr(stack, "SEARCH_LIMIT_S", 12.0)
    cells = np.zeros((80, 80), dtype=np.int8)
    cells[[0, -1], :] = cells[:, [0, -1]] = 100
    rig = create_rig(Fault("laser", 4 * NS_PER_S, 14 * NS_PER_S), map=OccupancyMap(cells, 0.05, (-2.0, -2.0)))
    handle = rig.navigation.go_to(Pose2D(1.0, 1.0, 0.0))
    assert rig.run(60.0, lambda: handle.done) == pytest.approx(22.0, abs=3.0)
    assert handle.status is GoalStatus.ABORTED
    assert handle.result.code == Nav2ErrorCode.NAVIGATE_TF_ERROR
    assert "the robot's pose is unknown" in handle.result.message
    rig.run(2.0)
    assert rig.body.ramped_twist() == pytest.approx((0.0, 0.0))
    again = rig.navigation.go_to(Pose2D(1.0, 1.0, 0.0))
    rig.run(2.0)
    assert not again.done
    assert rig.body.ramped_twist()[1] == pytest.approx(SEARCH_TURN, abs=0.02)
    assert rig.body.distance < 0.05


@pytest.mark.parametrize(
    ("goal", "code", "seconds"),
    [
        (Pose2D(1.05, 1.5, 0.0), Nav2ErrorCode.GOAL_OCCUPIED, 2.0),
        (Pose2D(9.0, 0.0, 0.0), Nav2ErrorCode.GOAL_OUTSIDE_MAP, 2.0),
        (Pose2D(4.3, 1.9, 0.0), Nav2ErrorCode.NO_VALID_PATH, 60.0),
    ],
)
def test_goal_that_cannot_be_reached_ends_with_planners_reason(
    create_rig: CreateRig, goal: Pose2D, code: Nav2ErrorCode, seconds: float
) -> None:
    rig = create_rig()
    handle = rig.navigation.go_to(goal)
    rig.run(seconds, lambda: handle.done)
    assert handle.status is GoalStatus.ABORTED
    assert handle.result.code == code
    assert handle.result.message.startswith(f"{code.name}: ")
    assert [outcome.status for outcome in rig.navigation.outcomes()] == ["ABORTED"]


def test_a_failure_does_not_have_the_reason_of_an_earlier_goal(create_rig: CreateRig) -> None:
    rig = create_rig()
    handle = rig.navigation.go_to(Pose2D(1.05, 1.5, 0.0))
    rig.run(2.0, lambda: handle.done)
    bad = NavigateGoal((Pose2D(1.0, 0.0, 0.0),), str(Path(__file__).parent / "no_such.xml"))
    again = rig.navigation.navigate_to_pose.send_goal(bad)
    rig.run(1.0, lambda: again.done)
    assert again.result.code == Nav2ErrorCode.FAILED_TO_LOAD_BEHAVIOR_TREE


def test_a_failure_names_the_server_that_is_not_active(create_rig: CreateRig) -> None:
    rig = create_rig()
    rig.navigation.servers.compute_path.is_active = False
    tree = "navigation/navigate_w_replanning_time.xml"
    goal = NavigateGoal((Pose2D(0.8, 0.0, 0.0),), str(TREES / tree))
    handle = rig.navigation.navigate_to_pose.send_goal(goal)
    rig.run(10.0, lambda: handle.done)
    result = handle.result
    assert (result.code, result.message) == (
        Nav2ErrorCode.GOAL_REJECTED,
        "GOAL_REJECTED: planner_server is not active",
    )


def test_several_goals_are_passed_in_their_order(create_rig: CreateRig) -> None:
    rig = create_rig()
    goals = [Pose2D(0.0, 1.2, 0.0), Pose2D(-1.2, 0.6, 0.0), Pose2D(-0.6, -0.9, 0.0)]
    handle = rig.navigation.go_through(goals)
    nearest = [9.0] * 3
    order = []

    def passing():
        for index, goal in enumerate(goals):
            nearest[index] = min(nearest[index], rig.distance_to(goal.x, goal.y))
            if nearest[index] < 0.75 and index not in order:
                order.append(index)
        return handle.done

    rig.run(80.0, passing)
    assert handle.status is GoalStatus.SUCCEEDED
    assert order == [0, 1, 2]
    assert rig.distance_to(-0.6, -0.9) < 0.35
    board = rig.navigation.navigate_through_poses.tree.blackboard
    assert [waypoint.state.name for waypoint in board["waypoint_statuses"]][:2] == ["COMPLETED", "COMPLETED"]
    assert [waypoint.state.name for waypoint in handle.result.value] == ["COMPLETED"] * 3


def test_the_waypoint_follower_lists_missed_waypoints_or_stops(create_rig: CreateRig) -> None:
    rig = create_rig()
    goals = (Pose2D(0.5, 0.0, 0.0), Pose2D(50.0, 0.0, 0.0), Pose2D(0.0, 0.3, 0.0))
    results = []
    for stops in (False, True):
        follower = WaypointFollower(rig.navigation.servers, WaypointFollowerParameters(stop_on_failure=stops))
        rig.body.schedule.add_task(follower.RATE, Phase.CONTROLLER, follower.step)
        handle = follower.send_goal(FollowWaypointsGoal(goals, loops=1))
        rig.run(60.0, partial(getattr, handle, "done"))
        missed = handle.result.value
        assert all(waypoint.code == Nav2ErrorCode.GOAL_OUTSIDE_MAP for waypoint in missed)
        results.append((handle.status.name, handle.result.code, [waypoint.index for waypoint in missed]))
    assert results == [("SUCCEEDED", 0, [1, 1]), ("ABORTED", Nav2ErrorCode.STOP_ON_MISSED_WAYPOINT, [1])]
    handle = follower.send_goal(FollowWaypointsGoal(goals, first=3))
    rig.run(0.2)
    assert handle.result.code == Nav2ErrorCode.NO_VALID_WAYPOINTS


def test_a_new_map_of_another_size_is_used_for_the_pose_and_for_paths(create_rig: CreateRig) -> None:
    rig = create_rig()
    rig.run(2.0)
    x0, y0 = rig.navigation.map.origin
    finer = rig.navigation.map.cells.repeat(2, axis=0).repeat(2, axis=1)
    wide = np.full((len(finer) + 40, len(finer[0]) + 20), -1, dtype=np.int8)
    wide[40:, 20:] = finer
    side = rig.navigation.map.resolution / 2
    changed = OccupancyMap(wide, side, (x0 - 20 * side, y0 - 40 * side))
    row, col = changed.cell(1.0, 0.4)
    changed.cells[row - 5 : row + 5, col - 5 : col + 5] = 100
    handle = rig.navigation.go_to(Pose2D(3.0, -1.0, 0.0))
    rig.run(1.0)
    rig.navigation.change_map(changed)
    compute_path = rig.navigation.servers.compute_path
    blocked, free = (compute_path.send_goal(ComputePathGoal((Pose2D(x, 0.4, 0.0),))) for x in (1.0, 2.0))
    rig.run(0.2)
    assert free.status is GoalStatus.SUCCEEDED
    assert blocked.result.code == Nav2ErrorCode.GOAL_OCCUPIED
    rig.run(60.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(3.0, -1.0) < 0.35
    assert rig.navigation.global_costmap.costs.shape == wide.shape


def test_without_localisation_the_robot_stands_and_goals_fail(create_rig: CreateRig) -> None:
    rig = create_rig()
    handle = rig.navigation.go_to(Pose2D(3.0, -1.0, 0.0))
    rig.run(3.0)
    rig.navigation.is_localising = False
    rig.run(1.0, lambda: handle.done)
    assert handle.result.code == Nav2ErrorCode.NAVIGATE_TF_ERROR
    rig.run(1.0)
    assert rig.body.ramped_twist() == pytest.approx((0.0, 0.0), abs=0.01)
    assert rig.navigation.estimate() is None
    rig.navigation.is_localising = True
    rig.run(1.0)
    assert rig.navigation.estimate() is not None


def test_a_goal_can_have_its_own_tree_and_a_path_of_nav2_selects_our_tree_of_that_name(
    create_rig: CreateRig,
) -> None:
    rig = create_rig()
    named = "/opt/ros/humble/share/nav2_bt_navigator/behavior_trees/navigate_w_replanning_time.xml"
    handle = rig.navigation.navigate_to_pose.send_goal(NavigateGoal((Pose2D(0.8, 0.0, 0.0),), named))
    rig.run(20.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert "RecoveryNode" not in {node.id for node in rig.navigation.navigate_to_pose.tree.nodes}


def test_an_invalid_tree_fails_only_its_own_goal(create_rig: CreateRig, tmp_path: Path) -> None:
    rig = create_rig()
    file = tmp_path / "tree.xml"
    for text in (
        "<root",
        '<root BTCPP_format="4"><BehaviorTree ID="T"><Fly/></BehaviorTree></root>',
        '<root BTCPP_format="4"><BehaviorTree ID="T"><RecoveryNode/></BehaviorTree></root>',
    ):
        file.write_text(text)
        goal = NavigateGoal((Pose2D(0.8, 0.0, 0.0),), str(file))
        handle = rig.navigation.navigate_to_pose.send_goal(goal)
        rig.run(1.0, lambda handle=handle: handle.done)
        assert handle.status is GoalStatus.ABORTED
        assert handle.result.code == Nav2ErrorCode.FAILED_TO_LOAD_BEHAVIOR_TREE
        assert "tree.xml" in handle.result.message
    after = rig.navigation.go_to(Pose2D(0.8, 0.0, 0.0))
    rig.run(20.0, lambda: after.done)
    assert after.status is GoalStatus.SUCCEEDED


def test_leaf_that_raises_fails_goal_and_stops_robot(create_rig: CreateRig, tmp_path: Path) -> None:
    rig = create_rig()
    file = tmp_path / "tree.xml"
    file.write_text(
        '<root BTCPP_format="4"><BehaviorTree ID="T"><Parallel>'
        '<Sequence><Wait wait_duration="3"/><TransformAvailable/></Sequence>'
        '<Sequence><ComputePathToPose goal="{goal}" path="{path}"/><FollowPath path="{path}"/></Sequence>'
        "</Parallel></BehaviorTree></root>"
    )
    handle = rig.navigation.navigate_to_pose.send_goal(NavigateGoal((Pose2D(4.0, 0.0, 0.0),), str(file)))
    rig.run(10.0, lambda: handle.done)
    rig.run(1.0)
    assert handle.status is GoalStatus.ABORTED
    assert "TransformAvailable" in handle.result.message
    assert rig.body.ramped_twist()[0] == pytest.approx(0.0, abs=0.02)


def test_a_laser_failure_of_five_seconds_stops_the_robot_until_it_ends(create_rig: CreateRig) -> None:
    rig = create_rig(Fault("laser", 6 * NS_PER_S, 11 * NS_PER_S))
    handle = rig.navigation.go_to(Pose2D(2.6, 0.0, 0.0))
    rig.run(6.0)
    assert rig.speeds[-1] > 0.25
    rig.run(1.0)
    assert rig.speeds[-1] == pytest.approx(0.0, abs=0.02)
    rig.run(4.0)
    assert max(rig.speeds) < 0.02
    rig.run(60.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(2.6, 0.0) < 0.35


@pytest.mark.parametrize("during", ["carried to another room", "restarted at zero"])
def test_without_odometry_the_robot_stops_and_its_pose_is_known_after_it(
    create_rig: CreateRig, caplog: pytest.LogCaptureFixture, during: str
) -> None:
    rig = create_rig(Fault("odometry", 6 * NS_PER_S, 11 * NS_PER_S))
    handle = rig.navigation.go_to(Pose2D(2.6, 0.0, 0.0))
    rig.run(6.0)
    assert rig.speeds[-1] > 0.25
    driven = rig.body.distance
    rig.run(0.3)
    assert rig.body.commanded_velocity().v < 0.3
    rig.run(0.3)
    assert rig.speeds[-1] == pytest.approx(0.0, abs=0.01)
    rig.run(2.0)
    # 0.2 s until the odometry is stale, a period of the controller, and the way to brake from 0.3 m/s.
    assert rig.body.distance - driven < 0.3 * 0.25 + 0.3**2 / 2 + 0.02
    assert rig.navigation.estimate() is None
    if during == "carried to another room":
        rig.body.kidnap(Pose2D(-2.2, -0.5, 2.5))
    else:
        odometry = rig.body.sensors.wheel_odometry
        odometry.x = odometry.y = odometry.yaw = 0.0
    rig.run(2.35)
    assert not handle.done
    driven = rig.body.distance
    found = rig.run(30.0, lambda: rig.navigation.estimate() is not None)
    assert found < (30.0 if during == "carried to another room" else 2.0)
    assert rig.body.distance - driven < 0.1
    estimate, true = rig.navigation.estimate(), rig.body.true_pose()
    assert math.hypot(estimate.x - true.x, estimate.y - true.y) < 0.2
    rig.run(60.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(2.6, 0.0) < 0.35
    warnings = [record.message for record in caplog.records if "odometry" in record.message]
    assert len(warnings) == 2
    assert warnings[0] == "no odometry for 0.2 s: the robot stands until it arrives again"
    assert re.fullmatch(r"the odometry arrives again after 5\.[01] s", warnings[1])


@pytest.mark.parametrize(
    ("sensor", "code", "reading", "tree"),
    [
        ("odometry", "NAVIGATE_TF_ERROR", "odometry", ""),
        ("laser", "CONTROLLER_TIMED_OUT", "laser scan", ""),
        ("odometry", "NAVIGATE_TF_ERROR", "odometry", "navigate_w_replanning_time.xml"),
    ],
)
def test_a_goal_fails_after_a_long_outage_with_its_cause(
    create_rig: CreateRig,
    monkeypatch: pytest.MonkeyPatch,
    sensor: str,
    code: str,
    reading: str,
    tree: str,
) -> None:
    monkeypatch.setattr(sensor_watch, "MAX_OUTAGE_S", 2.0)
    rig = create_rig(Fault(sensor, 3 * NS_PER_S, 99 * NS_PER_S))
    goal = NavigateGoal((Pose2D(4.3, 0.0, 0.0),), tree)
    handle = rig.navigation.navigate_to_pose.send_goal(goal)
    assert rig.run(8.0, lambda: handle.done) == pytest.approx(5.0, abs=0.2)
    assert handle.status is GoalStatus.ABORTED
    sentence = rf"{code}: no {reading} for 2.\d s: the robot stands until it arrives again"
    assert re.fullmatch(sentence, handle.result.message)
    assert Nav2ErrorCode(handle.result.code).name == code


def test_a_goal_fails_with_an_empty_battery_and_another_is_reached_after_recharging(
    create_rig: CreateRig,
) -> None:
    rig = create_rig()
    rig.body.battery_model.level = 0.6
    handle = rig.navigation.go_to(Pose2D(2.5, 0.0, 0.0))
    rig.run(20.0, lambda: handle.done)
    assert handle.status is GoalStatus.ABORTED
    assert handle.result.message == "FAILED_TO_MAKE_PROGRESS: the battery is empty"
    assert rig.body.battery().level == 0.0
    assert rig.distance_to(0.0, 0.0) > 0.2
    rig.body.recharge()
    again = rig.navigation.go_to(Pose2D(2.5, 0.0, 0.0))
    rig.run(30.0, lambda: again.done)
    assert again.status is GoalStatus.SUCCEEDED


def test_a_goal_waits_for_a_laser_that_fails_at_the_start(create_rig: CreateRig) -> None:
    rig = create_rig(Fault("laser", 0, 4 * NS_PER_S))
    handle = rig.navigation.go_to(Pose2D(1.5, 1.0, 0.0))
    rig.run(3.9)
    assert not handle.done
    assert rig.body.distance < 0.01
    rig.run(40.0, until=lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED


def test_a_kidnapped_robot_stops_finds_its_pose_and_reaches_the_goal(create_rig: CreateRig) -> None:
    rig = create_rig()
    handle = rig.navigation.go_to(Pose2D(2.5, -1.2, 0.0))
    rig.run(5.0)
    planned = rig.navigation.servers.compute_path.latest_path
    rig.body.kidnap(Pose2D(-2.2, -0.5, 2.5))
    noticed = rig.run(5.0, lambda: rig.navigation.estimate() is None)
    assert noticed < 2.0
    rig.run(1.0)
    assert max(rig.speeds[-5:]) == pytest.approx(0.0, abs=0.02)
    found = rig.run(60.0, lambda: rig.navigation.estimate() is not None)
    assert found < 60.0
    estimate, true = rig.navigation.estimate(), rig.body.true_pose()
    assert math.hypot(estimate.x - true.x, estimate.y - true.y) < 0.3
    rig.run(60.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.navigation.servers.compute_path.latest_path is not planned
    assert rig.distance_to(2.5, -1.2) < 0.35


def test_a_new_goal_ends_the_recovery_of_the_previous_goal(create_rig: CreateRig) -> None:
    rig = create_rig()
    first = rig.navigation.go_to(Pose2D(4.3, 1.9, 0.0))
    rig.run(60.0, lambda: rig.navigation.servers.wait.is_busy)
    assert rig.navigation.servers.wait.is_busy
    second = rig.navigation.go_to(Pose2D(0.8, 0.0, 0.0))
    rig.run(1.0)
    assert first.status is GoalStatus.CANCELED
    assert not rig.navigation.servers.wait.is_busy
    rig.run(20.0, lambda: second.done)
    assert second.status is GoalStatus.SUCCEEDED


def test_the_same_goal_again_gets_a_new_path(create_rig: CreateRig) -> None:
    rig = create_rig()
    first = rig.navigation.go_to(Pose2D(3.0, -1.0, 0.0))
    rig.run(4.0)
    first.cancel()
    rig.run(1.0)
    planned = rig.navigation.servers.compute_path.latest_path
    again = rig.navigation.go_to(Pose2D(3.0, -1.0, 0.0))
    rig.run(1.0)
    assert not again.done
    assert rig.navigation.servers.compute_path.latest_path is not planned


@pytest.mark.parametrize(
    ("named", "meant"),
    [
        ("/opt/ros/humble/share/navigate_w_replanning_time.xml", "navigate_w_replanning_time.xml"),
        ("navigate_w_replanning_time", "navigate_w_replanning_time.xml"),
        ("/somewhere/no_such_tree.xml", "navigate_to_pose_w_replanning_and_recovery.xml"),
        ("", "navigate_to_pose_w_replanning_and_recovery.xml"),
    ],
)
def test_a_tree_in_the_parameters_selects_our_tree_or_the_default_tree(
    create_rig: CreateRig, named: str, meant: str
) -> None:
    usual = NavigationParameters()
    navigator = replace(usual.navigator, default_nav_to_pose_bt_xml=named)
    rig = create_rig(parameters=replace(usual, navigator=navigator))
    assert rig.navigation.navigate_to_pose.default_tree == TREES / "navigation" / meant


def test_goal_waits_until_pose_is_known(create_rig: CreateRig, caplog: pytest.LogCaptureFixture) -> None:
    rig = create_rig(start=Pose2D(3.0, -1.2, 2.0))
    handle = rig.navigation.go_to(Pose2D(0.0, 0.0, 0.0))
    rig.run(1.0)
    assert rig.navigation.estimate() is None
    assert "the robot's pose is unknown" in caplog.text
    assert handle.feedback.navigation_time == pytest.approx(1.0, abs=0.1)
    rig.run(90.0, lambda: handle.done)
    assert handle.status is GoalStatus.SUCCEEDED
    assert rig.distance_to(0.0, 0.0) < 0.35
