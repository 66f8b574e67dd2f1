"""Nav2's nodes that plan."""

from typing import Annotated, Any

from btcore import In, Out, Port
from robot_nodes.navigation.action import ActionServer, GoalStatus
from robot_nodes.navigation.nodes.inputs import given, path_out, pose_at, poses_at, tell
from robot_nodes.navigation.nodes.serving import ErrorCode, ErrorMsg, ServerName, ServerNode, ServerTimeout
from robot_nodes.navigation.path import NavPath, empty_path
from robot_nodes.navigation.plan_server import PathGoal
from robot_nodes.navigation.servers import Handle, Servers
from robot_nodes.robot import Pose2D

Planned = Annotated[Out[NavPath], "The path; an empty one when there is none."]
PlannerId = Annotated[In[str], "The plug-in: GridBased, or nothing."]


class PlanningNode(ServerNode):
    """A planning server's node: the path is emptied on failure and on a halt."""

    server_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    planner_id: PlannerId = ""
    error_code_id: ErrorCode
    error_msg: ErrorMsg

    @staticmethod
    def provided_ports() -> list[Port]:
        """The path; its name is taken in Python."""
        return [path_out("The path; an empty one when there is none.")]

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def server(self) -> ActionServer[Any, Any, Any]:
        """The planner."""
        return self.servers.compute_path

    def ended(self, handle: Handle) -> None:
        """Write the path, or an empty one."""
        found = handle.result.value if handle.result is not None else None
        if handle.status is GoalStatus.SUCCEEDED and isinstance(found, NavPath):
            tell(self, path=found)
        else:
            tell(self, path=empty_path(self.now()))

    def on_halted(self) -> None:
        """Cancel the goal; there is no path."""
        super().on_halted()
        tell(self, path=empty_path(self.now()))


class ComputePathToPose(PlanningNode):
    """Plan to *goal*, through *viapoints* if there are any."""

    goal: Annotated[In[Pose2D], "Where to."]
    start: Annotated[In[Pose2D], "Where from; the robot's place where it isn't given."]
    use_start: Annotated[In[bool], "Whether *start* counts."] = True
    viapoints: Annotated[In[list[Pose2D]], "Places to pass on the way."]

    def make_goal(self) -> PathGoal:
        """The goal, after the places on the way."""
        start = pose_at(self, "start") if given(self, "use_start") is not False else None
        return PathGoal((*poses_at(self, "viapoints"), self.goal), start, self.planner_id)


class ComputePathThroughPoses(PlanningNode):
    """Plan through *goals*, one after another."""

    goals: Annotated[In[list[Pose2D]], "Where to, one after another."]
    start: Annotated[In[Pose2D], "Where from; the robot's place where it isn't given."]
    use_start: Annotated[In[bool], "Whether *start* counts."] = True
    last_reached_index: Annotated[Out[int], "The last of the goals that the path reaches."]

    def make_goal(self) -> PathGoal:
        """All goals."""
        start = pose_at(self, "start") if given(self, "use_start") is not False else None
        return PathGoal(poses_at(self, "goals"), start, self.planner_id, through=True)

    def ended(self, handle: Handle) -> None:
        """Write the path, and how far it reaches."""
        super().ended(handle)
        reached = len(handle.goal.goals) - 1 if handle.status is GoalStatus.SUCCEEDED else -1
        tell(self, last_reached_index=reached)
