"""Costmaps: what each cell of the floor costs a robot that drives over it, by Nav2's numbers.

A cost is 0 where it is free, 1–252 near an obstacle, 253 (INSCRIBED) where the robot's middle can't be
without touching one, 254 (LETHAL) where the obstacle is, 255 (UNKNOWN) where nobody has looked.
`GlobalCostmap` knows the map, `LocalCostmap` moves with the robot and knows what it sees; both put the
laser's obstacles, the keep-out rectangles and the inflation on top. Observations wait until `update`, and of
several by one sensor the newest counts. Arrays are changed in place: whoever keeps one copies it.
"""

import math

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.costmap_layers import (
    FREE,
    INSCRIBED,
    LETHAL,
    UNKNOWN,
    GridWindow,
    Inflation,
    ObstacleLayer,
    around,
    draw_keepouts,
    static_costs,
)
from btcore_robot.navigation.occupancy_map import Grid, OccupancyMap, Rectangle
from btcore_robot.robot import LaserScan, Pose2D

__all__ = ["FREE", "INSCRIBED", "LETHAL", "UNKNOWN", "Costmap", "GlobalCostmap", "LocalCostmap"]

_NOWHERE = GridWindow(0, 0, 0, 0)


class Costmap(Grid):
    """Costs on a grid.

    *costs* is uint8 of shape ``(height, width)``, row 0 with the lowest y; *resolution* (m) is a cell's
    side, *origin* (m) the lower-left corner in *frame*. What is off the grid is LETHAL. *version* counts
    the changes. *floor*, of the same shape, holds costs that no later cost is under, where that is known.
    """

    lower_bound: NDArray[np.uint8] | None = None

    def __init__(
        self, costs: NDArray[np.uint8], resolution: float, origin: tuple[float, float], frame: str = "map"
    ) -> None:
        self.costs = costs
        self.resolution = resolution
        self.origin = origin
        self.frame = frame
        self.version = 0

    def inside(self, x: float, y: float) -> bool:
        """Whether the point *x*, *y* (m) is on the grid."""
        row, col = self.cell(x, y)
        return 0 <= row < len(self.costs) and 0 <= col < len(self.costs[0])

    def cost(self, x: float, y: float) -> int:
        """The cost at the point *x*, *y* (m); LETHAL off the grid."""
        row, col = self.cell(x, y)
        if 0 <= row < len(self.costs) and 0 <= col < len(self.costs[0]):
            return int(self.costs[row, col])
        return LETHAL

    def costs_at(self, points: NDArray[np.floating]) -> NDArray[np.uint8]:
        """The costs at *points* (m, shape ``(…, 2)``), shape ``(…)``; LETHAL off the grid."""
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
        """The cells that a square of *side* (m) about *pose* touches, along the axes."""
        low = self.cell(pose.x - side / 2, pose.y - side / 2)
        high = self.cell(pose.x + side / 2, pose.y + side / 2)
        height, width = self.costs.shape
        window = GridWindow(max(0, low[0]), max(0, low[1]), min(height, high[0] + 1), min(width, high[1] + 1))
        return _NOWHERE if window.empty else window


class LayeredCostmap(Costmap):
    """A costmap whose obstacles come from scans: what the global and the local one have in common."""

    def __init__(
        self,
        shape: tuple[int, int],
        origin: tuple[float, float],
        frame: str,
        inflation: Inflation,
        obstacles: ObstacleLayer,
    ) -> None:
        super().__init__(np.zeros(shape, dtype=np.uint8), inflation.resolution, origin, frame)
        self.inflation = inflation
        self.obstacles = obstacles
        self.stamp = 0
        """When it was updated last (ns)."""
        self._waiting: dict[str, tuple[LaserScan, Pose2D]] = {}

    def observe(self, scan: LaserScan, laser_pose: Pose2D) -> None:
        """See *scan*, taken with the laser at *laser_pose* in this costmap's frame, at the next update."""
        self._waiting[scan.frame] = (scan, laser_pose)

    def clear(self) -> None:
        """Forget every obstacle that was seen; the map's own and the keep-outs stay."""
        self.obstacles.forget()
        self._waiting.clear()
        self._refresh(self._everywhere())

    def clear_around(self, pose: Pose2D, side: float) -> None:
        """Forget the obstacles seen in the square of *side* (m) about *pose* in this costmap's frame."""
        window = self.square(pose, side)
        self.obstacles.forget(window)
        self._refresh(window)

    def clear_except(self, pose: Pose2D, side: float) -> None:
        """Forget the obstacles seen outside the square of *side* (m) about *pose* in this costmap's frame."""
        self.obstacles.forget(self.square(pose, side), outside=True)
        self._refresh(self._everywhere())

    def _everywhere(self) -> GridWindow:
        return GridWindow(0, 0, *self.costs.shape)

    def _see(self) -> None:
        for scan, laser in self._waiting.values():
            self.obstacles.see(scan, laser, self.origin)
        self._waiting.clear()

    def _base(self, window: GridWindow) -> NDArray[np.uint8]:
        """The costs in *window* before inflation."""
        raise NotImplementedError

    def _refresh(self, changed: GridWindow) -> None:
        """Inflate anew wherever *changed* cells can be felt."""
        if changed.empty:
            return
        shape = (len(self.costs), len(self.costs[0]))
        felt = changed.grown(self.inflation.cells, shape)
        seen = felt.grown(self.inflation.cells, shape)
        self.costs[felt.slices] = self.inflation.inflated(self._base(seen))[seen.of(felt)]
        self.version += 1


