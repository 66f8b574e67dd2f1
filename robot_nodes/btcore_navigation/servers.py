"""The servers of a robot in this process, as a resource for Nav2's tree nodes."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Protocol, cast

from btcore.clock import NS_PER_S
from btcore_navigation.action import ActionServer, GoalHandle
from btcore_navigation.behaviours import (
    AssistedTeleopBehaviour,
    BackUpBehaviour,
    DriveOnHeadingBehaviour,
    SpinBehaviour,
    WaitBehaviour,
)
from btcore_navigation.controller import ControllerServer
from btcore_navigation.costmap import INSCRIBED, LETHAL, UNKNOWN, GlobalCostmap, LocalCostmap
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigation_servers import (
    AnyGoalHandle,
    Battery,
    CheckPath,
    ClearCostmap,
    ClearedArea,
    GetCosts,
    Message,
    NavigationServers,
    PathCheck,
    ReinitializeLocalization,
)
from btcore_navigation.planner import PlannerServer
from btcore_navigation.smoother import SmootherServer
from btcore_robot.robot import Odometry, Pose2D, Robot
from btcore_robot.transforms import TransformTree

OBSTACLE_MEMORY_S = 15.0
"""The time (s) for which the global costmap keeps an observed obstacle when a service clears the costmap.

The global costmap takes a scan once a second. Without this memory a cleared costmap is empty until the next
scan, so that the planner finds a path through an obstacle that the laser sees. The time is shorter than the
recoveries of Nav2's trees, which last about 20 s: an obstacle that is out of view, and may be gone, does not
block the way until these trees give up.
"""


class PoseSource(Protocol):
    """The source of the robot's pose in the frame map: a localiser, or a mapper that builds the map."""

    stamp: int
    """The stamp (ns) of the last scan that was processed."""

    @property
    def is_confident(self) -> bool:
        """Whether the pose is reliable enough for the robot to drive."""

    @property
    def is_contradicted(self) -> bool:
        """Whether the last scans contradict the pose, even if no other pose is known to be better."""

    @property
    def is_searching(self) -> bool:
        """Whether the robot has to turn on the spot, so that it scans in all directions."""

    def pose(self) -> Pose2D | None:
        """Return the present pose of `base_footprint` in `map` by the last estimate; None if unknown."""

    def step(self, now: int) -> None:
        """Process the newest scan at *now* (ns)."""

    def reinitialise_global_localisation(self) -> None:
        """Discard the pose, and search the whole map for it."""


