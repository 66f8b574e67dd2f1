"""Nav2's conditions on goals, distances, times, battery, odometry and error codes."""

import math
from collections import deque
from typing import Annotated, ClassVar

from btcore import Condition, In, NodeError, NodeSpec
from btcore.clock import NS_PER_S
from btcore.engine.node import read_clock
from btcore_navigation.controller import FollowPathFeedback
from btcore_navigation.error_codes import (
    CONTROLLER_RECOVERY_HELPS,
    PLANNER_RECOVERY_HELPS,
    SMOOTHER_RECOVERY_HELPS,
)
from btcore_navigation.navigation_servers import NavigationServers
from btcore_navigation.nodes.port_access import (
    OPTIONAL,
    Goal,
    GoalList,
    Goals,
    blackboard_default,
    goal_inputs,
    is_first_tick,
    optional_input,
    path_input,
    path_port,
    pose_input,
)
from btcore_navigation.path import NavPath, NearestPoseSearch
from btcore_robot.robot import Odometry, Pose2D

MAX_DECELERATION = -10.0
"""Nav2's limit (m/s²): only a collision decelerates the robot more strongly."""

BaseFrame = Annotated[In[str], "Robot base frame; always base_footprint here."]
GlobalFrame = Annotated[In[str], "Global frame; always map here."]

ROUTE_RECOVERY_HELPS = frozenset({400, 404, 405})
"""Nav2's codes of a route server's errors: unknown error, timeout, no valid route."""

ErrorCode = Annotated[In[int], "Error code; 0 when there was no error."]
ErrorCodes = Annotated[In[list[int]], "Error codes to check in place of the default codes."]


class GoalReached(Condition):
    """SUCCESS while the robot is within the navigator's goal tolerance of *goal*."""

    goal: Annotated[In[Pose2D], "Destination."]
    robot_base_frame: BaseFrame = "base_footprint"

    spec = NodeSpec(state_fields=())

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Compare the distance to the goal with the tolerance."""
        goal = pose_input(self, "goal")
        return goal is not None and self.servers.distance_to(goal) <= self.servers.goal_tolerance


class GoalUpdated(Condition):
    """SUCCESS when the goal has changed since the previous tick; FAILURE at the first tick after a reset."""

    goal: Goal = blackboard_default("goal")
    goals: GoalList = blackboard_default("goals")

    spec = NodeSpec(state_fields=("known",))

    def __init__(self) -> None:
        self.known: Goals = (None, ())

    def tick(self) -> bool:
        """Compare the goals with those of the previous tick."""
        goals = goal_inputs(self)
        changed = goals != self.known and not is_first_tick(self)
        self.known = goals
        return changed


class GlobalUpdatedGoal(Condition):
    """SUCCESS when the goal differs from the goal at the previous tick, and on the very first tick.

    Unlike GoalUpdated, the node still knows the previous goal after a halt.
    """

    goal: Goal = blackboard_default("goal")
    goals: GoalList = blackboard_default("goals")

    spec = NodeSpec(state_fields=("known",))

    def __init__(self) -> None:
        self.known: Goals | None = None

    def tick(self) -> bool:
        """Compare the goals with those of the previous tick."""
        goals = goal_inputs(self)
        changed = goals != self.known
        self.known = goals
        return changed


class IsStuck(Condition):
    """SUCCESS when odometry slowed down by more than 10 m/s², which only a collision causes."""

    spec = NodeSpec(state_fields=("history",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.history: deque[Odometry] = deque(maxlen=10)

    def tick(self) -> bool:
        """Compare the last two odometry readings with different stamps, once there are three readings."""
        newest = self.servers.odometry()
        if newest is None:
            return False
        if not self.history or newest.stamp > self.history[-1].stamp:
            self.history.append(newest)
        if len(self.history) < 3:
            return False
        before, last = self.history[-2], self.history[-1]
        seconds = (last.stamp - before.stamp) / NS_PER_S
        return (last.twist.v - before.twist.v) / seconds < MAX_DECELERATION


class IsBatteryLow(Condition):
    """SUCCESS when the battery's charge is *min_battery* or less (a fraction 0–1, as in `BatteryState`)."""

    min_battery: Annotated[In[float], "Minimum battery charge (fraction 0–1)."]
    battery_topic: Annotated[In[str], "Battery topic; navigation in this process ignores it."] = (
        "/battery_status"
    )
    is_voltage: Annotated[In[bool], "True if min_battery is a voltage; FAILURE if it is unknown."] = False

    spec = NodeSpec(state_fields=())

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Compare the charge or the voltage with the limit; return False if it is unknown."""
        battery = self.servers.battery(self.battery_topic)
        if battery is None:
            return False
        value = battery.voltage if self.is_voltage else battery.fraction
        return value is not None and value <= self.min_battery


class IsBatteryCharging(Condition):
    """SUCCESS while the battery is charged; in this process, while *battery_topic* contains `charging`."""

    battery_topic: Annotated[In[str], "Battery topic."] = "/battery_status"

    spec = NodeSpec(state_fields=())

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Return whether the battery is charged; False if that is unknown."""
        battery = self.servers.battery(self.battery_topic)
        return battery is not None and battery.charging


