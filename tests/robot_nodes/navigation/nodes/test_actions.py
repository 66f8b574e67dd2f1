"""Nav2's nodes with an action server: a test for each sentence of their documentation."""

import math
from dataclasses import replace
from typing import Any

import pytest

from btcore import Status, Tree
from btcore.clock import NS_PER_S
from btcore_navigation.action import GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.planner import Planner, PlannerServer
from btcore_navigation.servers import OBSTACLE_MEMORY_S
from btcore_robot.robot import Pose2D, Twist2D
from tests.robot_nodes.navigation.conftest import polyline_path, rig_on_floor
from tests.robot_nodes.navigation.nodes.conftest import NodeRig

AHEAD = Pose2D(2.0, 0.0, 0.0)
WALL = (1.0, -4.0, 1.4, 4.0)


def recoveries(tree: Tree) -> int:
    found = tree.blackboard.find("number_recoveries")
    return found.value if found is not None and found.value is not None else 0


# --- planning

PLAN = '<ComputePathToPose goal="{goal}" path="{path}" error_code_id="{code}" error_msg="{why}" %s/>'


def test_compute_path_runs_until_the_planner_has_answered(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % "", goal=AHEAD)
    assert tree.tick_exactly_once() is Status.RUNNING
    assert rig.run(tree, 1.0) is Status.SUCCESS
    path = tree.blackboard["path"]
    assert path.goal == AHEAD
    assert path[0].x == pytest.approx(0.0, abs=0.05)
    assert (tree.blackboard["code"], tree.blackboard["why"]) == (0, "")


def test_compute_path_clears_the_path_and_sets_the_error_when_it_fails(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % "", goal=Pose2D(4.99, 0.0, 0.0), path=polyline_path((0, 0), (1, 0)))
    assert rig.run(tree, 1.0) is Status.FAILURE
    assert len(tree.blackboard["path"]) == 0
    assert tree.blackboard["code"] == Nav2ErrorCode.GOAL_OCCUPIED
    assert tree.blackboard["why"]


def test_compute_path_clears_the_path_on_a_halt(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % "", goal=AHEAD, path=polyline_path((0, 0), (1, 0)))
    tree.tick_exactly_once()
    tree.halt()
    assert len(tree.blackboard["path"]) == 0
    rig.wait(0.2)
    assert not rig.compute_path.is_busy


