"""Nav2's nodes that edit lists of goals on the blackboard."""

from dataclasses import replace
from typing import Annotated, Any

from btcore import In, NodeSpec, Out, SyncAction, TreeNode
from btcore_navigation.costmap import UNKNOWN
from btcore_navigation.navigate_goal import WaypointState, WaypointStatus
from btcore_navigation.navigation_servers import AnyGoalHandle, GetCosts
from btcore_navigation.nodes.action_node import BtServiceNode, ServersAction, ServiceName
from btcore_navigation.nodes.port_access import OPTIONAL, optional_input, poses_input, write_outputs
from btcore_robot.leaves.pose_types import Poses
from btcore_robot.robot import Pose2D

InGoals = Annotated[In[Poses], "Original goals."]
OutGoals = Annotated[Out[Poses], "Remaining goals."]
InStatuses = Annotated[In[list[WaypointStatus]], "Original waypoint statuses."]
OutStatuses = Annotated[Out[list[WaypointStatus]], "Updated waypoint statuses."]
UnknownCounts = Annotated[In[bool], "Whether unknown cost counts as an obstacle."]
Threshold = Annotated[In[float], "Cost threshold (0–254): a pose at or above it is occupied."]


class RemovePassedGoals(ServersAction):
    """Removes the first goals as long as the robot is within *radius* of them; the last goal always stays."""

    input_goals: InGoals
    radius: Annotated[In[float], "Radius (m) around a goal within which it is passed."] = 0.5
    robot_base_frame: Annotated[In[str], "Robot base frame; always base_footprint here."] = "base_footprint"
    input_waypoint_statuses: InStatuses = OPTIONAL
    output_goals: OutGoals = OPTIONAL
    output_waypoint_statuses: OutStatuses = OPTIONAL

    spec = NodeSpec(writes=("output_waypoint_statuses",))  # only given statuses are updated

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


class _CostCheck(BtServiceNode):
    """Base of the nodes that request costs of the global costmap."""

    cost_threshold: Threshold = 254.0
    use_footprint: Annotated[In[bool], "Whether to check the robot's footprint."] = True
    consider_unknown_as_obstacle: UnknownCounts = False
    service_name: ServiceName = ""

    def poses(self) -> tuple[Pose2D, ...]:
        """Return the poses to check."""
        raise NotImplementedError

    def send(self) -> AnyGoalHandle:
        """Request the costs at the poses."""
        return self.servers.request(GetCosts(self.poses(), self.use_footprint), self.service_name)

    def is_occupied(self, cost: float) -> bool:
        """Return whether a pose of *cost* is occupied."""
        return self.consider_unknown_as_obstacle if cost == UNKNOWN else cost >= self.cost_threshold


class RemoveInCollisionGoals(_CostCheck):
    """Removes the goals at which the robot would be in collision according to the global costmap.

    The goals stay as they are when the service fails.
    """

    input_goals: InGoals
    input_waypoint_statuses: InStatuses = OPTIONAL
    output_goals: OutGoals = OPTIONAL
    output_waypoint_statuses: OutStatuses = OPTIONAL

    spec = NodeSpec(writes=("output_waypoint_statuses",))
    checked: tuple[Pose2D, ...] = ()

    def poses(self) -> tuple[Pose2D, ...]:
        """Return the goals."""
        self.checked = poses_input(self, "input_goals")
        return self.checked

    def on_response(self, value: Any) -> bool:
        """Write the goals without a collision."""
        goals = self.checked
        occupied = [goal for goal, cost in zip(goals, value, strict=True) if self.is_occupied(cost)]
        write_outputs(self, output_goals=[goal for goal in goals if goal not in occupied])
        update_waypoint_statuses(self, occupied, WaypointState.SKIPPED)
        return True

    def on_failure(self) -> None:
        """Write all goals."""
        write_outputs(self, output_goals=list(self.checked))


class CheckPoseOccupancy(_CostCheck):
    """SUCCESS when *pose* is occupied according to the global costmap."""

    pose: Annotated[In[Pose2D], "Pose to check."]

    def poses(self) -> tuple[Pose2D, ...]:
        """Return the pose."""
        return (self.pose,)

    def on_response(self, value: Any) -> bool:
        """Return whether the pose is occupied."""
        return self.is_occupied(value[0])


class AppendGoalPoseToGoals(SyncAction):
    """Appends *goal_pose* to the goals."""

    goal_pose: Annotated[In[Pose2D], "Goal pose to append."]
    input_goals: InGoals
    output_goals: OutGoals = OPTIONAL

    def tick(self) -> bool:
        """Write the goals with the appended pose."""
        write_outputs(self, output_goals=[*poses_input(self, "input_goals"), self.goal_pose])
        return True


class GetNextFewGoals(SyncAction):
    """Writes the first *num_goals* of the goals. FAILURE when there are no goals."""

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