class DistanceTraveled(Condition):
    """SUCCESS when the robot is *distance* (m) away from its position at the last SUCCESS or at the start."""

    distance: Annotated[In[float], "Distance (m)."] = 1.0
    global_frame: GlobalFrame = "map"
    robot_base_frame: BaseFrame = "base_footprint"

    spec = NodeSpec(state_fields=("start",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.start: Pose2D | None = None

    def tick(self) -> bool:
        """Compare the distance; return False while the robot's pose is unknown."""
        here = self.servers.pose()
        if is_first_tick(self) or self.start is None:
            self.start = here
            return False
        if here is None or math.hypot(here.x - self.start.x, here.y - self.start.y) < self.distance:
            return False
        self.start = here
        return True


class TimeExpired(Condition):
    """SUCCESS when *seconds* have passed since the last SUCCESS or since the start."""

    seconds: Annotated[In[float], "Time (s)."] = 1.0

    spec = NodeSpec(state_fields=("due",), time_fields=("due",))

    def __init__(self) -> None:
        self.due = 0

    def tick(self) -> bool:
        """Compare the elapsed time."""
        first = is_first_tick(self)
        if not (first or self.has_passed(self.due)):
            return False
        self.due = read_clock(self) + math.ceil(self.seconds * NS_PER_S)
        return not first


class PathExpiringTimer(Condition):
    """SUCCESS when *seconds* have passed since the path last changed or since the last SUCCESS."""

    seconds: Annotated[In[float], "Time (s)."] = 1.0

    provided_ports = path_port("Path whose age counts.")

    spec = NodeSpec(state_fields=("due", "known"), time_fields=("due",))

    def __init__(self) -> None:
        self.due = -1
        self.known: NavPath | None = None

    def tick(self) -> bool:
        """Compare the path and the elapsed time."""
        path = path_input(self, "path")
        is_new = self.due < 0 or path != self.known
        if not (is_new or self.has_passed(self.due)):
            return False
        self.known = path
        self.due = read_clock(self) + math.ceil(self.seconds * NS_PER_S)
        return not is_new


class TransformAvailable(Condition):
    """SUCCESS when the transform between two frames is available, and always after the first SUCCESS."""

    child: Annotated[In[str], "Child frame for transform."] = ""
    parent: Annotated[In[str], "Parent frame for transform."] = ""

    spec = NodeSpec(state_fields=("was_available",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.was_available = False

    def tick(self) -> bool:
        """Look up the transform.

        Raises:
            NodeError: A frame's name is empty.
        """
        if not (self.parent and self.child):
            raise NodeError("<TransformAvailable> needs the names of two frames: child and parent")
        self.was_available = self.was_available or self.servers.can_transform(self.parent, self.child)
        return self.was_available


class InitialPoseReceived(Condition):
    """SUCCESS when the flag *initial_pose_received* is true."""

    initial_pose_received: Annotated[In[bool], "True once an initial pose has been received."] = (
        blackboard_default("initial_pose_received")
    )

    def tick(self) -> bool:
        """Return the flag; an entry without a value counts as false."""
        return bool(optional_input(self, "initial_pose_received"))


class IsGoalNearby(Condition):
    """SUCCESS when the remaining part of *path* is shorter than *proximity_threshold*."""

    proximity_threshold: Annotated[In[float], "Remaining path length (m) that is near the goal."] = 1.0
    max_robot_pose_search_dist: Annotated[
        In[float], "Maximum distance (m) along the path to search for the robot's pose; -1: the whole path."
    ] = -1.0
    global_frame: GlobalFrame = "map"
    robot_base_frame: BaseFrame = "base_footprint"

    provided_ports = path_port("Path that the robot follows.")

    spec = NodeSpec(state_fields=("search",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.search = NearestPoseSearch()

    def tick(self) -> bool:
        """Compare the remaining length; return False without a path or while the robot's pose is unknown."""
        path, here = path_input(self, "path"), self.servers.pose()
        if path is None or here is None:
            return False
        nearest = self.search.nearest(path, here, self.max_robot_pose_search_dist)
        along = path.distances()
        return float(along[-1] - along[nearest]) < self.proximity_threshold


class ArePosesNear(Condition):
    """SUCCESS when two poses are at most *tolerance* (m) apart."""

    ref_pose: Annotated[In[Pose2D], "Reference pose."]
    target_pose: Annotated[In[Pose2D], "Target pose."]
    global_frame: GlobalFrame = "map"
    tolerance: Annotated[In[float], "Tolerance (m)."] = 0.5

    def tick(self) -> bool:
        """Compare the distance between the poses."""
        first, second = self.ref_pose, self.target_pose
        return math.hypot(first.x - second.x, first.y - second.y) <= self.tolerance


class IsWithinPathTrackingBounds(Condition):
    """SUCCESS while the robot's deviation from its path is within the bounds for left, right and heading."""

    max_error_left: Annotated[In[float], "Maximum tracking error (m) to the left of the path."] = 0.5
    max_error_right: Annotated[In[float], "Maximum tracking error (m) to the right of the path."] = 0.5
    max_error_heading: Annotated[In[float], "Maximum heading error (rad)."] = 3.14
    tracking_feedback: Annotated[In[FollowPathFeedback], "Tracking feedback of FollowPath."] = OPTIONAL

    def tick(self) -> bool:
        """Compare the errors with the bounds; return True without feedback."""
        feedback = optional_input(self, "tracking_feedback")
        if not isinstance(feedback, FollowPathFeedback):
            return True
        error = feedback.position_error
        limit = self.max_error_left if error >= 0.0 else self.max_error_right
        return abs(error) <= abs(limit) and abs(feedback.heading_error) <= abs(self.max_error_heading)


class AreErrorCodesPresent(Condition):
    """SUCCESS when *error_code* is one of *error_codes_to_check*."""

    error_code: ErrorCode
    error_codes_to_check: ErrorCodes = OPTIONAL

    default_codes: ClassVar[frozenset[int]] = frozenset()
    spec = NodeSpec(optional_inputs=("error_code",))

    def tick(self) -> bool:
        """Compare the code; an entry without a value is not an error."""
        code = optional_input(self, "error_code")
        checked = optional_input(self, "error_codes_to_check")
        codes = set(checked) if isinstance(checked, list | tuple) and checked else self.default_codes
        return isinstance(code, int | float) and int(code) in codes


class WouldAControllerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the controller failed with an error that clearing the local costmap may resolve."""

    default_codes = frozenset(map(int, CONTROLLER_RECOVERY_HELPS))


class WouldAPlannerRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the planner failed with an error that clearing the global costmap may resolve."""

    default_codes = frozenset(map(int, PLANNER_RECOVERY_HELPS))


class WouldASmootherRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when the smoother failed with an error that a retry may resolve."""

    default_codes = frozenset(map(int, SMOOTHER_RECOVERY_HELPS))


class WouldARouteRecoveryHelp(AreErrorCodesPresent):
    """SUCCESS when a route server failed with an error that a retry may resolve."""

    default_codes = ROUTE_RECOVERY_HELPS
