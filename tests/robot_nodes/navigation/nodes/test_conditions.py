"""Nav2's conditions: a test for each sentence of their documentation."""

from collections.abc import Callable

import pytest

from btcore import NodeExecutionError
from btcore_navigation.controller import FollowPathFeedback
from btcore_navigation.path import NavPath
from btcore_robot.robot import BatteryState, Odometry, Pose2D, Twist2D
from tests.robot_nodes.navigation.nodes.conftest import Bench

HERE, THERE = Pose2D(1.0, 0.0, 0.0), Pose2D(2.0, 0.0, 0.0)


def test_goal_reached_within_the_tolerance_of_the_navigator(bench: Bench) -> None:
    tree = bench.tree('<GoalReached goal="{goal}"/>', goal=HERE)
    bench.move(0.74)
    assert bench.letters(tree, 1) == "F"
    bench.move(0.76)
    assert bench.letters(tree, 1) == "S"
    bench.localiser.confident = False
    assert bench.letters(tree, 1) == "F"


@pytest.mark.parametrize("key", ["goal", "goals"])
def test_goal_updated_fails_at_first_and_succeeds_once_for_each_change(bench: Bench, key: str) -> None:
    tree = bench.tree("<GoalUpdated/>", goal=HERE)
    assert bench.letters(tree, 2) == "FF"
    tree.blackboard[key] = THERE if key == "goal" else [THERE]
    assert bench.letters(tree, 2) == "SF"


def test_goal_updated_forgets_its_goal_at_a_halt(bench: Bench) -> None:
    tree = bench.tree("<GoalUpdated/>", goal=HERE)
    bench.letters(tree, 1)
    tree.halt()
    tree.blackboard["goal"] = THERE
    assert bench.letters(tree, 1) == "F"


def test_global_updated_goal_succeeds_at_first_and_remembers_across_halts(bench: Bench) -> None:
    tree = bench.tree("<GlobalUpdatedGoal/>", goal=HERE)
    assert bench.letters(tree, 2) == "SF"
    tree.halt()
    assert bench.letters(tree, 1) == "F"
    tree.halt()
    tree.blackboard["goal"] = THERE
    assert bench.letters(tree, 2) == "SF"
    tree.blackboard["goals"] = [HERE, THERE]
    assert bench.letters(tree, 2) == "SF"


class Bumped:
    """The odometry of a robot that bumps into something."""

    def __init__(self, bench: Bench) -> None:
        self.bench = bench

    def at(self, v: float) -> None:
        self.bench.wait(0.02)
        self.bench.robot._odometry = Odometry(Pose2D(0, 0, 0), Twist2D(v, 0.0), self.bench.robot.clock.now())


def test_is_stuck_succeeds_when_the_robot_slows_down_as_in_a_collision(bench: Bench) -> None:
    tree, odometry = bench.tree("<IsStuck/>"), Bumped(bench)
    found = ""
    for speed in (0.3, 0.3, 0.3, 0.05, 0.05):
        odometry.at(speed)
        found += bench.letters(tree, 1)
    assert found == "FFFSF"


def test_is_stuck_fails_when_the_robot_brakes(bench: Bench) -> None:
    tree, odometry = bench.tree("<IsStuck/>"), Bumped(bench)
    found = ""
    for speed in (0.3, 0.3, 0.3, 0.15, 0.0, 0.0):
        odometry.at(speed)
        found += bench.letters(tree, 1)
    assert found == "FFFFFF"


@pytest.mark.parametrize(("level", "letter"), [(100.0, "F"), (20.1, "F"), (20.0, "S"), (3.0, "S")])
def test_is_battery_low_compares_the_level_with_its_threshold(
    bench: Bench, monkeypatch: pytest.MonkeyPatch, level: float, letter: str
) -> None:
    monkeypatch.setattr(bench.robot, "battery", lambda: BatteryState(level, 0))
    assert bench.letters(bench.tree('<IsBatteryLow min_battery="0.2"/>'), 1) == letter


