"""The whole navigation of one robot: every server, wired to the robot's schedule."""

import logging
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from btcore_robot.navigation.behaviours import (
    BackUpBehaviour,
    DriveOnHeadingBehaviour,
    SpinBehaviour,
    WaitBehaviour,
)
from btcore_robot.navigation.clearance import laser_pose
from btcore_robot.navigation.controller import ControllerServer
from btcore_robot.navigation.costmap import GlobalCostmap, LocalCostmap
from btcore_robot.navigation.localiser import Localiser
from btcore_robot.navigation.navigator import NavigateGoal, NavigateHandle, Navigator, tree_file
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.navigation.parameters import CostmapParameters, NavigationParameters, NavigatorParameters
from btcore_robot.navigation.planner import Planner
from btcore_robot.navigation.planner_server import PlannerServer
from btcore_robot.navigation.scan_filter import smooth_scan
from btcore_robot.navigation.scene import NavigationScene
from btcore_robot.navigation.servers import MAP, ODOM, PoseSource, Servers
from btcore_robot.robot import CMD_VEL, NS_PER_S, GoalOutcome, Phase, Pose2D, Robot
from btcore_robot.transforms import FrameBroadcaster, TransformError, TransformTree
from btcore_scene import MovingScene, StaticScene

log = logging.getLogger(__name__)

TREES = "navigation"
TO_POSE = "navigate_to_pose_w_replanning_and_recovery.xml"
THROUGH_POSES = "navigate_through_poses_w_replanning_and_recovery.xml"

SEARCH_TURN = 0.4
"""How fast (rad/s) the robot turns on the spot to see more while it doesn't know where it is."""
SEARCH_PRIORITY = CMD_VEL + 10
"""Of that command: whoever is held meanwhile, and asks for standing, must not stop the search."""
SEARCH_PATIENCE = 120.0
"""For how long (s) it does, until the goals that wait for it fail; a new goal makes it look again."""
LOOKS = 3
"""So many scans are held against the pose that the robot begins with, before it drives by that."""
PLANNER_RATE = 20.0
"""How often (Hz) the planner looks for a goal to plan to."""
MS_PER_S = 1000.0

_LOST = "it doesn't know where it is, since what it sees fits several places on the map, or none"


