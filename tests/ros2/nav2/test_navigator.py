"""`btcore ros2 navigator` serves Nav2's actions to a plain rclpy client, with servers in a third process."""

import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("tf2_msgs")

from geometry_msgs.msg import PoseStamped, TransformStamped
from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from rclpy.action import ActionClient
from tf2_msgs.msg import TFMessage

from btcore import Status
from btcore.clock import NS_PER_S
from btcore_monitor.events import TreeEvent
from btcore_monitor.watch.feed import Feed
from btcore_navigation.action import GoalStatus
from btcore_robot.robot import Pose2D
from btcore_ros2.nav2 import navigator_server
from btcore_ros2.nav2.conversions import pose_to_stamped, poses_to_goals
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known
from tests.ros2.nav2.conftest import LONG_TIMEOUTS

PLAIN_NAV2 = ("--without-navigator",)

DRIVE = """
<root BTCPP_format="4" main_tree_to_execute="Drive">
  <BehaviorTree ID="Drive">
    <PipelineSequence>
      <GoalUpdatedController>
        <ComputePathToPose goal="{goal}" path="{path}" server_timeout="60000"/>
      </GoalUpdatedController>
      <FollowPath path="{path}" server_name="hang/follow_path" server_timeout="60000"/>
    </PipelineSequence>
  </BehaviorTree>
</root>
"""
FAIL = """
<root BTCPP_format="4">
  <BehaviorTree ID="Fail">
    <Sequence>
      <ComputePathToPose goal="{goal}" path="{path}" server_timeout="60000"/>
      <FollowPath path="{path}" server_name="abort/follow_path" server_timeout="60000"/>
    </Sequence>
  </BehaviorTree>
</root>
"""
BROKEN = '<root BTCPP_format="4"><BehaviorTree ID="B"><Script code="a := missing + 1"/></BehaviorTree></root>'


