"""Nav2's tree nodes for servers that only a running Nav2 has: routes and assisted teleoperation."""

from dataclasses import dataclass
from typing import Annotated

from btcore import FAILURE, SUCCESS, Direction, In, NodeSpec, Out, Registry, Status, SyncAction
from btcore.engine.node import read_clock
from btcore_navigation.action import GoalStatus
from btcore_navigation.behaviours import AssistedTeleopGoal
from btcore_navigation.navigation_servers import AnyGoalHandle
from btcore_navigation.nodes.action_node import (
    BtActionNode,
    BtServiceNode,
    ServerName,
    count_recovery,
)
from btcore_navigation.nodes.actions import BASE
from btcore_navigation.nodes.port_access import OPTIONAL, path_port, pose_input, write_outputs
from btcore_navigation.path import NavPath, empty_path
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.robot import Pose2D


@dataclass(frozen=True, slots=True)
class ComputeRouteGoal:
    """A request for a route on the graph of the route server.

    Attributes:
        start_id: The id of the first node, without *goal*.
        goal_id: The id of the last node, without *goal*.
        goal: The destination, in the frame map; None = *start_id* and *goal_id* are used.
        start: The start, in the frame map; None = the robot's pose.
    """

    start_id: int = 0
    goal_id: int = 0
    goal: Pose2D | None = None
    start: Pose2D | None = None


@dataclass(frozen=True, slots=True)
class Route:
    """A route: its nodes in order, as poses in the frame map with the heading 0."""

    nodes: tuple[Pose2D, ...] = ()


@dataclass(frozen=True, slots=True)
class ComputedRoute:
    """The result of `ComputeRouteGoal`: the *route*, a *path* along it, and the *planning_time* (s)."""

    route: Route
    path: NavPath
    planning_time: float


class ComputeRoute(BtActionNode):
    """Plans a route on the graph of Nav2's route server. On failure and a halt, route and path are empty."""

    action = "compute_route"

    spec = NodeSpec(writes_on_halt=("route", "path", "planning_time"))

    start_id: Annotated[In[int], "ID of the first node; used without use_poses."] = 0
    goal_id: Annotated[In[int], "ID of the last node; used without use_poses."] = 0
    start: Annotated[In[Pose2D], "Start pose; used with use_poses and use_start."] = OPTIONAL
    goal: Annotated[In[Pose2D], "Destination; used with use_poses."] = OPTIONAL
    use_start: Annotated[In[bool], "False: begin at the robot's pose."] = False
    use_poses: Annotated[In[bool], "Whether to use poses instead of IDs."] = False
    route: Annotated[Out[Route], "The route."] = OPTIONAL
    planning_time: Annotated[Out[float], "Time (s) taken to compute the route."] = OPTIONAL

    provided_ports = path_port("Path along the route.", Direction.OUT)

    def make_goal(self) -> ComputeRouteGoal:
        """Return a goal with the poses or the IDs."""
        if not self.use_poses:
            return ComputeRouteGoal(self.start_id, self.goal_id)
        start = pose_input(self, "start") if self.use_start else None
        return ComputeRouteGoal(goal=self.goal, start=start)

    def on_completion(self, handle: AnyGoalHandle) -> None:
        """Write the route, or an empty route."""
        value = handle.result.value if handle.result is not None else None
        if handle.status is GoalStatus.SUCCEEDED and isinstance(value, ComputedRoute):
            self.write(value)
        else:
            self.write(ComputedRoute(Route(), empty_path(read_clock(self)), 0.0))

    def on_halted(self) -> None:
        """Cancel the goal, and write an empty route."""
        super().on_halted()
        self.write(ComputedRoute(Route(), empty_path(read_clock(self)), 0.0))

    def write(self, computed: ComputedRoute) -> None:
        """Write the output ports."""
        write_outputs(self, route=computed.route, path=computed.path, planning_time=computed.planning_time)


class ExtractRouteNodesAsGoals(SyncAction):
    """Writes the nodes of a route as goals. FAILURE for a route without nodes."""

    route: Annotated[In[Route], "Route to extract the nodes from."]
    goals: Annotated[Out[Poses], "Goals for the navigation."] = OPTIONAL

    spec = NodeSpec(state_fields=())

    def tick(self) -> bool:
        """Write the goals."""
        nodes = list(self.route.nodes)
        if nodes:
            write_outputs(self, goals=nodes)
        return bool(nodes)


class AssistedTeleop(BtActionNode):
    """Lets a user drive the robot; Nav2 stops it before obstacles.

    An aborted goal is a FAILURE only if the teleoperation counts as a recovery.
    """

    action = "assisted_teleop"
    # A start may write the count of recoveries.
    spec = NodeSpec(uses=BASE, writes=("number_recoveries",))

    time_allowance: Annotated[In[float], "Allowed time (s) for the teleoperation."] = 10.0
    is_recovery: Annotated[In[bool], "True if the teleoperation counts as a recovery."] = False

    def make_goal(self) -> AssistedTeleopGoal:
        """Count the recovery, and return the goal."""
        if self.is_recovery:
            count_recovery(self._blackboard)
        return AssistedTeleopGoal(self.time_allowance)

    def on_running(self) -> Status:
        """Check whether the server accepted or ended the goal."""
        handle = self.handle
        status = super().on_running()
        result = handle.result if handle is not None else None
        # Codes below 100 mean that no server accepted the goal.
        if status is FAILURE and result is not None and result.code >= 100 and not self.is_recovery:
            return SUCCESS
        return status


class CancelAssistedTeleop(BtServiceNode):
    """Cancels the assisted teleoperation."""

    server_name: ServerName = ""

    def send(self) -> AnyGoalHandle:
        """Send the request."""
        return self.servers.cancel_goals("assisted_teleop", self.server_name)


def register(nodes: Registry) -> None:
    """Register the nodes."""
    nodes.add(ComputeRoute, ExtractRouteNodesAsGoals, AssistedTeleop, CancelAssistedTeleop)
