"""Costmaps: the cost of driving over each cell of the floor, with Nav2's cost values.

A cost is 0 in a free cell, 1–252 near an obstacle, 253 (INSCRIBED) where the robot's centre can't be without
a collision, 254 (LETHAL) in an obstacle, and 255 (UNKNOWN) in a cell that was never observed. `GlobalCostmap`
covers the map; `LocalCostmap` moves with the robot and holds only what the laser sees. Both add the laser's
obstacles, the keep-out rectangles and the inflation. A scan that `observe` receives takes effect at the next
`update`; only the newest scan of each sensor is used. The array `costs` is changed in place: copy it to keep
the present costs.
"""

import math

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.costmap_layers import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    GridWindow,
    InflationLayer,
    ObstacleLayer,
    bounding_window,
    draw_keepouts,
    static_costs,
)
from btcore_navigation.parameters import (
    CostmapParameters,
    GlobalCostmapParameters,
    LocalCostmapParameters,
)
from btcore_robot.occupancy_map import Grid, OccupancyMap, Rectangle
from btcore_robot.robot import MAP_FRAME, ODOM_FRAME, LaserScan, Pose2D

__all__ = ["FREE", "INSCRIBED", "LETHAL", "UNKNOWN", "Costmap", "GlobalCostmap", "LocalCostmap"]

_GLOBAL = GlobalCostmapParameters(robot_radius=0.30)
_LOCAL = LocalCostmapParameters(robot_radius=0.30)


class Costmap(Grid):
    """Costs on a grid.

    *costs* is uint8 of shape `(height, width)`, row 0 with the lowest y; *resolution* (m) is the side
    length of a cell, *origin* (m) the lower-left corner in *frame*. Points off the grid are LETHAL. *version*
    counts the changes.
    """

    lower_bound: NDArray[np.uint8] | None = None
    """A lower bound of all later costs, cell by cell, in the shape of *costs*; None if unknown."""
    map_costs: NDArray[np.uint8] | None = None
    """The costs without observed obstacles, in the shape of *costs*; None if unknown."""

    def __init__(
        self, costs: NDArray[np.uint8], resolution: float, origin: tuple[float, float], frame: str = MAP_FRAME
    ) -> None:
        self.costs = costs
        self.resolution = resolution
        self.origin = origin
        self.frame = frame
        self.version = 0

    def inside(self, x: float, y: float) -> bool:
        """Return whether a point is on the grid.

        Args:
            x: The point's x coordinate (m) in the costmap's frame.
            y: The point's y coordinate (m) in the costmap's frame.
        """
        row, col = self.cell(x, y)
        return 0 <= row < len(self.costs) and 0 <= col < len(self.costs[0])

    def cost(self, x: float, y: float) -> int:
        """Return the cost (0–255) at a point; LETHAL off the grid.

        Args:
            x: The point's x coordinate (m) in the costmap's frame.
            y: The point's y coordinate (m) in the costmap's frame.
        """
        return int(self.costs[self.cell(x, y)]) if self.inside(x, y) else LETHAL

    def costs_at(self, points: NDArray[np.floating]) -> NDArray[np.uint8]:
        """Return the costs at *points* (m, shape `(…, 2)`), shape `(…)`; LETHAL off the grid."""
        height, width = self.costs.shape
        rows = np.floor((points[..., 1] - self.origin[1]) / self.resolution).astype(np.intp)
        cols = np.floor((points[..., 0] - self.origin[0]) / self.resolution).astype(np.intp)
        off = (rows < 0) | (rows >= height) | (cols < 0) | (cols >= width)
        rows[off] = 0
        cols[off] = 0
        costs: NDArray[np.uint8] = self.costs[rows, cols]
        costs[off] = LETHAL
        return costs

    def square(self, pose: Pose2D, side: float) -> GridWindow:
        """Return the window of cells that an axis-parallel square touches, clipped to the grid.

        Args:
            pose: The pose at the centre of the square, in the costmap's frame; the yaw is ignored.
            side: The side length (m) of the square.
        """
        low = self.cell(pose.x - side / 2, pose.y - side / 2)
        high = self.cell(pose.x + side / 2, pose.y + side / 2)
        return GridWindow.clipped(*low, high[0] + 1, high[1] + 1, self.costs.shape)