@pytest.fixture(scope="module")
def navigator(shared_rig: Any) -> Iterator[subprocess.Popen[str]]:
    """The process of the navigator."""
    command = [sys.executable, "-c", LONG_TIMEOUTS, "ros2", "navigator", "--ros-args", "-r spare:=other"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    with process:
        yield process
        if process.poll() is None:
            process.send_signal(signal.SIGINT)


class Client:
    """A plain rclpy client of both actions."""

    def __init__(self, rig: Any) -> None:
        self.rig = rig
        self.to_pose = ActionClient(rig.session.node, NavigateToPose, "navigate_to_pose")
        self.through_poses = ActionClient(rig.session.node, NavigateThroughPoses, "navigate_through_poses")
        self.feedback: list[Any] = []
        assert rig.session.wait_for(
            lambda: self.to_pose.server_is_ready() and self.through_poses.server_is_ready(), LIMIT_S
        )
        wait_until_known(rig.session, "navigate_to_pose")

    def send(self, x: float, tree: Any = "") -> Any:
        """Send a goal to (x, 0), and return its handle."""
        goal = NavigateToPose.Goal(pose=pose_to_stamped(Pose2D(x, 0.0, 0.0)), behavior_tree=str(tree))
        return self.wait(self.to_pose.send_goal_async(goal, self.take))

    def take(self, message: Any) -> None:
        """Store feedback."""
        self.feedback.append(message.feedback)

    def wait(self, future: Any) -> Any:
        """Return the result of a future."""
        assert self.rig.session.wait_for(future.done, LIMIT_S)
        return future.result()

    def result(self, handle: Any) -> tuple[GoalStatus, Any]:
        """Wait for the result of a goal."""
        answer = self.wait(handle.get_result_async())
        return GoalStatus(answer.status), answer.result

    def wait_until_received(self, name: str, count: int = 1) -> None:
        """Wait until a server of Nav2 has received goals."""
        received = self.rig.session.wait_for(lambda: self.rig.names().count(name) >= count, LIMIT_S)
        assert received, self.rig.names()


@pytest.fixture(scope="module")
def shared_client(shared_rig: Any, navigator: Any) -> Client:
    client = Client(shared_rig)
    # The navigator knows the robot's pose some time after its start.
    assert shared_rig.session.wait_for(
        lambda: client.result(client.send(2.0))[0] is GoalStatus.SUCCEEDED, LIMIT_S
    )
    return client


@pytest.fixture
def client(shared_client: Client, rig: Any) -> Client:
    shared_client.feedback.clear()
    return shared_client


@pytest.fixture
def drive(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The file of a tree that drives until its goal is cancelled."""
    file = tmp_path_factory.getbasetemp() / "drive.xml"
    file.write_text(DRIVE)
    return str(file)


def test_the_default_tree_reaches_the_goal(client: Client) -> None:
    handle = client.send(2.0)
    assert handle.accepted
    status, result = client.result(handle)
    assert (status, result.error_code, result.error_msg) == (GoalStatus.SUCCEEDED, 0, "")
    client.wait_until_received("follow_path")
    # A slow machine plans again while the path is followed.
    assert client.rig.names()[0] == "compute_path_to_pose"
    assert set(client.rig.names()) == {"compute_path_to_pose", "follow_path"}


def test_goals_through_poses_reach_the_last_pose(client: Client) -> None:
    goal = NavigateThroughPoses.Goal(poses=poses_to_goals([Pose2D(1.0, 2.0, 0.0), Pose2D(2.0, 0.0, 0.0)]))
    handle = client.wait(client.through_poses.send_goal_async(goal, client.take))
    assert client.result(handle)[0] is GoalStatus.SUCCEEDED
    client.wait_until_received("compute_path_through_poses")


def test_feedback_has_pose_times_and_distance(client: Client, drive: str) -> None:
    handle = client.send(2.0, drive)
    assert client.rig.session.wait_for(
        lambda: client.feedback and client.feedback[-1].distance_remaining > 0, LIMIT_S
    )
    feedback = client.feedback[-1]
    here = feedback.current_pose.pose.position
    assert (here.x, here.y) == pytest.approx((1.0, 2.0))
    # From (1, 2) straight to the nearest pose of the path, its end at (2, 0) or its start at (0, 0).
    assert feedback.distance_remaining == pytest.approx(5**0.5 + 2.0, abs=2.01)
    # The odometry reports 0.5 m/s.
    estimated = feedback.estimated_time_remaining
    seconds = estimated.sec + estimated.nanosec / 1e9
    assert seconds == pytest.approx(feedback.distance_remaining / 0.5, abs=0.01)
    assert feedback.number_of_recoveries == 0
    assert client.wait(handle.cancel_goal_async()).goals_canceling
    assert client.result(handle)[0] is GoalStatus.CANCELED


def test_cancelling_halts_the_tree_and_cancels_its_goals(client: Client, drive: str) -> None:
    handle = client.send(2.0, drive)
    client.wait_until_received("hang/follow_path")
    assert client.wait(handle.cancel_goal_async()).goals_canceling
    assert client.result(handle)[0] is GoalStatus.CANCELED
    client.wait_until_received("hang/follow_path canceled")


def test_a_new_goal_for_the_same_tree_takes_over_without_a_halt(client: Client, drive: str) -> None:
    first = client.send(2.0, drive)
    client.wait_until_received("hang/follow_path")
    second = client.send(3.0, drive)
    assert client.result(first)[0] is GoalStatus.ABORTED
    client.wait_until_received("compute_path_to_pose", 2)
    client.wait_until_received("hang/follow_path", 2)
    assert "hang/follow_path canceled" not in client.rig.names()
    assert client.wait(second.cancel_goal_async()).goals_canceling
    assert client.result(second)[0] is GoalStatus.CANCELED
    # Plain rclpy servers work on both goals; a server of Nav2 would have ended the first.
    client.rig.client.cancel_goals("follow_path", "hang/follow_path")
    client.wait_until_received("hang/follow_path canceled", 2)


def test_a_goal_for_another_tree_is_aborted_and_the_first_continues(client: Client, drive: str) -> None:
    first = client.send(2.0, drive)
    client.wait_until_received("hang/follow_path")
    status, result = client.result(client.send(3.0))
    assert status is GoalStatus.ABORTED
    assert result.error_code == NavigateToPose.Result.UNKNOWN
    assert "the goal in progress uses another tree" in result.error_msg
    assert client.wait(first.cancel_goal_async()).goals_canceling
    assert client.result(first)[0] is GoalStatus.CANCELED


def test_the_other_action_rejects_goals_meanwhile(client: Client, drive: str) -> None:
    first = client.send(2.0, drive)
    client.wait_until_received("hang/follow_path")
    goal = NavigateThroughPoses.Goal(poses=poses_to_goals([Pose2D(1.0, 2.0, 0.0)]))
    assert not client.wait(client.through_poses.send_goal_async(goal)).accepted
    client.wait(first.cancel_goal_async())
    assert client.result(first)[0] is GoalStatus.CANCELED


def test_the_result_has_the_error_code_of_the_server_that_failed(client: Client, tmp_path: Path) -> None:
    file = tmp_path / "fail.xml"
    file.write_text(FAIL)
    status, result = client.result(client.send(2.0, file))
    assert status is GoalStatus.ABORTED
    assert result.error_code == 102
    assert "no transform" in result.error_msg


@pytest.mark.parametrize(
    ("text", "code", "message"),
    [("<root", 9001, "tree.xml"), (BROKEN, 9000, "missing"), (None, 9001, "tree.xml")],
)
def test_unusable_tree_aborts_the_goal(
    client: Client, tmp_path: Path, text: str | None, code: int, message: str
) -> None:
    file = tmp_path / "tree.xml"
    if text is not None:
        file.write_text(text)
    status, result = client.result(client.send(2.0, file))
    assert status is GoalStatus.ABORTED
    assert result.error_code == code
    assert message in result.error_msg


def test_error_codes_of_goals_through_poses_begin_at_9100(client: Client, tmp_path: Path) -> None:
    goal = NavigateThroughPoses.Goal(poses=poses_to_goals([Pose2D(1.0, 2.0, 0.0)]))
    goal.behavior_tree = str(tmp_path / "missing.xml")
    handle = client.wait(client.through_poses.send_goal_async(goal))
    assert client.result(handle)[1].error_code == NavigateThroughPoses.Result.FAILED_TO_LOAD_BEHAVIOR_TREE


def test_a_goal_in_an_unknown_frame_is_aborted(client: Client) -> None:
    goal = NavigateToPose.Goal(pose=pose_to_stamped(Pose2D(1.0, 0.0, 0.0)))
    goal.pose.header.frame_id = "table"
    status, result = client.result(client.wait(client.to_pose.send_goal_async(goal)))
    assert status is GoalStatus.ABORTED
    assert "frame 'table'" in result.error_msg


def test_the_topic_goal_pose_starts_the_default_tree(client: Client) -> None:
    publisher = client.rig.session.node.create_publisher(PoseStamped, "goal_pose", 1)
    assert client.rig.session.wait_for(lambda: publisher.get_subscription_count() > 0, LIMIT_S)
    publisher.publish(pose_to_stamped(Pose2D(4.0, 0.0, 0.0)))
    client.wait_until_received("follow_path")
    goals = [goal for name, goal in client.rig.received if name == "compute_path_to_pose"]
    assert goals[0]["goal"]["pose"]["position"]["x"] == 4.0
    # A goal of the same tree replaces it, so that the navigator is free at the end of the test.
    assert client.result(client.send(2.0))[0] is GoalStatus.SUCCEEDED


def test_ctrl_c_cancels_the_goals_and_ends_the_process(
    client: Client, navigator: subprocess.Popen[str], drive: str
) -> None:
    handle = client.send(2.0, drive)
    client.wait_until_received("hang/follow_path")
    result = handle.get_result_async()
    wait_until_known(client.rig.session, "navigate_to_pose")  # the request has arrived, too
    navigator.send_signal(signal.SIGINT)
    client.wait_until_received("hang/follow_path canceled")
    assert client.rig.session.wait_for(result.done, LIMIT_S)
    assert result.result().status == GoalStatus.ABORTED
    output = navigator.communicate(timeout=LIMIT_S)[1]
    assert navigator.returncode == 130
    assert "Traceback" not in output
    assert "--ros-args has no effect" not in output


def test_viewers_see_the_tree_of_a_goal(session: Iterator[RosSession]) -> None:
    """In a namespace without tf: the goal waits for the robot's pose."""
    command = [sys.executable, "-m", "btcore", "ros2", "navigator", "--publish", "groot2", "--port", "0"]
    command += ["--ros-args", "-r __ns:=/seen"]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr is not None
        address = next(found for line in process.stderr if (found := re.search(r"127.0.0.1:(\d+)", line)))
        goals = session.node.create_publisher(PoseStamped, "/seen/goal_pose", 1)
        seen: list[str] = []
        with Feed(f":{address[1]}") as feed:

            def sees(name: str) -> bool:
                for event in feed.poll(0.05):
                    if isinstance(event, TreeEvent):
                        seen.extend(node.name for node in event.tree.nodes)
                return name in seen

            assert session.wait_for(lambda: sees("Navigator"), LIMIT_S)
            assert session.wait_for(lambda: goals.get_subscription_count() > 0, LIMIT_S)
            goals.publish(pose_to_stamped(Pose2D(2.0, 0.0, 0.0)))
            assert session.wait_for(lambda: sees("NavigateRecovery"), LIMIT_S), seen
        process.send_signal(signal.SIGINT)
        assert process.wait(LIMIT_S) == 130


def test_a_goal_waits_longer_for_the_first_pose(monkeypatch: pytest.MonkeyPatch) -> None:
    """A goal that arrives before any transform is not aborted after the patience for a lost pose."""
    monkeypatch.setattr(navigator_server, "POSE_PATIENCE_S", 0.0)
    monkeypatch.setattr(navigator_server, "FIRST_POSE_PATIENCE_S", LIMIT_S)
    # A namespace has its own tf.
    with RosSession("bt_navigator", arguments=["-r", "__ns:=/alone"]) as session:
        server = navigator_server.NavigatorServer(session)
        goals = session.node.create_publisher(PoseStamped, "goal_pose", 1)
        tf = session.node.create_publisher(TFMessage, "/tf", 1)
        clock = session.clock
        end = clock.now() + round(LIMIT_S * NS_PER_S)

        def step() -> None:
            assert clock.now() < end
            clock.wait_until(clock.now() + NS_PER_S // 100, threading.Event())

        while server.tree is None:
            goals.publish(pose_to_stamped(Pose2D(2.0, 0.0, 0.0)))
            step()
        assert server.tree.status is Status.IDLE
        frame = TransformStamped(child_frame_id="base_link")
        frame.header.frame_id, frame.transform.rotation.w = "map", 1.0
        while server.tree.status is Status.IDLE:
            frame.header.stamp = session.node.get_clock().now().to_msg()
            tf.publish(TFMessage(transforms=[frame]))
            step()
        server.close()
