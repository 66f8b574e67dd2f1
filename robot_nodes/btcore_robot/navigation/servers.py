"""The servers of a robot, as a resource for Nav2's tree nodes."""

import math
from dataclasses import dataclass, field
from typing import Any, Protocol

from btcore_robot.navigation.action import GoalHandle
from btcore_robot.navigation.behaviours import (
    BackUpBehaviour,
    DriveOnHeadingBehaviour,
    SpinBehaviour,
    WaitBehaviour,
)
from btcore_robot.navigation.controller import ControllerServer
from btcore_robot.navigation.costmap import GlobalCostmap, LocalCostmap
from btcore_robot.navigation.path import NavPath
from btcore_robot.navigation.planner import PlannerServer
from btcore_robot.robot import Pose2D, Robot
from btcore_robot.transforms import TransformTree

MAP_FRAME, ODOM_FRAME, BASE_FRAME = "map", "odom", "base_footprint"
"""The frames of the map, of odometry, and of the robot."""


class PoseSource(Protocol):
    """The source of the robot's pose in the frame map: a localiser, or a mapper that builds the map."""

    stamp: int
    """The stamp (ns) of the last scan that was processed."""

    @property
    def confident(self) -> bool:
        """Whether the pose is reliable enough for the robot to drive."""

    @property
    def is_contradicted(self) -> bool:
        """Whether the last scans contradict the pose, even if no other pose is known to be better."""

    @property
    def searching(self) -> bool:
        """Whether the robot has to turn on the spot, so that it scans in all directions."""

    def pose(self) -> Pose2D | None:
        """Return the present pose of `base_footprint` in `map` by the last estimate; None if unknown."""

    def step(self, now: int) -> None:
        """Process the newest scan at *now* (ns)."""

    def reinitialise_global_localisation(self) -> None:
        """Discard the pose, and search the whole map for it."""


@dataclass(slots=True)
class Servers:
    """The servers on the schedule of a robot.

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
        goal_tolerance: The distance (m) at which GoalReached succeeds.
        topics: The newest message by name of the topic, for ROS topics that no sensor provides: for instance
            the name of the planner that PlannerSelector chooses, or the moved goal of GoalUpdater.
        navigators: The servers of the navigators by name.
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
    goal_tolerance: float = 0.25
    topics: dict[str, object] = field(default_factory=dict)
    navigators: dict[str, Any] = field(default_factory=dict)
    """The servers `navigate_to_pose` and `navigate_through_poses`; `goal_to` is the class of goals."""

    def now(self) -> int:
        """Return the time (ns) on the robot's clock."""
        return self.robot.clock.now()

    def pose(self) -> Pose2D | None:
        """Return the robot's estimated pose in the frame map; None if unknown."""
        return self.localiser.pose()

    def distance_to(self, place: Pose2D) -> float:
        """Return the robot's distance (m) from *place* in the frame map; inf if its pose is unknown."""
        here = self.pose()
        return math.inf if here is None else math.hypot(place.x - here.x, place.y - here.y)

    def costmap(self, service: str) -> GlobalCostmap | LocalCostmap:
        """Return the costmap that a service belongs to.

        Args:
            service: The service's name, such as `local_costmap/clear_entirely_local_costmap`. A name with
                "local" belongs to the local costmap, every other name to the global costmap.
        """
        return self.local_costmap if "local" in service else self.global_costmap

    def remaining(self, path: NavPath) -> float:
        """Return the remaining length (m) of *path*; 0 if the robot's pose is unknown."""
        here = self.pose()
        return path.remaining(here.x, here.y) if here is not None else 0.0


AnyGoalHandle = GoalHandle[Any, Any, Any]
"""A handle of any kind of goal."""
