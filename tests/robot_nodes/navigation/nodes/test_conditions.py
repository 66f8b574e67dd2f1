"""Nav2's conditions: a test for each sentence of their documentation."""

import pytest

from btcore import NodeExecutionError, Tree
from btcore_navigation.controller import FollowPathFeedback
from btcore_robot.robot import BatteryState, Odometry, Pose2D, Twist2D
from tests.robot_nodes.navigation.conftest import polyline_path
from tests.robot_nodes.navigation.nodes.conftest import NodeRig

HERE, THERE = Pose2D(1.0, 0.0, 0.0), Pose2D(2.0, 0.0, 0.0)


def test_goal_reached_within_the_tolerance_of_the_navigator(rig: NodeRig) -> None:
    tree = rig.tree('<GoalReached goal="{goal}"/>', goal=HERE)
    rig.move(0.74)
    assert rig.letters(tree, 1) == "F"
    rig.move(0.76)
    assert rig.letters(tree, 1) == "S"
    rig.localiser.is_confident = False
    assert rig.letters(tree, 1) == "F"


@pytest.mark.parametrize("key", ["goal", "goals"])
def test_goal_updated_fails_at_first_and_succeeds_once_for_each_change(rig: NodeRig, key: str) -> None:
    tree = rig.tree("<GoalUpdated/>", goal=HERE)
    assert rig.letters(tree, 2) == "FF"
    tree.blackboard[key] = THERE if key == "goal" else [THERE]
    assert rig.letters(tree, 2) == "SF"


def test_goal_updated_forgets_its_goal_at_a_halt(rig: NodeRig) -> None:
    tree = rig.tree("<GoalUpdated/>", goal=HERE)
    rig.letters(tree, 1)
    tree.halt()
    tree.blackboard["goal"] = THERE
    assert rig.letters(tree, 1) == "F"


def test_global_updated_goal_succeeds_at_first_and_remembers_across_halts(rig: NodeRig) -> None:
    tree = rig.tree("<GlobalUpdatedGoal/>", goal=HERE)
    assert rig.letters(tree, 2) == "SF"
    tree.halt()
    assert rig.letters(tree, 1) == "F"
    tree.halt()
    tree.blackboard["goal"] = THERE
    assert rig.letters(tree, 2) == "SF"
    tree.blackboard["goals"] = [HERE, THERE]
    assert rig.letters(tree, 2) == "SF"


def letters_at_speeds(rig: NodeRig, tree: Tree, *speeds: float) -> str:
    """Tick every 20 ms with another speed (m/s) in the odometry; return the letters of the results."""
    letters = ""
    for speed in speeds:
        rig.wait(0.02)
        rig.robot._odometry = Odometry(Pose2D(0, 0, 0), Twist2D(speed, 0.0), rig.robot.clock.now())
        letters += rig.letters(tree, 1)
    return letters


def test_is_stuck_succeeds_when_the_robot_slows_down_as_in_a_collision(rig: NodeRig) -> None:
    assert letters_at_speeds(rig, rig.tree("<IsStuck/>"), 0.3, 0.3, 0.3, 0.05, 0.05) == "FFFSF"


def test_is_stuck_fails_when_the_robot_brakes(rig: NodeRig) -> None:
    assert letters_at_speeds(rig, rig.tree("<IsStuck/>"), 0.3, 0.3, 0.3, 0.15, 0.0, 0.0) == "FFFFFF"


@pytest.mark.parametrize(("level", "letter"), [(100.0, "F"), (20.1, "F"), (20.0, "S"), (3.0, "S")])
def test_is_battery_low_compares_the_level_with_its_threshold(
    rig: NodeRig, monkeypatch: pytest.MonkeyPatch, level: float, letter: str
) -> None:
    monkeypatch.setattr(rig.robot, "battery", lambda: BatteryState(level, 0))
    assert rig.letters(rig.tree('<IsBatteryLow min_battery="0.2"/>'), 1) == letter


def test_an_unknown_battery_level_is_not_low(rig: NodeRig) -> None:
    assert rig.letters(rig.tree('<IsBatteryLow min_battery="0.2"/>'), 1) == "F"


