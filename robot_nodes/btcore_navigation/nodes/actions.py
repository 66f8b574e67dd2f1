"""Nav2's action nodes: path planning, path following, recovery behaviours and navigation."""

from dataclasses import replace
from typing import Annotated

from btcore import Direction, In, NodeSpec, Out
from btcore.engine.node import read_clock
from btcore_navigation.action import GoalStatus
from btcore_navigation.behaviours import BackUpGoal, DriveOnHeadingGoal, SpinGoal, WaitGoal
from btcore_navigation.controller import FollowPathFeedback, FollowPathGoal
from btcore_navigation.navigate_goal import NavigateGoal
from btcore_navigation.navigation_servers import AnyGoalHandle
from btcore_navigation.nodes.action_node import BtActionNode, count_recovery
from btcore_navigation.nodes.port_access import (
    OPTIONAL,
    optional_input,
    path_input,
    path_port,
    plugin_input,
    pose_input,
    poses_input,
    write_outputs,
)
from btcore_navigation.path import NavPath, empty_path
from btcore_navigation.planner import ComputePathGoal
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.robot import Pose2D

ALL_GOALS = -1
"""Nav2's value of `last_reached_index` for a path that reaches all goals."""

Allowance = Annotated[In[float], "Allowed time (s) for the behaviour."]
Unchecked = Annotated[In[bool], "Disable collision checking."]


BASE = frozenset({"base"})
"""What the nodes that drive the robot use."""


class _PlanningNode(BtActionNode):
    """Base of the planning nodes: on failure and on a halt the path becomes empty."""

    spec = NodeSpec(writes_on_halt=("path", "last_reached_index"))

    planner_id: Annotated[In[str], "Planner plug-in: GridBased or empty."] = ""

    provided_ports = path_port("Path created by the planner; empty when there is none.", Direction.OUT)

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the planned path, or an empty path."""
        path = handle.result.value if handle.result is not None else None
        if handle.status is GoalStatus.SUCCEEDED and isinstance(path, NavPath):
            self.write(path)
        else:
            self.write(empty_path(read_clock(self)))

    def on_halted(self) -> None:
        """Cancel the goal and write an empty path."""
        super().on_halted()
        self.write(empty_path(read_clock(self)))

    def write(self, path: NavPath) -> None:
        """Write *path* to the output port."""
        write_outputs(self, path=path)


class ComputePathToPose(_PlanningNode):
    """Plans a path to *goal*, through *viapoints* if there are any."""

    action = "compute_path_to_pose"

    goal: Annotated[In[Pose2D], "Destination to plan to."]
    start: Annotated[In[Pose2D], "Start pose of the path; by default the robot's pose."] = OPTIONAL
    use_start: Annotated[In[bool], "False: ignore start and plan from the robot's pose."] = OPTIONAL
    viapoints: Annotated[In[Poses], "Poses to pass on the way."] = OPTIONAL

    def make_goal(self) -> ComputePathGoal:
        """Return a goal with the viapoints followed by the destination."""
        start = pose_input(self, "start") if optional_input(self, "use_start") is not False else None
        return ComputePathGoal(
            (*poses_input(self, "viapoints"), self.goal), start, plugin_input(self, "planner_id")
        )


class ComputePathThroughPoses(_PlanningNode):
    """Plans a path through *goals*, in order."""

    action = "compute_path_through_poses"

    goals: Annotated[In[Poses], "Destinations to plan through, in order."]
    start: Annotated[In[Pose2D], "Start pose of the path; by default the robot's pose."] = OPTIONAL
    last_reached_index: Annotated[
        Out[int], "Index of the last goal that a partial path reaches; -1 for a complete path and for none."
    ] = OPTIONAL

    def make_goal(self) -> ComputePathGoal:
        """Return a goal with all destinations."""
        return ComputePathGoal(
            poses_input(self, "goals"),
            pose_input(self, "start"),
            plugin_input(self, "planner_id"),
            through=True,
        )

    def write(self, path: NavPath) -> None:
        """Write *path*. The index is always -1: this planner returns complete paths only."""
        super().write(path)
        write_outputs(self, last_reached_index=ALL_GOALS)


class FollowPath(BtActionNode):
    """Follows *path*. A new path or plug-in is taken over without a stop while the robot drives."""

    action = "follow_path"
    spec = NodeSpec(uses=BASE, writes=("tracking_feedback",))

    controller_id: Annotated[In[str], "Controller plug-in: FollowPath or empty."] = ""
    goal_checker_id: Annotated[In[str], "Goal checker plug-in."] = ""
    progress_checker_id: Annotated[In[str], "Progress checker plug-in."] = ""
    path_handler_id: Annotated[In[str], "Path handler plug-in."] = ""
    tracking_feedback: Annotated[
        Out[FollowPathFeedback], "Tracking feedback: remaining path length and deviation from the path."
    ] = OPTIONAL

    provided_ports = path_port("Path to follow.")

    def make_goal(self) -> FollowPathGoal:
        """Return a goal with the current path and plug-ins."""
        path = path_input(self, "path")
        return FollowPathGoal(
            path if path is not None else empty_path(read_clock(self)),
            plugin_input(self, "controller_id"),
            plugin_input(self, "goal_checker_id"),
            plugin_input(self, "progress_checker_id"),
            plugin_input(self, "path_handler_id"),
        )

    def on_wait_for_result(self, handle: AnyGoalHandle) -> None:
        """Write the feedback; send the goal again when its path or a plug-in has changed."""
        if handle.feedback is not None:
            write_outputs(self, tracking_feedback=handle.feedback)
        goal = self.make_goal()
        # Without a path, for example while a new path is planned, the current path stays.
        if not len(goal.path):
            goal = replace(goal, path=handle.goal.path)
        if goal != handle.goal:
            self.send(goal)

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Reset the tracking feedback, because no path is followed any more."""
        write_outputs(self, tracking_feedback=FollowPathFeedback())


