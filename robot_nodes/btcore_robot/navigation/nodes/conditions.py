"""Nav2's conditions on goals, ways, times, and what the robot feels."""

import math
from collections import deque
from typing import Annotated

from btcore import Condition, In, NodeError, Port
from btcore_robot.leaves.poses import Poses
from btcore_robot.navigation.controller import FollowPathFeedback
from btcore_robot.navigation.nodes.nearest_pose import NearestPoseSearch
from btcore_robot.navigation.nodes.port_access import (
    OPTIONAL,
    Goals,
    blackboard_default,
    goals_of,
    is_first_tick,
    optional_input,
    path_input,
    path_input_port,
    pose_input,
)
from btcore_robot.navigation.path import NavPath
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import NS_PER_S, Odometry, Pose2D

BUMP = -10.0
"""The deceleration (m/s²) that nothing but a bump brings about; Nav2's figure."""

Goal = Annotated[In[Pose2D], "The goal."]
Several = Annotated[In[Poses], "The goals."]
BaseFrame = Annotated[In[str], "The robot's frame; base_footprint here."]
GlobalFrame = Annotated[In[str], "The frame of the distance; map here."]


class GoalReached(Condition):
    """SUCCESS when the robot is as near to *goal* as the navigator's tolerance, or nearer."""

    goal: Annotated[In[Pose2D], "The goal."]
    robot_base_frame: BaseFrame = "base_footprint"

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Compare."""
        goal = pose_input(self, "goal")
        return goal is not None and self.servers.distance_to(goal) <= self.servers.goal_tolerance


class GoalUpdated(Condition):
    """SUCCESS when the goal is another than at the last tick; the first tick after a reset only looks."""

    goal: Goal = blackboard_default("goal")
    goals: Several = blackboard_default("goals")

    def __init__(self) -> None:
        self.known: Goals = (None, ())

    def tick(self) -> bool:
        """Look, and compare."""
        goals = goals_of(self)
        changed = goals != self.known and not is_first_tick(self)
        self.known = goals
        return changed


class GlobalUpdatedGoal(Condition):
    """SUCCESS when the goal is another than at the last tick, halts or not; the very first tick succeeds."""

    goal: Goal = blackboard_default("goal")
    goals: Several = blackboard_default("goals")

    def __init__(self) -> None:
        self.known: Goals | None = None

    def tick(self) -> bool:
        """Look, and compare."""
        goals = goals_of(self)
        changed = goals != self.known
        self.known = goals
        return changed


class IsStuck(Condition):
    """SUCCESS when odometry has just slowed down as only a bump can: by more than 10 m/s²."""

    def __init__(self, servers: Servers) -> None:
        self.robot = servers.robot
        self.history: deque[Odometry] = deque(maxlen=10)

    def tick(self) -> bool:
        """Look at the last two readings that differ in time, once there are three."""
        newest = self.robot.odometry()
        if not self.history or newest.stamp > self.history[-1].stamp:
            self.history.append(newest)
        if len(self.history) < 3:
            return False
        before, last = self.history[-2], self.history[-1]
        seconds = (last.stamp - before.stamp) / NS_PER_S
        return (last.twist.v - before.twist.v) / seconds < BUMP


class IsBatteryLow(Condition):
    """SUCCESS when the battery holds *min_battery* or less (a share, 0–1, as in ``BatteryState``)."""

    min_battery: Annotated[In[float], "The share (0–1) that is low."]
    battery_topic: Annotated[In[str], "Where Nav2 hears of the battery."] = "/battery_status"
    is_voltage: Annotated[In[bool], "Whether the figure is a voltage; this robot tells none."] = False

    def __init__(self, servers: Servers) -> None:
        self.robot = servers.robot

    def tick(self) -> bool:
        """Compare; a battery that doesn't tell isn't low."""
        battery = self.robot.battery()
        return battery is not None and not self.is_voltage and battery.level / 100.0 <= self.min_battery


class IsBatteryCharging(Condition):
    """SUCCESS while the battery is charging, as the topic *battery_topic* says."""

    battery_topic: Annotated[In[str], "Where Nav2 hears of the battery."] = "/battery_status"

    def __init__(self, servers: Servers) -> None:
        self.topics = servers.topics

    def tick(self) -> bool:
        """Look."""
        return self.topics.get(self.battery_topic) == "charging"


class DistanceTraveled(Condition):
    """SUCCESS when the robot is *distance* (m) from where it was at the last SUCCESS, or at the start."""

    distance: Annotated[In[float], "How far (m)."] = 1.0
    global_frame: GlobalFrame = "map"
    robot_base_frame: BaseFrame = "base_footprint"

    def __init__(self, servers: Servers) -> None:
        self.servers = servers
        self.start: Pose2D | None = None

    def tick(self) -> bool:
        """Compare."""
        here = self.servers.pose()
        if is_first_tick(self) or self.start is None:
            self.start = here
            return False
        if here is None or math.hypot(here.x - self.start.x, here.y - self.start.y) < self.distance:
            return False
        self.start = here
        return True


class TimeExpired(Condition):
    """SUCCESS when *seconds* have passed since the last SUCCESS, or the start."""

    seconds: Annotated[In[float], "How long (s)."] = 1.0

    def __init__(self) -> None:
        self.since = 0

    def tick(self) -> bool:
        """Look at the clock."""
        now = self.now()
        if is_first_tick(self):
            self.since = now
            return False
        if now - self.since < self.seconds * NS_PER_S:
            return False
        self.since = now
        return True


class PathExpiringTimer(Condition):
    """SUCCESS when *seconds* have passed since the path was last another one, or the last SUCCESS."""

    seconds: Annotated[In[float], "How long (s)."] = 1.0

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path.")]

    def __init__(self) -> None:
        self.since: int | None = None
        self.known: NavPath | None = None

    def tick(self) -> bool:
        """Look at path and clock."""
        now, path = self.now(), path_input(self, "path")
        if self.since is None or path != self.known:
            self.since, self.known = now, path
            return False
        if now - self.since < self.seconds * NS_PER_S:
            return False
        self.since = now
        return True


class TransformAvailable(Condition):
    """SUCCESS when the transform between two frames is known; once it was, always."""

    child: Annotated[In[str], "The one frame."] = ""
    parent: Annotated[In[str], "The other frame."] = ""

    def __init__(self, servers: Servers) -> None:
        self.transforms = servers.transforms
        self.found = False

    def tick(self) -> bool:
        """Look it up. Raises NodeError where a frame isn't named."""
        if not (self.parent and self.child):
            raise NodeError("<TransformAvailable> needs the names of two frames: child and parent")
        self.found = self.found or self.transforms.can_transform(self.parent, self.child)
        return self.found


