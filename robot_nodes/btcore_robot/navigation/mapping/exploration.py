"""Navigation on a map that is being made: it can go wherever has been seen, and knows where to look next."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from btcore_robot.navigation.costmap import GlobalCostmap
from btcore_robot.navigation.costmap_layers import UNKNOWN, ObstacleLayer, static_costs
from btcore_robot.navigation.mapping.frontiers import Frontier, find_frontiers, still_there
from btcore_robot.navigation.mapping.mapper import Mapper
from btcore_robot.navigation.occupancy_map import OccupancyMap, Rectangle, save_map
from btcore_robot.navigation.parameters import NavigationParameters
from btcore_robot.navigation.servers import PoseSource
from btcore_robot.navigation.stack import Navigation, costmap_arguments
from btcore_robot.robot import Pose2D, Robot


class GrowingCostmap(GlobalCostmap):
    """A global costmap whose map changes. Nothing is known that no later cost would be under."""

    def redraw(self, map: OccupancyMap) -> None:
        """Take *map* for the one before, whatever its size; what was seen is forgotten, since it is on it."""
        shape = (map.height, map.width)
        before = self.obstacles
        self.obstacles = ObstacleLayer(
            shape,
            map.resolution,
            UNKNOWN,
            min_range=before.min_range,
            max_range=before.max_range,
            raytrace_range=before.raytrace_range,
        )
        self.map = map
        self.origin = map.origin
        self._static = static_costs(map)
        self.costs = np.zeros(shape, dtype=np.uint8)
        self._refresh(self._everywhere())


class Exploration(Navigation):
    """Drives *robot* about where it has no map yet, and makes one; nothing that is unknown is driven over.

    The map begins at the initial pose of the localiser's parameters, (0, 0, 0) unless they say otherwise.
    *keepout* are places that the laser can't show.
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
        figures = parameters if parameters is not None else NavigationParameters()
        # A map that is begun has one cell, and everything around it is unknown.
        begun = OccupancyMap(
            np.full((1, 1), -1, dtype=np.int8), figures.global_costmap.resolution, (0.0, 0.0), keepout
        )
        known = replace(figures, planner=replace(figures.planner, allow_unknown=False))
        super().__init__(robot, begun, random, trees, known)
        self._drawn = -1
        self._left_out: list[tuple[float, float]] = []
        self._aim: Frontier | None = None

    @property
    def mapper(self) -> Mapper:
        """Who makes the map, and knows where on it the robot is."""
        return self.localiser

    def next_goal(self) -> Pose2D | None:
        """Where to go next in order to see more, in the frame map; None when there is no such place left."""
        here = self.estimate()
        if here is None:
            return None
        self._redraw()
        radius = self.parameters.global_costmap.robot_radius
        found = find_frontiers(self.map, self.global_costmap, here, self._left_out, radius=radius)
        self._aim = found[0] if found else None
        return self._aim.goal if self._aim is not None else None

    def is_goal_unknown(self) -> bool:
        """Whether what was to be looked at, at the place of the last `next_goal`, still is unknown."""
        return self._aim is not None and still_there(self.mapper.map(), self._aim.place)

    def exclude_goal(self) -> None:
        """Don't look there again: the last place can't be reached, or shows nothing."""
        if self._aim is not None:
            self._left_out.append(self._aim.place)
            self._aim = None

    def save(self, path: Path) -> None:
        """Write the map as it is now; raises `MapError` when that can't be."""
        save_map(self.mapper.map(), path)

    def _make_localiser(self, random: np.random.Generator) -> PoseSource:
        names = self.parameters.amcl
        return Mapper(
            self.robot,
            self.transforms,
            start=Pose2D(names.initial_pose_x, names.initial_pose_y, names.initial_pose_yaw),
            resolution=self.map.resolution,
            keepout=self.map.keepout,
            frames=(names.global_frame_id, names.odom_frame_id, names.base_frame_id),
        )

    def _make_global_costmap(self) -> GlobalCostmap:
        made = GrowingCostmap(self.map, **costmap_arguments(self.parameters.global_costmap))
        made.lower_bound = None
        return made

    def _update_global(self, now: int) -> None:
        self._redraw()
        super()._update_global(now)

    def _redraw(self) -> None:
        if self._drawn != self.mapper.version:
            self._drawn = self.mapper.version
            self.map = self.mapper.map()
            self.global_costmap.redraw(self.map)
