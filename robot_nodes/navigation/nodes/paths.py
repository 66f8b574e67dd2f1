"""Nav2's nodes that work on the paths and goals of the blackboard."""

import math
from typing import Annotated

import numpy as np

from btcore import In, Out, Port, SyncAction
from robot_nodes.navigation.costmap import LETHAL, UNKNOWN
from robot_nodes.navigation.nodes.inputs import path_at, path_in, pose_at, poses_at, tell
from robot_nodes.navigation.nodes.serving import ServerName, ServerTimeout
from robot_nodes.navigation.path import NavPath, joined
from robot_nodes.navigation.servers import Servers
from robot_nodes.robot import Pose2D

InPath = Annotated[In[NavPath], "The path."]
OutPath = Annotated[Out[NavPath], "The path that results."]
InGoals = Annotated[In[list[Pose2D]], "The goals."]
OutGoals = Annotated[Out[list[Pose2D]], "The goals that are left."]
UnknownCounts = Annotated[In[bool], "Whether what isn't known counts as an obstacle."]
Threshold = Annotated[In[float], "The cost (0–254) from which on a place counts as taken."]


class TruncatePath(SyncAction):
    """Leave out the end of a path: every pose nearer than *distance* to the last. Always SUCCESS.

    The last pose that is left looks to the goal.
    """

    input_path: InPath
    distance: Annotated[In[float], "How much (m) is left out, as the crow flies."] = 1.0
    output_path: OutPath

    def tick(self) -> bool:
        """Cut."""
        path = path_at(self, "input_path")
        if path is None:
            return True
        goal = path.points[-1]
        far = np.hypot(*(path.points - goal).T) >= self.distance
        last = int(np.flatnonzero(far)[-1]) if far.any() else 0
        poses = path.poses[: last + 1].copy()
        dx, dy = goal - poses[-1, :2]
        if math.hypot(dx, dy) > 0.0:
            poses[-1, 2] = math.atan2(dy, dx)
        self.output_path = NavPath(poses, path.stamp, path.frame)
        return True


class TruncatePathLocal(SyncAction):
    """Keep the part of a path around the robot: so far ahead and so far back, along the path.

    FAILURE where the robot doesn't know where it is.
    """

    input_path: InPath
    distance_forward: Annotated[In[float], "How far (m) ahead; -1: to the end."] = 8.0
    distance_backward: Annotated[In[float], "How far (m) back."] = 4.0
    pose: Annotated[In[Pose2D], "Where the robot is, if it isn't to be asked."]
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"
    transform_tolerance: Annotated[In[float], "How old (s) the robot's place may be."] = 0.2
    angular_distance_weight: Annotated[In[float], "How much (m/rad) a heading that is off counts."] = 0.0
    max_robot_pose_search_dist: Annotated[In[float], "How far (m) ahead the robot is sought."] = math.inf
    output_path: OutPath

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Find the robot on the path, and cut."""
        path = path_at(self, "input_path")
        here = pose_at(self, "pose") or self.servers.pose()
        if path is None or here is None:
            return False
        along = path.distances()
        off = np.hypot(path.poses[:, 0] - here.x, path.poses[:, 1] - here.y)
        off += self.angular_distance_weight * np.abs(
            np.remainder(path.poses[:, 2] - here.yaw + np.pi, 2 * np.pi) - np.pi
        )
        reach = self.max_robot_pose_search_dist
        searched = len(off) if reach < 0 or math.isinf(reach) else int(np.searchsorted(along, reach, "right"))
        nearest = int(np.argmin(off[:searched]))
        forward = self.distance_forward
        most = along[-1] if forward < 0 else along[nearest] + forward
        kept = (along >= along[nearest] - self.distance_backward) & (along <= most)
        self.output_path = NavPath(path.poses[kept], path.stamp, path.frame)
        return True


class ValidatePath(SyncAction):
    """SUCCESS while nothing on *path* is in the way of the robot, by the global costmap."""

    max_cost: Annotated[In[int], "The greatest cost (0–254) that a path may have under the robot."] = 254
    consider_unknown_as_obstacle: UnknownCounts = False
    layer_name: Annotated[In[str], "The layer to look at; all together here."] = ""
    footprint: Annotated[In[str], "Another footprint; the robot's circle here."] = ""
    stop_at_first_collision: Annotated[In[bool], "Whether one place in the way is enough."] = True
    max_lookahead_distance: Annotated[
        In[float], "How far (m) along the path is looked; -1: to the end."
    ] = -1.0
    service_name: ServerName = ""
    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    collision_poses: Annotated[Out[list[Pose2D]], "Where something is in the way."]

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_in("The path.")]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Look along the path, from where the robot is."""
        path = path_at(self, "path")
        if path is None:
            return False
        here = self.servers.pose()
        start = path.nearest(here.x, here.y) if here is not None else 0
        ahead = path.poses[start:]
        if self.max_lookahead_distance >= 0.0:
            along = path.distances()[start:]
            ahead = ahead[along - along[0] <= self.max_lookahead_distance]
        costs = self.servers.global_costmap.costs_at(ahead[:, :2])
        # A circle is in collision where its middle is within its radius of an obstacle: cost 253.
        bad = (costs >= min(self.max_cost, LETHAL - 1)) & (costs != UNKNOWN)
        if self.consider_unknown_as_obstacle:
            bad |= costs == UNKNOWN
        found = [Pose2D(float(x), float(y), float(yaw)) for x, y, yaw in ahead[bad]]
        tell(self, collision_poses=found[:1] if self.stop_at_first_collision else found)
        return not found