def test_an_unknown_battery_level_is_not_low(bench: Bench) -> None:
    assert bench.letters(bench.tree('<IsBatteryLow min_battery="0.2"/>'), 1) == "F"


def test_is_battery_charging_reads_its_topic(bench: Bench) -> None:
    tree = bench.tree("<IsBatteryCharging/>")
    assert bench.letters(tree, 1) == "F"
    bench.servers.topics["/battery_status"] = "charging"
    assert bench.letters(tree, 1) == "S"
    other = bench.tree('<IsBatteryCharging battery_topic="/other"/>')
    assert bench.letters(other, 1) == "F"


def test_distance_traveled_counts_from_the_last_success(bench: Bench) -> None:
    tree = bench.tree('<DistanceTraveled distance="0.5"/>')
    assert bench.letters(tree, 1) == "F"
    bench.move(0.45)
    assert bench.letters(tree, 1) == "F"
    bench.move(0.55)
    assert bench.letters(tree, 2) == "SF"
    bench.move(1.0)
    assert bench.letters(tree, 1) == "F"
    bench.move(1.06)
    assert bench.letters(tree, 1) == "S"


def test_time_expired_counts_from_the_first_tick_and_the_last_success(bench: Bench) -> None:
    tree = bench.tree('<TimeExpired seconds="0.5"/>')
    assert bench.letters(tree, 12, every=0.1) == "FFFFFSFFFFSF"


def test_time_expired_starts_again_after_a_halt(bench: Bench) -> None:
    tree = bench.tree('<TimeExpired seconds="0.5"/>')
    bench.letters(tree, 1, every=0.6)
    tree.halt()
    assert bench.letters(tree, 1) == "F"