class LayeredCostmap(Costmap):
    """A costmap whose obstacles come from scans: the base of the global and the local costmap."""

    def __init__(
        self,
        parameters: CostmapParameters,
        shape: tuple[int, int],
        resolution: float,
        origin: tuple[float, float],
        frame: str,
        unobserved: int,
    ) -> None:
        super().__init__(np.zeros(shape, dtype=np.uint8), resolution, origin, frame)
        self.inflation = InflationLayer(
            parameters.robot_radius, parameters.inflation_radius, parameters.cost_scaling_factor, resolution
        )
        self.obstacles = ObstacleLayer(
            shape,
            resolution,
            unobserved,
            min_range=parameters.obstacle_min_range,
            max_range=parameters.obstacle_max_range,
            raytrace_range=parameters.raytrace_max_range,
        )
        self.stamp = 0
        """The time (ns) of the last update."""
        self._pending: dict[str, tuple[LaserScan, Pose2D]] = {}

    def observe(self, scan: LaserScan, laser_pose: Pose2D) -> None:
        """Store *scan* for the next update; *laser_pose* is the laser's pose in this costmap's frame."""
        self._pending[scan.frame] = (scan, laser_pose)

    def clear(self, *, before: int | None = None) -> None:
        """Remove the observed obstacles; the obstacles of the map and the keep-outs stay.

        Args:
            before: The time (ns) from which on observed obstacles stay; by default all are removed.
        """
        self.obstacles.forget(before=before)
        self._pending.clear()
        self._refresh(self._whole_grid())

    def clear_around(self, pose: Pose2D, side: float, *, before: int | None = None) -> None:
        """Remove the observed obstacles in a square.

        Args:
            pose: The centre of the square, in this costmap's frame.
            side: The side length (m) of the square.
            before: As for `clear`.
        """
        window = self.square(pose, side)
        self.obstacles.forget(window, before=before)
        self._refresh(window)

    def clear_except(self, pose: Pose2D, side: float, *, before: int | None = None) -> None:
        """Remove the observed obstacles outside the square that `clear_around` clears.

        Args:
            pose: The centre of the square, in this costmap's frame.
            side: The side length (m) of the square.
            before: As for `clear`.
        """
        self.obstacles.forget(self.square(pose, side), outside=True, before=before)
        self._refresh(self._whole_grid())

    def _whole_grid(self) -> GridWindow:
        return GridWindow(0, 0, *self.costs.shape)

    def _take_observations(self) -> None:
        for scan, laser in self._pending.values():
            self.obstacles.update_from_scan(scan, laser, self.origin)
        self._pending.clear()

    def _base(self, window: GridWindow) -> NDArray[np.uint8]:
        """Return the costs in *window* before inflation."""
        raise NotImplementedError

    def _refresh(self, changed: GridWindow) -> None:
        """Compute the costs again wherever the inflation of *changed* cells reaches."""
        if changed.is_empty:
            return
        shape = (len(self.costs), len(self.costs[0]))
        affected = changed.grown(self.inflation.cells, shape)
        # Obstacles up to an inflation radius outside the affected cells contribute to their costs.
        needed = affected.grown(self.inflation.cells, shape)
        self.costs[affected.slices] = self.inflation.inflate(self._base(needed))[needed.of(affected)]
        self.version += 1