class InitialPoseReceived(Condition):
    """SUCCESS when the flag is true."""

    initial_pose_received: Annotated[In[bool], "Whether the robot was told where it is."] = (
        blackboard_default("initial_pose_received")
    )

    def tick(self) -> bool:
        """Look; a flag that nobody has written yet isn't true."""
        return bool(optional_input(self, "initial_pose_received"))


class IsGoalNearby(Condition):
    """SUCCESS when what is left of *path* is shorter than *proximity_threshold*."""

    proximity_threshold: Annotated[In[float], "How near (m) counts, along the path."] = 1.0
    max_robot_pose_search_dist: Annotated[
        In[float], "How far (m) along the path from where the robot was it is sought; -1: everywhere."
    ] = -1.0
    global_frame: GlobalFrame = "map"
    robot_base_frame: BaseFrame = "base_footprint"

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path that is followed.")]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers
        self.search = NearestPoseSearch()

    def tick(self) -> bool:
        """Measure; FAILURE without a path, and where the robot doesn't know where it is."""
        path, here = path_input(self, "path"), self.servers.pose()
        if path is None or here is None:
            return False
        nearest = self.search.nearest(path, here, self.max_robot_pose_search_dist)
        along = path.distances()
        return float(along[-1] - along[nearest]) < self.proximity_threshold


class ArePosesNear(Condition):
    """SUCCESS when two poses are no farther than *tolerance* apart."""

    ref_pose: Annotated[In[Pose2D], "The one pose."]
    target_pose: Annotated[In[Pose2D], "The other pose."]
    global_frame: GlobalFrame = "map"
    tolerance: Annotated[In[float], "How near (m)."] = 0.5

    def tick(self) -> bool:
        """Measure."""
        one, other = self.ref_pose, self.target_pose
        return math.hypot(one.x - other.x, one.y - other.y) <= self.tolerance


class IsWithinPathTrackingBounds(Condition):
    """SUCCESS while the robot keeps to its path, to the left and to the right."""

    max_error_left: Annotated[In[float], "How far (m) to the left of the path it may be."] = 0.5
    max_error_right: Annotated[In[float], "How far (m) to the right of the path it may be."] = 0.5
    max_error_heading: Annotated[In[float], "How far (rad) its heading may be off the path's."] = 3.14
    tracking_feedback: Annotated[In[FollowPathFeedback], "What FollowPath tells."] = OPTIONAL

    def tick(self) -> bool:
        """Compare; without feedback all is well."""
        feedback = optional_input(self, "tracking_feedback")
        if not isinstance(feedback, FollowPathFeedback):
            return True
        aside = feedback.position_error
        most = self.max_error_left if aside >= 0.0 else self.max_error_right
        return abs(aside) <= abs(most) and abs(feedback.heading_error) <= abs(self.max_error_heading)