def test_compute_path_fails_when_the_pose_is_unknown(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % "", goal=AHEAD)
    rig.localiser.is_confident = False
    assert rig.run(tree, 2.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.COMPUTE_PATH_TF_ERROR


def test_compute_path_waits_up_to_a_second_for_the_pose(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % "", goal=AHEAD)
    rig.localiser.is_confident = False
    assert rig.run(tree, 0.8) is Status.RUNNING
    rig.localiser.is_confident = True
    assert rig.run(tree, 0.3) is Status.SUCCESS
    assert len(tree.blackboard["path"])


def test_server_failure_is_logged_once_per_reason(rig: NodeRig, caplog: pytest.LogCaptureFixture) -> None:
    outside, other = Pose2D(99.0, 0.0, 0.0), Pose2D(98.0, 0.0, 0.0)
    tree = rig.tree(PLAN % "", goal=outside)
    for goal in (outside, outside, other):
        tree.blackboard["goal"] = goal
        assert rig.run(tree, 1.0) is Status.FAILURE
    assert [record.getMessage() for record in caplog.records] == [
        "ComputePathToPose::1: the goal (99.00, 0.00) is outside the map",
        "ComputePathToPose::1: the goal (98.00, 0.00) is outside the map",
    ]


def test_compute_path_fails_with_an_unknown_planner(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % 'planner_id="Other"', goal=AHEAD)
    assert rig.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.INVALID_PLANNER
    assert rig.run(rig.tree(PLAN % 'planner_id="GridBased"', goal=AHEAD), 1.0) is Status.SUCCESS


def test_an_unselected_plug_in_is_the_default_plug_in(rig: NodeRig) -> None:
    text = (
        '<Sequence><ComputePathToPose goal="{goal}" path="{path}" planner_id="{selected_planner}"/>'
        '<FollowPath path="{path}" controller_id="{selected_controller}"/></Sequence>'
    )
    tree = rig.tree(text, goal=AHEAD)
    assert rig.run(tree, 1.0) is Status.RUNNING
    assert len(tree.blackboard["path"])


@pytest.mark.parametrize(
    ("ports", "x"),
    [
        ('start="-2;0"', -2.0),
        ('start="-2;0" use_start="true"', -2.0),
        ('start="-2;0" use_start="false"', 0.0),
    ],
)
def test_compute_path_begins_at_start_unless_use_start_is_false(rig: NodeRig, ports: str, x: float) -> None:
    tree = rig.tree(PLAN % ports, goal=AHEAD)
    assert rig.run(tree, 1.0) is Status.SUCCESS
    assert tree.blackboard["path"][0].x == pytest.approx(x, abs=0.05)


def test_compute_path_passes_the_viapoints(rig: NodeRig) -> None:
    tree = rig.tree(PLAN % 'viapoints="{via}"', goal=AHEAD, via=[Pose2D(0.0, 2.0, 0.0)])
    assert rig.run(tree, 1.0) is Status.SUCCESS
    points = tree.blackboard["path"].points
    assert min(math.hypot(x, y - 2.0) for x, y in points) < 0.1


def test_compute_path_through_poses_passes_them_all(rig: NodeRig) -> None:
    tree = rig.tree(
        '<ComputePathThroughPoses goals="{goals}" path="{path}" last_reached_index="{last}"/>',
        goals=[Pose2D(2.0, 0.0, 0.0), Pose2D(2.0, 2.0, 0.0), Pose2D(0.0, 2.0, 0.0)],
    )
    assert rig.run(tree, 1.0) is Status.SUCCESS
    points = tree.blackboard["path"].points
    for goal in tree.blackboard["goals"]:
        assert min(math.hypot(x - goal.x, y - goal.y) for x, y in points) < 0.1
    assert tree.blackboard["last"] == -1


def test_compute_path_through_poses_has_its_own_error_codes(rig: NodeRig) -> None:
    text = '<ComputePathThroughPoses goals="{goals}" path="{path}" error_code_id="{code}"/>'
    tree = rig.tree(text, goals=[])
    assert rig.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.NO_VIAPOINTS_GIVEN
    tree = rig.tree(text, goals=[Pose2D(4.99, 0.0, 0.0)])
    assert rig.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.THROUGH_GOAL_OCCUPIED


# --- driving

FOLLOW = '<FollowPath path="{path}" error_code_id="{code}" tracking_feedback="{how}" %s/>'


def test_follow_path_drives_to_the_end(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "", path=polyline_path((0, 0), (1, 0)))
    assert rig.run(tree, 20.0) is Status.SUCCESS
    assert rig.robot.pose.x == pytest.approx(1.0, abs=0.26)
    assert tree.blackboard["code"] == 0


def test_follow_path_switches_to_another_path_at_once(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "", path=polyline_path((0, 0), (4, 0)))
    rig.run(tree, 3.0)
    first = rig.servers.follow_path.current
    tree.blackboard["path"] = polyline_path((0, 0), (4, 0), (4, 1))
    slowest = 1.0
    for _ in range(100):
        tree.tick_exactly_once()
        rig.wait(0.01)
        slowest = min(slowest, rig.robot.speed)
    assert first.status is GoalStatus.CANCELED
    assert rig.servers.follow_path.current.goal.path is tree.blackboard["path"]
    assert slowest == pytest.approx(0.3, abs=0.01)


def test_follow_path_keeps_goal_while_path_is_truncated(rig: NodeRig) -> None:
    tree = rig.tree(
        '<PipelineSequence><TruncatePath input_path="{path}" output_path="{cut}"/>'
        '<FollowPath path="{cut}"/></PipelineSequence>',
        path=polyline_path((0, 0), (4, 0)),
    )
    rig.letters(tree, 5)
    first, cut = rig.servers.follow_path.current, tree.blackboard["cut"]
    rig.letters(tree, 5)
    assert tree.blackboard["cut"] is not cut
    assert rig.servers.follow_path.current is first


def test_follow_path_keeps_old_path_if_new_path_is_empty(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "", path=polyline_path((0, 0), (4, 0)))
    rig.run(tree, 1.0)
    tree.blackboard["path"] = polyline_path((0, 0), (4, 0)).__class__(polyline_path((0, 0)).poses[:0], 0)
    rig.run(tree, 1.0)
    assert rig.servers.follow_path.current.status is GoalStatus.EXECUTING
    assert rig.robot.speed == pytest.approx(0.3, abs=0.01)


def test_follow_path_sends_goal_again_for_another_plug_in(rig: NodeRig) -> None:
    tree = rig.tree(
        FOLLOW % 'goal_checker_id="{checker}"', path=polyline_path((0, 0), (4, 0)), checker="goal_checker"
    )
    rig.run(tree, 0.5)
    tree.blackboard["checker"] = "general_goal_checker"
    rig.run(tree, 0.2)
    assert rig.servers.follow_path.current.goal.goal_checker_id == "general_goal_checker"


def test_follow_path_writes_feedback_and_resets_it_at_end(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "", path=polyline_path((0, 0.1), (1, 0.1)))
    rig.run(tree, 0.5)
    assert tree.blackboard["how"].position_error == pytest.approx(-0.1, abs=0.02)
    assert tree.blackboard["how"].distance_to_goal == pytest.approx(1.0, abs=0.1)
    rig.run(tree, 20.0)
    assert tree.blackboard["how"].distance_to_goal == 0.0


def test_follow_path_fails_without_a_path(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "")
    assert rig.run(tree, 1.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.INVALID_PATH


def test_a_halt_cancels_the_goal_and_stops_the_robot(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "", path=polyline_path((0, 0), (4, 0)))
    rig.run(tree, 2.0)
    tree.halt()
    rig.wait(1.0)
    assert rig.servers.follow_path.current.status is GoalStatus.CANCELED
    assert rig.robot.speed == pytest.approx(0.0, abs=0.01)


def test_goal_that_another_client_cancelled_is_success(rig: NodeRig) -> None:
    tree = rig.tree(FOLLOW % "", path=polyline_path((0, 0), (4, 0)))
    rig.run(tree, 1.0)
    rig.servers.follow_path.current.cancel()
    assert rig.run(tree, 1.0) is Status.SUCCESS


# --- recoveries


def test_spin_makes_a_quarter_turn_to_the_left(rig: NodeRig) -> None:
    tree = rig.tree("<Spin/>")
    assert rig.run(tree, 15.0) is Status.SUCCESS
    assert rig.robot.pose.yaw == pytest.approx(1.57, abs=0.1)
    assert recoveries(tree) == 1


def test_spin_is_not_counted_as_a_recovery_if_is_recovery_is_false(rig: NodeRig) -> None:
    tree = rig.tree('<Spin spin_dist="-0.3" is_recovery="false"/>')
    assert rig.run(tree, 15.0) is Status.SUCCESS
    assert rig.robot.pose.yaw == pytest.approx(-0.3, abs=0.1)
    assert recoveries(tree) == 0


def test_spin_fails_when_it_takes_too_long(rig: NodeRig) -> None:
    tree = rig.tree('<Spin spin_dist="3" time_allowance="1" error_code_id="{code}" error_msg="{why}"/>')
    assert rig.run(tree, 15.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.SPIN_TIMEOUT
    assert tree.blackboard["why"]


def test_back_up_accepts_a_positive_distance_and_speed(rig: NodeRig) -> None:
    rig.wait(0.3)
    tree = rig.tree('<BackUp backup_dist="0.2" backup_speed="0.1"/>')
    assert rig.run(tree, 10.0) is Status.SUCCESS
    assert rig.robot.pose.x == pytest.approx(-0.2, abs=0.03)
    assert recoveries(tree) == 1


def test_drive_on_heading_goes_straight_and_is_not_counted_as_a_recovery(rig: NodeRig) -> None:
    tree = rig.tree('<DriveOnHeading dist_to_travel="0.3" speed="0.1"/>')
    assert rig.run(tree, 10.0) is Status.SUCCESS
    assert rig.robot.pose.x == pytest.approx(0.3, abs=0.03)
    assert recoveries(tree) == 0


def test_drive_on_heading_fails_before_a_wall() -> None:
    rig = NodeRig(rig_on_floor(WALL))
    rig.wait(0.3)
    tree = rig.tree('<DriveOnHeading dist_to_travel="2" speed="0.2" error_code_id="{code}"/>')
    assert rig.run(tree, 20.0) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.DRIVE_ON_HEADING_COLLISION_AHEAD
    assert rig.robot.nearest > 0.0


def test_a_goal_that_the_server_does_not_accept_in_time_fails_and_is_cancelled(rig: NodeRig) -> None:
    # A server that is not on the schedule accepts no goal.
    server = rig.servers.compute_path = PlannerServer(Planner(rig.costmap), rig.localiser.pose)
    inside = '<ComputePathToPose goal="1;0;0" path="{path}" error_code_id="{code}" error_msg="{text}"/>'
    tree = rig.tree(inside)
    assert rig.run(tree, 5.0) is Status.FAILURE
    server.step(rig.robot.clock.now())
    assert server.current is None
    assert tree.blackboard["code"] == Nav2ErrorCode.SEND_GOAL_FAILURE
    assert tree.blackboard["text"] == "no server accepted the goal"


@pytest.mark.parametrize("seconds", ["2", "-2"])
def test_wait_ignores_the_sign_of_its_duration(rig: NodeRig, seconds: str) -> None:
    tree = rig.tree(f'<Wait wait_duration="{seconds}"/>')
    assert rig.run(tree, 1.8) is Status.RUNNING
    assert rig.run(tree, 0.5) is Status.SUCCESS
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
def test_a_cancel_node_cancels_the_goal_of_its_server(rig: NodeRig, node: str, server: str) -> None:
    rig.wait(0.2)
    work = {
        "follow_path": '<FollowPath path="{path}"/>',
        "spin": '<Spin spin_dist="3"/>',
        "back_up": '<BackUp backup_dist="1"/>',
        "drive_on_heading": '<DriveOnHeading dist_to_travel="1"/>',
        "wait": '<Wait wait_duration="9"/>',
    }[server]
    tree = rig.tree(work, path=polyline_path((0, 0), (3, 0)))
    assert rig.run(tree, 0.5) is Status.RUNNING
    assert rig.letters(rig.tree(f"<{node}/>"), 1) == "S"
    assert rig.run(tree, 0.5) is Status.SUCCESS
    assert getattr(rig.servers, server).current.status is GoalStatus.CANCELED


def test_cancelling_an_idle_server_is_a_success(rig: NodeRig) -> None:
    assert rig.letters(rig.tree("<CancelSpin/>"), 1) == "S"


# --- costmaps, localisation and selectors


def observe_scan(rig: NodeRig, age: float) -> None:
    """Add the laser's scan to both costmaps, in the global costmap as a scan of *age* (s)."""
    rig.wait(0.3)
    scan = replace(rig.robot.scan(), stamp=rig.robot.clock.now() - round(age * NS_PER_S))
    rig.costmap.observe(scan, rig.servers.transforms.lookup("map", scan.frame).to_pose())
    rig.costmap.update(rig.robot.clock.now(), rig.servers.pose())


@pytest.fixture
def boxed() -> NodeRig:
    rig = NodeRig(rig_on_floor((0.7, -0.3, 0.9, 0.3), (0.8, 1.2, 1.2, 1.4)))
    observe_scan(rig, OBSTACLE_MEMORY_S + 1.0)
    assert boxes_on(rig.costmap) == (True, True)
    assert boxes_on(rig.servers.local_costmap) == (True, True)
    return rig


def boxes_on(costmap: Any) -> tuple[bool, bool]:
    """Return whether *costmap* contains the box ahead, and the box to the left."""
    return costmap.cost(0.75, 0.0) >= 253, costmap.cost(0.9, 1.25) >= 253


@pytest.mark.parametrize(("name", "left"), [("global", "local"), ("local", "global")])
def test_clear_entire_costmap_removes_observed_obstacles(boxed: NodeRig, name: str, left: str) -> None:
    tree = boxed.tree(f'<ClearEntireCostmap service_name="{name}_costmap/clear_entirely_{name}_costmap"/>')
    assert boxed.letters(tree, 1) == "S"
    costmaps = {"global": boxed.costmap, "local": boxed.servers.local_costmap}
    assert boxes_on(costmaps[name]) == (False, False)
    assert boxes_on(costmaps[left]) == (True, True)
    assert recoveries(tree) == 1


def test_the_global_costmap_keeps_obstacles_that_were_observed_a_short_time_ago(boxed: NodeRig) -> None:
    observe_scan(boxed, OBSTACLE_MEMORY_S - 1.0)
    for node in (
        '<ClearEntireCostmap service_name="global"/>',
        '<ClearCostmapAroundRobot service_name="global" reset_distance="9"/>',
        '<ClearCostmapExceptRegion service_name="global" reset_distance="0.1"/>',
    ):
        assert boxed.letters(boxed.tree(node), 1) == "S"
        assert boxes_on(boxed.costmap) == (True, True)


def test_clear_entire_costmap_keeps_the_map(boxed: NodeRig) -> None:
    boxed.letters(boxed.tree('<ClearEntireCostmap service_name="global_costmap"/>'), 1)
    assert boxed.costmap.cost(4.99, 0.0) == 254


@pytest.mark.parametrize(
    ("node", "left"),
    [
        ('<ClearCostmapAroundRobot service_name="global" reset_distance="2"/>', (False, True)),
        ('<ClearCostmapExceptRegion service_name="global" reset_distance="2"/>', (True, False)),
        ('<ClearCostmapAroundPose service_name="global" pose="1;1.3" reset_distance="1"/>', (True, False)),
    ],
)
def test_parts_of_a_costmap_can_be_cleared(boxed: NodeRig, node: str, left: tuple[bool, bool]) -> None:
    tree = boxed.tree(node)
    assert boxed.letters(tree, 1) == "S"
    assert boxes_on(boxed.costmap) == left
    assert recoveries(tree) == 1


def test_reinitialize_global_localization_starts_a_search(rig: NodeRig) -> None:
    assert rig.letters(rig.tree("<ReinitializeGlobalLocalization/>"), 1) == "S"
    assert rig.localiser.searches == 1


def test_check_stop_status_runs_until_the_robot_has_stood_for_a_second(rig: NodeRig) -> None:
    tree = rig.tree("<CheckStopStatus/>")
    assert rig.letters(tree, 12, every=0.1) == "RRRRRRRRRRSS"


def test_check_stop_status_fails_while_the_robot_moves(rig: NodeRig) -> None:
    rig.robot.drive(0.3, 0.0)
    rig.wait(0.3)
    assert rig.robot.odometry().twist != Twist2D(0.0, 0.0)
    assert rig.letters(rig.tree("<CheckStopStatus/>"), 1) == "F"


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
def test_a_selector_uses_the_value_of_its_topic_or_the_default(rig: NodeRig, node: str, kind: str) -> None:
    assert rig.letters(rig.tree(f'<{node} selected_{kind}="{{it}}"/>'), 1) == "F"
    tree = rig.tree(f'<{node} default_{kind}="Usual" selected_{kind}="{{it}}"/>')
    assert rig.letters(tree, 1) == "S"
    assert tree.blackboard["it"] == "Usual"
    rig.servers.topics[f"{kind}_selector"] = "Other"
    assert rig.letters(tree, 1) == "S"
    assert tree.blackboard["it"] == "Other"
    required = rig.tree(f'<{node} topic_name="mine" selected_{kind}="{{it}}"/>')
    assert rig.letters(required, 1) == "F"
