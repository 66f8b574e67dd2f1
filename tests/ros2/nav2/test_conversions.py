"""Goals, feedback and results are the same after a conversion to messages and back."""

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("nav2_msgs")

from rclpy.serialization import deserialize_message, serialize_message
from std_msgs.msg import Header

from btcore_navigation.behaviours import (
    AssistedTeleopGoal,
    BackUpGoal,
    BehaviourFeedback,
    DriveOnHeadingGoal,
    SpinGoal,
    WaitGoal,
)
from btcore_navigation.controller import FollowPathFeedback, FollowPathGoal
from btcore_navigation.navigate_goal import NavigateFeedback, NavigateGoal
from btcore_navigation.path import NavPath
from btcore_navigation.planner import ComputePathGoal
from btcore_navigation.waypoint_follower import FollowWaypointsGoal
from btcore_robot.robot import Pose2D
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.conversions import (
    ACTIONS,
    nav2_type,
    path_from_message,
    path_to_message,
    pose_from_stamped,
    pose_to_stamped,
)

HERE, THERE = Pose2D(0.5, -1.5, 0.25), Pose2D(4.0, 2.0, -0.5)
PATH = NavPath(np.array([[0.0, 0.0, 0.5], [1.0, 0.5, -0.25]]), 0)

GOALS = [
    ComputePathGoal((THERE,)),
    ComputePathGoal((THERE,), HERE, "GridBased"),
    ComputePathGoal((HERE, THERE), None, "GridBased", through=True),
    FollowPathGoal(PATH, "FollowPath", "precise", "patient"),
    SpinGoal(-0.5, 3.25, True),
    BackUpGoal(0.5, 0.25, 2.5, True),
    DriveOnHeadingGoal(0.5, 0.25, 2.5),
    WaitGoal(1.5),
    AssistedTeleopGoal(2.5),
    FollowWaypointsGoal((HERE, THERE), loops=2, first=1),
    NavigateGoal((THERE,), "tree.xml"),
    NavigateGoal((HERE, THERE), "", through=True),
]


def transmit(message: Any):
    """Return what a receiver gets."""
    return deserialize_message(serialize_message(message), type(message))


def is_close(first: Pose2D, second: Pose2D) -> bool:
    return math.dist((first.x, first.y, first.yaw), (second.x, second.y, second.yaw)) < 1e-12


@pytest.mark.parametrize("goal", GOALS, ids=lambda goal: type(goal).__name__)
def test_goals_survive_the_transmission(goal: Any) -> None:
    through = getattr(goal, "through", None)
    [converter] = [
        converter
        for converter in ACTIONS.values()
        if type(goal) is converter.goal_type and getattr(converter, "through", None) == through
    ]
    message = converter.type.Goal()
    converter.write_goal(goal, message)
    back = converter.read_goal(transmit(message))
    if isinstance(goal, FollowPathGoal):
        assert np.allclose(back.path.poses, PATH.poses)
        assert (back.controller_id, back.goal_checker_id) == ("FollowPath", "precise")
    elif isinstance(goal, FollowWaypointsGoal):
        assert all(map(is_close, back.goals, goal.goals))
        assert (back.loops, back.first) == (2, 1)
    elif isinstance(goal, ComputePathGoal | NavigateGoal):
        assert all(map(is_close, back.goals, goal.goals))
        assert len(back.goals) == len(goal.goals)
        assert back.through is goal.through
    else:
        assert back == goal


@pytest.mark.parametrize(
    ("action", "feedback"),
    [
        ("follow_path", FollowPathFeedback(1.5, 0.25)),
        ("spin", BehaviourFeedback(0.5)),
        ("backup", BehaviourFeedback(0.5)),
        ("drive_on_heading", BehaviourFeedback(0.5)),
        ("wait", BehaviourFeedback(0.5)),
        ("assisted_teleop", BehaviourFeedback(0.5)),
        ("follow_waypoints", 3),
        ("navigate_to_pose", NavigateFeedback(None, 2.5, 3, 1.5, 1, 6.25)),
        ("navigate_through_poses", NavigateFeedback(Pose2D(1.0, 2.0, 0.0), 2.5, 3, 1.5, 2)),
    ],
)
def test_feedback_survives_the_transmission(action: str, feedback: Any) -> None:
    converter = ACTIONS[action]
    message = converter.type.Feedback()
    converter.write_feedback(feedback, message)
    assert converter.read_feedback(transmit(message)) == feedback


def test_a_planned_path_survives_the_transmission() -> None:
    converter = ACTIONS["compute_path_to_pose"]
    message = converter.type.Result()
    converter.write_result(PATH, message)
    back = converter.read_result(transmit(message))
    assert np.allclose(back.poses, PATH.poses)
    assert back.frame == "map"


def test_the_frame_of_a_path_is_kept() -> None:
    path = NavPath(PATH.poses, 7, "odom")
    assert path_from_message(path_to_message(path)).frame == "odom"


def test_a_pose_in_another_frame_is_refused() -> None:
    message = pose_to_stamped(HERE)
    message.header.frame_id = "odom"
    with pytest.raises(RosError, match="in the frame 'odom', but it must be in 'map'"):
        pose_from_stamped(message)


def test_a_frame_has_to_be_named() -> None:
    message = pose_to_stamped(HERE)
    message.header = Header()
    with pytest.raises(RosError, match="a pose names no frame, but it must be in 'map'"):
        pose_from_stamped(message)
    path = path_to_message(PATH)
    path.header = Header()
    assert path_from_message(path).frame == "map"  # by its poses
    path.poses[0].header.frame_id = ""
    with pytest.raises(RosError, match="the path names no frame"):
        path_from_message(path)


def test_a_pose_that_is_not_finite_is_refused() -> None:
    message = pose_to_stamped(HERE)
    message.pose.position.x = math.nan
    with pytest.raises(RosError, match="finite"):
        pose_from_stamped(message)


def test_a_class_of_another_release_is_reported() -> None:
    with pytest.raises(RosError, match="no srv/ClearCostmapAroundPose: it belongs to another release"):
        nav2_type("srv", "ClearCostmapAroundPose")
