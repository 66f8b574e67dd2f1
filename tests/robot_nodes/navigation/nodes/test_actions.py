"""Nav2's nodes with an action server: a test for each sentence of their documentation."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from btcore import Status, Tree
from btcore.clock import NS_PER_S
from btcore_navigation.action import GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.path import NavPath
from btcore_navigation.planner import Planner, PlannerServer
from btcore_navigation.servers import OBSTACLE_MEMORY
from btcore_robot.robot import Pose2D, Twist2D
from tests.robot_nodes.navigation.nodes.conftest import Bench

AHEAD = Pose2D(2.0, 0.0, 0.0)
WALL = (1.0, -4.0, 1.4, 4.0)


def recoveries(tree: Tree) -> int:
    found = tree.blackboard.find("number_recoveries")
    return found.value if found is not None and found.value is not None else 0


# --- planning

PLAN = '<ComputePathToPose goal="{goal}" path="{path}" error_code_id="{code}" error_msg="{why}" %s/>'


def test_compute_path_runs_until_the_planner_has_answered(bench: Bench) -> None:
    tree = bench.tree(PLAN % "", goal=AHEAD)
    assert tree.tick_exactly_once() is Status.RUNNING
    assert bench.run(tree, 1.0) is Status.SUCCESS
    path = tree.blackboard["path"]
    assert path.goal == AHEAD
    assert path[0].x == pytest.approx(0.0, abs=0.05)
    assert (tree.blackboard["code"], tree.blackboard["why"]) == (0, "")


def test_compute_path_clears_the_path_and_sets_the_error_when_it_fails(
    bench: Bench, path: Callable[..., NavPath]
) -> None:
    tree = bench.tree(PLAN % "", goal=Pose2D(4.99, 0.0, 0.0), path=path((0, 0), (1, 0)))
    assert bench.run(tree, 1.0) is Status.FAILURE
    assert len(tree.blackboard["path"]) == 0
    assert tree.blackboard["code"] == Nav2ErrorCode.GOAL_OCCUPIED
    assert tree.blackboard["why"]


def test_compute_path_clears_the_path_on_a_halt(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(PLAN % "", goal=AHEAD, path=path((0, 0), (1, 0)))
    tree.tick_exactly_once()
    tree.halt()
    assert len(tree.blackboard["path"]) == 0
    bench.wait(0.2)
    assert not bench.compute_path.busy


def test_compute_path_fails_when_the_pose_is_unknown(bench: Bench) -> None:
    tree = bench.tree(PLAN % "", goal=AHEAD)
    bench.localiser.confident = False
    assert bench.run(tree, 2.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.COMPUTE_PATH_TF_ERROR


def test_compute_path_waits_up_to_a_second_for_the_pose(bench: Bench) -> None:
    tree = bench.tree(PLAN % "", goal=AHEAD)
    bench.localiser.confident = False
    assert bench.run(tree, 0.8) is Status.RUNNING
    bench.localiser.confident = True
    assert bench.run(tree, 0.3) is Status.SUCCESS
    assert len(tree.blackboard["path"])


def test_server_failure_is_logged_once_per_reason(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    outside, other = Pose2D(99.0, 0.0, 0.0), Pose2D(98.0, 0.0, 0.0)
    tree = bench.tree(PLAN % "", goal=outside)
    for goal in (outside, outside, other):
        tree.blackboard["goal"] = goal
        assert bench.run(tree, 1.0) is Status.FAILURE
    assert [one.getMessage() for one in caplog.records] == [
        "ComputePathToPose::1: the goal (99.00, 0.00) is outside the map",
        "ComputePathToPose::1: the goal (98.00, 0.00) is outside the map",
    ]


def test_compute_path_fails_with_an_unknown_planner(bench: Bench) -> None:
    tree = bench.tree(PLAN % 'planner_id="Other"', goal=AHEAD)
    assert bench.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.INVALID_PLANNER
    assert bench.run(bench.tree(PLAN % 'planner_id="GridBased"', goal=AHEAD), 1.0) is Status.SUCCESS


def test_an_unselected_plug_in_is_the_default_plug_in(bench: Bench) -> None:
    text = (
        '<Sequence><ComputePathToPose goal="{goal}" path="{path}" planner_id="{selected_planner}"/>'
        '<FollowPath path="{path}" controller_id="{selected_controller}"/></Sequence>'
    )
    tree = bench.tree(text, goal=AHEAD)
    assert bench.run(tree, 1.0) is Status.RUNNING
    assert len(tree.blackboard["path"])


@pytest.mark.parametrize(
    ("ports", "x"),
    [
        ('start="-2;0"', -2.0),
        ('start="-2;0" use_start="true"', -2.0),
        ('start="-2;0" use_start="false"', 0.0),
    ],
)
def test_compute_path_begins_at_start_unless_use_start_is_false(bench: Bench, ports: str, x: float) -> None:
    tree = bench.tree(PLAN % ports, goal=AHEAD)
    assert bench.run(tree, 1.0) is Status.SUCCESS
    assert tree.blackboard["path"][0].x == pytest.approx(x, abs=0.05)


def test_compute_path_passes_the_viapoints(bench: Bench) -> None:
    tree = bench.tree(PLAN % 'viapoints="{via}"', goal=AHEAD, via=[Pose2D(0.0, 2.0, 0.0)])
    assert bench.run(tree, 1.0) is Status.SUCCESS
    points = tree.blackboard["path"].points
    assert min(math.hypot(x, y - 2.0) for x, y in points) < 0.1


def test_compute_path_through_poses_passes_them_all(bench: Bench) -> None:
    tree = bench.tree(
        '<ComputePathThroughPoses goals="{goals}" path="{path}" last_reached_index="{last}"/>',
        goals=[Pose2D(2.0, 0.0, 0.0), Pose2D(2.0, 2.0, 0.0), Pose2D(0.0, 2.0, 0.0)],
    )
    assert bench.run(tree, 1.0) is Status.SUCCESS
    points = tree.blackboard["path"].points
    for goal in tree.blackboard["goals"]:
        assert min(math.hypot(x - goal.x, y - goal.y) for x, y in points) < 0.1
    assert tree.blackboard["last"] == -1


def test_compute_path_through_poses_has_its_own_error_codes(bench: Bench) -> None:
    text = '<ComputePathThroughPoses goals="{goals}" path="{path}" error_code_id="{code}"/>'
    tree = bench.tree(text, goals=[])
    assert bench.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.NO_VIAPOINTS_GIVEN
    tree = bench.tree(text, goals=[Pose2D(4.99, 0.0, 0.0)])
    assert bench.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.THROUGH_GOAL_OCCUPIED


# --- driving

FOLLOW = '<FollowPath path="{path}" error_code_id="{code}" tracking_feedback="{how}" %s/>'


def test_follow_path_drives_to_the_end(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(FOLLOW % "", path=path((0, 0), (1, 0)))
    assert bench.run(tree, 20.0) is Status.SUCCESS
    assert bench.robot.pose.x == pytest.approx(1.0, abs=0.26)
    assert tree.blackboard["code"] == 0


def test_follow_path_switches_to_another_path_without_a_stop(
    bench: Bench, path: Callable[..., NavPath]
) -> None:
    tree = bench.tree(FOLLOW % "", path=path((0, 0), (4, 0)))
    bench.run(tree, 3.0)
    first = bench.servers.follow_path.current
    tree.blackboard["path"] = path((0, 0), (4, 0), (4, 1))
    slowest = 1.0
    for _ in range(100):
        tree.tick_exactly_once()
        bench.wait(0.01)
        slowest = min(slowest, bench.robot.speed)
    assert first.status is GoalStatus.CANCELED
    assert bench.servers.follow_path.current.goal.path is tree.blackboard["path"]
    assert slowest == pytest.approx(0.3, abs=0.01)


def test_follow_path_keeps_its_goal_while_the_same_path_is_truncated_again(
    bench: Bench, path: Callable[..., NavPath]
) -> None:
    tree = bench.tree(
        '<PipelineSequence><TruncatePath input_path="{path}" output_path="{cut}"/>'
        '<FollowPath path="{cut}"/></PipelineSequence>',
        path=path((0, 0), (4, 0)),
    )
    bench.letters(tree, 5)
    first, cut = bench.servers.follow_path.current, tree.blackboard["cut"]
    bench.letters(tree, 5)
    assert tree.blackboard["cut"] is not cut
    assert bench.servers.follow_path.current is first


def test_follow_path_keeps_old_path_if_new_path_is_empty(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(FOLLOW % "", path=path((0, 0), (4, 0)))
    bench.run(tree, 1.0)
    tree.blackboard["path"] = path((0, 0), (4, 0)).__class__(path((0, 0)).poses[:0], 0)
    bench.run(tree, 1.0)
    assert bench.servers.follow_path.current.status is GoalStatus.EXECUTING
    assert bench.robot.speed == pytest.approx(0.3, abs=0.01)


def test_follow_path_sends_goal_again_for_another_plug_in(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(
        FOLLOW % 'goal_checker_id="{checker}"', path=path((0, 0), (4, 0)), checker="goal_checker"
    )
    bench.run(tree, 0.5)
    tree.blackboard["checker"] = "general_goal_checker"
    bench.run(tree, 0.2)
    assert bench.servers.follow_path.current.goal.goal_checker_id == "general_goal_checker"


def test_follow_path_writes_feedback_and_resets_it_at_end(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(FOLLOW % "", path=path((0, 0.1), (1, 0.1)))
    bench.run(tree, 0.5)
    assert tree.blackboard["how"].position_error == pytest.approx(-0.1, abs=0.02)
    assert tree.blackboard["how"].distance_to_goal == pytest.approx(1.0, abs=0.1)
    bench.run(tree, 20.0)
    assert tree.blackboard["how"].distance_to_goal == 0.0


def test_follow_path_fails_without_a_path(bench: Bench) -> None:
    tree = bench.tree(FOLLOW % "")
    assert bench.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.INVALID_PATH


def test_a_halt_cancels_the_goal_and_stops_the_robot(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(FOLLOW % "", path=path((0, 0), (4, 0)))
    bench.run(tree, 2.0)
    tree.halt()
    bench.wait(1.0)
    assert bench.servers.follow_path.current.status is GoalStatus.CANCELED
    assert bench.robot.speed == pytest.approx(0.0, abs=0.01)


def test_goal_that_another_client_cancelled_is_success(bench: Bench, path: Callable[..., NavPath]) -> None:
    tree = bench.tree(FOLLOW % "", path=path((0, 0), (4, 0)))
    bench.run(tree, 1.0)
    bench.servers.follow_path.current.cancel()
    assert bench.run(tree, 1.0) is Status.SUCCESS


# --- recoveries


def test_spin_makes_a_quarter_turn_to_the_left(bench: Bench) -> None:
    tree = bench.tree("<Spin/>")
    assert bench.run(tree, 15.0) is Status.SUCCESS
    assert bench.robot.pose.yaw == pytest.approx(1.57, abs=0.1)
    assert recoveries(tree) == 1


def test_spin_is_not_counted_as_a_recovery_if_is_recovery_is_false(bench: Bench) -> None:
    tree = bench.tree('<Spin spin_dist="-0.3" is_recovery="false"/>')
    assert bench.run(tree, 15.0) is Status.SUCCESS
    assert bench.robot.pose.yaw == pytest.approx(-0.3, abs=0.1)
    assert recoveries(tree) == 0


def test_spin_fails_when_it_takes_too_long(bench: Bench) -> None:
    tree = bench.tree('<Spin spin_dist="3" time_allowance="1" error_code_id="{code}" error_msg="{why}"/>')
    assert bench.run(tree, 15.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.SPIN_TIMEOUT
    assert tree.blackboard["why"]


def test_back_up_accepts_a_positive_distance_and_speed(bench: Bench) -> None:
    bench.wait(0.3)
    tree = bench.tree('<BackUp backup_dist="0.2" backup_speed="0.1"/>')
    assert bench.run(tree, 10.0) is Status.SUCCESS
    assert bench.robot.pose.x == pytest.approx(-0.2, abs=0.03)
    assert recoveries(tree) == 1


def test_drive_on_heading_goes_straight_and_is_not_counted_as_a_recovery(bench: Bench) -> None:
    tree = bench.tree('<DriveOnHeading dist_to_travel="0.3" speed="0.1"/>')
    assert bench.run(tree, 10.0) is Status.SUCCESS
    assert bench.robot.pose.x == pytest.approx(0.3, abs=0.03)
    assert recoveries(tree) == 0


def test_drive_on_heading_fails_before_a_wall(among: Callable[..., Bench]) -> None:
    bench = among(WALL)
    bench.wait(0.3)
    tree = bench.tree('<DriveOnHeading dist_to_travel="2" speed="0.2" error_code_id="{code}"/>')
    assert bench.run(tree, 20.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.DRIVE_ON_HEADING_COLLISION_AHEAD
    assert bench.robot.nearest > 0.0


def test_a_goal_that_the_server_does_not_accept_in_time_fails_and_is_cancelled(bench: Bench) -> None:
    # A server that is not on the schedule accepts no goal.
    server = bench.servers.compute_path = PlannerServer(Planner(bench.costmap), bench.localiser.pose)
    inside = '<ComputePathToPose goal="1;0;0" path="{path}" error_code_id="{code}" error_msg="{text}"/>'
    tree = bench.tree(inside)
    assert bench.run(tree, 5.0) is Status.FAILURE
    server.step(bench.robot.clock.now())
    assert server.current is None
    assert tree.blackboard["code"] == Nav2ErrorCode.SEND_GOAL_FAILURE
    assert tree.blackboard["text"] == "no server accepted the goal"


@pytest.mark.parametrize("seconds", ["2", "-2"])
def test_wait_ignores_the_sign_of_its_duration(bench: Bench, seconds: str) -> None:
    tree = bench.tree(f'<Wait wait_duration="{seconds}"/>')
    assert bench.run(tree, 1.8) is Status.RUNNING
    assert bench.run(tree, 0.5) is Status.SUCCESS
    assert recoveries(tree) == 1


@pytest.mark.parametrize(
    ("node", "server"),
    [
        ("CancelControl", "follow_path"),
        ("CancelSpin", "spin"),
        ("CancelBackUp", "back_up"),
        ("CancelDriveOnHeading", "drive_on_heading"),
        ("CancelWait", "wait"),
    ],
)
def test_a_cancel_node_cancels_the_goal_of_its_server(
    bench: Bench, path: Callable[..., NavPath], node: str, server: str
) -> None:
    bench.wait(0.2)
    work = {
        "follow_path": '<FollowPath path="{path}"/>',
        "spin": '<Spin spin_dist="3"/>',
        "back_up": '<BackUp backup_dist="1"/>',
        "drive_on_heading": '<DriveOnHeading dist_to_travel="1"/>',
        "wait": '<Wait wait_duration="9"/>',
    }[server]
    tree = bench.tree(work, path=path((0, 0), (3, 0)))
    assert bench.run(tree, 0.5) is Status.RUNNING
    assert bench.letters(bench.tree(f"<{node}/>"), 1) == "S"
    assert bench.run(tree, 0.5) is Status.SUCCESS
    assert getattr(bench.servers, server).current.status is GoalStatus.CANCELED


def test_cancelling_an_idle_server_is_a_success(bench: Bench) -> None:
    assert bench.letters(bench.tree("<CancelSpin/>"), 1) == "S"


# --- costmaps, localisation and selectors


def observe_scan(bench: Bench, age: float) -> None:
    """Add the laser's scan to both costmaps, in the global costmap as a scan of *age* (s)."""
    bench.wait(0.3)
    scan = replace(bench.robot.scan(), stamp=bench.robot.clock.now() - round(age * NS_PER_S))
    bench.costmap.observe(scan, bench.servers.transforms.lookup("map", scan.frame).to_pose())
    bench.costmap.update(bench.robot.clock.now(), bench.servers.pose())


