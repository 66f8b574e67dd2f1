"""The planner: find the cheapest path over a costmap and smooth it, or report why there is no path.

`PlannerServer` is Nav2's action server `compute_path_to_pose` and `compute_path_through_poses`.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.action import ActionServer, GoalHandle
from btcore_navigation.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.grid_search import (
    COST_FACTOR,
    COST_NEUTRAL,
    IMPASSABLE,
    Cell,
    CostBounds,
    find_cheapest_path,
    grid_costs,
    reachable_cells,
)
from btcore_navigation.path import NavPath, join_paths, path_through
from btcore_navigation.path_smoothing import anchor_path, resample, smooth_path
from btcore_robot.errors import RobotError
from btcore_robot.robot import Pose2D

__all__ = [
    "THROUGH_OFFSET",
    "ComputePathGoal",
    "ComputePathHandle",
    "Planner",
    "PlannerError",
    "PlannerServer",
]

_MAX_BOUNDS = 8
THROUGH_OFFSET = Nav2ErrorCode.THROUGH_UNKNOWN - Nav2ErrorCode.COMPUTE_PATH_UNKNOWN
"""The offset of ComputePathThroughPoses' error codes from ComputePathToPose's error codes."""

PLANNER_ID = "GridBased"
"""The name of the only plug-in, as in the book's and Nav2's files."""

POSE_WAIT_NS = 1_000_000_000
"""The time (ns) for which a goal waits for the robot's pose, which is unknown right after start-up."""


class PlannerError(RobotError):
    """No path exists: *code* is one of Nav2's error codes, the message gives the reason.

    Args:
        message: The error message.
    """

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code


