"""Nav2's nodes on the servers of another process: results, failures, cancellations, and time-outs."""

import math
import subprocess
import sys
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest

from tests.ros2.conftest import LIMIT_S
from tests.ros2.nav2.conftest import ClientRig

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")

from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile
from tf2_msgs.msg import TFMessage

import btcore
from btcore import Registry, Status
from btcore_navigation.action import GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.leaves.navigate import Move
from btcore_navigation.nodes import action_node
from btcore_navigation.nodes.action_node import MIN_ACCEPTANCE_MS
from btcore_navigation.path import NavPath
from btcore_robot.robot import Pose2D, Robot
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.client import Nav2Client
from btcore_ros2.nav2.nodes import Route
from btcore_ros2.nav2.pose_listener import PoseListener
from btcore_ros2.session import RosSession

AHEAD, LEFT = Pose2D(2.0, 0.0, 0.0), Pose2D(2.0, 3.0, 1.0)
PATH = NavPath(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]), 0)
SPIN = '<Spin spin_dist="1.5" server_name="{}/spin" error_code_id="{{code}}" error_msg="{{why}}"/>'


@pytest.fixture
def short_limits(rig: ClientRig, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let the nodes wait for an answer as long as for users."""
    monkeypatch.setattr(action_node, "MIN_ACCEPTANCE_MS", MIN_ACCEPTANCE_MS)


# --- accepted goals: the server receives the ports, and the node writes the result


@pytest.mark.parametrize(
    ("leaf", "action", "expected"),
    [
        ('<Spin spin_dist="-0.5" time_allowance="3"/>', "spin", {"target_yaw": -0.5}),
        ('<BackUp backup_dist="0.5" backup_speed="0.25"/>', "backup", {"speed": 0.25}),
        ('<DriveOnHeading dist_to_travel="0.5" speed="0.25"/>', "drive_on_heading", {"speed": 0.25}),
        (
            '<AssistedTeleop time_allowance="2"/>',
            "assisted_teleop",
            {"time_allowance": {"sec": 2, "nanosec": 0}},
        ),
        ('<Wait wait_duration="1.5"/>', "wait", {"time": {"sec": 1, "nanosec": 500_000_000}}),
        (
            '<NavigateToPose goal="2;0" behavior_tree="a.xml"/>',
            "navigate_to_pose",
            {"behavior_tree": "a.xml"},
        ),
        ('<NavigateThroughPoses goals="2;0|2;3"/>', "navigate_through_poses", {"behavior_tree": ""}),
    ],
)
def test_server_receives_ports(rig: ClientRig, leaf: str, action: str, expected: dict[str, Any]) -> None:
    assert rig.run(rig.tree(leaf)) is Status.SUCCESS
    assert rig.session.wait_for(lambda: rig.received, LIMIT_S)
    name, goal = rig.received[0]
    assert name == action
    assert {key: goal[key] for key in expected} == expected


def test_compute_path_writes_the_path(rig: ClientRig) -> None:
    tree = rig.tree(
        '<ComputePathToPose goal="2;0" start="1;0" planner_id="Lattice"'
        ' path="{path}" error_code_id="{code}"/>'
    )
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["path"].goal == AHEAD
    assert tree.blackboard["path"].stamp > 0
    assert tree.blackboard["code"] == 0
    assert rig.session.wait_for(lambda: rig.received, LIMIT_S)
    _, goal = rig.received[0]
    assert (goal["planner_id"], goal["use_start"], goal["start"]["pose"]["position"]["x"]) == (
        "Lattice",
        True,
        1,
    )


def test_compute_path_through_poses_passes_all_goals(rig: ClientRig) -> None:
    tree = rig.tree('<ComputePathThroughPoses goals="{goals}" path="{path}"/>', goals=[AHEAD, LEFT])
    assert rig.run(tree) is Status.SUCCESS
    path = tree.blackboard["path"]
    assert [(pose.x, pose.y) for pose in (path[1], path[2])] == [(2, 0), (2, 3)]
    assert path[2].yaw == pytest.approx(1.0)


def test_smooth_path_writes_the_result(rig: ClientRig) -> None:
    tree = rig.tree(
        '<SmoothPath unsmoothed_path="{path}" smoothed_path="{out}" was_completed="{done}"/>', path=PATH
    )
    assert rig.run(tree) is Status.SUCCESS
    assert np.allclose(tree.blackboard["out"].poses, PATH.poses)
    assert tree.blackboard["done"] is True


def test_follow_path_writes_its_feedback_while_it_runs(rig: ClientRig) -> None:
    tree = rig.tree(
        '<FollowPath path="{path}" tracking_feedback="{how}" server_name="hang/follow_path"/>', path=PATH
    )
    find = tree.blackboard.find
    assert rig.run(tree, lambda: find("how") is not None and find("how").value) is Status.RUNNING
    assert tree.blackboard["how"].distance_to_goal == 1.5
    tree.halt()
    assert rig.session.wait_for(lambda: "hang/follow_path canceled" in rig.names(), LIMIT_S)


def test_follow_path_sends_a_changed_path_without_cancelling(rig: ClientRig) -> None:
    tree = rig.tree('<FollowPath path="{path}" server_name="hang/follow_path"/>', path=PATH)
    rig.run(tree, lambda: rig.names().count("hang/follow_path") == 1)
    tree.blackboard["path"] = NavPath(PATH.poses[:2], 1)
    assert rig.run(tree, lambda: rig.names().count("hang/follow_path") == 2) is Status.RUNNING
    assert rig.names() == ["hang/follow_path", "hang/follow_path"]
    tree.halt()
    # Plain rclpy servers work on both goals; a server of Nav2 would have ended the first.
    rig.client.cancel_goals("follow_path", "hang/follow_path")
    assert rig.session.wait_for(lambda: rig.names().count("hang/follow_path canceled") == 2, LIMIT_S)


# --- failures


def test_an_aborted_goal_is_a_failure_with_code_and_message(rig: ClientRig) -> None:
    tree = rig.tree(SPIN.format("abort"))
    assert rig.run(tree) is Status.FAILURE
    assert (tree.blackboard["code"], tree.blackboard["why"]) == (Nav2ErrorCode.SPIN_TF_ERROR, "no transform")


def test_compute_path_clears_the_path_when_it_is_aborted(rig: ClientRig) -> None:
    leaf = '<ComputePathToPose goal="2;0" path="{path}" server_name="abort/compute_path_to_pose"/>'
    tree = rig.tree(leaf, path=PATH)
    assert rig.run(tree) is Status.FAILURE
    assert len(tree.blackboard["path"]) == 0


def test_a_rejected_goal_is_a_failure(rig: ClientRig) -> None:
    tree = rig.tree(SPIN.format("reject"))
    assert rig.run(tree) is Status.FAILURE
    assert tree.blackboard["code"] == Nav2ErrorCode.GOAL_REJECTED
    assert tree.blackboard["why"] == "the action server 'reject/spin' rejected the goal"


@pytest.mark.usefixtures("short_limits")
def test_a_missing_server_is_a_failure_after_the_time_out(
    rig: ClientRig, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rig.client, "discovery_ns", 0)
    tree = rig.tree(SPIN.format("hagn"))
    began = rig.session.clock.now()
    assert rig.run(tree) is Status.FAILURE
    assert rig.session.clock.now() - began > 1_000_000_000
    assert tree.blackboard["code"] == Nav2ErrorCode.SEND_GOAL_FAILURE
    assert "no action server 'hagn/spin' (nav2_msgs/action/Spin): start it" in tree.blackboard["why"]
    assert "hagn/spin" in caplog.text
    assert rig.client.last_goals()["spin"].result.message == tree.blackboard["why"]


@pytest.mark.usefixtures("short_limits")
def test_a_server_that_accepts_too_late_is_told_to_cancel(rig: ClientRig) -> None:
    tree = rig.tree(SPIN.format("late"))
    assert rig.run(tree) is Status.FAILURE
    assert tree.blackboard["why"] == "the action server 'late/spin' did not answer the goal in time"
    assert rig.session.wait_for(lambda: "late/spin canceled" in rig.names(), LIMIT_S)


@pytest.mark.usefixtures("short_limits")
def test_server_timeout_is_respected_above_a_second(rig: ClientRig) -> None:
    tree = rig.tree('<Spin server_name="late/spin" server_timeout="60000"/>')
    end = rig.session.clock.now() + 1_300_000_000
    assert rig.run(tree, lambda: rig.session.clock.now() > end) is Status.RUNNING
    tree.halt()
    assert rig.session.wait_for(lambda: "late/spin canceled" in rig.names(), LIMIT_S)


def wait_server(name: str, execute: str) -> "subprocess.Popen[bytes]":
    """Start a process with a plain server of the action Wait, which executes a goal by the code *execute*."""
    code = f"""
import time, rclpy
from nav2_msgs.action import Wait
from rclpy.action import ActionServer
def execute(goal):
    {execute}
    return Wait.Result()
rclpy.init()
node = rclpy.create_node("wait_server")
server = ActionServer(node, Wait, "{name}", execute)
while not node.count_clients("{name}/_action/send_goal"):
    time.sleep(0.01)  # an answer to an unknown client is lost
rclpy.spin(node)
server.destroy()
node.destroy_node()
"""
    return subprocess.Popen([sys.executable, "-c", code], stderr=subprocess.DEVNULL)


@pytest.mark.parametrize(
    ("execute", "result", "reason"),
    [
        ("goal.succeed()", Status.SUCCESS, ""),
        ("rclpy.shutdown()", Status.FAILURE, " disappeared while it worked on the goal"),
    ],
    ids=["starts late", "ends"],
)
def test_a_server_starts_late_and_may_end_while_it_works(
    rig: ClientRig, execute: str, result: Status, reason: str
) -> None:
    name = f"{result.name.lower()}/wait"
    tree = rig.tree(f'<Wait server_name="{name}" server_timeout="120000" error_msg="{{why}}"/>')
    assert tree.tick_exactly_once() is Status.RUNNING
    with wait_server(name, execute) as process:
        try:
            assert rig.run(tree) is result
        finally:
            process.kill()
    assert tree.blackboard["why"] == (f"the action server '{name}'{reason}" if reason else "")


def test_the_time_for_the_discovery_of_a_server_is_a_parameter() -> None:
    with RosSession("long_timeout", arguments=["-p", "wait_for_service_timeout:=25000"]) as session:
        assert [Nav2Client(session).discovery_ns for _ in range(2)] == [25_000_000_000] * 2
        client = Nav2Client(session)
        handle = client.go_to(AHEAD)
        assert handle.discovery_ns > 20_000_000_000
        handle.cancel()
    wrong, message = (
        ["-p", "wait_for_service_timeout:=soon"],
        'timeout is "soon", and a whole number is expected',
    )
    with RosSession("wrong", arguments=wrong) as session, pytest.raises(RosError, match=message):
        Nav2Client(session)


def test_move_waits_for_the_discovery_of_the_navigator() -> None:
    nodes = Registry.standard()
    nodes.add(Move)
    move = '<Move goal="{goal}" error="{why}"/>'
    text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{move}</BehaviorTree></root>'
    with RosSession("alone", arguments=["-r", "__ns:=/nowhere"]) as session:
        client, robot = Nav2Client(session), Mock(spec=Robot, clock=session.clock)
        client.discovery_ns = 300_000_000
        tree = btcore.loads(text, nodes=nodes, resources=[client, robot], clock=session.clock)
        tree.blackboard["goal"] = AHEAD
        began = session.clock.now()
        assert tree.tick_while_running(period=0.01) is Status.FAILURE
        assert session.clock.now() - began >= 1_300_000_000
    assert tree.blackboard["why"].startswith("no action server 'navigate_to_pose'")


@pytest.mark.parametrize(("recovery", "result"), [("true", Status.FAILURE), ("false", Status.SUCCESS)])
def test_aborted_teleoperation_fails_only_as_recovery(rig: ClientRig, recovery: str, result: Status) -> None:
    ports = f'is_recovery="{recovery}" server_name="abort/assisted_teleop" error_code_id="{{code}}"'
    tree = rig.tree(f"<AssistedTeleop {ports}/>")
    assert rig.run(tree) is result
    assert tree.blackboard["code"] == 732


def test_action_of_another_release_is_failure(rig: ClientRig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr("nav2_msgs.action.ComputeRoute", raising=False)
    tree = rig.tree('<ComputeRoute goal="1;2" use_poses="true" route="{route}" error_msg="{why}"/>')
    assert rig.run(tree) is Status.FAILURE
    assert tree.blackboard["why"] == (
        "the installed nav2_msgs has no action/ComputeRoute: it belongs to another release"
    )
    assert tree.blackboard["route"] == Route()


def test_nodes_of_a_route_become_goals(rig: ClientRig) -> None:
    tree = rig.tree('<ExtractRouteNodesAsGoals route="{r}" goals="{goals}"/>', r=Route((AHEAD, LEFT)))
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["goals"] == [AHEAD, LEFT]


# --- cancellations


def test_a_halt_returns_at_once_and_cancels_the_goal(rig: ClientRig) -> None:
    tree = rig.tree(SPIN.format("hang"))
    rig.run(tree, lambda: rig.names() == ["hang/spin"])
    rig.wait(0.1)
    drains: list[None] = []
    end = rig.session.after_drain(lambda: drains.append(None))
    tree.halt()
    assert not drains  # it waited for nothing
    end()
    assert rig.session.wait_for(lambda: "hang/spin canceled" in rig.names(), LIMIT_S)


def test_a_goal_that_another_client_cancels_is_a_success(rig: ClientRig) -> None:
    tree = rig.tree(SPIN.format("hang"))
    rig.run(tree, lambda: rig.names() == ["hang/spin"])
    rig.wait(0.1)
    with RosSession("other") as session:
        other = Nav2Client(session)
        handle = other.cancel_goals("spin", "hang/spin")
        assert session.wait_for(lambda: handle.status is GoalStatus.SUCCEEDED, LIMIT_S)
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["code"] == 0


def test_a_cancel_node_ends_the_goals_of_its_server(rig: ClientRig) -> None:
    running = rig.tree(SPIN.format("hang"))
    rig.run(running, lambda: rig.names() == ["hang/spin"])
    rig.wait(0.1)
    assert rig.run(rig.tree('<CancelSpin server_name="hang/spin"/>')) is Status.SUCCESS
    assert rig.run(running) is Status.SUCCESS


def test_a_refused_cancellation_is_logged(rig: ClientRig, caplog: pytest.LogCaptureFixture) -> None:
    tree = rig.tree(SPIN.format("stubborn"))
    rig.run(tree, lambda: rig.names() == ["stubborn/spin"])
    rig.wait(0.1)
    tree.halt()
    assert rig.session.wait_for(lambda: "refused to cancel" in caplog.text, LIMIT_S)


# --- services


@pytest.mark.parametrize(
    ("leaf", "service", "expected"),
    [
        (
            '<ClearEntireCostmap service_name="local_costmap/clear_entirely_local_costmap"/>',
            "local_costmap/clear_entirely_local_costmap",
            {},
        ),
        (
            '<ClearCostmapAroundRobot reset_distance="3"'
            ' service_name="local_costmap/clear_around_local_costmap"/>',
            "local_costmap/clear_around_local_costmap",
            {"reset_distance": 3.0},
        ),
        (
            '<ClearCostmapExceptRegion reset_distance="3"'
            ' service_name="local_costmap/clear_except_local_costmap"/>',
            "local_costmap/clear_except_local_costmap",
            {"reset_distance": 3.0},
        ),
        ("<ReinitializeGlobalLocalization/>", "reinitialize_global_localization", {}),
    ],
)
def test_service_receives_request(rig: ClientRig, leaf: str, service: str, expected: dict[str, Any]) -> None:
    tree = rig.tree(leaf)
    assert rig.run(tree) is Status.SUCCESS
    assert rig.session.wait_for(lambda: rig.received, LIMIT_S)
    name, request = rig.received[0]
    assert name == service
    assert {key: request[key] for key in expected} == expected


def test_clearing_counts_as_a_recovery_once(rig: ClientRig) -> None:
    tree = rig.tree('<ClearEntireCostmap service_name="local_costmap/clear_entirely_local_costmap"/>')
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["number_recoveries"] == 1


@pytest.mark.parametrize("node", ["IsPathValid", "ValidatePath"])
@pytest.mark.parametrize(("length", "result"), [(2, Status.SUCCESS), (3, Status.FAILURE)])
def test_a_path_is_checked(rig: ClientRig, node: str, length: int, result: Status) -> None:
    tree = rig.tree(f'<{node} path="{{path}}" max_cost="200"/>', path=NavPath(PATH.poses[:length], 0))
    assert rig.run(tree) is result
    assert rig.session.wait_for(lambda: rig.received, LIMIT_S)
    assert rig.received[0][1]["max_cost"] == 200


def test_validate_path_writes_the_poses_in_collision(rig: ClientRig) -> None:
    tree = rig.tree('<ValidatePath path="{path}" collision_poses="{hits}"/>', path=PATH)
    assert rig.run(tree) is Status.FAILURE
    assert tree.blackboard["hits"] == [Pose2D(1.0, 0.0, 0.0)]


def test_goals_in_collision_are_removed(rig: ClientRig) -> None:
    goals = [AHEAD, LEFT, Pose2D(9.0, 9.0, 0.0)]
    tree = rig.tree('<RemoveInCollisionGoals input_goals="{goals}" output_goals="{left}"/>', goals=goals)
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["left"] == goals[:2]


def test_a_service_that_reports_a_failure_is_a_failure(rig: ClientRig) -> None:
    tree = rig.tree('<RemoveInCollisionGoals input_goals="" output_goals="{left}"/>')
    assert rig.run(tree) is Status.FAILURE
    assert tree.blackboard["left"] == []


@pytest.mark.usefixtures("short_limits")
@pytest.mark.parametrize(
    ("service", "message"),
    [
        ("late/clear", "the service 'late/clear' did not answer in time"),
        ("no/clear", "no service 'no/clear' (nav2_msgs/srv/ClearEntireCostmap)"),
        ("", "ClearEntireCostmap has no default name: set the port service_name"),
    ],
)
def test_a_service_that_does_not_answer_is_a_failure(
    rig: ClientRig,
    caplog: pytest.LogCaptureFixture,
    monkeypatch: pytest.MonkeyPatch,
    service: str,
    message: str,
) -> None:
    monkeypatch.setattr(rig.client, "discovery_ns", 0)
    assert rig.run(rig.tree(f'<ClearEntireCostmap service_name="{service}"/>')) is Status.FAILURE
    assert message in caplog.text


def test_a_service_of_another_release_is_a_failure(
    rig: ClientRig, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delattr("nav2_msgs.srv.ClearCostmapAroundPose", raising=False)
    tree = rig.tree('<ClearCostmapAroundPose pose="1;2" service_name="global_costmap/clear_around_pose"/>')
    assert rig.run(tree) is Status.FAILURE
    assert "no srv/ClearCostmapAroundPose: it belongs to another release" in caplog.text


# --- pose, odometry, battery and topics


def test_the_pose_comes_from_tf(rig: ClientRig) -> None:
    pose = rig.client.pose()
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((1.0, 2.0, math.pi / 2))
    assert rig.run(rig.tree('<TransformAvailable parent="map" child="base_link"/>')) is Status.SUCCESS
    assert rig.run(rig.tree('<GoalReached goal="1.1;2"/>')) is Status.SUCCESS
    assert rig.run(rig.tree('<GoalReached goal="2;2"/>')) is Status.FAILURE


def test_the_pose_is_new_after_a_jump_of_the_clock() -> None:
    def transform(second: int, x: float, child: str = "base_footprint", parent: str = "odom"):
        frame = TransformStamped(child_frame_id=child)
        frame.header.frame_id, frame.header.stamp.sec = parent, second
        frame.transform.translation.x = x
        return frame

    own_topics = ["-r", "/tf:=/reset_tf", "-r", "/tf_static:=/reset_tf_static"]
    with RosSession("listener", arguments=own_topics) as session:
        publisher = session.node.create_publisher(TFMessage, "/tf", 100)
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        static = session.node.create_publisher(TFMessage, "/tf_static", latched)
        static.publish(TFMessage(transforms=[transform(0, 10.0, "odom", "map")]))
        listener = PoseListener(session)

        def is_at(x: float, *frames):
            publisher.publish(TFMessage(transforms=frames))
            return session.wait_for(lambda: listener.pose() == Pose2D(x, 0.0, 0.0), LIMIT_S)

        assert session.wait_for(publisher.get_subscription_count, LIMIT_S)
        assert is_at(11.0, transform(100, 1.0))
        assert is_at(12.0, transform(101, 2.0), transform(100, 1.0))  # the second is late
        assert is_at(15.0, transform(3, 5.0))


def test_a_selector_reads_its_latched_topic(rig: ClientRig) -> None:
    tree = rig.tree(
        '<PlannerSelector topic_name="planner_selector" default_planner="Grid" selected_planner="{planner}"/>'
    )
    assert rig.session.wait_for(lambda: rig.client.latest("planner_selector", str), LIMIT_S)
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["planner"] == "Lattice"


def test_the_goal_updater_reads_its_topic(rig: ClientRig) -> None:
    tree = rig.tree(
        '<GoalUpdater input_goal="{goal}" output_goal="{moved}"><AlwaysSuccess/></GoalUpdater>', goal=AHEAD
    )
    assert rig.session.wait_for(lambda: rig.client.latest("goal_update", Pose2D), LIMIT_S)
    assert rig.run(tree) is Status.SUCCESS
    assert tree.blackboard["moved"] == Pose2D(7.0, 0.0, 0.0)


def test_the_battery_is_read(rig: ClientRig) -> None:
    rig.client.battery("/battery_status")
    assert rig.session.wait_for(lambda: rig.client.battery("/battery_status"), LIMIT_S)
    for leaf, result in (
        ('<IsBatteryLow min_battery="0.3"/>', Status.SUCCESS),
        ('<IsBatteryLow min_battery="0.2"/>', Status.FAILURE),
        ('<IsBatteryLow min_battery="25" is_voltage="true"/>', Status.SUCCESS),
        ("<IsBatteryCharging/>", Status.SUCCESS),
    ):
        assert rig.run(rig.tree(leaf)) is result


def test_a_moving_robot_has_not_stopped(rig: ClientRig) -> None:
    assert rig.run(rig.tree('<CheckStopStatus velocity_threshold="0.1"/>')) is Status.FAILURE
    assert rig.client.odometry().twist.v == 0.5
