"""Nav2's default trees reach their goals: robot and servers, navigator, and client in three processes."""

import math
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")
pytest.importorskip("tf2_msgs")
pytest.importorskip("pybullet")

from nav2_msgs.action import NavigateThroughPoses, NavigateToPose
from rclpy.action import ActionClient

from btcore_robot.navigation.action import GoalStatus
from btcore_robot.robot import Pose2D
from btcore_ros2.nav2.conversions import pose_to_stamped, poses_to_goals
from btcore_ros2.nav2.pose_listener import PoseListener
from btcore_ros2.session import RosSession

LIMIT = 120.0
NAVIGATION = "navigation --world arena --camera off --start 0,0,0 --without-navigators"


def start(arguments: str) -> subprocess.Popen[str]:
    """Start a command of `btcore ros2`."""
    command = [sys.executable, "-m", "btcore", "ros2", *arguments.split()]
    return subprocess.Popen(command, text=True, env={**os.environ, "NO_COLOR": "1"})


@pytest.fixture(scope="module")
def session() -> Iterator[RosSession]:
    """A session of a client, while the robot and the navigator run."""
    processes = [start(NAVIGATION), start("navigator")]
    with RosSession("client") as made:
        yield made
    for process in reversed(processes):
        process.send_signal(signal.SIGINT)
        process.wait(timeout=LIMIT)


@pytest.fixture(scope="module")
def listener(session: RosSession) -> PoseListener:
    """A listener that knows the robot's pose."""
    made = PoseListener(session)
    assert session.wait_for(made.pose, LIMIT)
    return made


def send(session: RosSession, kind: Any, name: str, goal: Any) -> tuple[GoalStatus, Any]:
    """Send a goal, wait for its end, and return its status and result."""
    client = ActionClient(session.node, kind, name)
    assert session.wait_for(client.server_is_ready, LIMIT)
    session.wait_for(lambda: False, 0.2)  # the server has to find the client, too
    accepted = client.send_goal_async(goal)
    assert session.wait_for(accepted.done, LIMIT)
    result = accepted.result().get_result_async()
    assert session.wait_for(result.done, LIMIT)
    return GoalStatus(result.result().status), result.result().result


def distance(listener: PoseListener, x: float, y: float) -> float:
    here = listener.pose()
    assert here is not None
    return math.hypot(here.x - x, here.y - y)


def test_navigate_to_pose(session: RosSession, listener: PoseListener) -> None:
    goal = NavigateToPose.Goal(pose=pose_to_stamped(Pose2D(0.8, 0.0, 0.0)))
    status, result = send(session, NavigateToPose, "navigate_to_pose", goal)
    assert status is GoalStatus.SUCCEEDED, result.error_msg
    assert distance(listener, 0.8, 0.0) < 0.4


def test_navigate_through_poses(session: RosSession, listener: PoseListener) -> None:
    poses = poses_to_goals([Pose2D(0.9, 0.0, 0.0), Pose2D(1.4, 0.1, 0.0)])
    goal = NavigateThroughPoses.Goal(poses=poses)
    status, result = send(session, NavigateThroughPoses, "navigate_through_poses", goal)
    assert status is GoalStatus.SUCCEEDED, result.error_msg
    assert distance(listener, 1.4, 0.1) < 0.4


def test_a_tree_without_the_navigator(session: RosSession, listener: PoseListener) -> None:
    before = listener.pose()
    assert before is not None
    tree = "navigation/navigate_w_replanning_time"
    command = [sys.executable, "-m", "btcore", "run", tree, "--nav2", "--set", f"goal={before.x + 0.6};0.2"]
    done = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    output: list[str] = []
    reader = threading.Thread(target=lambda: output.append(done.communicate()[0]))
    reader.start()
    assert session.wait_for(lambda: done.poll() is not None, LIMIT)
    reader.join()
    assert done.returncode == 0, output
    session.drain()
    assert distance(listener, before.x + 0.6, 0.2) < 0.4