@pytest.fixture
def seen(among: Callable[..., Bench]) -> None:
    bench = among((0.7, -0.3, 0.9, 0.3), (0.8, 1.2, 1.2, 1.4))
    observe_scan(bench, OBSTACLE_MEMORY + 1.0)
    assert boxes_on(bench.costmap) == (True, True)
    assert boxes_on(bench.servers.local_costmap) == (True, True)
    return bench


def boxes_on(costmap: Any) -> tuple[bool, bool]:
    """Return whether *costmap* contains the box ahead, and the box to the left."""
    return costmap.cost(0.75, 0.0) >= 253, costmap.cost(0.9, 1.25) >= 253


@pytest.mark.parametrize(("name", "left"), [("global", "local"), ("local", "global")])
def test_clear_entire_costmap_removes_observed_obstacles(seen: Bench, name: str, left: str) -> None:
    tree = seen.tree(f'<ClearEntireCostmap service_name="{name}_costmap/clear_entirely_{name}_costmap"/>')
    assert seen.letters(tree, 1) == "S"
    costmaps = {"global": seen.costmap, "local": seen.servers.local_costmap}
    assert boxes_on(costmaps[name]) == (False, False)
    assert boxes_on(costmaps[left]) == (True, True)
    assert recoveries(tree) == 1