class GlobalCostmap(LayeredCostmap):
    """A costmap of the whole map, in the frame map, with the obstacles that the laser has observed.

    `lower_bound` contains the costs of the map's occupied cells and the keep-outs, with inflation.
    `map_costs` contains the map's unknown cells, too.

    Args:
        map: The map, which determines the resolution.
        parameters: The parameters; by default Nav2's, with the radius of Tiago.
    """

    def __init__(self, map: OccupancyMap, parameters: GlobalCostmapParameters = _GLOBAL) -> None:
        shape = (map.height, map.width)
        super().__init__(parameters, shape, map.resolution, map.origin, MAP_FRAME, UNKNOWN)
        self._track_unknown = parameters.track_unknown_space
        self._draw(map)

    def change_map(self, map: OccupancyMap) -> None:
        """Replace the map by *map*, of any size and resolution, and forget the observations."""
        shape, inflation = (map.height, map.width), self.inflation
        self.inflation = InflationLayer(
            inflation.radius, inflation.inflation_radius, inflation.scaling, map.resolution
        )
        self.obstacles.resolution = self.resolution = map.resolution
        self.obstacles.restart(shape)
        self._pending.clear()
        self.costs, self.origin = np.zeros(shape, dtype=np.uint8), map.origin
        self._draw(map)

    def _draw(self, map: OccupancyMap) -> None:
        self.map = map
        self._static = static_costs(map, track_unknown=self._track_unknown)
        is_lethal = np.where(self._static == LETHAL, LETHAL, FREE).astype(np.uint8)
        self.lower_bound = self.inflation.inflate(is_lethal)
        self.map_costs = self.inflation.inflate(self._static)
        self._refresh(self._whole_grid())

    def update(self, now: int, robot_pose: Pose2D | None = None) -> None:
        """Apply the observed scans; only the costs of changed windows are computed again.

        Args:
            now: The time (ns).
            robot_pose: The robot's pose in the map; the cells under the robot become FREE.
        """
        self.stamp = now
        windows = [self.obstacles.reachable(laser, self.origin) for _, laser in self._pending.values()]
        if robot_pose is not None:
            windows.append(self.square(robot_pose, 2 * self.inflation.radius + self.resolution))
        windows = [window for window in windows if not window.is_empty]
        # Most scans of a known place change nothing: comparing is cheaper than inflating.
        before = [self.obstacles.values[window.slices].copy() for window in windows]
        self._take_observations()
        if robot_pose is not None:
            self.obstacles.free_disc(robot_pose, self.inflation.radius, self.origin)
        for window, old in zip(windows, before, strict=True):
            self._refresh(bounding_window(self.obstacles.values[window.slices] != old, window))

    def _base(self, window: GridWindow) -> NDArray[np.uint8]:
        static = self._static[window.slices]
        seen = self.obstacles.values[window.slices]
        # UNKNOWN is the highest number, but must not hide what the map or the laser knows of a cell.
        highest = np.maximum(static, np.where(seen == UNKNOWN, FREE, seen))
        base: NDArray[np.uint8] = np.where((static == UNKNOWN) & (seen != UNKNOWN), seen, highest)
        return base


class LocalCostmap(LayeredCostmap):
    """A costmap of a square around the robot, in the frame `odom`, with observed obstacles.

    Cells without an observation are FREE.

    Args:
        parameters: The parameters; by default Nav2's, with the radius of Tiago.
        keepout: Rectangles in the frame map. They are drawn at the newest *map_pose* that `update` has
            received; before the first *map_pose* they are not drawn.
    """

    def __init__(
        self, parameters: LocalCostmapParameters = _LOCAL, keepout: tuple[Rectangle, ...] = ()
    ) -> None:
        side = round(parameters.width / parameters.resolution)
        super().__init__(parameters, (side, side), parameters.resolution, (0.0, 0.0), ODOM_FRAME, FREE)
        self._corner = (0, 0)
        self.keepout = keepout
        self._map_in_frame: Pose2D | None = None
        self._center_on(Pose2D(0.0, 0.0, 0.0))

    def update(self, now: int, robot_pose: Pose2D, map_pose: Pose2D | None = None) -> None:
        """Move the costmap with the robot and apply the observed scans.

        Args:
            now: The time (ns).
            robot_pose: The robot's pose in this costmap's frame, the new centre.
            map_pose: The pose of the frame map in this costmap's frame, for the keep-outs.
        """
        self.stamp = now
        if map_pose is not None:
            self._map_in_frame = map_pose
        self._center_on(robot_pose)
        self._take_observations()
        self.obstacles.free_disc(robot_pose, self.inflation.radius, self.origin)
        self._refresh(self._whole_grid())

    def _center_on(self, pose: Pose2D) -> None:
        half = len(self.costs) // 2
        corner = (
            math.floor(pose.y / self.resolution) - half,
            math.floor(pose.x / self.resolution) - half,
        )
        if corner != self._corner:
            self.obstacles.shift(corner[0] - self._corner[0], corner[1] - self._corner[1])
            self._corner = corner
            self.origin = (corner[1] * self.resolution, corner[0] * self.resolution)

    def _base(self, window: GridWindow) -> NDArray[np.uint8]:
        if not self.keepout or self._map_in_frame is None:
            return self.obstacles.values[window.slices]
        # Drawn on a copy: `map_pose` changes with each correction of the localiser.
        base = self.obstacles.values.copy()
        draw_keepouts(base, self.resolution, self.origin, self.keepout, self._map_in_frame)
        return base[window.slices]