@dataclass(slots=True)
class Servers(NavigationServers):
    """The servers on the schedule of a robot.

    Names of servers and services are ignored: there is one of each kind.

    Attributes:
        robot: The robot.
        transforms: The transform tree.
        localiser: The source of the robot's pose.
        global_costmap: The costmap of the planner.
        local_costmap: The costmap of the controller and of the recoveries.
        compute_path: The planner's server.
        follow_path: The controller's server.
        spin: The server of `SpinGoal`.
        back_up: The server of `BackUpGoal`.
        drive_on_heading: The server of `DriveOnHeadingGoal`.
        wait: The server of `WaitGoal`.
        assisted_teleop: The server of `AssistedTeleopGoal`.
        smooth_path: The smoother's server.
        goal_tolerance: The distance (m) at which GoalReached succeeds.
        topics: The newest message by name of the topic, for ROS topics that no sensor provides: for instance
            the name of the planner that PlannerSelector chooses, or the moved goal of GoalUpdater.
        navigators: The servers of the actions `navigate_to_pose` and `navigate_through_poses`.
    """

    robot: Robot
    transforms: TransformTree
    localiser: PoseSource
    global_costmap: GlobalCostmap
    local_costmap: LocalCostmap
    compute_path: PlannerServer
    follow_path: ControllerServer
    spin: SpinBehaviour
    back_up: BackUpBehaviour
    drive_on_heading: DriveOnHeadingBehaviour
    wait: WaitBehaviour
    assisted_teleop: AssistedTeleopBehaviour
    smooth_path: SmootherServer
    goal_tolerance: float = 0.25
    topics: dict[str, object] = field(default_factory=dict)
    navigators: dict[str, ActionServer[Any, Any, Any]] = field(default_factory=dict)

    def now(self) -> int:
        """Return the time (ns) on the robot's clock."""
        return self.robot.clock.now()

    def pose(self) -> Pose2D | None:
        """Return the robot's estimated pose in the frame map; None if unknown."""
        return self.localiser.pose()

    def costmap(self, service: str) -> GlobalCostmap | LocalCostmap:
        """Return the costmap that a service belongs to.

        Args:
            service: The service's name, such as `local_costmap/clear_entirely_local_costmap`. A name with
                "local" belongs to the local costmap, every other name to the global costmap.
        """
        return self.local_costmap if "local" in service else self.global_costmap

    @property
    def by_action(self) -> dict[str, ActionServer[Any, Any, Any]]:
        """The servers, also those of the navigators, by Nav2's names of their actions."""
        return self.without_navigators | self.navigators

    @property
    def without_navigators(self) -> dict[str, ActionServer[Any, Any, Any]]:
        """The servers, without those of the navigators, by Nav2's names of their actions."""
        return {
            "compute_path_to_pose": self.compute_path,
            "compute_path_through_poses": self.compute_path,
            "smooth_path": self.smooth_path,
            "follow_path": self.follow_path,
            "spin": self.spin,
            "backup": self.back_up,
            "drive_on_heading": self.drive_on_heading,
            "wait": self.wait,
            "assisted_teleop": self.assisted_teleop,
        }

    def send_goal(self, goal: object, action: str, server_name: str = "") -> AnyGoalHandle:
        """Send a goal; see `NavigationServers.send_goal`."""
        server = self.by_action.get(action)
        if server is None:
            return _aborted(
                goal, Nav2ErrorCode.SEND_GOAL_FAILURE, f"this navigation has no server of {action}"
            )
        return server.send_goal(goal)

    def cancel_goals(self, action: str, server_name: str = "") -> AnyGoalHandle:
        """Cancel the current goal of a server; see `NavigationServers.cancel_goals`."""
        server = self.by_action.get(action)
        current = server.current if server is not None else None
        if current is not None:
            current.cancel()
        return _succeeded(action)

    def request(self, request: object, service_name: str = "") -> AnyGoalHandle:
        """Carry out a request; see `NavigationServers.request`. The handle has ended when it is returned."""
        match request:
            case ClearCostmap():
                return self._clear(request, service_name)
            case CheckPath():
                collisions = self._collisions(request)
                if request.stop_at_first_collision:
                    collisions = collisions[:1]
                return _succeeded(request, PathCheck(not collisions, collisions))
            case GetCosts():
                return _succeeded(
                    request, tuple(self._cost(pose, request.use_footprint) for pose in request.poses)
                )
            case ReinitializeLocalization():
                self.localiser.reinitialise_global_localisation()
                return _succeeded(request)
        return _aborted(request, 0, f"this navigation has no service for {type(request).__name__}")

    def odometry(self) -> Odometry:
        """Return the newest odometry."""
        return self.robot.odometry()

    def battery(self, topic: str) -> Battery:
        """Return the robot's charge; the battery is being charged if *topic* has the message `charging`."""
        state = self.robot.battery()
        is_charging = self.topics.get(topic) == "charging"
        return Battery(state.level / 100.0 if state is not None else None, None, is_charging)

    def latest(self, topic: str, message_type: type[Message]) -> Message | None:
        """Return the newest message in `topics`; see `NavigationServers.latest`."""
        return cast("Message | None", self.topics.get(topic))

    def can_transform(self, target: str, source: str) -> bool:
        """Return whether the transform from the frame *source* to the frame *target* is available."""
        return self.transforms.can_transform(target, source)

    def last_goals(self) -> Mapping[str, AnyGoalHandle]:
        """Return the last goals by action; see `NavigationServers.last_goals`."""
        servers = self.without_navigators.items()
        return {action: goal for action, server in servers if (goal := server.current) is not None}

    @property
    def is_recovering(self) -> bool:
        """Whether a recovery behaviour has a goal that has not ended."""
        return any(server.is_busy for server in self._recoveries())

    @property
    def is_pose_contradicted(self) -> bool:
        """Whether the last scans contradict the robot's pose."""
        return self.localiser.is_contradicted

    def _recoveries(self) -> tuple[ActionServer[Any, Any, Any], ...]:
        return self.spin, self.back_up, self.drive_on_heading, self.wait, self.assisted_teleop

    def _clear(self, request: ClearCostmap, service_name: str) -> AnyGoalHandle:
        around_pose = request.area is ClearedArea.AROUND_POSE
        costmap = self.global_costmap if around_pose else self.costmap(service_name)
        # The local costmap is in the odometry frame; the global costmap is in the frame map.
        is_local = costmap is self.local_costmap
        before = None if is_local else self.now() - round(OBSTACLE_MEMORY_S * NS_PER_S)
        if request.area is ClearedArea.ENTIRE:
            costmap.clear(before=before)
            return _succeeded(request)
        if around_pose:
            centre = request.pose
        else:
            centre = self.robot.odometry().pose if is_local else self.pose()
        if centre is None:
            return _aborted(request, 0, "the robot's pose is unknown")
        if request.area is ClearedArea.EXCEPT_REGION:
            costmap.clear_except(centre, request.reset_distance, before=before)
        else:
            costmap.clear_around(centre, request.reset_distance, before=before)
        return _succeeded(request)

    def _collisions(self, request: CheckPath) -> tuple[Pose2D, ...]:
        """Return the poses of the path ahead of the robot at which the robot would be in collision."""
        path, reach = request.path, request.max_lookahead_distance
        here = self.pose()
        start = path.nearest(here.x, here.y) if here is not None else 0
        ahead = path.poses[start:]
        if reach >= 0.0:
            along = path.distances()[start:]
            ahead = ahead[along - along[0] <= reach]
        costs = self.global_costmap.costs_at(ahead[:, :2])
        # The robot's circle is in collision where its centre is within its radius of an obstacle: cost 253.
        blocked = (costs >= min(request.max_cost, INSCRIBED)) & (costs != UNKNOWN)
        if request.unknown_is_obstacle:
            blocked |= costs == UNKNOWN
        return tuple(Pose2D(float(x), float(y), float(yaw)) for x, y, yaw in ahead[blocked])

    def _cost(self, pose: Pose2D, footprint: bool) -> float:
        cost = self.global_costmap.cost(pose.x, pose.y)
        # The inscribed cost marks centres from which the robot's circle touches an obstacle.
        return float(LETHAL if footprint and cost == INSCRIBED else cost)


def _succeeded(request: object, value: object = None) -> AnyGoalHandle:
    handle: AnyGoalHandle = GoalHandle(request)
    handle.succeed(value)
    return handle


def _aborted(request: object, code: int, message: str) -> AnyGoalHandle:
    handle: AnyGoalHandle = GoalHandle(request)
    handle.abort(int(code), message)
    return handle