def test_the_global_costmap_keeps_obstacles_that_were_observed_a_short_time_ago(seen: Bench) -> None:
    observe_scan(seen, OBSTACLE_MEMORY - 1.0)
    for node in (
        '<ClearEntireCostmap service_name="global"/>',
        '<ClearCostmapAroundRobot service_name="global" reset_distance="9"/>',
        '<ClearCostmapExceptRegion service_name="global" reset_distance="0.1"/>',
    ):
        assert seen.letters(seen.tree(node), 1) == "S"
        assert boxes_on(seen.costmap) == (True, True)


def test_clear_entire_costmap_keeps_the_map(seen: Bench) -> None:
    seen.letters(seen.tree('<ClearEntireCostmap service_name="global_costmap"/>'), 1)
    assert seen.costmap.cost(4.99, 0.0) == 254


@pytest.mark.parametrize(
    ("node", "left"),
    [
        ('<ClearCostmapAroundRobot service_name="global" reset_distance="2"/>', (False, True)),
        ('<ClearCostmapExceptRegion service_name="global" reset_distance="2"/>', (True, False)),
        ('<ClearCostmapAroundPose service_name="global" pose="1;1.3" reset_distance="1"/>', (True, False)),
    ],
)
def test_parts_of_a_costmap_can_be_cleared(seen: Bench, node: str, left: tuple[bool, bool]) -> None:
    tree = seen.tree(node)
    assert seen.letters(tree, 1) == "S"
    assert boxes_on(seen.costmap) == left
    assert recoveries(tree) == 1


