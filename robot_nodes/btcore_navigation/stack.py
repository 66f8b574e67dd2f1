"""The navigation of a robot: creates all servers and puts them on the robot's schedule."""

import logging
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np

from btcore.clock import NS_PER_S
from btcore_navigation.behaviours import (
    AssistedTeleopBehaviour,
    BackUpBehaviour,
    DriveOnHeadingBehaviour,
    SpinBehaviour,
    WaitBehaviour,
)
from btcore_navigation.clearance import ClearanceGrid, laser_pose
from btcore_navigation.controller import ControllerServer
from btcore_navigation.costmap import GlobalCostmap, LocalCostmap
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.localiser import Localiser
from btcore_navigation.navigator import NavigateGoal, NavigateHandle, Navigator, navigation_nodes, tree_file
from btcore_navigation.parameters import NavigationParameters, NavigatorParameters
from btcore_navigation.planner import Planner, PlannerServer
from btcore_navigation.scene import NavigationScene
from btcore_navigation.sensor_watch import SensorWatch
from btcore_navigation.servers import PoseSource, Servers
from btcore_navigation.smoother import SmootherServer
from btcore_robot.errors import RobotError
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import CMD_VEL, MAP_FRAME, ODOM_FRAME, GoalOutcome, Phase, Pose2D, Robot, Waypoints
from btcore_robot.transforms import FrameBroadcaster, TransformError, TransformTree
from btcore_scene import MovingScene, StaticScene

__all__ = ["Navigation", "missing_trees"]

log = logging.getLogger(__name__)

TREES = "navigation"
TO_POSE = "navigate_to_pose_w_replanning_and_recovery.xml"
THROUGH_POSES = "navigate_through_poses_w_replanning_and_recovery.xml"

SEARCH_TURN = 0.4
"""The rate (rad/s) of the turn on the spot while the localiser searches for the robot's pose."""
SEARCH_PRIORITY = CMD_VEL + 10
"""The priority of the command for this turn.

It is higher than CMD_VEL, so that the zero velocity of a server that has to wait doesn't stop the turn.
"""
SEARCH_LIMIT_S = 120.0
"""The time (s) of the turn after which waiting goals fail; a new goal starts another search."""
WATCH_RATE = 20.0
"""The rate (Hz) at which outages of sensors are noticed for the log."""
INITIAL_SCANS = 3
"""The number of scans that validate the initial pose before the robot drives."""
PLANNER_RATE = 20.0
"""The rate (Hz) of the planner's steps."""
MS_PER_S = 1000.0
_DETOUR_SPEED = 2 / 3  # share of the maximum speed: a detour that is driven faster on average is progress

_LOST = "the robot's pose is unknown: its scans fit several places on the map, or none"


