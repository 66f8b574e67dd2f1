"""Conversions between our navigation's goals, poses and paths and the messages of ROS 2 and Nav2.

`ACTIONS` holds a converter for each action of Nav2, which clients and servers share.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from nav_msgs.msg import Path
from std_msgs.msg import Header

from btcore.clock import NS_PER_S
from btcore_navigation.behaviours import (
    AssistedTeleopGoal,
    BackUpGoal,
    BehaviourFeedback,
    DriveOnHeadingGoal,
    SpinGoal,
    WaitGoal,
)
from btcore_navigation.controller import FollowPathFeedback, FollowPathGoal
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigate_goal import (
    NavigateFeedback,
    NavigateGoal,
    WaypointState,
    WaypointStatus,
)
from btcore_navigation.navigation_servers import SmoothedPath, SmoothPathGoal
from btcore_navigation.path import NavPath
from btcore_navigation.planner import ComputePathGoal
from btcore_navigation.waypoint_follower import FollowWaypointsGoal, MissedWaypoint
from btcore_robot.robot import MAP_FRAME, Pose2D
from btcore_ros2.errors import RosError
from btcore_ros2.nav2.nodes import ComputedRoute, ComputeRouteGoal, Route

if TYPE_CHECKING:
    from nav_msgs.msg import Goals

THROUGH_OFFSET = 100
"""The difference between the error codes of NavigateThroughPoses and NavigateToPose."""

_ALLOWANCE: Final = {"time_allowance": "time_allowance"}
_LIMITS: Final = {**_ALLOWANCE, "disable_collision_checks": "disable_collision_checks"}
"""Attributes of goals, and the fields of the same names in the messages."""


class FrameError(RosError):
    """A pose is in another frame than the receiver needs."""


def nav2_type(kind: str, name: str) -> Any:
    """Return a message, service or action class of nav2_msgs.

    Args:
        kind: The part of the package: `msg`, `srv` or `action`.
        name: The name of the class.

    Raises:
        RosError: The package is missing, or its release has no such class.
    """
    try:
        package = import_module(f"nav2_msgs.{kind}")
    except ModuleNotFoundError as missing:
        raise RosError(
            "the package nav2_msgs is missing: generate it (btcore ros2 messages FOLDER), "
            "or source the setup file of a ROS 2 with Nav2"
        ) from missing
    try:
        return getattr(package, name)
    except AttributeError:
        raise RosError(
            f"the installed nav2_msgs has no {kind}/{name}: it belongs to another release"
        ) from None


def pose_to_message(pose: Pose2D) -> Pose:
    """Return *pose* as a `geometry_msgs/Pose` on the floor."""
    half = pose.yaw / 2.0
    return Pose(
        position=Point(x=pose.x, y=pose.y), orientation=Quaternion(z=math.sin(half), w=math.cos(half))
    )


def pose_to_stamped(pose: Pose2D) -> PoseStamped:
    """Return *pose* in the frame map as a `geometry_msgs/PoseStamped`.

    Its stamp is zero, which stands for the newest transform.
    """
    return PoseStamped(header=Header(frame_id=MAP_FRAME), pose=pose_to_message(pose))


def pose_from_message(message: Pose) -> Pose2D:
    """Return the position and heading on the floor of a `geometry_msgs/Pose`.

    The heading of the quaternion (0, 0, 0, 0) is 0, as in Nav2.

    Raises:
        RosError: A number is not finite.
    """
    point, turn = message.position, message.orientation
    yaw = math.atan2(2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y**2 + turn.z**2))
    if not (math.isfinite(point.x) and math.isfinite(point.y) and math.isfinite(yaw)):
        raise RosError("the numbers of a pose must be finite")
    return Pose2D(point.x, point.y, yaw)


def pose_from_stamped(message: PoseStamped, frame: str = MAP_FRAME, default: str = "") -> Pose2D:
    """Return the pose of a `geometry_msgs/PoseStamped`.

    Args:
        frame: The name of the frame that the pose must have.
        default: The frame of a message that names no frame.

    Raises:
        FrameError: The pose is in another frame, or names none.
        RosError: A number is not finite.
    """
    found = (message.header.frame_id or default).strip("/")
    if found != frame:
        named = f"is in the frame '{found}'" if found else "names no frame"
        raise FrameError(f"a pose {named}, but it must be in '{frame}'")
    return pose_from_message(message.pose)


def poses_to_goals(poses: Iterable[Pose2D]) -> "Goals":
    """Return *poses* in the frame `map` as a `nav_msgs/Goals`, with the stamp zero."""
    from nav_msgs.msg import Goals  # Jazzy does not have this message

    return Goals(header=Header(frame_id=MAP_FRAME), goals=list(map(pose_to_stamped, poses)))


def poses_from_goals(message: "Goals") -> tuple[Pose2D, ...]:
    """Return the poses of a `nav_msgs/Goals`.

    Raises:
        RosError: A pose is not in the frame `map`, or a number is not finite.
    """
    default = message.header.frame_id
    return tuple(pose_from_stamped(goal, MAP_FRAME, default) for goal in message.goals)


def path_to_message(path: NavPath, stamp: Time | None = None) -> Path:
    """Return *path* as a `nav_msgs/Path`.

    Args:
        stamp: The stamp; None = zero, which stands for the newest transform. The stamp of *path* itself may
            belong to another clock.
    """
    header = Header(frame_id=path.frame, stamp=stamp or Time())
    return Path(
        header=header,
        poses=[
            PoseStamped(header=header, pose=pose_to_message(Pose2D(x, y, yaw)))
            for x, y, yaw in path.poses.tolist()
        ],
    )


def path_from_message(message: Path) -> NavPath:
    """Return a `nav_msgs/Path`; without a frame it is in the frame of its first pose.

    Raises:
        FrameError: The poses are in different frames, or no frame is named.
        RosError: A number is not finite.
    """
    frame = message.header.frame_id or (message.poses[0].header.frame_id if message.poses else MAP_FRAME)
    if not frame:
        raise FrameError("the path names no frame")
    poses = [pose_from_stamped(pose, frame, frame) for pose in message.poses]
    array = np.array([(pose.x, pose.y, pose.yaw) for pose in poses], dtype=np.float64).reshape(-1, 3)
    return NavPath(array, time_to_ns(message.header.stamp), frame)


def time_to_ns(message: Time | Duration) -> int:
    """Return a time or duration in ns."""
    return int(message.sec) * NS_PER_S + int(message.nanosec)


def seconds_to_duration(seconds: float) -> Duration:
    """Return *seconds* (s) as a `builtin_interfaces/Duration`."""
    sec, nanosec = divmod(round(seconds * NS_PER_S), NS_PER_S)
    return Duration(sec=sec, nanosec=nanosec)


def duration_to_seconds(message: Duration) -> float:
    """Return a duration in s."""
    return time_to_ns(message) / NS_PER_S


class ActionConverter:
    """The conversions of an action of Nav2.

    Goals, feedback and results are copied field by field into messages that the caller has created, because
    releases of Nav2 differ: a field that the message class lacks is left out. Error code and message of a
    result are the same in all actions and are left to the caller.

    Attributes:
        name: The name under which Nav2 serves the action.
        type_name: The name of the class in `nav2_msgs.action`.
        goal_type: The class of our goal.
    """

    name: str
    type_name: str
    goal_type: type

    @property
    def type(self) -> Any:
        """The class in `nav2_msgs.action`. Raises RosError if it is missing."""
        return nav2_type("action", self.type_name)

    def error_code(self, code: int) -> int:
        """Return the error code of the action for an error code of our server."""
        return code

    def write_goal(self, goal: Any, message: Any) -> None:
        """Copy *goal* into the goal message. Raises RosError for a goal that the message can't express."""
        raise NotImplementedError

    def read_goal(self, message: Any) -> Any:
        """Return the goal of a goal message. Raises RosError for an invalid message."""
        raise NotImplementedError

    def write_feedback(self, feedback: Any, message: Any) -> None:
        """Copy *feedback* into the feedback message."""

    def read_feedback(self, message: Any) -> Any:
        """Return the feedback of a feedback message, or None."""
        return None

    def write_result(self, value: Any, message: Any) -> None:
        """Copy the value of a result into the result message."""

    def read_result(self, message: Any) -> Any:
        """Return the value of a result message, or None."""
        return None


