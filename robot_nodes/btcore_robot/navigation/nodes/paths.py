"""Nav2's nodes that work on the paths of the blackboard."""

import math
from typing import Annotated

import numpy as np

from btcore import Condition, In, Out, Port, SyncAction
from btcore_robot.leaves.poses import Poses
from btcore_robot.navigation.costmap import LETHAL, UNKNOWN
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.nodes.action_node import ErrorCode, ErrorMsg, ServerName, ServerTimeout
from btcore_robot.navigation.nodes.nearest_pose import NearestPoseSearch
from btcore_robot.navigation.nodes.port_access import (
    OPTIONAL,
    path_input,
    path_input_port,
    pose_input,
    write_outputs,
)
from btcore_robot.navigation.path import NavPath, empty_path, join_paths
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import Pose2D

InPath = Annotated[In[NavPath], "The path."]
OutPath = Annotated[Out[NavPath], "The path that results."]
UnknownCounts = Annotated[In[bool], "Whether what isn't known counts as an obstacle."]


class TruncatePath(SyncAction):
    """Leave out the end of a path: every pose nearer than *distance* to the last. Always SUCCESS.

    Two poses stay in any case. The last one that is left looks to the goal.
    """

    input_path: InPath
    distance: Annotated[In[float], "How much (m) is left out, as the crow flies."] = 1.0
    output_path: OutPath = OPTIONAL

    def tick(self) -> bool:
        """Cut."""
        path = path_input(self, "input_path")
        if path is None:
            write_outputs(self, output_path=empty_path(self.now()))
            return True
        goal = path.points[-1]
        far = np.hypot(*(path.points - goal).T) >= self.distance
        last = int(np.flatnonzero(far)[-1]) if far.any() else 0
        poses = path.poses[: max(last, 1) + 1].copy()
        dx, dy = goal - poses[-1, :2]
        if math.hypot(dx, dy) > 0.0:
            poses[-1, 2] = math.atan2(dy, dx)
        write_outputs(self, output_path=NavPath(poses, path.stamp, path.frame))
        return True


class TruncatePathLocal(SyncAction):
    """Keep the part of a path around the robot: so far ahead and so far back, along the path.

    FAILURE where the robot doesn't know where it is.
    """

    input_path: InPath
    distance_forward: Annotated[In[float], "How far (m) ahead; -1: to the end."] = 8.0
    distance_backward: Annotated[In[float], "How far (m) back."] = 4.0
    pose: Annotated[In[Pose2D], "Where the robot is, if it isn't to be asked."] = OPTIONAL
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"
    transform_tolerance: Annotated[In[float], "How old (s) the robot's place may be."] = 0.2
    angular_distance_weight: Annotated[In[float], "How much (m/rad) a heading that is off counts."] = 0.0
    max_robot_pose_search_dist: Annotated[
        In[float], "How far (m) along the path from where the robot was it is sought; inf: everywhere."
    ] = math.inf
    output_path: OutPath = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers
        self.search = NearestPoseSearch()

    def tick(self) -> bool:
        """Find the robot on the path, and cut."""
        path = path_input(self, "input_path")
        here = pose_input(self, "pose") or self.servers.pose()
        if here is None:
            return False
        if path is None:
            write_outputs(self, output_path=empty_path(self.now()))
            return True
        along = path.distances()
        reach, turn = self.max_robot_pose_search_dist, self.angular_distance_weight
        at = along[self.search.nearest(path, here, reach, turn)]
        forward = self.distance_forward if self.distance_forward >= 0.0 else math.inf
        kept = (along >= at - self.distance_backward) & (along <= at + forward)
        write_outputs(self, output_path=NavPath(path.poses[kept], path.stamp, path.frame))
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
    server_timeout: ServerTimeout = 20
    collision_poses: Annotated[Out[Poses], "Where something is in the way."] = OPTIONAL

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path.")]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Look along the path, from where the robot is; FAILURE for a path of no poses."""
        path = path_input(self, "path")
        reach = self.max_lookahead_distance
        found: list[Pose2D] = []
        if path is not None:
            found = in_the_way(self.servers, path, self.max_cost, self.consider_unknown_as_obstacle, reach)
        write_outputs(self, collision_poses=found[:1] if self.stop_at_first_collision else found)
        return path is not None and not found


