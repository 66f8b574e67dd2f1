"""Nav2's nodes that work on the goals of the blackboard."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated

from btcore import In, Out, SyncAction, TreeNode
from btcore_robot.leaves.poses import Poses
from btcore_robot.navigation.costmap import LETHAL, UNKNOWN
from btcore_robot.navigation.nodes.action_node import ServerName, ServerTimeout
from btcore_robot.navigation.nodes.port_access import OPTIONAL, optional_input, poses_input, write_outputs
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import Pose2D


class WaypointState(IntEnum):
    """What became of a goal; names and numbers are those of ``nav2_msgs/WaypointStatus``."""

    PENDING = 0
    COMPLETED = 1
    SKIPPED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class WaypointStatus:
    """One of several goals, the *index*-th that was asked for, and what became of it."""

    goal: Pose2D
    index: int
    state: WaypointState = WaypointState.PENDING


InGoals = Annotated[In[Poses], "The goals."]
OutGoals = Annotated[Out[Poses], "The goals that are left."]
InStatuses = Annotated[In[list[WaypointStatus]], "What became of each goal so far."]
OutStatuses = Annotated[Out[list[WaypointStatus]], "What became of each goal now."]
UnknownCounts = Annotated[In[bool], "Whether what isn't known counts as an obstacle."]
Threshold = Annotated[In[float], "The cost (0–254) from which on a place counts as taken."]


class RemovePassedGoals(SyncAction):
    """Leave out the first goals as long as the robot is nearer than *radius* to them; the last one stays."""

    input_goals: InGoals
    radius: Annotated[In[float], "How near (m) is passed."] = 0.5
    robot_base_frame: Annotated[In[str], "The robot's frame."] = "base_footprint"
    input_waypoint_statuses: InStatuses = OPTIONAL
    output_goals: OutGoals = OPTIONAL
    output_waypoint_statuses: OutStatuses = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Leave out; FAILURE where the robot doesn't know where it is."""
        goals = list(poses_input(self, "input_goals"))
        if goals and self.servers.pose() is None:
            return False
        passed = 0
        while passed < len(goals) - 1 and self.servers.distance_to(goals[passed]) <= self.radius:
            passed += 1
        write_outputs(self, output_goals=goals[passed:])
        mark(self, goals[:passed], WaypointState.COMPLETED)
        return True


class RemoveInCollisionGoals(SyncAction):
    """Leave out the goals at which something is in the way, by the global costmap."""

    input_goals: InGoals
    cost_threshold: Threshold = 254.0
    use_footprint: Annotated[In[bool], "Whether the robot's size counts."] = True
    consider_unknown_as_obstacle: UnknownCounts = False
    input_waypoint_statuses: InStatuses = OPTIONAL
    service_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    output_goals: OutGoals = OPTIONAL
    output_waypoint_statuses: OutStatuses = OPTIONAL

    def __init__(self, servers: Servers) -> None:
        self.servers = servers

    def tick(self) -> bool:
        """Look at every goal."""
        figures = self.cost_threshold, self.use_footprint, self.consider_unknown_as_obstacle
        goals = poses_input(self, "input_goals")
        taken = [goal for goal in goals if occupied(self.servers, goal, *figures)]
        write_outputs(self, output_goals=[goal for goal in goals if goal not in taken])
        mark(self, taken, WaypointState.SKIPPED)
        return True


class CheckPoseOccupancy(SyncAction):
    """SUCCESS when something is in the way at *pose*, by the global costmap."""

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
        figures = self.cost_threshold, self.use_footprint, self.consider_unknown_as_obstacle
        return occupied(self.servers, self.pose, *figures)


class AppendGoalPoseToGoals(SyncAction):
    """Write the goals with one more at their end."""

    goal_pose: Annotated[In[Pose2D], "The goal to append."]
    input_goals: InGoals
    output_goals: OutGoals = OPTIONAL

    def tick(self) -> bool:
        """Append."""
        write_outputs(self, output_goals=[*poses_input(self, "input_goals"), self.goal_pose])
        return True


class GetNextFewGoals(SyncAction):
    """Write the first *num_goals* of the goals. FAILURE where there are none."""

    num_goals: Annotated[In[int], "How many."]
    input_goals: InGoals
    output_goals: OutGoals = OPTIONAL

    def tick(self) -> bool:
        """Take them."""
        goals = list(poses_input(self, "input_goals"))
        if not goals:
            return False
        write_outputs(self, output_goals=goals[: max(self.num_goals, 0)])
        return True


def mark(node: TreeNode, goals: list[Pose2D], state: WaypointState) -> None:
    """Write that the next of the waypoints at each of *goals*, of those still pending, is in *state*."""
    statuses = optional_input(node, "input_waypoint_statuses")
    if not isinstance(statuses, list):
        return
    found = list(statuses)
    for goal in goals:
        for index, one in enumerate(found):
            if one.goal == goal and one.state is WaypointState.PENDING:
                found[index] = replace(one, state=state)
                break
    write_outputs(node, output_waypoint_statuses=found)


def occupied(servers: Servers, place: Pose2D, threshold: float, footprint: bool, unknown: bool) -> bool:
    """Whether the robot (with *footprint*), or its middle, can't be at *place* by the global costmap."""
    cost = servers.global_costmap.cost(place.x, place.y)
    if cost == UNKNOWN:
        return unknown
    return cost >= (min(threshold, LETHAL - 1) if footprint else threshold)
