"""Nav2's default tree reaches its goal: robot and servers, navigator, and client in three processes."""

import math
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("tf2_msgs")
pytest.importorskip("pybullet")

from nav2_msgs.action import FollowWaypoints, NavigateToPose
from nav2_msgs.srv import ManageLifecycleNodes
from rclpy.action import ActionClient

from btcore_navigation.action import GoalStatus
from btcore_robot.robot import Pose2D
from btcore_ros2.nav2.conversions import pose_to_stamped
from btcore_ros2.nav2.pose_listener import PoseListener
from btcore_ros2.session import RosSession
from tests.ros2.conftest import LIMIT_S
from tests.ros2.discovery import wait_until_known
from tests.ros2.nav2.conftest import LONG_TIMEOUTS

NAVIGATION = "navigation --world arena --camera off --start 0,0,0 --without-navigators"


@contextmanager
def running(arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run a command of `btcore ros2`, and end it like Ctrl-C unless it has ended."""
    command = [sys.executable, "-c", LONG_TIMEOUTS, "ros2", *arguments.split()]
    with subprocess.Popen(command, text=True, env={**os.environ, "NO_COLOR": "1"}) as process:
        try:
            yield process
            process.send_signal(signal.SIGINT)
            process.wait(LIMIT_S)
        finally:
            process.kill()


@pytest.fixture(scope="module")
def processes() -> list[subprocess.Popen[str]]:
    """The running processes: the robot with its servers, and the navigator."""
    return []


@pytest.fixture(scope="module")
def session(processes: list[subprocess.Popen[str]]) -> Iterator[RosSession]:
    """A session of a client, while the robot runs."""
    with RosSession("client") as session, running(NAVIGATION) as process:
        processes.append(process)
        yield session


@pytest.fixture(scope="module")
def listener(session: RosSession, processes: list[subprocess.Popen[str]]) -> Iterator[PoseListener]:
    """A listener that knows the robot's pose, while the navigator runs."""
    listener = PoseListener(session)
    with running("navigator") as process:
        processes.append(process)
        assert session.wait_for(listener.pose, LIMIT_S)
        yield listener


def send(session: RosSession, kind: Any, name: str, goal: Any) -> tuple[GoalStatus, Any]:
    """Send a goal, wait for its end, and return its status and result."""
    client = ActionClient(session.node, kind, name)
    assert session.wait_for(client.server_is_ready, LIMIT_S)
    wait_until_known(session, name)
    accepted = client.send_goal_async(goal)
    assert session.wait_for(accepted.done, LIMIT_S)
    result = accepted.result().get_result_async()
    assert session.wait_for(result.done, LIMIT_S)
    return GoalStatus(result.result().status), result.result().result


def distance(listener: PoseListener, x: float, y: float) -> float:
    here = listener.pose()
    assert here is not None
    return math.hypot(here.x - x, here.y - y)


def test_without_navigators(session: RosSession) -> None:
    node = session.node
    assert session.wait_for(lambda: "/amcl_pose" in dict(node.get_topic_names_and_types()), LIMIT_S)
    assert session.wait_for(lambda: node.count_publishers("spin/_action/status"), LIMIT_S)
    assert node.count_publishers("navigate_to_pose/_action/status") == 0
    assert node.count_subscribers("goal_pose") == 0


def test_navigate_to_pose(session: RosSession, listener: PoseListener) -> None:
    goal = NavigateToPose.Goal(pose=pose_to_stamped(Pose2D(0.5, 0.0, 0.0)))
    status, result = send(session, NavigateToPose, "navigate_to_pose", goal)
    assert status is GoalStatus.SUCCEEDED, result.error_msg
    assert distance(listener, 0.5, 0.0) < 0.4


def test_follow_waypoints(session: RosSession, listener: PoseListener) -> None:
    """The waypoint follower of the navigation uses the navigator of the other process."""
    goal = FollowWaypoints.Goal(poses=[pose_to_stamped(Pose2D(0.5, 0.2, 0.5))])
    status, result = send(session, FollowWaypoints, "follow_waypoints", goal)
    assert status is GoalStatus.SUCCEEDED, result.error_msg


def test_shutdown_by_the_lifecycle_managers(
    session: RosSession, processes: list[subprocess.Popen[str]], listener: PoseListener
) -> None:
    """The last test: both programs end without an error when all their nodes are shut down."""
    kind = "nav2_msgs/srv/ManageLifecycleNodes"
    names = [name for name, kinds in session.node.get_service_names_and_types() if kind in kinds]
    assert names == [
        f"/lifecycle_manager_{scope}/manage_nodes" for scope in ("localization", "navigation", "navigator")
    ]
    for name in names:
        client = session.node.create_client(ManageLifecycleNodes, name)
        assert session.wait_for(client.service_is_ready, LIMIT_S)
        for _ in range(20):  # a response to a client that the server does not know yet is lost
            response = client.call_async(ManageLifecycleNodes.Request(command=4))
            if session.wait_for(response.done, LIMIT_S / 20):
                break
        assert response.result().success
    assert [process.wait(LIMIT_S) for process in processes] == [0, 0]
