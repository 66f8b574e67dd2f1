"""Nav2's nodes that edit lists of goals on the blackboard."""

from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Annotated

from btcore import In, Out, SyncAction, TreeNode
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.navigation.costmap import LETHAL, UNKNOWN
from btcore_robot.navigation.nodes.action_node import ServerName, ServersAction, ServerTimeout
from btcore_robot.navigation.nodes.port_access import OPTIONAL, optional_input, poses_input, write_outputs
from btcore_robot.navigation.servers import Servers
from btcore_robot.robot import Pose2D


class WaypointState(IntEnum):
    """The progress of a goal; names and numbers are those of `nav2_msgs/WaypointStatus`."""

    PENDING = 0
    COMPLETED = 1
    SKIPPED = 2
    FAILED = 3


@dataclass(frozen=True, slots=True)
class WaypointStatus:
    """The state of a goal in a list of goals; *index* is its place in the original list."""

    goal: Pose2D
    index: int
    state: WaypointState = WaypointState.PENDING


InGoals = Annotated[In[Poses], "Original goals."]
OutGoals = Annotated[Out[Poses], "Remaining goals."]
InStatuses = Annotated[In[list[WaypointStatus]], "Original waypoint statuses."]
OutStatuses = Annotated[Out[list[WaypointStatus]], "Updated waypoint statuses."]
UnknownCounts = Annotated[In[bool], "Whether unknown cost counts as an obstacle."]
Threshold = Annotated[In[float], "Cost threshold (0–254): a pose at or above it is occupied."]


class RemovePassedGoals(ServersAction):
    """Remove the first goals as long as the robot is within *radius* of them; the last goal always stays."""

    input_goals: InGoals
    radius: Annotated[In[float], "Radius (m) around a goal within which it is passed."] = 0.5
    robot_base_frame: Annotated[In[str], "Robot base frame; always base_footprint here."] = "base_footprint"
    input_waypoint_statuses: InStatuses = OPTIONAL
    output_goals: OutGoals = OPTIONAL
    output_waypoint_statuses: OutStatuses = OPTIONAL

    def tick(self) -> bool:
        """Write the remaining goals; return FAILURE while the robot's pose is unknown."""
        goals = list(poses_input(self, "input_goals"))
        if goals and self.servers.pose() is None:
            return False
        passed = 0
        while passed < len(goals) - 1 and self.servers.distance_to(goals[passed]) <= self.radius:
            passed += 1
        write_outputs(self, output_goals=goals[passed:])
        update_waypoint_statuses(self, goals[:passed], WaypointState.COMPLETED)
        return True


class RemoveInCollisionGoals(ServersAction):
    """Remove the goals at which the robot would be in collision according to the global costmap."""

    input_goals: InGoals
    cost_threshold: Threshold = 254.0
    use_footprint: Annotated[In[bool], "Whether to check the robot's footprint."] = True
    consider_unknown_as_obstacle: UnknownCounts = False
    input_waypoint_statuses: InStatuses = OPTIONAL
    service_name: ServerName = ""
    server_timeout: ServerTimeout = 20
    output_goals: OutGoals = OPTIONAL
    output_waypoint_statuses: OutStatuses = OPTIONAL

    def tick(self) -> bool:
        """Check every goal and write the goals without a collision."""
        criteria = self.cost_threshold, self.use_footprint, self.consider_unknown_as_obstacle
        goals = poses_input(self, "input_goals")
        occupied = [goal for goal in goals if is_occupied(self.servers, goal, *criteria)]
        write_outputs(self, output_goals=[goal for goal in goals if goal not in occupied])
        update_waypoint_statuses(self, occupied, WaypointState.SKIPPED)
        return True


class CheckPoseOccupancy(ServersAction):
    """SUCCESS when *pose* is occupied according to the global costmap."""

    pose: Annotated[In[Pose2D], "Pose to check."]
    cost_threshold: Threshold = 254.0
    use_footprint: Annotated[In[bool], "Whether to check the robot's footprint."] = True
    consider_unknown_as_obstacle: UnknownCounts = False
    service_name: ServerName = ""
    server_timeout: ServerTimeout = 20

    def tick(self) -> bool:
        """Check the cost at the pose."""
        criteria = self.cost_threshold, self.use_footprint, self.consider_unknown_as_obstacle
        return is_occupied(self.servers, self.pose, *criteria)


class AppendGoalPoseToGoals(SyncAction):
    """Append *goal_pose* to the goals."""

    goal_pose: Annotated[In[Pose2D], "Goal pose to append."]
    input_goals: InGoals
    output_goals: OutGoals = OPTIONAL

    def tick(self) -> bool:
        """Write the goals with the appended pose."""
        write_outputs(self, output_goals=[*poses_input(self, "input_goals"), self.goal_pose])
        return True


class GetNextFewGoals(SyncAction):
    """Write the first *num_goals* of the goals. FAILURE when there are no goals."""

    num_goals: Annotated[In[int], "Number of goals."]
    input_goals: InGoals
    output_goals: OutGoals = OPTIONAL

    def tick(self) -> bool:
        """Write the first goals."""
        goals = list(poses_input(self, "input_goals"))
        if not goals:
            return False
        write_outputs(self, output_goals=goals[: max(self.num_goals, 0)])
        return True


def update_waypoint_statuses(node: TreeNode, goals: list[Pose2D], state: WaypointState) -> None:
    """Write the waypoint statuses with a new state for the given goals to `output_waypoint_statuses`.

    Nothing is written if the port `input_waypoint_statuses` has no list.

    Args:
        node: The node with both ports.
        goals: The goals to update. For each goal the state of its first PENDING status changes.
        state: The new state.

    Raises:
        BlackboardError: The output port is not bound to an entry, or the entry has another type.
        ConversionError: A value does not convert to the type of its port.
    """
    statuses = optional_input(node, "input_waypoint_statuses")
    if not isinstance(statuses, list):
        return
    updated = list(statuses)
    for goal in goals:
        for index, status in enumerate(updated):
            if status.goal == goal and status.state is WaypointState.PENDING:
                updated[index] = replace(status, state=state)
                break
    write_outputs(node, output_waypoint_statuses=updated)


def is_occupied(servers: Servers, pose: Pose2D, threshold: float, footprint: bool, unknown: bool) -> bool:
    """Return whether the global costmap's cost at *pose* reaches *threshold*.

    Args:
        servers: The navigation servers with the global costmap.
        pose: The pose to check, in the frame map.
        threshold: The cost (0–254) from which on the pose is occupied.
        footprint: Whether to check the robot's circle in place of its centre.
        unknown: The result for a pose of unknown cost.
    """
    cost = servers.global_costmap.cost(pose.x, pose.y)
    if cost == UNKNOWN:
        return unknown
    # The inscribed cost, LETHAL - 1, marks centres from which the robot's circle touches an obstacle.
    return cost >= (min(threshold, LETHAL - 1) if footprint else threshold)