class IsPathValid(ValidatePath):
    """ValidatePath under the name that Nav2 had for it up to humble."""


class SmoothPath(SyncAction):
    """Hand on the path: the planner of this stack smooths its paths itself."""

    unsmoothed_path: InPath
    max_smoothing_duration: Annotated[In[float], "How long (s) it may take."] = 3.0
    check_for_collisions: Annotated[In[bool], "Whether the result is checked."] = False
    smoother_id: Annotated[In[str], "The plug-in."] = ""
    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    smoothed_path: OutPath
    smoothing_duration: Annotated[Out[float], "How long (s) it took."]
    was_completed: Annotated[Out[bool], "Whether it came to its end."]
    error_code_id: Annotated[Out[int], "Nav2's number of what went wrong; 0 when nothing did."]
    error_msg: Annotated[Out[str], "What went wrong, in words."]

    def tick(self) -> bool:
        """Hand it on."""
        path = path_at(self, "unsmoothed_path")
        if path is None:
            tell(self, error_code_id=505, error_msg="there is no path to smooth", was_completed=False)
            return False
        tell(
            self,
            smoothed_path=path,
            smoothing_duration=0.0,
            was_completed=True,
            error_code_id=0,
            error_msg="",
        )
        return True


class RemovePassedGoals(SyncAction):
    """Leave out the first goals as long as the robot is nearer than *radius* to them; the last one stays."""

    input_goals: InGoals
    radius: Annotated[In[float], "How near (m) is passed."] = 0.5
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"
    output_goals: OutGoals

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Leave out; FAILURE where the robot doesn't know where it is."""
        goals = list(poses_at(self, "input_goals"))
        if goals and self.servers.pose() is None:
            return False
        while len(goals) > 1 and self.servers.distance_to(goals[0]) <= self.radius:
            del goals[0]
        self.output_goals = goals
        return True


class RemoveInCollisionGoals(SyncAction):
    """Leave out the goals at which something is in the way, by the global costmap."""

    input_goals: InGoals
    cost_threshold: Threshold = 254.0
    use_footprint: Annotated[In[bool], "Whether the robot's size counts."] = True
    consider_unknown_as_obstacle: UnknownCounts = False
    service_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    output_goals: OutGoals

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Look at every goal."""
        self.output_goals = [
            goal
            for goal in poses_at(self, "input_goals")
            if not occupied(
                self.servers, goal, self.cost_threshold, self.use_footprint, self.consider_unknown_as_obstacle
            )
        ]
        return True


class CheckPoseOccupancy(SyncAction):
    """SUCCESS when nothing is in the way at *pose*."""

    pose: Annotated[In[Pose2D], "The place."]
    cost_threshold: Threshold = 254.0
    use_footprint: Annotated[In[bool], "Whether the robot's size counts."] = True
    consider_unknown_as_obstacle: UnknownCounts = False
    service_name: ServerName = ""
    server_timeout: ServerTimeout = 20

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Look."""
        return not occupied(
            self.servers,
            self.pose,
            self.cost_threshold,
            self.use_footprint,
            self.consider_unknown_as_obstacle,
        )


class GetPoseFromPath(SyncAction):
    """Write the pose *index* of a path; a negative one counts from the end. FAILURE where there is none."""

    index: Annotated[In[int], "Which, from 0."] = 0
    pose: Annotated[Out[Pose2D], "The pose."]

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_in("The path.")]

    def tick(self) -> bool:
        """Take it."""
        path = path_at(self, "path")
        if path is None or not -len(path) <= self.index < len(path):
            return False
        self.pose = path[self.index]
        return True


class GetCurrentPose(SyncAction):
    """Write where the robot is; FAILURE where it doesn't know."""

    global_frame: Annotated[In[str], "The frame of the pose; map here."] = "map"
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"
    current_pose: Annotated[Out[Pose2D], "Where the robot is."]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Ask."""
        here = self.servers.pose()
        if here is None:
            return False
        self.current_pose = here
        return True


class ConcatenatePaths(SyncAction):
    """Write the second path behind the first. FAILURE when both are empty."""

    input_path1: InPath
    input_path2: InPath
    output_path: OutPath

    def tick(self) -> bool:
        """Join."""
        paths = [path for port in ("input_path1", "input_path2") if (path := path_at(self, port)) is not None]
        if not paths:
            return False
        self.output_path = joined(paths, self.now())
        return True


class AppendGoalPoseToGoals(SyncAction):
    """Write the goals with one more at their end."""

    goal_pose: Annotated[In[Pose2D], "The goal to append."]
    input_goals: InGoals
    output_goals: OutGoals

    def tick(self) -> bool:
        """Append."""
        self.output_goals = [*poses_at(self, "input_goals"), self.goal_pose]
        return True


class GetNextFewGoals(SyncAction):
    """Write the first *num_goals* of the goals."""

    num_goals: Annotated[In[int], "How many."]
    input_goals: InGoals
    output_goals: OutGoals

    def tick(self) -> bool:
        """Take them; FAILURE where there are none."""
        goals = list(poses_at(self, "input_goals"))[: self.num_goals]
        self.output_goals = goals
        return bool(goals)


def occupied(servers: Servers, place: Pose2D, threshold: float, footprint: bool, unknown: bool) -> bool:
    """Whether the robot (with *footprint*), or its middle, can't be at *place* by the global costmap."""
    cost = servers.global_costmap.cost(place.x, place.y)
    if cost == UNKNOWN:
        return unknown
    return cost >= (min(threshold, LETHAL - 1) if footprint else threshold)