class Planner:
    """A planner over *costmap* for a robot of *radius* (m).

    A path is the cheapest path over the cells (cost 50 + 0.8·c, as in NavFn), then smoothed (see
    `path_smoothing`). It enters no cell with a cost of INSCRIBED or LETHAL, except to drive the robot out of
    such cells. With a *tolerance* of 0 the path ends at the goal or planning fails. With a larger *tolerance*
    (m), the path may end at the reachable point nearest to the goal, at most *tolerance* away from it. With
    *allow_unknown*, unknown cells are passable at a high price.

    For a costmap with a `lower_bound`, planning again to the same goal from farther along takes a fraction of
    the time. For a costmap with `map_costs`, errors name the place at which observed obstacles block the way.
    *place_name* returns the name of a goal for errors; by default the errors have the coordinates.
    """

    def __init__(
        self,
        costmap: Costmap,
        *,
        radius: float = 0.30,
        tolerance: float = 0.0,
        allow_unknown: bool = True,
        place_name: Callable[[Pose2D], str] | None = None,
    ) -> None:
        self.costmap = costmap
        self.place_name = place_name or _position
        self.radius = radius
        self.tolerance = tolerance
        self.allow_unknown = allow_unknown
        self._lower_bound = costmap.lower_bound
        self._lower_costs = None if costmap.lower_bound is None else grid_costs(costmap.lower_bound)
        self._bounds_by_goal: dict[Cell, CostBounds | None] = {}

    def plan(self, start: Pose2D, goal: Pose2D, now: int) -> NavPath:
        """Return a path in the costmap's frame.

        The headings point along the path; the last pose has the heading of the goal.

        Args:
            start: The pose at which the path begins, in the costmap's frame.
            goal: The pose at which the path ends, in the costmap's frame.
            now: The path's stamp (ns).

        Raises:
            PlannerError: No path exists; the code is START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP, START_OCCUPIED,
                GOAL_OCCUPIED or NO_VALID_PATH.
        """
        first = self._start_cell(start)
        last = self._goal_cell(goal)
        costs = grid_costs(self.costmap.costs, allow_unknown=self.allow_unknown)
        opened = self._open_start(costs, self.costmap.costs, start, first)
        reached = self._end(costs, first, goal, last)
        if reached is None:
            raise self._failure(costs, start, goal)
        end, place = reached
        # The bounds don't hold for cells that were opened for this start.
        cells = find_cheapest_path(costs, first, end, None if opened else self._bounds(first, end))
        if cells is None:
            raise PlannerError(Nav2ErrorCode.NO_VALID_PATH, f"no path to {self.place_name(goal)}")
        way = anchor_path(costs, cells, self._pixel(start.x, start.y), self._pixel(*place))
        points = self._points(smooth_path(costs, way))
        points[0], points[-1] = (start.x, start.y), place
        return path_through(points, goal, now, self.costmap.frame)

    def smooth(self, path: NavPath, now: int) -> NavPath | None:
        """Return a smooth path with the ends of *path*; None if *path* leads through obstacles.

        Args:
            path: The path, in the costmap's frame.
            now: The stamp (ns) of the result.
        """
        costs = grid_costs(self.costmap.costs, allow_unknown=self.allow_unknown)
        way = resample(np.array([self._pixel(x, y) for x, y, _ in path.poses.tolist()]), 1.0)
        cells = np.rint(way).astype(np.intp)
        if (cells < 0).any() or (cells >= costs.shape).any() or (costs[cells[:, 0], cells[:, 1]] < 0).any():
            return None
        points = self._points(smooth_path(costs, way))
        points[[0, -1]] = path.poses[[0, -1], :2]
        return path_through(points, path[-1], now, path.frame)

    def check_goal(self, goal: Pose2D) -> None:
        """Raise an error if *goal* can't be reached because of the map, whatever the robot observes.

        Raises:
            PlannerError: The goal is outside the map or too close to an obstacle of the map; the code is
                GOAL_OUTSIDE_MAP or GOAL_OCCUPIED.
        """
        last = self._goal_cell(goal)
        costs = self.costmap.map_costs
        if costs is not None and self.tolerance == 0 and costs[last] in (INSCRIBED, LETHAL):
            raise self._occupied(int(costs[last]), goal)

    def plan_through(self, poses: Sequence[Pose2D], now: int) -> NavPath:
        """Return a path through several poses.

        Args:
            poses: The start and the poses to pass, in order.
            now: The path's stamp (ns).

        Raises:
            PlannerError: No path exists. The code is NO_VIAPOINTS_GIVEN for fewer than two poses, otherwise
                the code of `plan` plus 100, as in ComputePathThroughPoses.
        """
        if len(poses) < 2:
            raise PlannerError(Nav2ErrorCode.NO_VIAPOINTS_GIVEN, "the list of goals is empty")
        legs: list[NavPath] = []
        for index in range(1, len(poses)):
            try:
                legs.append(self.plan(poses[index - 1], poses[index], now))
            except PlannerError as error:
                raise PlannerError(
                    Nav2ErrorCode(error.code + THROUGH_OFFSET), f"leg {index} of {len(poses) - 1}: {error}"
                ) from None
        return join_paths(legs, now)

    def _start_cell(self, start: Pose2D) -> Cell:
        if not self._is_on_map(start):
            raise PlannerError(
                Nav2ErrorCode.START_OUTSIDE_MAP, f"the robot {_position(start)} is outside the map"
            )
        return self.costmap.cell(start.x, start.y)

    def _goal_cell(self, goal: Pose2D) -> Cell:
        if not self._is_on_map(goal):
            raise PlannerError(
                Nav2ErrorCode.GOAL_OUTSIDE_MAP, f"the goal {self.place_name(goal)} is outside the map"
            )
        return self.costmap.cell(goal.x, goal.y)

    def _is_on_map(self, pose: Pose2D) -> bool:
        return math.isfinite(pose.x) and math.isfinite(pose.y) and self.costmap.inside(pose.x, pose.y)

    def _open_start(
        self, prices: NDArray[np.float64], costs: NDArray[np.uint8], start: Pose2D, first: Cell
    ) -> bool:
        """Open the cells under a robot that stands too near an obstacle; return whether cells were opened."""
        if prices[first] >= 0:
            return False
        window = self.costmap.square(start, 2 * self.radius)
        rows = np.arange(window.low_row, window.high_row) - first[0]
        cols = np.arange(window.low_col, window.high_col) - first[1]
        covered = np.hypot(rows[:, None], cols) * self.costmap.resolution <= self.radius
        inscribed = costs[window.slices] == INSCRIBED
        price = COST_NEUTRAL + COST_FACTOR * INSCRIBED
        part = prices[window.slices]
        part[covered & inscribed] = price
        prices[first] = price
        return True

    def _end(
        self, costs: NDArray[np.float64], first: Cell, goal: Pose2D, last: Cell
    ) -> tuple[Cell, tuple[float, float]] | None:
        """Return the last cell of the path and the point (m) in it; None if there is no path."""
        reachable = reachable_cells(costs, first)
        if reachable[last]:
            return last, (goal.x, goal.y)
        if self.tolerance > 0:
            window = self.costmap.square(goal, 2 * self.tolerance)
            rows, cols = np.nonzero(reachable[window.slices])
            if len(rows):
                y = self.costmap.origin[1] + (rows + window.low_row + 0.5) * self.costmap.resolution
                x = self.costmap.origin[0] + (cols + window.low_col + 0.5) * self.costmap.resolution
                off = np.hypot(x - goal.x, y - goal.y)
                best = int(np.argmin(off))
                if off[best] <= self.tolerance:
                    cell = int(rows[best]) + window.low_row, int(cols[best]) + window.low_col
                    return cell, (float(x[best]), float(y[best]))
        return None

    def _failure(self, costs: NDArray[np.float64], start: Pose2D, goal: Pose2D) -> PlannerError:
        """Return the error for a goal to which no path leads over cells with the prices *costs*."""
        first, last = self._start_cell(start), self._goal_cell(goal)
        cost = int(self.costmap.costs[last])
        if cost in (INSCRIBED, LETHAL):
            return self._occupied(cost, goal)
        if self.costmap.costs[first] == LETHAL:
            return PlannerError(
                Nav2ErrorCode.START_OCCUPIED, "the robot stands in an obstacle and no path leads out of it"
            )
        within = f" or to a place within {self.tolerance:g} m of it" if self.tolerance > 0 else ""
        if cost == UNKNOWN and costs[last] == IMPASSABLE:
            reason = "the goal is in unknown space"
        else:
            reason = self._obstruction(costs, start, goal)
        return PlannerError(
            Nav2ErrorCode.NO_VALID_PATH, f"no path to {self.place_name(goal)}{within}: {reason}"
        )

    def _occupied(self, cost: int, goal: Pose2D) -> PlannerError:
        """Return the error for a goal whose cell has the cost INSCRIBED or LETHAL."""
        place = "in an obstacle" if cost == LETHAL else "too close to an obstacle for the robot"
        known = self.costmap.map_costs
        if known is not None and known[self._goal_cell(goal)] not in (INSCRIBED, LETHAL):
            x, y = self._nearest_obstacle(goal.x, goal.y)
            place = f"{place}: an obstacle at ({x:.2f}, {y:.2f}) is not on the map"
        return PlannerError(Nav2ErrorCode.GOAL_OCCUPIED, f"the goal {self.place_name(goal)} is {place}")

    def _obstruction(self, costs: NDArray[np.float64], start: Pose2D, goal: Pose2D) -> str:
        """Return why no path leads over cells with the prices *costs*, compared with the map alone.

        The cause of a blocked way is the first observed obstacle on the path that the map alone would allow.
        """
        known = self.costmap.map_costs
        if known is None:
            return "obstacles block every way"
        first = self._start_cell(start)
        prices = grid_costs(known, allow_unknown=self.allow_unknown)
        opened = self._open_start(prices, known, start, first)
        reached = self._end(prices, first, goal, self._goal_cell(goal))
        if reached is None:
            return "the map does not connect it with the robot's position"
        end, _ = reached
        cells = find_cheapest_path(prices, first, end, None if opened else self._bounds(first, end))
        blocked = next((cell for cell in cells or () if costs[cell] < 0), None)
        if blocked is None:
            return "obstacles block every way"
        x, y = self._nearest_obstacle(*self._points(np.array([blocked], dtype=np.float64))[0])
        return f"blocked at ({x:.2f}, {y:.2f})"

    def _nearest_obstacle(self, x: float, y: float) -> tuple[float, float]:
        """Return the obstacle (m) that is nearest to a point whose cell the robot can't enter."""
        window = self.costmap.square(Pose2D(x, y, 0.0), 2 * self.radius)
        rows, cols = np.nonzero(self.costmap.costs[window.slices] == LETHAL)
        if not len(rows):
            return x, y
        points = self._points(np.stack((rows + window.low_row, cols + window.low_col), axis=1).astype(float))
        nearest = points[np.argmin(np.hypot(*(points - (x, y)).T))]
        return float(nearest[0]), float(nearest[1])

    def _bounds(self, first: Cell, end: Cell) -> CostBounds | None:
        """Return lower bounds for paths to *end*; computed only for a goal that is planned for again."""
        if self.costmap.lower_bound is not self._lower_bound:  # the map was replaced
            self._lower_bound = self.costmap.lower_bound
            self._lower_costs = None if self._lower_bound is None else grid_costs(self._lower_bound)
            self._bounds_by_goal.clear()
        if self._lower_costs is None:
            return None
        bounds = None
        if end in self._bounds_by_goal:
            bounds = self._bounds_by_goal.pop(end) or CostBounds(self._lower_costs, first, end)
        self._bounds_by_goal[end] = bounds  # last in the dictionary: the least recent goal is dropped first
        while len(self._bounds_by_goal) > _MAX_BOUNDS:
            del self._bounds_by_goal[next(iter(self._bounds_by_goal))]
        return bounds

    def _pixel(self, x: float, y: float) -> tuple[float, float]:
        return (
            (y - self.costmap.origin[1]) / self.costmap.resolution - 0.5,
            (x - self.costmap.origin[0]) / self.costmap.resolution - 0.5,
        )

    def _points(self, way: NDArray[np.float64]) -> NDArray[np.float64]:
        points: NDArray[np.float64] = way[:, ::-1] + 0.5
        points *= self.costmap.resolution
        points += self.costmap.origin
        return points