class _RecoveryAction(BtActionNode):
    """Base of the behaviours that count as recoveries."""

    spec = NodeSpec(writes=("number_recoveries",))

    def make_goal(self) -> object:
        """Count the recovery and return the subclass's goal."""
        if optional_input(self, "is_recovery") is not False:
            count_recovery(self._blackboard)
        return self.behaviour()

    def behaviour(self) -> object:
        """Return the goal to send to the behaviour's server."""
        raise NotImplementedError


class Spin(_RecoveryAction):
    """Turns on the spot by *spin_dist* (rad, positive to the left)."""

    action = "spin"
    spec = NodeSpec(uses=BASE)

    spin_dist: Annotated[In[float], "Spin distance (rad), positive to the left."] = 1.57
    time_allowance: Allowance = 10.0
    is_recovery: Annotated[In[bool], "True if the spin counts as a recovery."] = True
    disable_collision_checks: Unchecked = False

    def behaviour(self) -> SpinGoal:
        """Return the goal of the turn."""
        return SpinGoal(self.spin_dist, self.time_allowance, self.disable_collision_checks)


class BackUp(_RecoveryAction):
    """Drives backwards by *backup_dist* (m) at *backup_speed* (m/s), both positive."""

    action = "backup"
    spec = NodeSpec(uses=BASE)

    backup_dist: Annotated[In[float], "Distance to back up (m)."] = 0.15
    backup_speed: Annotated[In[float], "Speed at which to back up (m/s)."] = 0.025
    time_allowance: Allowance = 10.0
    disable_collision_checks: Unchecked = False

    def behaviour(self) -> BackUpGoal:
        """Return the goal of backing up."""
        return BackUpGoal(
            self.backup_dist, self.backup_speed, self.time_allowance, self.disable_collision_checks
        )


class DriveOnHeading(BtActionNode):
    """Drives straight ahead by *dist_to_travel* (m) at *speed* (m/s)."""

    action = "drive_on_heading"
    spec = NodeSpec(uses=BASE)

    dist_to_travel: Annotated[In[float], "Distance to travel (m)."] = 0.15
    speed: Annotated[In[float], "Speed at which to travel (m/s)."] = 0.025
    time_allowance: Allowance = 10.0
    disable_collision_checks: Unchecked = False

    def make_goal(self) -> DriveOnHeadingGoal:
        """Return the goal of driving straight ahead."""
        return DriveOnHeadingGoal(
            self.dist_to_travel, self.speed, self.time_allowance, self.disable_collision_checks
        )


class Wait(_RecoveryAction):
    """Waits for *wait_duration* (s); its sign is ignored."""

    action = "wait"

    wait_duration: Annotated[In[float], "Wait time (s)."] = 1.0

    def behaviour(self) -> WaitGoal:
        """Return the goal of waiting."""
        return WaitGoal(abs(self.wait_duration))


class NavigateToPose(BtActionNode):
    """Navigates to *goal* by the navigator's default tree or by *behavior_tree*."""

    action = "navigate_to_pose"
    spec = NodeSpec(uses=BASE)

    goal: Annotated[In[Pose2D], "Destination to plan to."]
    behavior_tree: Annotated[In[str], "Behavior tree file to run; empty: the navigator's default."] = ""

    def make_goal(self) -> NavigateGoal:
        """Return the navigator's goal object for *goal*."""
        return NavigateGoal((self.goal,), self.behavior_tree)


class NavigateThroughPoses(BtActionNode):
    """Navigates through *goals* by the navigator's default tree or by *behavior_tree*."""

    action = "navigate_through_poses"
    spec = NodeSpec(uses=BASE)

    goals: Annotated[In[Poses], "Destinations to plan through, in order."]
    behavior_tree: Annotated[In[str], "Behavior tree file to run; empty: the navigator's default."] = ""

    def make_goal(self) -> NavigateGoal:
        """Return the navigator's goal object for *goals*."""
        return NavigateGoal(poses_input(self, "goals"), self.behavior_tree, through=True)
