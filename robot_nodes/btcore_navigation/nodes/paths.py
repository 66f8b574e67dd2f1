"""Nav2's nodes that check and edit paths on the blackboard."""

import math
from typing import Annotated, Any

import numpy as np

from btcore import FAILURE, RUNNING, SUCCESS, In, NodeSpec, NodeType, Out, Status, SyncAction
from btcore.engine.node import read_clock
from btcore_navigation.action import GoalStatus
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigation_servers import (
    AnyGoalHandle,
    CheckPath,
    NavigationServers,
    SmoothedPath,
    SmoothPathGoal,
)
from btcore_navigation.nodes.action_node import (
    BtActionNode,
    BtServiceNode,
    ServersAction,
    ServiceName,
)
from btcore_navigation.nodes.port_access import (
    OPTIONAL,
    optional_input,
    path_input,
    path_port,
    plugin_input,
    pose_input,
    write_outputs,
)
from btcore_navigation.path import NavPath, NearestPoseSearch, empty_path
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.robot import Pose2D

InPath = Annotated[In[NavPath], "Original path."]
OutPath = Annotated[Out[NavPath], "Resulting path."]
MaxCost = Annotated[In[int], "Maximum cost (0–254) of the path: a pose at or above it is a collision."]
UnknownCounts = Annotated[In[bool], "Whether unknown cost counts as an obstacle."]


class TruncatePath(SyncAction):
    """Removes the end of a path: every pose closer than *distance* to the last pose. Always SUCCESS.

    At least two poses stay. The last remaining pose is turned towards the goal.
    """

    spec = NodeSpec(results=frozenset({SUCCESS}))

    input_path: InPath
    distance: Annotated[
        In[float], "Distance (m), in a straight line, before the goal at which the path ends."
    ] = 1.0
    output_path: OutPath = OPTIONAL

    def tick(self) -> bool:
        """Write the truncated path."""
        path = path_input(self, "input_path")
        if path is None:
            write_outputs(self, output_path=empty_path(read_clock(self)))
            return True
        goal = path.points[-1]
        far = np.hypot(*(path.points - goal).T) >= self.distance
        last = int(np.flatnonzero(far)[-1]) if far.any() else 0
        poses = path.poses[: max(last, 1) + 1].copy()
        dx, dy = goal - poses[-1, :2]
        # The last pose may be the goal itself, which keeps its heading.
        if math.hypot(dx, dy) > 0.0:
            poses[-1, 2] = math.atan2(dy, dx)
        write_outputs(self, output_path=NavPath(poses, path.stamp, path.frame))
        return True


class TruncatePathLocal(SyncAction):
    """Keeps the part of a path around the robot, between two distances along the path.

    FAILURE while the robot's pose is unknown.
    """

    input_path: InPath
    distance_forward: Annotated[In[float], "Distance (m) ahead of the robot; -1: to the end."] = 8.0
    distance_backward: Annotated[In[float], "Distance (m) behind the robot."] = 4.0
    pose: Annotated[In[Pose2D], "The robot's pose; by default the localiser's."] = OPTIONAL
    robot_base_frame: Annotated[In[str], "Robot base frame; always base_footprint here."] = "base_footprint"
    transform_tolerance: Annotated[In[float], "Maximum age (s) of the robot's pose; not used here."] = 0.2
    angular_distance_weight: Annotated[In[float], "Weight (m/rad) of the heading error in the search."] = 0.0
    max_robot_pose_search_dist: Annotated[
        In[float], "Maximum distance (m) along the path to search for the robot's pose; inf: the whole path."
    ] = math.inf
    output_path: OutPath = OPTIONAL

    spec = NodeSpec(state_fields=("search",))

    def __init__(self, servers: NavigationServers) -> None:
        self.servers = servers
        self.search = NearestPoseSearch()

    def tick(self) -> bool:
        """Find the robot on the path and write the part around it."""
        path = path_input(self, "input_path")
        here = pose_input(self, "pose") or self.servers.pose()
        if here is None:
            return False
        if path is None:
            write_outputs(self, output_path=empty_path(read_clock(self)))
            return True
        along = path.distances()
        reach, turn = self.max_robot_pose_search_dist, self.angular_distance_weight
        at = along[self.search.nearest(path, here, reach, turn)]
        forward = self.distance_forward if self.distance_forward >= 0.0 else math.inf
        kept = (along >= at - self.distance_backward) & (along <= at + forward)
        write_outputs(self, output_path=NavPath(path.poses[kept], path.stamp, path.frame))
        return True


class _PathValidation(BtServiceNode):
    """Base of the nodes that request whether a path is valid."""

    spec = NodeSpec(optional_inputs=("path",))

    provided_ports = path_port("Path to check.")

    def on_start(self) -> Status:
        """Send the request; return FAILURE for a missing or empty path."""
        if path_input(self, "path") is None:
            self.on_failure()
            return FAILURE
        return super().on_start()

    def on_response(self, value: Any) -> bool:
        """Return whether the path is valid."""
        return bool(value.valid)


