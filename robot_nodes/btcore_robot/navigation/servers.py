"""What Nav2's tree nodes ask for: the servers of one robot, and what they know."""

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
from btcore_robot.navigation.planner_server import PlannerServer
from btcore_robot.robot import Pose2D, Robot
from btcore_robot.transforms import TransformTree

MAP, ODOM, BASE = "map", "odom", "base_footprint"
"""The frames of what is known, of what is counted, and of the robot."""


class PoseSource(Protocol):
    """Who tells where the robot is in the frame map: a localiser, or who makes the map on the way."""

    stamp: int
    """The stamp (ns) of the last scan that was looked at."""

    @property
    def confident(self) -> bool:
        """Whether the pose may be driven by."""
        ...

    @property
    def contradicted(self) -> bool:
        """Whether what is seen speaks against the pose, though no other is known to be better."""
        ...

    @property
    def searching(self) -> bool:
        """Whether the robot has to turn on the spot, to see more."""
        ...

    def pose(self) -> Pose2D | None:
        """Where ``base_footprint`` is in ``map`` now, by the last belief."""
        ...

    def step(self, now: int) -> None:
        """Look at the newest scan, at *now* (ns)."""
        ...

    def global_localisation(self) -> None:
        """Forget the pose, and search for it everywhere."""
        ...


@dataclass(slots=True)
class Servers:
    """The servers on one robot's schedule.

    *topics* holds the newest message of what ROS has topics for and nothing here has a sensor: a selector's
    choice, a goal to follow.
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
    """Who serves ``navigate_to_pose`` and ``navigate_through_poses``."""

    def now(self) -> int:
        """The time (ns)."""
        return self.robot.clock.now()

    def pose(self) -> Pose2D | None:
        """Where the robot takes itself to be, in the frame map."""
        return self.localiser.pose()

    def distance_to(self, place: Pose2D) -> float:
        """How far (m) the robot is from *place* in the frame map; inf when it doesn't know."""
        here = self.pose()
        return math.inf if here is None else math.hypot(place.x - here.x, place.y - here.y)

    def costmap(self, service: str) -> GlobalCostmap | LocalCostmap:
        """The costmap that a service name like ``local_costmap/clear_entirely_local_costmap`` means."""
        return self.local_costmap if "local" in service else self.global_costmap

    def remaining(self, path: NavPath) -> float:
        """How long (m) the way along *path* still is; 0 where the robot doesn't know where it is."""
        here = self.pose()
        return path.remaining(here.x, here.y) if here is not None else 0.0


Handle = GoalHandle[Any, Any, Any]
