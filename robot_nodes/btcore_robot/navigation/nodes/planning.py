"""Nav2's nodes that plan."""

from typing import Annotated, Any

from btcore import In, Out, Port
from btcore_robot.leaves.poses import Poses
from btcore_robot.navigation.action import ActionServer, GoalStatus
from btcore_robot.navigation.nodes.action_node import (
    BtActionNode,
    ErrorCode,
    ErrorMsg,
    ServerName,
    ServerTimeout,
)
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
from btcore_robot.navigation.planner_server import ComputePathGoal
from btcore_robot.navigation.servers import AnyGoalHandle, Servers
from btcore_robot.robot import Pose2D

ALL_GOALS = -1
"""Nav2's index of a path that leaves no goal out."""
PlannerId = Annotated[In[str], "The plug-in: GridBased, or nothing."]


class PlanningNode(BtActionNode):
    """A planning server's node: the path is emptied on failure and on a halt."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    planner_id: PlannerId = ""
    error_code_id: ErrorCode = OPTIONAL
    error_msg: ErrorMsg = OPTIONAL

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_output_port("The path; an empty one when there is none.")]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def server(self) -> ActionServer[Any, Any, Any]:
        """The planner."""
        return self.servers.compute_path

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the path, or an empty one."""
        found = handle.result.value if handle.result is not None else None
        if handle.status is GoalStatus.SUCCEEDED and isinstance(found, NavPath):
            self.write(found)
        else:
            self.write(empty_path(self.now()))

    def on_halted(self) -> None:
        """Cancel the goal; there is no path."""
        super().on_halted()
        self.write(empty_path(self.now()))

    def write(self, path: NavPath) -> None:
        """Write the path."""
        write_outputs(self, path=path)


class ComputePathToPose(PlanningNode):
    """Plan to *goal*, through *viapoints* if there are any."""

    goal: Annotated[In[Pose2D], "Where to."]
    start: Annotated[In[Pose2D], "Where from; the robot's place where it isn't given."] = OPTIONAL
    use_start: Annotated[In[bool], "Whether *start* counts; it does unless this says false."] = OPTIONAL
    viapoints: Annotated[In[Poses], "Places to pass on the way."] = OPTIONAL

    def make_goal(self) -> ComputePathGoal:
        """The goal, after the places on the way."""
        start = pose_input(self, "start") if optional_input(self, "use_start") is not False else None
        return ComputePathGoal(
            (*poses_input(self, "viapoints"), self.goal), start, plugin_input(self, "planner_id")
        )


class ComputePathThroughPoses(PlanningNode):
    """Plan through *goals*, one after another."""

    goals: Annotated[In[Poses], "Where to, one after another."]
    start: Annotated[In[Pose2D], "Where from; the robot's place where it isn't given."] = OPTIONAL
    last_reached_index: Annotated[
        Out[int], "The last goal that a path which isn't whole reaches; -1 of one that is, and of none."
    ] = OPTIONAL

    def make_goal(self) -> ComputePathGoal:
        """All goals."""
        return ComputePathGoal(
            poses_input(self, "goals"),
            pose_input(self, "start"),
            plugin_input(self, "planner_id"),
            through=True,
        )

    def write(self, path: NavPath) -> None:
        """Write the path, which is whole or none."""
        super().write(path)
        write_outputs(self, last_reached_index=ALL_GOALS)