class _ComputePath(ActionConverter):
    goal_type = ComputePathGoal

    def __init__(self, name: str, type_name: str, *, through: bool) -> None:
        self.name, self.type_name, self.through = name, type_name, through

    def write_goal(self, goal: ComputePathGoal, message: Any) -> None:
        if self.through:
            message.goals = poses_to_goals(goal.goals)
        else:
            *viapoints, last = goal.goals
            message.goal = pose_to_stamped(last)
            if viapoints and not hasattr(message, "viapoints"):
                raise RosError("Nav2 of this release plans without viapoints: use ComputePathThroughPoses")
            if viapoints:
                message.viapoints = [pose_to_stamped(pose) for pose in viapoints]
        if goal.start is not None:
            message.start = pose_to_stamped(goal.start)
        message.use_start = goal.start is not None
        message.planner_id = goal.planner_id

    def read_goal(self, message: Any) -> ComputePathGoal:
        if self.through:
            goals = poses_from_goals(message.goals)
        else:
            viapoints = map(pose_from_stamped, getattr(message, "viapoints", ()))
            goals = (*viapoints, pose_from_stamped(message.goal))
        start = pose_from_stamped(message.start) if message.use_start else None
        return ComputePathGoal(goals, start, message.planner_id, self.through)

    def write_result(self, value: NavPath | None, message: Any) -> None:
        if value is not None:
            message.path = path_to_message(value)

    def read_result(self, message: Any) -> NavPath:
        return path_from_message(message.path)