def test_is_battery_charging_reads_its_topic(rig: NodeRig) -> None:
    tree = rig.tree("<IsBatteryCharging/>")
    assert rig.letters(tree, 1) == "F"
    rig.servers.topics["/battery_status"] = "charging"
    assert rig.letters(tree, 1) == "S"
    other = rig.tree('<IsBatteryCharging battery_topic="/other"/>')
    assert rig.letters(other, 1) == "F"


def test_distance_traveled_counts_from_the_last_success(rig: NodeRig) -> None:
    tree = rig.tree('<DistanceTraveled distance="0.5"/>')
    assert rig.letters(tree, 1) == "F"
    rig.move(0.45)
    assert rig.letters(tree, 1) == "F"
    rig.move(0.55)
    assert rig.letters(tree, 2) == "SF"
    rig.move(1.0)
    assert rig.letters(tree, 1) == "F"
    rig.move(1.06)
    assert rig.letters(tree, 1) == "S"


def test_time_expired_counts_from_the_first_tick_and_the_last_success(rig: NodeRig) -> None:
    tree = rig.tree('<TimeExpired seconds="0.5"/>')
    assert rig.letters(tree, 12, every=0.1) == "FFFFFSFFFFSF"


def test_time_expired_starts_again_after_a_halt(rig: NodeRig) -> None:
    tree = rig.tree('<TimeExpired seconds="0.5"/>')
    rig.letters(tree, 1, every=0.6)
    tree.halt()
    assert rig.letters(tree, 1) == "F"


def test_path_expiring_timer_counts_from_a_new_path(rig: NodeRig) -> None:
    tree = rig.tree('<PathExpiringTimer seconds="0.5" path="{path}"/>', path=polyline_path((0, 0), (1, 0)))
    assert rig.letters(tree, 4, every=0.1) == "FFFF"
    tree.blackboard["path"] = polyline_path((0, 0), (2, 0))
    assert rig.letters(tree, 7, every=0.1) == "FFFFFSF"


def test_path_expiring_timer_continues_across_halts(rig: NodeRig) -> None:
    tree = rig.tree('<PathExpiringTimer seconds="0.5" path="{path}"/>', path=polyline_path((0, 0), (1, 0)))
    rig.letters(tree, 1, every=0.6)
    tree.halt()
    assert rig.letters(tree, 1) == "S"


def test_transform_available_succeeds_always_after_the_first_success(rig: NodeRig) -> None:
    tree = rig.tree('<TransformAvailable child="{child}" parent="map"/>', child="nowhere")
    assert rig.letters(tree, 1) == "F"
    tree.blackboard["child"] = "base_laser_link"
    assert rig.letters(tree, 1) == "S"
    tree.blackboard["child"] = "nowhere"
    assert rig.letters(tree, 1) == "S"


def test_transform_available_requires_two_frames(rig: NodeRig) -> None:
    with pytest.raises(NodeExecutionError, match="two frames"):
        rig.tree('<TransformAvailable child="map"/>').tick_exactly_once()


def test_initial_pose_received_reads_its_port_or_the_entry_of_that_name(rig: NodeRig) -> None:
    tree = rig.tree("<InitialPoseReceived/>")
    assert rig.letters(tree, 1) == "F"
    tree.blackboard["initial_pose_received"] = True
    assert rig.letters(tree, 1) == "S"
    other = rig.tree('<InitialPoseReceived initial_pose_received="{reported}"/>', reported=False)
    assert rig.letters(other, 1) == "F"


def test_is_goal_nearby_compares_remaining_length_of_path(rig: NodeRig) -> None:
    tree = rig.tree('<IsGoalNearby path="{path}"/>', path=polyline_path((0, 0), (2, 0), (2, 0.5)))
    rig.move(1.4)
    assert rig.letters(tree, 1) == "F"
    rig.move(1.6)
    assert rig.letters(tree, 1) == "S"


