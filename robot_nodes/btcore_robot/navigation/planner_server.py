"""The planner as an action: Nav2's ``compute_path_to_pose`` and ``compute_path_through_poses``."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from btcore_robot.navigation.action import ActionServer, GoalHandle
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.path import NavPath, joined
from btcore_robot.navigation.planner import Planner, PlannerError
from btcore_robot.robot import Pose2D

PLANNER_ID = "GridBased"
"""The one plug-in, by the name that the book's and Nav2's files give it."""

POSE_WITHIN = 1_000_000_000
"""How long (ns) a goal waits for the robot to know where it is; it begins without."""

_THROUGH = int(Nav2ErrorCode.THROUGH_UNKNOWN) - int(Nav2ErrorCode.COMPUTE_PATH_UNKNOWN)


@dataclass(frozen=True, slots=True)
class PathGoal:
    """A path through *goals* (map), from *start*, or from where the robot is.

    *through* says that the goals were asked for as several, which has error numbers of its own.
    """

    goals: tuple[Pose2D, ...]
    start: Pose2D | None = None
    planner_id: str = ""
    through: bool = False


class PlannerServer(ActionServer[PathGoal, None, NavPath]):
    """Plans within one step, once *pose* tells where the robot is; it is None while nobody knows."""

    name = "compute_path"

    def __init__(self, planner: Planner, pose: Callable[[], Pose2D | None]) -> None:
        super().__init__()
        self.planner = planner
        self.pose = pose
        self.newest: NavPath | None = None
        """The last path that was found, for whoever draws it."""
        self._accepted = 0

    def start(
        self,
        handle: GoalHandle[PathGoal, None, NavPath],
        now: int,
        previous: GoalHandle[PathGoal, None, NavPath] | None,
    ) -> None:
        """Note the time."""
        self._accepted = now

    def work(self, handle: GoalHandle[PathGoal, None, NavPath], now: int) -> None:
        """Plan."""
        goal = handle.goal
        offset = _THROUGH if goal.through else 0
        if not goal.goals:
            handle.abort(int(Nav2ErrorCode.NO_VIAPOINTS_GIVEN), "there is no goal to plan to")
            return
        if goal.planner_id not in ("", PLANNER_ID):
            code = int(Nav2ErrorCode.INVALID_PLANNER) + offset
            handle.abort(code, f"there is no planner '{goal.planner_id}': there is {PLANNER_ID}")
            return
        start = goal.start if goal.start is not None else self.pose()
        if start is None:
            if now - self._accepted <= POSE_WITHIN:
                return
            handle.abort(
                int(Nav2ErrorCode.COMPUTE_PATH_TF_ERROR) + offset, "the robot doesn't know where it is"
            )
            return
        try:
            if goal.through:
                path = self.planner.plan_through([start, *goal.goals], now)
            else:
                path = self._plan(start, goal.goals, now)
        except PlannerError as fault:
            handle.abort(int(fault.code), str(fault))
            return
        self.newest = path
        handle.succeed(path)

    def _plan(self, start: Pose2D, goals: tuple[Pose2D, ...], now: int) -> NavPath:
        legs = [self.planner.plan(*leg, now) for leg in pairwise((start, *goals))]
        return legs[0] if len(legs) == 1 else joined(legs, now)