class ValidatePath(_PathValidation):
    """SUCCESS while *path* is free of collisions according to the global costmap."""

    max_cost: MaxCost = 254
    consider_unknown_as_obstacle: UnknownCounts = False
    layer_name: Annotated[In[str], "Costmap layer to check; navigation in this process checks all."] = ""
    footprint: Annotated[
        In[str], "Footprint to check; navigation in this process checks the robot's circle."
    ] = ""
    stop_at_first_collision: Annotated[In[bool], "Whether to report the first collision only."] = True
    max_lookahead_distance: Annotated[
        In[float], "Maximum distance (m) ahead of the robot to check; -1: to the end of the path."
    ] = -1.0
    service_name: ServiceName = ""
    collision_poses: Annotated[Out[Poses], "Poses of the path that are in collision."] = OPTIONAL

    def send(self) -> AnyGoalHandle:
        """Request a check of the path from the robot's pose on."""
        request = CheckPath(
            path_input(self, "path") or empty_path(read_clock(self)),
            self.max_cost,
            self.consider_unknown_as_obstacle,
            self.layer_name,
            self.footprint,
            self.stop_at_first_collision,
            self.max_lookahead_distance,
        )
        return self.servers.request(request, self.service_name)

    def on_response(self, value: Any) -> bool:
        """Write the poses in collision."""
        write_outputs(self, collision_poses=list(value.collisions))
        return bool(value.valid)

    def on_failure(self) -> None:
        """Write an empty list."""
        write_outputs(self, collision_poses=[])


class IsPathValid(_PathValidation):
    """The predecessor of ValidatePath in Nav2 up to the release kilted: SUCCESS while *path* is valid."""

    spec = NodeSpec(node_type=NodeType.CONDITION)

    max_cost: MaxCost = 254
    consider_unknown_as_obstacle: UnknownCounts = False

    def send(self) -> AnyGoalHandle:
        """Request a check of the path from the robot's pose on."""
        path = path_input(self, "path") or empty_path(read_clock(self))
        return self.servers.request(CheckPath(path, self.max_cost, self.consider_unknown_as_obstacle))


class SmoothPath(BtActionNode):
    """Smooths a path. FAILURE without a path.

    Navigation in this process writes the path unchanged, because its planner's paths are smooth already.
    """

    action = "smooth_path"
    # A goal that another client cancels has no path.
    spec = NodeSpec(
        may_complete_on_start=True, writes=("smoothed_path", "smoothing_duration", "was_completed")
    )

    unsmoothed_path: InPath
    max_smoothing_duration: Annotated[In[float], "Maximum smoothing duration (s)."] = 3.0
    check_for_collisions: Annotated[In[bool], "Whether to check the result for collisions."] = False
    smoother_id: Annotated[In[str], "Smoother plug-in."] = ""
    smoothed_path: OutPath = OPTIONAL
    smoothing_duration: Annotated[Out[float], "Time (s) taken to smooth the path."] = OPTIONAL
    was_completed: Annotated[Out[bool], "True if smoothing was not interrupted."] = OPTIONAL

    def tick(self) -> Status:
        """Start or continue to smooth the path. A completed node starts again."""
        return self.on_running() if self.status is RUNNING else self.on_start()

    def on_start(self) -> Status:
        """Send the goal; return FAILURE without a path."""
        if path_input(self, "unsmoothed_path") is None:
            self.report(int(Nav2ErrorCode.SMOOTH_INVALID_PATH), "there is no path to smooth")
            write_outputs(self, was_completed=False)
            return FAILURE
        return super().on_start()

    def make_goal(self) -> SmoothPathGoal:
        """Return a goal with the path."""
        path = path_input(self, "unsmoothed_path")
        assert path is not None, "checked by on_start"
        return SmoothPathGoal(
            path,
            plugin_input(self, "smoother_id"),
            self.max_smoothing_duration,
            self.check_for_collisions,
        )

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the smooth path."""
        smoothed = handle.result.value if handle.result is not None else None
        if isinstance(smoothed, SmoothedPath):
            write_outputs(self, smoothing_duration=smoothed.duration, was_completed=smoothed.was_completed)
            if handle.status is GoalStatus.SUCCEEDED:
                write_outputs(self, smoothed_path=smoothed.path)


class GetPoseFromPath(SyncAction):
    """Writes the pose of a path at *index*; a negative index counts from the end. FAILURE if none exists."""

    index: Annotated[In[int], "Index of the pose, from 0."] = 0
    pose: Annotated[Out[Pose2D], "The pose."] = OPTIONAL

    provided_ports = path_port("Path to take the pose from.")

    def tick(self) -> bool:
        """Write the pose."""
        path = path_input(self, "path")
        if path is None or not -len(path) <= self.index < len(path):
            return False
        write_outputs(self, pose=path[self.index])
        return True


class GetCurrentPose(ServersAction):
    """Writes the robot's pose. FAILURE while the pose is unknown."""

    global_frame: Annotated[In[str], "Global frame; always map here."] = "map"
    robot_base_frame: Annotated[In[str], "Robot base frame; always base_footprint here."] = "base_footprint"
    current_pose: Annotated[Out[Pose2D], "The robot's pose."] = OPTIONAL

    def tick(self) -> bool:
        """Write the localiser's pose."""
        here = self.servers.pose()
        if here is None:
            return False
        write_outputs(self, current_pose=here)
        return True


class ConcatenatePaths(SyncAction):
    """Joins two paths: all poses of the first, then all poses of the second. FAILURE when both are empty.

    The joined path has the frame and the time of planning of the first path, as in Nav2.
    """

    input_path1: InPath
    input_path2: InPath
    output_path: OutPath = OPTIONAL

    def tick(self) -> bool:
        """Write the joined path."""
        inputs = optional_input(self, "input_path1"), optional_input(self, "input_path2")
        paths = [path for path in inputs if isinstance(path, NavPath)]
        if not any(map(len, paths)):
            return False
        poses = np.concatenate([path.poses for path in paths])
        write_outputs(self, output_path=NavPath(poses, paths[0].stamp, paths[0].frame))
        return True