class Navigation:
    """Drives *robot* about on *map*: localisation, costmaps, planning, driving, recoveries, navigators.

    All of it are tasks on the robot's schedule: nothing happens but while somebody waits on its clock. While
    the localiser isn't sure, the robot is held where it is, and while it searches it turns on the spot; the
    goals that it was given wait meanwhile, and go on afterwards with a path that is planned anew. Where
    places look alike, or none is as it should be, the search ends after a time, and so do they.
    """

    def __init__(
        self,
        robot: Robot,
        map: OccupancyMap,
        random: np.random.Generator,
        trees: Path,
        parameters: NavigationParameters | None = None,
    ) -> None:
        # A step takes well under a millisecond: sharing it among threads costs more than it saves.
        cv2.setNumThreads(1)
        self.robot = robot
        self.map = map
        self.parameters = figures = parameters if parameters is not None else NavigationParameters()
        self.transforms = TransformTree()
        frames = FrameBroadcaster(robot, self.transforms)
        frames.step(robot.clock.now())
        self.localiser = self._make_localiser(random)
        self.global_costmap = self._make_global_costmap()
        self.local_costmap = _local_costmap(map, figures.local_costmap)
        planner = Planner(
            self.global_costmap,
            radius=figures.global_costmap.robot_radius,
            tolerance=figures.planner.tolerance,
            allow_unknown=figures.planner.allow_unknown,
        )
        tree, local, behaviours = self.transforms, self.local_costmap, figures.behaviours
        self.servers = Servers(
            robot,
            tree,
            self.localiser,
            self.global_costmap,
            local,
            PlannerServer(planner, self.estimate),
            ControllerServer(robot, tree, local, figures.controller, hold=self.must_wait),
            SpinBehaviour(robot, tree, local, behaviours),
            BackUpBehaviour(robot, tree, local, behaviours),
            DriveOnHeadingBehaviour(robot, tree, local, behaviours),
            WaitBehaviour(),
            figures.navigator.goal_reached_tol,
        )
        self._outcomes: list[GoalOutcome] = []
        named = figures.navigator
        self.navigate_to_pose = Navigator(
            self.servers,
            _known(named.default_nav_to_pose_bt_xml, trees / TREES / TO_POSE),
            plugins=named.plugin_lib_names,
            ended=self._outcomes.append,
            hold=self.must_wait,
            hopeless=self.hopeless,
        )
        self.navigate_through_poses = Navigator(
            self.servers,
            _known(named.default_nav_through_poses_bt_xml, trees / TREES / THROUGH_POSES),
            through=True,
            plugins=named.plugin_lib_names,
            ended=self._outcomes.append,
            hold=self.must_wait,
            hopeless=self.hopeless,
        )
        self.servers.navigators = {
            "navigate_to_pose": self.navigate_to_pose,
            "navigate_through_poses": self.navigate_through_poses,
            "goal_to": NavigateGoal,
        }
        self._scene = NavigationScene(self.servers)
        self._scan_seen = {ODOM: -1, MAP: -1}
        self._looks = 0
        self._was_sure = self._searched = False
        self._search_began = 0
        self._gave_up: int | None = None
        self._wire(frames)

    def go_to(self, goal: Pose2D) -> NavigateHandle:
        """Navigate to *goal* (map); a goal that runs is given up for it."""
        return self.navigate_to_pose.send_goal(NavigateGoal((goal,)))

    def go_through(self, goals: Sequence[Pose2D]) -> NavigateHandle:
        """Navigate through *goals* (map) to the last one."""
        return self.navigate_through_poses.send_goal(NavigateGoal(tuple(goals)))

    def estimate(self) -> Pose2D | None:
        """Where the robot takes itself to be in the frame map; None while it doesn't know."""
        return None if self.must_wait() else self.localiser.pose()

    def outcomes(self) -> Sequence[GoalOutcome]:
        """Every goal that was accepted and has ended, in order; one that a newer one replaced is CANCELED."""
        return self._outcomes

    def scene_static(self) -> StaticScene:
        """Return the map and its keepout areas."""
        return self._scene.static()

    def scene_moving(self) -> MovingScene:
        """Return costmaps, paths, poses and notes that are new."""
        return self._scene.moving(self.robot.clock.now())

    def _make_localiser(self, random: np.random.Generator) -> PoseSource:
        """Who tells where the robot is."""
        return Localiser(self.robot, self.map, self.transforms, random, self.parameters.amcl)

    def _make_global_costmap(self) -> GlobalCostmap:
        """What is planned on."""
        return GlobalCostmap(self.map, **costmap_figures(self.parameters.global_costmap))

    def must_wait(self) -> bool:
        """Whether the robot has to stand because it isn't sure where it is."""
        return self._looks < LOOKS or not self.localiser.confident

    def hopeless(self, began: int) -> str:
        """Why a goal that began then (ns) doesn't wait any longer for the robot to find itself, or nothing.

        A goal that is newer than the last search makes the robot search again.
        """
        if self._gave_up is None or began <= self._gave_up:
            return "" if self._gave_up is None else _LOST
        self._gave_up, self._search_began = None, began
        return ""

    def _wire(self, frames: FrameBroadcaster) -> None:
        every, figures, servers = self.robot.schedule.every, self.parameters, self.servers
        every(frames.RATE, Phase.TRANSFORMS, frames.step)
        every(self.robot.laser.rate, Phase.LOCALISER, self._localise)
        every(figures.local_costmap.update_frequency, Phase.COSTMAPS, self._update_local)
        every(figures.global_costmap.update_frequency, Phase.COSTMAPS, self._update_global)
        every(PLANNER_RATE, Phase.PLANNER, servers.compute_path.step)
        every(figures.controller.controller_frequency, Phase.CONTROLLER, servers.follow_path.step)
        for behaviour in (servers.spin, servers.back_up, servers.drive_on_heading, servers.wait):
            every(figures.behaviours.cycle_frequency, Phase.CONTROLLER, behaviour.step)
        rate = MS_PER_S / figures.navigator.bt_loop_duration
        every(rate, Phase.CONTROLLER, self.navigate_to_pose.step)
        every(rate, Phase.CONTROLLER, self.navigate_through_poses.step)

    def _localise(self, now: int) -> None:
        before = self.localiser.stamp
        self.localiser.step(now)
        self._looks += self.localiser.stamp != before
        sure = not self.must_wait()
        if self.localiser.searching:
            if not self._searched:
                log.warning("the robot doesn't know where it is: it stops, and looks around")
                self._search_began = now
            if self._gave_up is None and now - self._search_began > SEARCH_PATIENCE * NS_PER_S:
                log.warning("the robot gives up looking around: %s", _LOST)
                self._gave_up = now
            if self._gave_up is None:
                self.robot.drive(0.0, SEARCH_TURN, priority=SEARCH_PRIORITY)
        else:
            self._gave_up = None
        if sure and not self._was_sure:
            # What was seen from where the robot isn't.
            self.global_costmap.clear()
        elif self._was_sure and not sure:
            self.navigate_to_pose.start_over()
            self.navigate_through_poses.start_over()
        self._searched = self.localiser.searching
        self._was_sure = sure

    def _update_local(self, now: int) -> None:
        self._observe(self.local_costmap, ODOM)
        here = self.robot.odometry().pose
        try:
            placed = self.transforms.lookup(ODOM, MAP).to_pose()
        except TransformError:
            placed = None
        self.local_costmap.update(now, here, placed)

    def _update_global(self, now: int) -> None:
        here = self.estimate()
        if here is not None:
            self._observe(self.global_costmap, MAP)
            self.global_costmap.update(now, here)

    def _observe(self, costmap: LocalCostmap | GlobalCostmap, frame: str) -> None:
        scan = self.robot.scan()
        if scan is None or scan.stamp == self._scan_seen[frame]:
            return
        try:
            laser = laser_pose(self.transforms, frame, scan)
        except TransformError:
            return
        self._scan_seen[frame] = scan.stamp
        costmap.observe(smooth_scan(scan), laser)