class Navigation:
    """The navigation of *robot* on *map*: localisation, costmaps, planning, driving, recoveries, navigators.

    Everything runs as tasks on the robot's schedule, and only while a thread waits on the robot's clock.
    While the localiser is not confident, the robot stands; while it searches, the robot turns on the spot.
    The robot also stands while the odometry, the scans or the laser's pose on the robot are too old.
    Goals wait in this time, and continue with a newly planned path. If the search has no result after
    `SEARCH_LIMIT_S`, because places look alike or the map doesn't fit, the robot stops searching and the
    waiting goals fail. They also fail when a sensor has no readings for longer than
    `btcore_robot.time_limits.MAX_OUTAGE_S`, and at once when the battery is empty.

    *random* is the source of the localiser's samples. *trees* is the folder whose subfolder `navigation`
    contains the default trees. Messages have the names of *waypoints* instead of their coordinates.

    Attributes:
        robot: The robot.
        map: The map.
        parameters: The parameters of all servers.
        transforms: The transform tree, which contains the frame `map`.
        sensors: The watch over the sensors.
        localiser: The estimator of the robot's pose.
        global_costmap: The costmap of the planner.
        local_costmap: The costmap of the controller and of the recoveries.
        servers: The action servers.
        is_localising: Whether scans correct the pose. While it is False, the pose counts as unknown.
        navigate_to_pose: The server for goals with a single pose.
        navigate_through_poses: The server for goals with several poses.

    Raises:
        RegistrationError: A library of the parameter `plugin_lib_names` can't be used.
    """

    def __init__(
        self,
        robot: Robot,
        map: OccupancyMap,
        random: np.random.Generator,
        trees: Path,
        parameters: NavigationParameters | None = None,
        waypoints: Waypoints | None = None,
    ) -> None:
        # A step takes much less than a millisecond: distributing it over threads costs more than it saves.
        cv2.setNumThreads(1)
        self.robot = robot
        self.map = map
        self._waypoints = waypoints
        configured = parameters or NavigationParameters()
        self.parameters = parameters = configured.for_robot(robot.base_info)
        for name in ("global_costmap", "local_costmap"):
            radius, least = getattr(configured, name).given_radius, getattr(parameters, name).robot_radius
            if 0.0 < radius < least:
                log.warning(
                    "%s: the radius %g m is too small for the robot: %g m is used", name, radius, least
                )
        self.transforms = TransformTree()
        frames = FrameBroadcaster(robot, self.transforms)
        frames.step(robot.clock.now())
        limits = parameters.controller
        self.sensors = SensorWatch(robot, self.transforms, limits.scan_timeout, limits.odometry_timeout)
        self.localiser = self._create_localiser(random)
        self.is_localising = True
        self.global_costmap = self._create_global_costmap()
        self.local_costmap = LocalCostmap(parameters.local_costmap, map.keepout)
        self._clearance = ClearanceGrid(self.local_costmap)
        planner = Planner(
            self.global_costmap,
            radius=parameters.global_costmap.robot_radius,
            tolerance=parameters.planner.tolerance,
            allow_unknown=parameters.planner.allow_unknown,
            place_name=self._place_name,
        )
        self.servers = self._create_servers(planner)
        self._outcomes: list[GoalOutcome] = []
        named = parameters.navigator
        self._nodes = navigation_nodes(named.plugin_lib_names)
        to_pose = _existing_tree(named.default_nav_to_pose_bt_xml, trees / TREES / TO_POSE)
        through_poses = _existing_tree(named.default_nav_through_poses_bt_xml, trees / TREES / THROUGH_POSES)
        self.navigate_to_pose = self._create_navigator(planner, to_pose, through=False)
        self.navigate_through_poses = self._create_navigator(planner, through_poses, through=True)
        # Navigators need the servers of the other actions, and their trees may use both navigators.
        self.servers.navigators = {
            "navigate_to_pose": self.navigate_to_pose,
            "navigate_through_poses": self.navigate_through_poses,
        }
        self._scene = NavigationScene(self.servers, self._outcomes)
        self._scan_seen = {ODOM_FRAME: -1, MAP_FRAME: -1}
        self._processed_scans = 0
        self._was_confident = False
        self._searched: int | None = None
        """The time (ns) of the present search, without outages of sensors; None without a search."""
        self._gave_up: int | None = None
        """The time (ns) at which the robot gave up the present search."""
        self._odometry_was_missing = False
        self._wire(frames)

    def _place_name(self, goal: Pose2D) -> str:
        """Return the name of the waypoint at *goal*, otherwise its coordinates."""
        name = self._waypoints.name_at(goal) if self._waypoints is not None else None
        return f"({goal.x:.2f}, {goal.y:.2f})" if name is None else name

    def go_to(self, goal: Pose2D) -> NavigateHandle:
        """Send *goal* (in the frame map) and return its handle; a running goal is replaced."""
        return self.navigate_to_pose.send_goal(NavigateGoal((goal,)))

    def go_through(self, goals: Sequence[Pose2D]) -> NavigateHandle:
        """Send *goals* (in the frame map), to pass in order, and return their handle."""
        return self.navigate_through_poses.send_goal(NavigateGoal(tuple(goals)))

    def change_map(self, map: OccupancyMap) -> None:
        """Replace the map; goals in progress continue with a newly planned path.

        Raises:
            RobotError: The robot is making the map.
        """
        if not isinstance(self.localiser, Localiser):
            raise RobotError("the robot is making its map, which cannot be replaced")
        self.map = map
        self.localiser.change_map(map)
        self.global_costmap.change_map(map)
        self.local_costmap.keepout = map.keepout
        self.navigate_to_pose.restart_goal()
        self.navigate_through_poses.restart_goal()

    def estimate(self) -> Pose2D | None:
        """Return the robot's estimated pose in the frame map; None while the pose is unknown."""
        return None if self.must_wait() else self.localiser.pose()

    def outcomes(self) -> Sequence[GoalOutcome]:
        """Return the outcomes of accepted goals that have ended, in order; replaced goals are CANCELED."""
        return self._outcomes

    def static_scene(self) -> StaticScene:
        """Return the map and its keep-out areas."""
        return self._scene.static()

    def moving_scene(self) -> MovingScene:
        """Return costmaps, paths, poses and notes that are new."""
        return self._scene.moving(self.robot.clock.now())

    def _create_localiser(self, random: np.random.Generator) -> PoseSource:
        """Create the source of the robot's pose."""
        limit = self.parameters.controller.odometry_timeout
        return Localiser(self.robot, self.map, self.transforms, random, self.parameters.amcl, limit)

    def _create_global_costmap(self) -> GlobalCostmap:
        """Create the costmap for planning."""
        return GlobalCostmap(self.map, self.parameters.global_costmap)

    def _create_servers(self, planner: Planner) -> Servers:
        """Create the servers of all actions but those of the navigators."""
        robot, tree, parameters = self.robot, self.transforms, self.parameters
        motion = robot, tree, self._clearance, self.sensors
        recovery = *motion, parameters.behaviours
        return Servers(
            robot,
            tree,
            self.localiser,
            self.global_costmap,
            self.local_costmap,
            PlannerServer(planner, self.estimate),
            ControllerServer(*motion, parameters.controller, self.must_wait),
            SpinBehaviour(*recovery),
            BackUpBehaviour(*recovery),
            DriveOnHeadingBehaviour(*recovery),
            WaitBehaviour(),
            AssistedTeleopBehaviour(*recovery),
            SmootherServer(planner),
            parameters.navigator.goal_reached_tol,
        )

    def _create_navigator(self, planner: Planner, tree: Path, *, through: bool) -> Navigator:
        """Create a navigator with the default tree *tree*."""
        return Navigator(
            self.servers,
            tree,
            self._nodes,
            clock=self.robot.clock,
            resources=[self.robot],
            through=through,
            on_end=self._outcomes.append,
            hold=self.goals_wait,
            keep_waiting=self.keep_waiting,
            check_goal=planner.check_goal,
            slowest=_DETOUR_SPEED * min(self.parameters.controller.max_vel_x, self.robot.base_info.v_max),
        )

    def must_wait(self) -> bool:
        """Return whether the robot has to stand because its pose is uncertain."""
        return not self._is_localised() or self.sensors.odometry_outage(self.robot.clock.now()) is not None

    def goals_wait(self) -> bool:
        """Return whether the robot cannot drive to any goal at present.

        Its pose is not known, a sensor has no readings, or the battery is empty.
        """
        if not self._is_localised() or self.sensors.outage(self.robot.clock.now()) is not None:
            return True
        return self._is_battery_empty()

    def _is_localised(self) -> bool:
        return self.is_localising and self._processed_scans >= INITIAL_SCANS and self.localiser.is_confident

    def _is_battery_empty(self) -> bool:
        battery = self.robot.battery()
        return battery is not None and battery.level <= 0.0

    def keep_waiting(self, began: int) -> tuple[Nav2ErrorCode, str] | None:
        """Let a goal wait on, and return None; or return why it gives up: an error code and a message.

        If the goal began after the robot gave up the search for its pose, the robot searches again.

        Args:
            began: The time (ns) at which the goal began.
        """
        if self._is_battery_empty():
            return Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS, "the battery is empty"
        if not self.is_localising:
            return (
                Nav2ErrorCode.NAVIGATE_TF_ERROR,
                "the robot's pose is unknown: the localisation is not active",
            )
        now = self.robot.clock.now()
        outage = self.sensors.outage(now)
        if outage is not None and outage.exceeds_patience(now):
            return outage.error_code(Nav2ErrorCode.NAVIGATE_TF_ERROR), outage.message(now)
        if self._gave_up is None:
            return None
        if began <= self._gave_up:
            return Nav2ErrorCode.NAVIGATE_TF_ERROR, _LOST
        self._gave_up, self._searched = None, 0
        return None

    def _wire(self, frames: FrameBroadcaster) -> None:
        add_task, parameters, servers = self.robot.schedule.add_task, self.parameters, self.servers
        add_task(frames.RATE, Phase.TRANSFORMS, frames.step)
        add_task(WATCH_RATE, Phase.TRANSFORMS, self.sensors.report)
        add_task(self.robot.laser_info.rate, Phase.LOCALISER, self._localise)
        add_task(parameters.local_costmap.update_frequency, Phase.COSTMAPS, self._update_local)
        add_task(parameters.global_costmap.update_frequency, Phase.COSTMAPS, self._update_global)
        add_task(PLANNER_RATE, Phase.PLANNER, servers.compute_path.step)
        add_task(PLANNER_RATE, Phase.PLANNER, servers.smooth_path.step)
        add_task(parameters.controller.controller_frequency, Phase.CONTROLLER, servers.follow_path.step)
        for behaviour in (
            *(servers.spin, servers.back_up, servers.drive_on_heading),
            *(servers.wait, servers.assisted_teleop),
        ):
            add_task(parameters.behaviours.cycle_frequency, Phase.CONTROLLER, behaviour.step)
        rate = MS_PER_S / parameters.navigator.bt_loop_duration
        add_task(rate, Phase.CONTROLLER, self._step_navigators)

    def _step_navigators(self, now: int) -> None:
        self.navigate_to_pose.step(now)
        self.navigate_through_poses.step(now)

    def _localise(self, now: int) -> None:
        before = self.localiser.stamp
        if self.is_localising:
            self.localiser.step(now)
        self._processed_scans += self.localiser.stamp != before
        is_confident = not self.must_wait()
        self._odometry_was_missing |= self.sensors.odometry_outage(now) is not None
        if self.localiser.is_searching and self.is_localising:
            self._look_around(now)
        else:
            self._searched = self._gave_up = None
        if is_confident and not self._was_confident:
            # Obstacles that were observed at a wrong pose are at wrong places in the map.
            self.global_costmap.clear()
            if self._odometry_was_missing:
                # The odometry may have jumped, and with it the place of the obstacles around the robot.
                self.local_costmap.clear()
                self._odometry_was_missing = False
        elif self._was_confident and not is_confident:
            self.navigate_to_pose.restart_goal()
            self.navigate_through_poses.restart_goal()
        self._was_confident = is_confident

    def _look_around(self, now: int) -> None:
        """Turn the robot while its pose is searched for; give up after `SEARCH_LIMIT_S` with readings."""
        if self._searched is None:
            log.warning("the robot's pose is unknown: the robot stops and looks around")
            self._searched = 0
        if self._gave_up is not None or self.sensors.outage(now) is not None:
            return
        self._searched += round(NS_PER_S / self.robot.laser_info.rate)
        if self._searched > SEARCH_LIMIT_S * NS_PER_S:
            log.warning("the robot stops looking around: %s", _LOST)
            self._gave_up = now
        else:
            self.robot.drive(0.0, SEARCH_TURN, priority=SEARCH_PRIORITY)

    def _update_local(self, now: int) -> None:
        self._observe(self.local_costmap, ODOM_FRAME)
        here = self.robot.odometry().pose
        try:
            map_pose = self.transforms.lookup(ODOM_FRAME, MAP_FRAME).to_pose()
        except TransformError:
            map_pose = None
        self.local_costmap.update(now, here, map_pose)

    def _update_global(self, now: int) -> None:
        here = self.estimate()
        if here is not None:
            self._observe(self.global_costmap, MAP_FRAME)
            self.global_costmap.update(now, here)

    def _observe(self, costmap: LocalCostmap | GlobalCostmap, frame: str) -> None:
        scan = self.robot.scan()
        if scan is None or scan.stamp == self._scan_seen[frame]:
            return
        if self.sensors.outage(self.robot.clock.now()) is not None:
            return
        try:
            laser = laser_pose(self.transforms, frame, scan)
        except TransformError:
            return
        self._scan_seen[frame] = scan.stamp
        costmap.observe(self._clearance.smoother.smooth(scan), laser)


def missing_trees(parameters: NavigatorParameters, trees: Path) -> list[str]:
    """Return a warning for each tree in *parameters* that doesn't exist and is replaced by a default tree.

    Args:
        parameters: The parameters of the navigator.
        trees: The folder whose subfolder `navigation` contains the default trees.
    """
    named = (
        (parameters.default_nav_to_pose_bt_xml, TO_POSE),
        (parameters.default_nav_through_poses_bt_xml, THROUGH_POSES),
    )
    return [
        f"there is no tree {name}: {default} is used instead"
        for name, default in named
        if name and not tree_file(name, trees / TREES / default).is_file()
    ]


def _existing_tree(name: str, default: Path) -> Path:
    """Return the tree file for *name*, or the default if it doesn't exist."""
    file = tree_file(name, default)
    return file if file.is_file() else default