class _FollowPath(ActionConverter):
    name, type_name, goal_type = "follow_path", "FollowPath", FollowPathGoal

    def write_goal(self, goal: FollowPathGoal, message: Any) -> None:
        message.path = path_to_message(goal.path)
        message.controller_id = goal.controller_id
        message.goal_checker_id = goal.goal_checker_id
        message.progress_checker_id = goal.progress_checker_id
        if hasattr(message, "path_handler_id"):
            message.path_handler_id = goal.path_handler_id

    def read_goal(self, message: Any) -> FollowPathGoal:
        return FollowPathGoal(
            path_from_message(message.path),
            message.controller_id,
            message.goal_checker_id,
            message.progress_checker_id,
            getattr(message, "path_handler_id", ""),
        )

    def write_feedback(self, feedback: FollowPathFeedback, message: Any) -> None:
        if hasattr(message, "tracking_feedback"):
            tracking = message.tracking_feedback
            tracking.remaining_path_length = feedback.distance_to_goal
            tracking.position_tracking_error = feedback.position_error
            tracking.heading_tracking_error = feedback.heading_error
        else:
            message.distance_to_goal = feedback.distance_to_goal
            message.speed = feedback.speed

    def read_feedback(self, message: Any) -> FollowPathFeedback:
        tracking = getattr(message, "tracking_feedback", None)
        if tracking is None:
            return FollowPathFeedback(message.distance_to_goal, message.speed)
        return FollowPathFeedback(
            tracking.remaining_path_length,
            0.0,
            tracking.position_tracking_error,
            tracking.heading_tracking_error,
        )


class _SmoothPath(ActionConverter):
    name, type_name, goal_type = "smooth_path", "SmoothPath", SmoothPathGoal

    def write_goal(self, goal: SmoothPathGoal, message: Any) -> None:
        message.path = path_to_message(goal.path)
        message.smoother_id = goal.smoother_id
        message.max_smoothing_duration = seconds_to_duration(goal.max_duration)
        message.check_for_collisions = goal.check_for_collisions

    def read_goal(self, message: Any) -> SmoothPathGoal:
        return SmoothPathGoal(
            path_from_message(message.path),
            message.smoother_id,
            duration_to_seconds(message.max_smoothing_duration),
            message.check_for_collisions,
        )

    def write_result(self, value: SmoothedPath | None, message: Any) -> None:
        if value is not None:
            message.path = path_to_message(value.path)
            message.smoothing_duration = seconds_to_duration(value.duration)
            message.was_completed = value.was_completed

    def read_result(self, message: Any) -> SmoothedPath:
        duration = duration_to_seconds(message.smoothing_duration)
        return SmoothedPath(path_from_message(message.path), duration, message.was_completed)


