"""Navigation on a map that is being made: the robot drives over known floor only and explores the rest."""

import logging
from dataclasses import replace
from pathlib import Path

import numpy as np

from btcore.clock import NS_PER_S
from btcore_navigation.costmap import INSCRIBED, GlobalCostmap
from btcore_navigation.costmap_layers import static_costs
from btcore_navigation.mapping.frontiers import Frontier, find_frontiers, is_unknown_nearby
from btcore_navigation.mapping.map_quality import MapQuality
from btcore_navigation.mapping.mapper import Mapper
from btcore_navigation.parameters import NavigationParameters
from btcore_navigation.servers import PoseSource
from btcore_navigation.stack import Navigation
from btcore_robot.occupancy_map import OccupancyMap, Rectangle, save_map
from btcore_robot.robot import Pose2D, Robot

_log = logging.getLogger(__name__)

OBSTACLE_MEMORY_NS = 30 * NS_PER_S
"""The time (ns) for which an observed obstacle stays in the costmap although the map does not have it.

In a passage that is just wide enough for the robot, the scans and the map disagree. Without a memory the
robot would turn round each time it looks at the passage, and turn back as soon as it looks away. In this time
it leaves the passage on the other way.
"""


class GrowingCostmap(GlobalCostmap):
    """A global costmap whose map changes.

    Its creator must set `lower_bound` and `map_costs` to None, because a new map has other costs.
    """

    def redraw(self, map: OccupancyMap) -> None:
        """Replace the map by *map*, of any size, and forget old observations: the map contains them."""
        shape = (map.height, map.width)
        rows = round((map.origin[1] - self.origin[1]) / self.resolution)
        cols = round((map.origin[0] - self.origin[0]) / self.resolution)
        self.obstacles.rebuild(shape, rows, cols, self.stamp - OBSTACLE_MEMORY_NS)
        self.map = map
        self.origin = map.origin
        self._static = static_costs(map)
        self.costs = np.zeros(shape, dtype=np.uint8)
        self._refresh(self._whole_grid())


class Exploration(Navigation):
    """Navigation that explores unknown space and makes a map; the robot never drives over unknown cells.

    In the new map, the robot starts at the initial pose of the localiser's parameters, by default (0, 0, 0).

    Args:
        robot: The robot to drive.
        random: The source of random numbers.
        trees: The folder whose subfolder `navigation` contains the default behavior trees.
        parameters: The parameters of the servers; the defaults if omitted.
        keepout: Rectangles that are added to the map because the laser cannot detect them.

    Attributes:
        localiser: The mapper.
        global_costmap: The costmap of the map so far.
    """

    localiser: Mapper
    global_costmap: GrowingCostmap

    def __init__(
        self,
        robot: Robot,
        random: np.random.Generator,
        trees: Path,
        parameters: NavigationParameters | None = None,
        keepout: tuple[Rectangle, ...] = (),
    ) -> None:
        parameters = parameters if parameters is not None else NavigationParameters()
        parameters = replace(parameters, planner=replace(parameters.planner, allow_unknown=False))
        # A new map has one cell, and everything around it is unknown.
        unknown = np.full((1, 1), -1, dtype=np.int8)
        empty_map = OccupancyMap(unknown, parameters.global_costmap.resolution, (0.0, 0.0), keepout)
        super().__init__(robot, empty_map, random, trees, parameters)
        self._drawn_version = -1
        self._excluded: list[tuple[float, float]] = []
        self._frontier: Frontier | None = None
        self.saved_quality: MapQuality | None = None
        """The quality of the map that was saved last; None before."""

    @property
    def mapper(self) -> Mapper:
        """The mapper, which makes the map and localises the robot on it."""
        return self.localiser

    def next_goal(self) -> Pose2D | None:
        """Return the next goal in the frame map, or None if there is nothing left to explore."""
        here = self.estimate()
        if here is None:
            return None
        self._redraw()
        radius = self.parameters.global_costmap.robot_radius
        frontiers = find_frontiers(self.map, self.global_costmap, here, self._excluded, radius=radius)
        self._frontier = frontiers[0] if frontiers else None
        return self._frontier.goal if self._frontier is not None else None

    def is_goal_unknown(self) -> bool:
        """Return whether the area around the last goal of `next_goal` is still unknown."""
        return self._frontier is not None and is_unknown_nearby(self.mapper.map(), self._frontier.position)

    def is_goal_free(self) -> bool:
        """Return whether the robot can stand at the last goal of `next_goal`, by what it has seen since."""
        if self._frontier is None:
            return False
        goal = self._frontier.goal
        return self.global_costmap.cost(goal.x, goal.y) < INSCRIBED

    def exclude_goal(self) -> None:
        """Exclude the frontier of the last goal, after the goal was unreachable or showed nothing new."""
        if self._frontier is not None:
            self._excluded.append(self._frontier.position)
            self._frontier = None

    def save(self, path: Path) -> None:
        """Write the current map to the YAML file *path* and the files beside it; see `save_map`.

        A warning in the log reports a poor map.

        Raises:
            MapError: The files cannot be written.
        """
        save_map(self.mapper.map(), path)
        self.saved_quality = self.mapper.quality()
        warning = self.saved_quality.warning() if self.saved_quality is not None else ""
        if warning:
            _log.warning("%s: %s", path, warning)

    def _create_localiser(self, random: np.random.Generator) -> PoseSource:
        amcl = self.parameters.amcl
        return Mapper(
            self.robot,
            self.transforms,
            start=Pose2D(amcl.initial_pose_x, amcl.initial_pose_y, amcl.initial_pose_yaw),
            resolution=self.map.resolution,
            keepout=self.map.keepout,
            odometry_limit=self.parameters.controller.odometry_timeout,
        )

    def _create_global_costmap(self) -> GlobalCostmap:
        costmap = GrowingCostmap(self.map, self.parameters.global_costmap)
        costmap.lower_bound = costmap.map_costs = None
        return costmap

    def _update_global(self, now: int) -> None:
        self._redraw()
        super()._update_global(now)

    def _redraw(self) -> None:
        if self._drawn_version != self.mapper.version:
            self._drawn_version = self.mapper.version
            self.map = self.mapper.map()
            self.global_costmap.redraw(self.map)
