"""Nav2's path planning nodes."""

from typing import Annotated, Any

from btcore import In, Out, Port
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.navigation.action import ActionServer, GoalStatus
from btcore_robot.navigation.nodes.action_node import BtActionNode
from btcore_robot.navigation.nodes.port_access import (
    OPTIONAL,
    optional_input,
    path_output_port,
    plugin_input,
    pose_input,
    poses_input,
    write_outputs,
)
from btcore_robot.navigation.path import NavPath, empty_path
from btcore_robot.navigation.planner import ComputePathGoal
from btcore_robot.navigation.servers import AnyGoalHandle
from btcore_robot.robot import Pose2D

ALL_GOALS = -1
"""Nav2's value of `last_reached_index` for a path that reaches all goals."""


class _PlanningNode(BtActionNode):
    """Base of the planning nodes: on failure and on a halt the path becomes empty."""

    planner_id: Annotated[In[str], "Planner plug-in: GridBased or empty."] = ""

    @staticmethod
    def provided_ports() -> list[Port]:
        """Return the ``path`` port."""
        return [path_output_port("Path created by the planner; empty when there is none.")]

    def server(self) -> ActionServer[Any, Any, Any]:
        """Return the planner server."""
        return self.servers.compute_path

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the planned path, or an empty path."""
        path = handle.result.value if handle.result is not None else None
        if handle.status is GoalStatus.SUCCEEDED and isinstance(path, NavPath):
            self.write(path)
        else:
            self.write(empty_path(self.now()))

    def on_halted(self) -> None:
        """Cancel the goal and write an empty path."""
        super().on_halted()
        self.write(empty_path(self.now()))

    def write(self, path: NavPath) -> None:
        """Write *path* to the output port."""
        write_outputs(self, path=path)


class ComputePathToPose(_PlanningNode):
    """Plan a path to *goal*, through *viapoints* if there are any."""

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
    """Plan a path through *goals*, in order."""

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