class _Behaviour(ActionConverter):
    """An action of the behaviour server. Its feedback is the progress, a number; durations are in s.

    *fields* are the fields of the goal message, by the attributes of our goal, and *progress* is the field of
    the feedback.
    """

    def __init__(
        self, name: str, type_name: str, goal_type: type, fields: Mapping[str, str], progress: str
    ) -> None:
        self.name, self.type_name, self.goal_type = name, type_name, goal_type
        self._fields, self._progress = fields, progress

    def write_goal(self, goal: Any, message: Any) -> None:
        for attribute, field in self._fields.items():
            _write_number(message, field, getattr(goal, attribute))

    def read_goal(self, message: Any) -> Any:
        return self.goal_type(**{name: _read_number(message, field) for name, field in self._fields.items()})

    def write_feedback(self, feedback: BehaviourFeedback, message: Any) -> None:
        _write_number(message, self._progress, feedback.progress)

    def read_feedback(self, message: Any) -> BehaviourFeedback:
        return BehaviourFeedback(_read_number(message, self._progress))


def _write_number(message: Any, field: str, value: float) -> None:
    is_duration = isinstance(getattr(message, field), Duration)
    setattr(message, field, seconds_to_duration(value) if is_duration else value)


def _read_number(message: Any, field: str) -> float:
    value: Any = getattr(message, field)
    return duration_to_seconds(value) if isinstance(value, Duration) else value


class _Straight(_Behaviour):
    def __init__(self, name: str, type_name: str, goal_type: type) -> None:
        super().__init__(name, type_name, goal_type, {"speed": "speed", **_LIMITS}, "distance_traveled")

    def write_goal(self, goal: BackUpGoal | DriveOnHeadingGoal, message: Any) -> None:
        super().write_goal(goal, message)
        message.target = Point(x=goal.dist)

    def read_goal(self, message: Any) -> Any:
        target = message.target
        if target.y != 0.0 or target.z != 0.0:
            raise RosError(f"{self.name}: the target must be on the x axis, but its y or z is not 0")
        return replace(super().read_goal(message), dist=target.x)


class _ComputeRoute(ActionConverter):
    name, type_name, goal_type = "compute_route", "ComputeRoute", ComputeRouteGoal

    def write_goal(self, goal: ComputeRouteGoal, message: Any) -> None:
        message.start_id, message.goal_id = goal.start_id, goal.goal_id
        message.use_poses = goal.goal is not None
        message.use_start = goal.start is not None
        if goal.goal is not None:
            message.goal = pose_to_stamped(goal.goal)
        if goal.start is not None:
            message.start = pose_to_stamped(goal.start)

    def read_goal(self, message: Any) -> ComputeRouteGoal:
        return ComputeRouteGoal(
            message.start_id,
            message.goal_id,
            pose_from_stamped(message.goal) if message.use_poses else None,
            pose_from_stamped(message.start) if message.use_start else None,
        )

    def read_result(self, message: Any) -> ComputedRoute:
        nodes = tuple(Pose2D(node.position.x, node.position.y, 0.0) for node in message.route.nodes)
        path = path_from_message(message.path)
        return ComputedRoute(Route(nodes), path, duration_to_seconds(message.planning_time))


class _FollowWaypoints(ActionConverter):
    name, type_name, goal_type = "follow_waypoints", "FollowWaypoints", FollowWaypointsGoal

    def write_goal(self, goal: FollowWaypointsGoal, message: Any) -> None:
        message.poses = [pose_to_stamped(pose) for pose in goal.goals]
        message.number_of_loops, message.goal_index = goal.loops, goal.first

    def read_goal(self, message: Any) -> FollowWaypointsGoal:
        goals = tuple(pose_from_stamped(pose) for pose in message.poses)
        return FollowWaypointsGoal(goals, message.number_of_loops, message.goal_index)

    def write_feedback(self, feedback: int, message: Any) -> None:
        message.current_waypoint = feedback

    def read_feedback(self, message: Any) -> int:
        return int(message.current_waypoint)

    def write_result(self, value: tuple[MissedWaypoint, ...] | None, message: Any) -> None:
        for missed in value or ():
            entry = _status_to_message(WaypointStatus(missed.goal, missed.index, WaypointState.FAILED))
            entry.error_code, entry.error_msg = missed.code, missed.message
            message.missed_waypoints.append(entry)