class GlobalCostmap(LayeredCostmap):
    """The whole map, in its frame, with what was seen since.

    *radius* (m) is the robot's, *inflation_radius* (m) and *scaling* (1/m) those of `Inflation`; readings
    mark up to *obstacle_max_range* (m) and clear up to *raytrace_range*. Unknown cells of the map stay
    UNKNOWN until a ray crosses them, unless *track_unknown* is off. `lower_bound` has the costs of the map's
    occupied cells and the keep-outs.
    """

    def __init__(
        self,
        map: OccupancyMap,
        radius: float = 0.30,
        inflation_radius: float = 0.55,
        scaling: float = 3.0,
        *,
        obstacle_min_range: float = 0.0,
        obstacle_max_range: float = 2.5,
        raytrace_range: float = 3.0,
        track_unknown: bool = True,
    ) -> None:
        shape = (map.height, map.width)
        obstacles = ObstacleLayer(
            shape,
            map.resolution,
            UNKNOWN,
            min_range=obstacle_min_range,
            max_range=obstacle_max_range,
            raytrace_range=raytrace_range,
        )
        inflation = Inflation(radius, inflation_radius, scaling, map.resolution)
        super().__init__(shape, map.origin, "map", inflation, obstacles)
        self.map = map
        self._static = static_costs(map, track_unknown=track_unknown)
        self.lower_bound = inflation.inflated(np.where(self._static == LETHAL, LETHAL, FREE).astype(np.uint8))
        self._refresh(self._everywhere())

    def update(self, now: int, robot_pose: Pose2D | None = None) -> None:
        """Take in what was observed; with a *robot_pose*, nothing is seen where the robot itself stands.

        Costs nothing to speak of when nothing has changed.
        """
        self.stamp = now
        windows = [self.obstacles.reachable(laser, self.origin) for _, laser in self._waiting.values()]
        if robot_pose is not None:
            windows.append(self.square(robot_pose, 2 * self.inflation.radius + self.resolution))
        windows = [window for window in windows if not window.empty]
        before = [self.obstacles.values[window.slices].copy() for window in windows]
        self._see()
        if robot_pose is not None:
            self.obstacles.free_disc(robot_pose, self.inflation.radius, self.origin)
        for window, old in zip(windows, before, strict=True):
            self._refresh(around(self.obstacles.values[window.slices] != old, window))

    def _base(self, window: GridWindow) -> NDArray[np.uint8]:
        static = self._static[window.slices]
        seen = self.obstacles.values[window.slices]
        highest = np.maximum(static, np.where(seen == UNKNOWN, FREE, seen))
        base: NDArray[np.uint8] = np.where((static == UNKNOWN) & (seen != UNKNOWN), seen, highest)
        return base


class LocalCostmap(LayeredCostmap):
    """A square of *size* (m) about the robot, in the frame ``odom``, with what is seen in it.

    What nobody has looked at is FREE. *keepout* are rectangles of the frame map, which are where the newest
    *map_to_odom* says; before the first they are nowhere. The other figures are those of `GlobalCostmap`.
    """

    def __init__(
        self,
        radius: float = 0.30,
        inflation_radius: float = 0.55,
        scaling: float = 3.0,
        *,
        size: float = 3.0,
        resolution: float = 0.05,
        keepout: tuple[Rectangle, ...] = (),
        obstacle_min_range: float = 0.0,
        obstacle_max_range: float = 2.5,
        raytrace_range: float = 3.0,
        frame: str = "odom",
    ) -> None:
        side = round(size / resolution)
        obstacles = ObstacleLayer(
            (side, side),
            resolution,
            FREE,
            min_range=obstacle_min_range,
            max_range=obstacle_max_range,
            raytrace_range=raytrace_range,
        )
        inflation = Inflation(radius, inflation_radius, scaling, resolution)
        super().__init__((side, side), (0.0, 0.0), frame, inflation, obstacles)
        self._corner = (0, 0)
        self._keepout = keepout
        self._map_in_frame: Pose2D | None = None
        self._go_to(Pose2D(0.0, 0.0, 0.0))

    def update(self, now: int, robot_pose: Pose2D, map_pose: Pose2D | None = None) -> None:
        """Move the middle to *robot_pose* in this costmap's frame, and take in what was observed.

        *map_pose* is where the frame map is in this costmap's frame, for the keep-outs.
        """
        self.stamp = now
        if map_pose is not None:
            self._map_in_frame = map_pose
        self._go_to(robot_pose)
        self._see()
        self.obstacles.free_disc(robot_pose, self.inflation.radius, self.origin)
        self._refresh(self._everywhere())

    def _go_to(self, pose: Pose2D) -> None:
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
        if not self._keepout or self._map_in_frame is None:
            return self.obstacles.values[window.slices]
        base = self.obstacles.values.copy()
        draw_keepouts(base, self.resolution, self.origin, self._keepout, self._map_in_frame)
        return base[window.slices]
