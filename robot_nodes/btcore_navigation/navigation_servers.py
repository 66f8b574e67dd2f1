"""The protocol by which Nav2's tree nodes use a navigation: goals, requests, poses and topics."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Protocol, TypeVar, runtime_checkable

from btcore_navigation.action import GoalHandle
from btcore_navigation.path import NavPath
from btcore_robot.robot import Odometry, Pose2D

Message = TypeVar("Message")

AnyGoalHandle = GoalHandle[Any, Any, Any]
"""A handle of any kind of goal or request."""


class ClearedArea(Enum):
    """The part of a costmap that a service clears."""

    ENTIRE = "entire"
    EXCEPT_REGION = "except region"
    AROUND_ROBOT = "around robot"
    AROUND_POSE = "around pose"


@dataclass(frozen=True, slots=True)
class ClearCostmap:
    """A request to clear the obstacles of a costmap that are not on the map.

    Attributes:
        area: The part that is cleared.
        reset_distance: The side length (m) of the square around the robot or around *pose*.
        pose: The centre of the square for `AROUND_POSE`, in the frame map.
        plugins: The layers to clear; () = all layers.
    """

    area: ClearedArea
    reset_distance: float = 0.0
    pose: Pose2D | None = None
    plugins: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class CheckPath:
    """A request to check the part of *path* ahead of the robot for collisions; its result is a `PathCheck`.

    Attributes:
        path: The path.
        max_cost: The cost (0–254) from which on a pose is a collision.
        unknown_is_obstacle: Whether unknown cost is a collision.
        layer_name: The layer of the costmap to check; "" = all layers.
        footprint: The footprint to check; "" = the robot's.
        stop_at_first_collision: Whether the first collision only is of interest.
        max_lookahead_distance: The distance (m) along the path to check; negative: to the end.
    """

    path: NavPath
    max_cost: int = 254
    unknown_is_obstacle: bool = False
    layer_name: str = ""
    footprint: str = ""
    stop_at_first_collision: bool = True
    max_lookahead_distance: float = -1.0


@dataclass(frozen=True, slots=True)
class PathCheck:
    """The result of `CheckPath`: whether the path is *valid*, and the poses in collision."""

    valid: bool
    collisions: tuple[Pose2D, ...] = ()


@dataclass(frozen=True, slots=True)
class GetCosts:
    """A request for the costs (0–255) of the global costmap at *poses*; its result is a tuple of numbers.

    With *use_footprint* the cost is that of the robot's footprint, and LETHAL in a collision.
    """

    poses: tuple[Pose2D, ...]
    use_footprint: bool = True


@dataclass(frozen=True, slots=True)
class ReinitializeLocalization:
    """A request to discard the robot's pose, and to search the whole map for it."""


@dataclass(frozen=True, slots=True)
class SmoothPathGoal:
    """A request for a smooth path; its result is a `SmoothedPath`.

    Attributes:
        path: The path.
        smoother_id: The name of the smoother's plug-in; "" = the default.
        max_duration: The time limit (s).
        check_for_collisions: Whether the result is checked for collisions.
    """

    path: NavPath
    smoother_id: str = ""
    max_duration: float = 3.0
    check_for_collisions: bool = False


@dataclass(frozen=True, slots=True)
class SmoothedPath:
    """The result of smoothing: the *path*, the *duration* (s), and whether smoothing was completed."""

    path: NavPath
    duration: float
    was_completed: bool


@dataclass(frozen=True, slots=True)
class Battery:
    """The state of the battery.

    Attributes:
        fraction: The charge (0–1), or None if it is unknown.
        voltage: The voltage (V), or None if it is unknown.
        charging: Whether the battery is being charged.
    """

    fraction: float | None = None
    voltage: float | None = None
    charging: bool = False


@runtime_checkable
class NavigationServers(Protocol):
    """The navigation as Nav2's tree nodes use it: servers in this process, or Nav2's servers over ROS 2.

    Goals and requests return at once. The handle reports acceptance, feedback, and the result; requests are
    goals without acceptance and feedback. The names of actions are Nav2's default names.
    """

    goal_tolerance: float
    """The distance (m) at which GoalReached succeeds."""

    def send_goal(self, goal: object, action: str, server_name: str = "") -> AnyGoalHandle:
        """Send a goal.

        Args:
            action: The name of the action, such as `follow_path`.
            server_name: The name of the server; "" = *action*.
        """

    def cancel_goals(self, action: str, server_name: str = "") -> AnyGoalHandle:
        """Cancel all goals of a server, including those of other clients.

        Args:
            action: The name of the action, such as `follow_path`.
            server_name: The name of the server; "" = *action*.

        Returns:
            A handle that succeeds when the server has received the request.
        """

    def request(self, request: object, service_name: str = "") -> AnyGoalHandle:
        """Send a request to a service.

        Args:
            request: One of the requests of this module.
            service_name: The name of the service; "" = Nav2's default name, if there is one.
        """

    def pose(self) -> Pose2D | None:
        """Return the robot's estimated pose in the frame map; None if unknown."""

    def distance_to(self, place: Pose2D) -> float:
        """Return the robot's distance (m) from *place* in the frame map; inf if its pose is unknown."""
        here = self.pose()
        return math.inf if here is None else math.hypot(place.x - here.x, place.y - here.y)

    def remaining(self, path: NavPath) -> float:
        """Return the remaining length (m) of *path*; 0 if the robot's pose is unknown."""
        here = self.pose()
        return path.remaining(here.x, here.y) if here is not None else 0.0

    def odometry(self) -> Odometry | None:
        """Return the newest odometry, or None before the first message."""

    def battery(self, topic: str) -> Battery | None:
        """Return the state of the battery by the newest message of *topic*, or None before the first."""

    def latest(self, topic: str, message_type: type[Message]) -> Message | None:
        """Return the newest message of *topic*, or None before the first.

        Args:
            topic: The name of the topic.
            message_type: The type of the message: str, Pose2D, or list for a list of poses.
        """

    def can_transform(self, target: str, source: str) -> bool:
        """Return whether the transform from the frame *source* to the frame *target* is available."""

    def last_goals(self) -> Mapping[str, AnyGoalHandle]:
        """Return the last goals by action, in this order: planner, smoother, controller, recoveries."""

    @property
    def is_recovering(self) -> bool:
        """Whether a recovery behaviour has a goal that has not ended."""

    @property
    def is_pose_contradicted(self) -> bool:
        """Whether the last scans contradict the robot's pose."""