def test_reinitialize_global_localization_starts_a_search(bench: Bench) -> None:
    assert bench.letters(bench.tree("<ReinitializeGlobalLocalization/>"), 1) == "S"
    assert bench.localiser.searches == 1


def test_check_stop_status_runs_until_the_robot_has_stood_for_a_second(bench: Bench) -> None:
    tree = bench.tree("<CheckStopStatus/>")
    assert bench.letters(tree, 12, every=0.1) == "RRRRRRRRRRSS"


def test_check_stop_status_fails_while_the_robot_moves(bench: Bench) -> None:
    bench.robot.drive(0.3, 0.0)
    bench.wait(0.3)
    assert bench.robot.odometry().twist != Twist2D(0.0, 0.0)
    assert bench.letters(bench.tree("<CheckStopStatus/>"), 1) == "F"


@pytest.mark.parametrize(
    ("node", "kind"),
    [
        ("PlannerSelector", "planner"),
        ("ControllerSelector", "controller"),
        ("SmootherSelector", "smoother"),
        ("GoalCheckerSelector", "goal_checker"),
        ("ProgressCheckerSelector", "progress_checker"),
        ("PathHandlerSelector", "path_handler"),
    ],
)
def test_a_selector_uses_the_value_of_its_topic_or_the_default(bench: Bench, node: str, kind: str) -> None:
    assert bench.letters(bench.tree(f'<{node} selected_{kind}="{{it}}"/>'), 1) == "F"
    tree = bench.tree(f'<{node} default_{kind}="Usual" selected_{kind}="{{it}}"/>')
    assert bench.letters(tree, 1) == "S"
    assert tree.blackboard["it"] == "Usual"
    bench.servers.topics[f"{kind}_selector"] = "Other"
    assert bench.letters(tree, 1) == "S"
    assert tree.blackboard["it"] == "Other"
    required = bench.tree(f'<{node} topic_name="mine" selected_{kind}="{{it}}"/>')
    assert bench.letters(required, 1) == "F"
