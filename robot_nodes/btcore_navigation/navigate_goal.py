"""The goals of the navigators: Nav2's actions NavigateToPose and NavigateThroughPoses."""

from dataclasses import dataclass
from enum import IntEnum

from btcore_navigation.action import GoalHandle
from btcore_robot.robot import Pose2D


@dataclass(frozen=True, slots=True)
class NavigateGoal:
    """A request to drive through the poses *goals* (in the frame map) to the last of them.

    *behavior_tree* is the file of the tree to run; "" stands for the navigator's default tree. *through*
    chooses the server navigate_through_poses.
    """

    goals: tuple[Pose2D, ...]
    behavior_tree: str = ""
    through: bool = False


class WaypointState(IntEnum):
    """The progress of a goal; names and numbers are those of `nav2_msgs/WaypointStatus`."""

    PENDING = 0
    COMPLETED = 1
    SKIPPED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class WaypointStatus:
    """The state of a goal in a list of goals; *index* is its place in the original list."""

    goal: Pose2D
    index: int
    state: WaypointState = WaypointState.PENDING


@dataclass(frozen=True, slots=True)
class NavigateFeedback:
    """The progress of a goal.

    Attributes:
        current_pose: The estimated pose in the frame `map`, or None.
        navigation_time: The time since the start (s).
        number_of_recoveries: The number of recoveries so far.
        distance_remaining: The remaining distance along the path (m).
        number_of_poses_remaining: The number of poses of the goal that are not yet reached.
        estimated_time_remaining: The remaining time (s) at the present speed; 0 if it is unknown.
        waypoint_statuses: The state of each pose of a goal of navigate_through_poses.
    """

    current_pose: Pose2D | None
    navigation_time: float
    number_of_recoveries: int
    distance_remaining: float
    number_of_poses_remaining: int
    estimated_time_remaining: float = 0.0
    waypoint_statuses: tuple[WaypointStatus, ...] = ()


NavigateHandle = GoalHandle[NavigateGoal, NavigateFeedback, tuple[WaypointStatus, ...]]
"""The handle of a `NavigateGoal`; its result is the state of each pose of navigate_through_poses."""