def costmap_figures(figures: CostmapParameters) -> dict[str, Any]:
    """The arguments of a `GlobalCostmap` that *figures* mean."""
    return {
        "radius": figures.robot_radius,
        "inflation_radius": figures.inflation_radius,
        "scaling": figures.cost_scaling_factor,
        "obstacle_min_range": figures.obstacle_min_range,
        "obstacle_max_range": figures.obstacle_max_range,
        "raytrace_range": figures.raytrace_max_range,
        "track_unknown": figures.track_unknown_space,
    }


def _local_costmap(map: OccupancyMap, figures: CostmapParameters) -> LocalCostmap:
    return LocalCostmap(
        figures.robot_radius,
        figures.inflation_radius,
        figures.cost_scaling_factor,
        size=figures.width,
        resolution=figures.resolution,
        keepout=map.keepout,
        obstacle_min_range=figures.obstacle_min_range,
        obstacle_max_range=figures.obstacle_max_range,
        raytrace_range=figures.raytrace_max_range,
    )


def missing_trees(figures: NavigatorParameters, trees: Path) -> list[str]:
    """A sentence for each tree that *figures* name and that is nowhere: one of *trees* takes its place."""
    named = (
        (figures.default_nav_to_pose_bt_xml, TO_POSE),
        (figures.default_nav_through_poses_bt_xml, THROUGH_POSES),
    )
    return [
        f"there is no tree {name}: {ours} takes its place"
        for name, ours in named
        if name and not tree_file(name, trees / TREES / ours).is_file()
    ]


def _known(named: str, default: Path) -> Path:
    """The file that the parameters name, or ours of that name; the default where there is neither."""
    file = tree_file(named, default)
    return file if file.is_file() else default
