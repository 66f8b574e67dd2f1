"""Nav2's nodes that move the robot: following a path, recoveries, navigating."""

from dataclasses import replace
from typing import Annotated, Any

from btcore import In, Out, Port
from btcore_robot.leaves.poses import Poses
from btcore_robot.navigation.action import ActionServer
from btcore_robot.navigation.behaviours import BackUpGoal, DriveOnHeadingGoal, SpinGoal, WaitGoal
from btcore_robot.navigation.controller import FollowPathFeedback, FollowPathGoal
from btcore_robot.navigation.nodes.action_node import (
    BtActionNode,
    ErrorCode,
    ErrorMsg,
    ServerName,
    ServerTimeout,
    count_recovery,
)
from btcore_robot.navigation.nodes.port_access import (
    OPTIONAL,
    optional_input,
    path_input,
    path_input_port,
    plugin_input,
    poses_input,
    write_outputs,
)
from btcore_robot.navigation.path import empty_path
from btcore_robot.navigation.servers import AnyGoalHandle, Servers
from btcore_robot.robot import Pose2D

Allowance = Annotated[In[float], "How long (s) it may take."]
Unchecked = Annotated[In[bool], "Whether it goes on without a look at what is in the way."]


class MovingNode(BtActionNode):
    """A server's node with the ports that all of Nav2's have."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    error_code_id: ErrorCode = OPTIONAL
    error_msg: ErrorMsg = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers


class FollowPath(MovingNode):
    """Drive along *path*. Another path or plug-in while it drives is taken over without a stop."""

    controller_id: Annotated[In[str], "The plug-in: FollowPath, or nothing."] = ""
    goal_checker_id: Annotated[In[str], "The goal checker's plug-in."] = ""
    progress_checker_id: Annotated[In[str], "The progress checker's plug-in."] = ""
    path_handler_id: Annotated[In[str], "The path handler's plug-in."] = ""
    tracking_feedback: Annotated[Out[FollowPathFeedback], "How far it is, and how far off the path."] = (
        OPTIONAL
    )

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_input_port("The path.")]

    def server(self) -> ActionServer[Any, Any, Any]:
        """The controller."""
        return self.servers.follow_path

    def make_goal(self) -> FollowPathGoal:
        """The path and the plug-ins as they are now."""
        path = path_input(self, "path")
        return FollowPathGoal(
            path if path is not None else empty_path(self.now()),
            plugin_input(self, "controller_id"),
            plugin_input(self, "goal_checker_id"),
            plugin_input(self, "progress_checker_id"),
            plugin_input(self, "path_handler_id"),
        )

    def on_wait_for_result(self, handle: AnyGoalHandle) -> None:
        """Tell how it goes; send the goal anew when it is another one."""
        if handle.feedback is not None:
            write_outputs(self, tracking_feedback=handle.feedback)
        wanted = self.make_goal()
        if not len(wanted.path):
            wanted = replace(wanted, path=handle.goal.path)
        if wanted != handle.goal:
            self.handle = self.servers.follow_path.send_goal(wanted)
            self.sent = self.now()

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """There is nothing to track any more."""
        write_outputs(self, tracking_feedback=FollowPathFeedback())


class Recovery(MovingNode):
    """A node that is counted as a recovery."""

    def make_goal(self) -> object:
        """Count it; the goal is a subclass's."""
        if optional_input(self, "is_recovery") is not False:
            count_recovery(self.blackboard)
        return self.behaviour()

    def behaviour(self) -> object:
        """The goal."""
        raise NotImplementedError


class Spin(Recovery):
    """Turn on the spot by *spin_dist* (rad, + left)."""

    spin_dist: Annotated[In[float], "How far (rad), + to the left."] = 1.57
    time_allowance: Allowance = 10.0
    is_recovery: Annotated[In[bool], "Whether it counts as a recovery."] = True
    disable_collision_checks: Unchecked = False

    def server(self) -> ActionServer[Any, Any, Any]:
        """The spin server."""
        return self.servers.spin

    def behaviour(self) -> SpinGoal:
        """The turn."""
        return SpinGoal(self.spin_dist, self.time_allowance, self.disable_collision_checks)


class BackUp(Recovery):
    """Go back by *backup_dist* (m) at *backup_speed* (m/s), both given without a sign."""

    backup_dist: Annotated[In[float], "How far (m)."] = 0.15
    backup_speed: Annotated[In[float], "How fast (m/s)."] = 0.025
    time_allowance: Allowance = 10.0
    disable_collision_checks: Unchecked = False

    def server(self) -> ActionServer[Any, Any, Any]:
        """The back-up server."""
        return self.servers.back_up

    def behaviour(self) -> BackUpGoal:
        """The way back."""
        return BackUpGoal(
            self.backup_dist, self.backup_speed, self.time_allowance, self.disable_collision_checks
        )


class DriveOnHeading(MovingNode):
    """Drive straight on by *dist_to_travel* (m) at *speed* (m/s)."""

    dist_to_travel: Annotated[In[float], "How far (m)."] = 0.15
    speed: Annotated[In[float], "How fast (m/s)."] = 0.025
    time_allowance: Allowance = 10.0
    disable_collision_checks: Unchecked = False

    def server(self) -> ActionServer[Any, Any, Any]:
        """The drive-on-heading server."""
        return self.servers.drive_on_heading

    def make_goal(self) -> DriveOnHeadingGoal:
        """The way."""
        return DriveOnHeadingGoal(
            self.dist_to_travel, self.speed, self.time_allowance, self.disable_collision_checks
        )


class Wait(Recovery):
    """Wait for *wait_duration* (s), whatever its sign."""

    wait_duration: Annotated[In[float], "How long (s)."] = 1.0

    def server(self) -> ActionServer[Any, Any, Any]:
        """The wait server."""
        return self.servers.wait

    def behaviour(self) -> WaitGoal:
        """The time."""
        return WaitGoal(abs(self.wait_duration))


class NavigateToPose(MovingNode):
    """Have the navigator go to *goal*, by its own tree or by *behavior_tree*."""

    goal: Annotated[In[Pose2D], "Where to."]
    behavior_tree: Annotated[In[str], "The tree's file; the navigator's own where there is none."] = ""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The navigator."""
        navigator: ActionServer[Any, Any, Any] = self.servers.navigators["navigate_to_pose"]
        return navigator

    def make_goal(self) -> object:
        """The goal, in the navigator's form."""
        return self.servers.navigators["goal_to"]((self.goal,), self.behavior_tree)


class NavigateThroughPoses(MovingNode):
    """Have the navigator go through *goals*, by its own tree or by *behavior_tree*."""

    goals: Annotated[In[Poses], "Where to, one after another."]
    behavior_tree: Annotated[In[str], "The tree's file; the navigator's own where there is none."] = ""

    def server(self) -> ActionServer[Any, Any, Any]:
        """The navigator."""
        navigator: ActionServer[Any, Any, Any] = self.servers.navigators["navigate_through_poses"]
        return navigator

    def make_goal(self) -> object:
        """The goals, in the navigator's form."""
        return self.servers.navigators["goal_to"](poses_input(self, "goals"), self.behavior_tree)