def test_path_expiring_timer_counts_from_a_new_path(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree('<PathExpiringTimer seconds="0.5" path="{path}"/>', path=path((0, 0), (1, 0)))
    assert bench.letters(tree, 4, every=0.1) == "FFFF"
    tree.blackboard["path"] = path((0, 0), (2, 0))
    assert bench.letters(tree, 7, every=0.1) == "FFFFFSF"


def test_path_expiring_timer_continues_across_halts(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree('<PathExpiringTimer seconds="0.5" path="{path}"/>', path=path((0, 0), (1, 0)))
    bench.letters(tree, 1, every=0.6)
    tree.halt()
    assert bench.letters(tree, 1) == "S"


def test_transform_available_succeeds_always_after_the_first_success(bench: Bench) -> None:
    tree = bench.tree('<TransformAvailable child="{child}" parent="map"/>', child="nowhere")
    assert bench.letters(tree, 1) == "F"
    tree.blackboard["child"] = "base_laser_link"
    assert bench.letters(tree, 1) == "S"
    tree.blackboard["child"] = "nowhere"
    assert bench.letters(tree, 1) == "S"


def test_transform_available_requires_two_frames(bench: Bench) -> None:
    with pytest.raises(NodeExecutionError, match="two frames"):
        bench.tree('<TransformAvailable child="map"/>').tick_exactly_once()


def test_initial_pose_received_reads_its_port_or_the_entry_of_that_name(bench: Bench) -> None:
    tree = bench.tree("<InitialPoseReceived/>")
    assert bench.letters(tree, 1) == "F"
    tree.blackboard["initial_pose_received"] = True
    assert bench.letters(tree, 1) == "S"
    other = bench.tree('<InitialPoseReceived initial_pose_received="{reported}"/>', reported=False)
    assert bench.letters(other, 1) == "F"


def test_is_goal_nearby_compares_remaining_length_of_path(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree('<IsGoalNearby path="{path}"/>', path=path((0, 0), (2, 0), (2, 0.5)))
    bench.move(1.4)
    assert bench.letters(tree, 1) == "F"
    bench.move(1.6)
    assert bench.letters(tree, 1) == "S"


def test_is_goal_nearby_fails_without_a_path_or_a_pose(bench: Bench, path: Callable[..., NavPath]) -> None:
    assert bench.letters(bench.tree('<IsGoalNearby path="{path}"/>'), 1) == "F"
    assert bench.letters(bench.tree('<IsGoalNearby path="{path}"/>', path=path((0, 0))), 1) == "S"
    bench.localiser.confident = False
    assert bench.letters(bench.tree('<IsGoalNearby path="{path}"/>', path=path((0, 0))), 1) == "F"


def test_is_goal_nearby_can_limit_search_at_start_of_loop(bench: Bench, path: Callable[..., NavPath]) -> None:
    loop = path((0, 0), (3, 0), (3, 2), (0, 2), (0, 0.02))
    all_of_it = bench.tree('<IsGoalNearby path="{path}"/>', path=loop)
    ahead = bench.tree('<IsGoalNearby path="{path}" max_robot_pose_search_dist="1.0"/>', path=loop)
    bench.move(0.0, 0.1)
    assert bench.letters(all_of_it, 1) == "S"
    assert bench.letters(ahead, 1) == "F"
    for x, y in ((1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (2, 2), (1, 2), (0, 2), (0, 1.1)):
        bench.move(x, y)
        assert bench.letters(ahead, 1) == "F"
    bench.move(0.0, 0.6)
    assert bench.letters(ahead, 1) == "S"


@pytest.mark.parametrize(("x", "letter"), [(1.49, "S"), (1.51, "F")])
def test_are_poses_near(bench: Bench, x: float, letter: str) -> None:
    text = '<ArePosesNear ref_pose="{a}" target_pose="{b}"/>'
    assert bench.letters(bench.tree(text, a=HERE, b=Pose2D(x, 0.0, 2.0)), 1) == letter


@pytest.mark.parametrize(
    ("aside", "turned", "letter"),
    [(0.2, 0.0, "S"), (0.4, 0.0, "F"), (-0.4, 0.0, "S"), (-0.6, 0.0, "F"), (0.0, 0.9, "S"), (0.0, -1.1, "F")],
)
def test_within_tracking_bounds_checks_left_right_and_heading_errors(
    bench: Bench, aside: float, turned: float, letter: str
) -> None:
    tree = bench.tree(
        '<IsWithinPathTrackingBounds max_error_left="0.3" max_error_heading="1" tracking_feedback="{how}"/>',
        how=FollowPathFeedback(1.0, 0.3, aside, turned),
    )
    assert bench.letters(tree, 1) == letter


def test_within_tracking_bounds_succeeds_without_feedback(bench: Bench) -> None:
    assert bench.letters(bench.tree('<IsWithinPathTrackingBounds tracking_feedback="{how}"/>'), 1) == "S"
    assert bench.letters(bench.tree("<IsWithinPathTrackingBounds/>"), 1) == "S"


def test_are_error_codes_present(bench: Bench) -> None:
    text = '<AreErrorCodesPresent error_code="{code}" error_codes_to_check="{codes}"/>'
    assert bench.letters(bench.tree(text, code=104, codes=[100, 104]), 1) == "S"
    assert bench.letters(bench.tree(text, code=105, codes=[100, 104]), 1) == "F"
    assert bench.letters(bench.tree(text, codes=[100, 104]), 1) == "F"


@pytest.mark.parametrize(
    ("node", "codes"),
    [
        ("WouldAControllerRecoveryHelp", {100, 104, 105, 106}),
        ("WouldAPlannerRecoveryHelp", {200, 207, 208, 300, 307, 308}),
        ("WouldASmootherRecoveryHelp", {500, 502, 503, 504}),
        ("WouldARouteRecoveryHelp", {400, 404, 405}),
    ],
)
def test_would_a_recovery_help(bench: Bench, node: str, codes: set[int]) -> None:
    tree, helped = bench.tree(f'<{node} error_code="{{code}}"/>'), set()
    for code in range(1000):
        tree.blackboard["code"] = code
        if bench.letters(tree, 1) == "S":
            helped.add(code)
    assert helped == codes