class _Navigate(ActionConverter):
    goal_type = NavigateGoal

    def __init__(self, name: str, type_name: str, *, through: bool) -> None:
        self.name, self.type_name, self.through = name, type_name, through

    def error_code(self, code: int) -> int:
        return code + THROUGH_OFFSET if self.through and code >= Nav2ErrorCode.NAVIGATE_UNKNOWN else code

    def write_goal(self, goal: NavigateGoal, message: Any) -> None:
        if self.through:
            message.poses = poses_to_goals(goal.goals)
        else:
            message.pose = pose_to_stamped(goal.goals[-1])
        message.behavior_tree = goal.behavior_tree

    def read_goal(self, message: Any) -> NavigateGoal:
        goals: Sequence[Pose2D] = (
            poses_from_goals(message.poses) if self.through else (pose_from_stamped(message.pose),)
        )
        return NavigateGoal(tuple(goals), message.behavior_tree, self.through)

    def write_feedback(self, feedback: NavigateFeedback, message: Any) -> None:
        if feedback.current_pose is not None:
            message.current_pose = pose_to_stamped(feedback.current_pose)
        message.navigation_time = seconds_to_duration(feedback.navigation_time)
        message.estimated_time_remaining = seconds_to_duration(feedback.estimated_time_remaining)
        message.number_of_recoveries = feedback.number_of_recoveries
        message.distance_remaining = feedback.distance_remaining
        if self.through:
            message.number_of_poses_remaining = feedback.number_of_poses_remaining
            _write_statuses(feedback.waypoint_statuses, message)

    def read_feedback(self, message: Any) -> NavigateFeedback:
        return NavigateFeedback(
            pose_from_message(message.current_pose.pose) if message.current_pose.header.frame_id else None,
            duration_to_seconds(message.navigation_time),
            message.number_of_recoveries,
            message.distance_remaining,
            message.number_of_poses_remaining if self.through else 1,
            duration_to_seconds(message.estimated_time_remaining),
        )

    def write_result(self, value: tuple[WaypointStatus, ...] | None, message: Any) -> None:
        _write_statuses(value or (), message)


def _write_statuses(statuses: tuple[WaypointStatus, ...], message: Any) -> None:
    if hasattr(message, "waypoint_statuses"):
        message.waypoint_statuses = [_status_to_message(status) for status in statuses]


def _status_to_message(status: WaypointStatus) -> Any:
    """Return *status* as a `nav2_msgs/WaypointStatus`."""
    return nav2_type("msg", "WaypointStatus")(
        waypoint_status=int(status.state),
        waypoint_index=status.index,
        waypoint_pose=pose_to_stamped(status.goal),
    )


ACTIONS: Final[dict[str, ActionConverter]] = {
    converter.name: converter
    for converter in (
        _ComputePath("compute_path_to_pose", "ComputePathToPose", through=False),
        _ComputePath("compute_path_through_poses", "ComputePathThroughPoses", through=True),
        _FollowPath(),
        _SmoothPath(),
        _Behaviour("spin", "Spin", SpinGoal, {"dist": "target_yaw", **_LIMITS}, "angular_distance_traveled"),
        _Straight("backup", "BackUp", BackUpGoal),
        _Straight("drive_on_heading", "DriveOnHeading", DriveOnHeadingGoal),
        _Behaviour("wait", "Wait", WaitGoal, {"duration": "time"}, "time_left"),
        _Behaviour(
            "assisted_teleop", "AssistedTeleop", AssistedTeleopGoal, _ALLOWANCE, "current_teleop_duration"
        ),
        _ComputeRoute(),
        _FollowWaypoints(),
        _Navigate("navigate_to_pose", "NavigateToPose", through=False),
        _Navigate("navigate_through_poses", "NavigateThroughPoses", through=True),
    )
}
"""The converters of Nav2's actions, by the name under which Nav2 serves the action."""