def _position(pose: Pose2D) -> str:
    return f"({pose.x:.2f}, {pose.y:.2f})"


@dataclass(frozen=True, slots=True)
class ComputePathGoal:
    """A request for a path.

    Attributes:
        goals: The poses to pass, in the frame `map`.
        start: The start of the path; None = the robot's pose.
        planner_id: The name of the planner's plug-in; "" = the default.
        through: Whether the goal is a request of ComputePathThroughPoses, which has error codes of its own.
    """

    goals: tuple[Pose2D, ...]
    start: Pose2D | None = None
    planner_id: str = ""
    through: bool = False


ComputePathHandle = GoalHandle[ComputePathGoal, None, NavPath]
"""The handle of a `ComputePathGoal`; its result is the path."""


class PlannerServer(ActionServer[ComputePathGoal, None, NavPath]):
    """The server of `ComputePathGoal`. It plans within a step, once *pose* returns a pose instead of None.

    Attributes:
        name: The name of the action.
        planner: The planner.
        pose: A function that returns the robot's pose, or None while the pose is unknown.
    """

    name = "compute_path"
    node = "planner_server"

    def __init__(self, planner: Planner, pose: Callable[[], Pose2D | None]) -> None:
        super().__init__()
        self.planner = planner
        self.pose = pose
        self.latest_path: NavPath | None = None
        """The last path that was found; public for displays."""
        self._accepted = 0
        self._earlier: list[ComputePathHandle | None] = []

    def send_goal(self, goal: ComputePathGoal) -> ComputePathHandle:
        """Send *goal* and return its handle. Goals that wait for the same step don't replace each other."""
        if self._next is not None:
            self._earlier.append(self._next)
            self._next = None
        return super().send_goal(goal)

    def step(self, now: int) -> None:
        """Plan for all goals that wait: those of the trees, and those of other clients."""
        waiting, self._earlier = [*self._earlier, self._next], []
        for handle in waiting:
            self._next = handle
            super().step(now)

    def start(self, handle: ComputePathHandle, now: int, previous: ComputePathHandle | None) -> None:
        """Remember the time of acceptance."""
        self._accepted = now

    def work(self, handle: ComputePathHandle, now: int) -> None:
        """Plan, or wait for the robot's pose."""
        goal = handle.goal
        offset = THROUGH_OFFSET if goal.through else 0
        if not goal.goals:
            handle.abort(int(Nav2ErrorCode.NO_VIAPOINTS_GIVEN), "the list of goals is empty")
            return
        if goal.planner_id not in ("", PLANNER_ID):
            code = int(Nav2ErrorCode.INVALID_PLANNER) + offset
            handle.abort(code, f"unknown planner '{goal.planner_id}': use {PLANNER_ID}")
            return
        start = goal.start if goal.start is not None else self.pose()
        if start is None:
            if now - self._accepted <= POSE_WAIT_NS:
                return
            handle.abort(int(Nav2ErrorCode.COMPUTE_PATH_TF_ERROR) + offset, "the robot's pose is unknown")
            return
        try:
            if goal.through:
                path = self.planner.plan_through([start, *goal.goals], now)
            else:
                path = self._plan(start, goal.goals, now)
        except PlannerError as error:
            handle.abort(int(error.code), str(error))
            return
        self.latest_path = path
        handle.succeed(path)

    def _plan(self, start: Pose2D, goals: tuple[Pose2D, ...], now: int) -> NavPath:
        legs = [self.planner.plan(*leg, now) for leg in pairwise((start, *goals))]
        return legs[0] if len(legs) == 1 else join_paths(legs, now)