class IsPathValid(Condition):
    """The condition that Nav2 had in place of ValidatePath up to humble."""

    max_cost: Annotated[In[int], "The greatest cost (0–254) that a path may have under the robot."] = 254
    consider_unknown_as_obstacle: UnknownCounts = False
    server_timeout: ServerTimeout = 20

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path.")]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Look along the path, from where the robot is."""
        path, unknown = path_input(self, "path"), self.consider_unknown_as_obstacle
        return path is not None and not in_the_way(self.servers, path, self.max_cost, unknown)


def in_the_way(
    servers: Servers, path: NavPath, max_cost: int, unknown: bool, reach: float = -1.0
) -> list[Pose2D]:
    """The poses of *path* from the robot on, *reach* (m) along it or all, at which the robot can't be.

    *unknown* tells that what isn't known is in the way too.
    """
    here = servers.pose()
    start = path.nearest(here.x, here.y) if here is not None else 0
    ahead = path.poses[start:]
    if reach >= 0.0:
        along = path.distances()[start:]
        ahead = ahead[along - along[0] <= reach]
    costs = servers.global_costmap.costs_at(ahead[:, :2])
    # A circle is in collision where its middle is within its radius of an obstacle: cost 253.
    bad = (costs >= min(max_cost, LETHAL - 1)) & (costs != UNKNOWN)
    if unknown:
        bad |= costs == UNKNOWN
    return [Pose2D(float(x), float(y), float(yaw)) for x, y, yaw in ahead[bad]]


class SmoothPath(SyncAction):
    """Hand on the path: the planner of this stack smooths its paths itself."""

    unsmoothed_path: InPath
    max_smoothing_duration: Annotated[In[float], "How long (s) it may take."] = 3.0
    check_for_collisions: Annotated[In[bool], "Whether the result is checked."] = False
    smoother_id: Annotated[In[str], "The plug-in."] = ""
    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    smoothed_path: OutPath = OPTIONAL
    smoothing_duration: Annotated[Out[float], "How long (s) it took."] = OPTIONAL
    was_completed: Annotated[Out[bool], "Whether it came to its end."] = OPTIONAL
    error_code_id: ErrorCode = OPTIONAL
    error_msg: ErrorMsg = OPTIONAL

    def tick(self) -> bool:
        """Hand it on."""
        path = path_input(self, "unsmoothed_path")
        if path is None:
            code = int(Nav2ErrorCode.SMOOTH_INVALID_PATH)
            write_outputs(
                self, error_code_id=code, error_msg="there is no path to smooth", was_completed=False
            )
            return False
        write_outputs(
            self,
            smoothed_path=path,
            smoothing_duration=0.0,
            was_completed=True,
            error_code_id=0,
            error_msg="",
        )
        return True


class GetPoseFromPath(SyncAction):
    """Write the pose *index* of a path; a negative one counts from the end. FAILURE where there is none."""

    index: Annotated[In[int], "Which, from 0."] = 0
    pose: Annotated[Out[Pose2D], "The pose."] = OPTIONAL

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path.")]

    def tick(self) -> bool:
        """Take it."""
        path = path_input(self, "path")
        if path is None or not -len(path) <= self.index < len(path):
            return False
        write_outputs(self, pose=path[self.index])
        return True


class GetCurrentPose(SyncAction):
    """Write where the robot is; FAILURE where it doesn't know."""

    global_frame: Annotated[In[str], "The frame of the pose; map here."] = "map"
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"
    current_pose: Annotated[Out[Pose2D], "Where the robot is."] = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Ask."""
        here = self.servers.pose()
        if here is None:
            return False
        write_outputs(self, current_pose=here)
        return True


class ConcatenatePaths(SyncAction):
    """Write the second path behind the first. FAILURE when both are empty."""

    input_path1: InPath
    input_path2: InPath
    output_path: OutPath = OPTIONAL

    def tick(self) -> bool:
        """Join."""
        paths = [
            path for port in ("input_path1", "input_path2") if (path := path_input(self, port)) is not None
        ]
        if not paths:
            return False
        write_outputs(self, output_path=join_paths(paths, self.now()))
        return True