def test_is_goal_nearby_fails_without_a_path_or_a_pose(rig: NodeRig) -> None:
    assert rig.letters(rig.tree('<IsGoalNearby path="{path}"/>'), 1) == "F"
    assert rig.letters(rig.tree('<IsGoalNearby path="{path}"/>', path=polyline_path((0, 0))), 1) == "S"
    rig.localiser.is_confident = False
    assert rig.letters(rig.tree('<IsGoalNearby path="{path}"/>', path=polyline_path((0, 0))), 1) == "F"


def test_is_goal_nearby_can_limit_search_at_start_of_loop(rig: NodeRig) -> None:
    loop = polyline_path((0, 0), (3, 0), (3, 2), (0, 2), (0, 0.02))
    all_of_it = rig.tree('<IsGoalNearby path="{path}"/>', path=loop)
    ahead = rig.tree('<IsGoalNearby path="{path}" max_robot_pose_search_dist="1.0"/>', path=loop)
    rig.move(0.0, 0.1)
    assert rig.letters(all_of_it, 1) == "S"
    assert rig.letters(ahead, 1) == "F"
    for x, y in ((1, 0), (2, 0), (3, 0), (3, 1), (3, 2), (2, 2), (1, 2), (0, 2), (0, 1.1)):
        rig.move(x, y)
        assert rig.letters(ahead, 1) == "F"
    rig.move(0.0, 0.6)
    assert rig.letters(ahead, 1) == "S"


@pytest.mark.parametrize(("x", "letter"), [(1.49, "S"), (1.51, "F")])
def test_are_poses_near(rig: NodeRig, x: float, letter: str) -> None:
    text = '<ArePosesNear ref_pose="{a}" target_pose="{b}"/>'
    assert rig.letters(rig.tree(text, a=HERE, b=Pose2D(x, 0.0, 2.0)), 1) == letter


@pytest.mark.parametrize(
    ("aside", "turned", "letter"),
    [(0.2, 0.0, "S"), (0.4, 0.0, "F"), (-0.4, 0.0, "S"), (-0.6, 0.0, "F"), (0.0, 0.9, "S"), (0.0, -1.1, "F")],
)
def test_within_tracking_bounds_checks_left_right_and_heading_errors(
    rig: NodeRig, aside: float, turned: float, letter: str
) -> None:
    tree = rig.tree(
        '<IsWithinPathTrackingBounds max_error_left="0.3" max_error_heading="1" tracking_feedback="{how}"/>',
        how=FollowPathFeedback(1.0, 0.3, aside, turned),
    )
    assert rig.letters(tree, 1) == letter


def test_within_tracking_bounds_succeeds_without_feedback(rig: NodeRig) -> None:
    assert rig.letters(rig.tree('<IsWithinPathTrackingBounds tracking_feedback="{how}"/>'), 1) == "S"
    assert rig.letters(rig.tree("<IsWithinPathTrackingBounds/>"), 1) == "S"


def test_are_error_codes_present(rig: NodeRig) -> None:
    text = '<AreErrorCodesPresent error_code="{code}" error_codes_to_check="{codes}"/>'
    assert rig.letters(rig.tree(text, code=104, codes=[100, 104]), 1) == "S"
    assert rig.letters(rig.tree(text, code=105, codes=[100, 104]), 1) == "F"
    assert rig.letters(rig.tree(text, codes=[100, 104]), 1) == "F"


@pytest.mark.parametrize(
    ("node", "codes"),
    [
        ("WouldAControllerRecoveryHelp", {100, 104, 105, 106}),
        ("WouldAPlannerRecoveryHelp", {200, 207, 208, 300, 307, 308}),
        ("WouldASmootherRecoveryHelp", {500, 502, 503, 504}),
        ("WouldARouteRecoveryHelp", {400, 404, 405}),
    ],
)
def test_would_a_recovery_help(rig: NodeRig, node: str, codes: set[int]) -> None:
    tree, helped = rig.tree(f'<{node} error_code="{{code}}"/>'), set()
    for code in range(1000):
        tree.blackboard["code"] = code
        if rig.letters(tree, 1) == "S":
            helped.add(code)
    assert helped == codes
