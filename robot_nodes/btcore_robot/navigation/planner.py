"""The planner: the cheapest way over a costmap to a goal, made smooth, or a reason why there is none."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from btcore_robot.errors import RobotError
from btcore_robot.navigation.costmap import INSCRIBED, LETHAL, UNKNOWN, Costmap
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.grid_search import (
    FACTOR,
    NEUTRAL,
    WALL,
    Bounds,
    Cell,
    connected,
    find_cheapest_path,
    grid_costs,
)
from btcore_robot.navigation.path import NavPath, empty_path, joined, through
from btcore_robot.navigation.path_smoothing import anchored, smooth_path
from btcore_robot.robot import Pose2D

_BOUNDS_KEPT = 8
_THROUGH = Nav2ErrorCode.THROUGH_UNKNOWN - Nav2ErrorCode.COMPUTE_PATH_UNKNOWN


class PlannerError(RobotError):
    """There is no path: *code* is one of Nav2's numbers, *message* says what stands in the way."""

    def __init__(self, code: int, message: str) -> None:
        super().__init__(message)
        self.code = code
        self.message = message


class Planner:
    """Plans over *costmap* for a robot of *radius* (m).

    A path is a cheapest one over the cells (cost 50 + 0.8·c, as NavFn's), made straight and round (see
    `path_smoothing`); it enters no cell from INSCRIBED up, but for those that a robot standing among them
    has to leave. With *tolerance* (m) 0 a goal is reached or refused; above, the path may end at the nearest
    place within it that can be reached. Unknown cells are driven through at a high price if *allow_unknown*.

    When the same goal is planned for again, from further on, what is left of the search is a fraction, for a
    costmap that knows its `lower_bound`.
    """

    def __init__(
        self,
        costmap: Costmap,
        *,
        radius: float = 0.30,
        tolerance: float = 0.0,
        allow_unknown: bool = True,
    ) -> None:
        self.costmap = costmap
        self.radius = radius
        self.tolerance = tolerance
        self.allow_unknown = allow_unknown
        self._floor = None if costmap.lower_bound is None else grid_costs(costmap.lower_bound)
        self._asked: dict[Cell, Bounds | None] = {}

    def plan(self, start: Pose2D, goal: Pose2D, now: int) -> NavPath:
        """The path from *start* to *goal*, in the costmap's frame, stamped *now* (ns).

        Each pose looks along the path, the last one as *goal* does. Raises `PlannerError` with
        START_OUTSIDE_MAP, GOAL_OUTSIDE_MAP, START_OCCUPIED, GOAL_OCCUPIED or NO_VALID_PATH.
        """
        first = self._cell(start, Nav2ErrorCode.START_OUTSIDE_MAP, "the robot")
        last = self._cell(goal, Nav2ErrorCode.GOAL_OUTSIDE_MAP, "the goal")
        costs = grid_costs(self.costmap.costs, allow_unknown=self.allow_unknown)
        occupied = self.costmap.costs[first] == LETHAL
        left = self._leave(costs, start, first)
        reached = connected(costs, first)
        end, place = self._end(costs, reached, goal, last, stuck=bool(occupied))
        cells = find_cheapest_path(costs, first, end, None if left else self._bounds(first, end))
        if cells is None:
            raise PlannerError(Nav2ErrorCode.NO_VALID_PATH, f"no path leads to the goal {_said(goal)}")
        way = anchored(costs, cells, self._pixel(start.x, start.y), self._pixel(*place))
        points = self._points(smooth_path(costs, way))
        points[0], points[-1] = (start.x, start.y), place
        return through(points, goal, now, self.costmap.frame)

    def plan_through(self, poses: Sequence[Pose2D], now: int) -> NavPath:
        """One path from the first of *poses* through all others, in their order.

        Raises `PlannerError` with the codes of ComputePathThroughPoses: NO_VIAPOINTS_GIVEN for fewer than two
        poses, else those of `plan` plus 100.
        """
        if len(poses) < 2:
            raise PlannerError(Nav2ErrorCode.NO_VIAPOINTS_GIVEN, "a path through poses needs one to go to")
        legs: list[NavPath] = []
        for index in range(1, len(poses)):
            try:
                legs.append(self.plan(poses[index - 1], poses[index], now))
            except PlannerError as fault:
                raise PlannerError(
                    Nav2ErrorCode(fault.code + _THROUGH), f"leg {index} of {len(poses) - 1}: {fault.message}"
                ) from None
        return joined(legs, now)

    def empty(self, now: int) -> NavPath:
        """The path of a plan that failed: no poses."""
        return empty_path(now, self.costmap.frame)

    def _cell(self, pose: Pose2D, code: Nav2ErrorCode, who: str) -> Cell:
        if not (math.isfinite(pose.x) and math.isfinite(pose.y)) or not self.costmap.inside(pose.x, pose.y):
            raise PlannerError(code, f"{who} {_said(pose)} is outside the map")
        return self.costmap.cell(pose.x, pose.y)

    def _leave(self, costs: NDArray[np.float64], start: Pose2D, first: Cell) -> bool:
        """Let a robot that stands too near to something leave: its own cell and those it covers are open.

        Whether that was needed.
        """
        if costs[first] >= 0:
            return False
        window = self.costmap.square(start, 2 * self.radius)
        rows = np.arange(window.low_row, window.high_row) - first[0]
        cols = np.arange(window.low_col, window.high_col) - first[1]
        covered = np.hypot(rows[:, None], cols) * self.costmap.resolution <= self.radius
        near = self.costmap.costs[window.slices] == INSCRIBED
        dear = NEUTRAL + FACTOR * INSCRIBED
        part = costs[window.slices]
        part[covered & near] = dear
        costs[first] = dear
        return True

    def _end(
        self,
        costs: NDArray[np.float64],
        reached: NDArray[np.bool_],
        goal: Pose2D,
        last: Cell,
        *,
        stuck: bool,
    ) -> tuple[Cell, tuple[float, float]]:
        """Where the path ends: the cell and the place in it."""
        if reached[last]:
            return last, (goal.x, goal.y)
        if self.tolerance > 0:
            window = self.costmap.square(goal, 2 * self.tolerance)
            rows, cols = np.nonzero(reached[window.slices])
            if len(rows):
                y = self.costmap.origin[1] + (rows + window.low_row + 0.5) * self.costmap.resolution
                x = self.costmap.origin[0] + (cols + window.low_col + 0.5) * self.costmap.resolution
                off = np.hypot(x - goal.x, y - goal.y)
                best = int(np.argmin(off))
                if off[best] <= self.tolerance:
                    cell = int(rows[best]) + window.low_row, int(cols[best]) + window.low_col
                    return cell, (float(x[best]), float(y[best]))
        cost = int(self.costmap.costs[last])
        within = f" or to a place within {self.tolerance:g} m of it" if self.tolerance > 0 else ""
        if cost in (INSCRIBED, LETHAL):
            why = "in an obstacle" if cost == LETHAL else "nearer to an obstacle than the robot can stand"
            raise PlannerError(Nav2ErrorCode.GOAL_OCCUPIED, f"the goal {_said(goal)} is {why}")
        if stuck:
            raise PlannerError(
                Nav2ErrorCode.START_OCCUPIED, "the robot stands in an obstacle and finds no way out of it"
            )
        unseen = cost == UNKNOWN and costs[last] == WALL
        raise PlannerError(
            Nav2ErrorCode.NO_VALID_PATH,
            f"no path leads to the goal {_said(goal)}{within}: "
            + ("nobody has seen what is there" if unseen else "something closes every way"),
        )

    def _bounds(self, first: Cell, end: Cell) -> Bounds | None:
        """What is known of ways to *end*; worth finding out when a goal is asked for again."""
        if self._floor is None:
            return None
        if end not in self._asked:
            known = None
        else:
            known = self._asked.pop(end) or Bounds(self._floor, first, end)
        self._asked[end] = known
        while len(self._asked) > _BOUNDS_KEPT:
            del self._asked[next(iter(self._asked))]
        return known

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


def _said(pose: Pose2D) -> str:
    return f"({pose.x:.2f}, {pose.y:.2f})"
