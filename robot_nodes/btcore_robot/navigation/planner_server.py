"""The planner as an action server: Nav2's ``compute_path_to_pose`` and ``compute_path_through_poses``."""

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

from btcore_robot.navigation.action import ActionServer, GoalHandle
from btcore_robot.navigation.error_codes import Nav2ErrorCode
from btcore_robot.navigation.path import NavPath, join_paths
from btcore_robot.navigation.planner import Planner, PlannerError
from btcore_robot.robot import Pose2D

PLANNER_ID = "GridBased"
"""The name of the only plug-in, as in the book's and Nav2's files."""

POSE_WITHIN = 1_000_000_000
"""The time (ns) for which a goal waits for a known pose of the robot: at its start the pose is unknown."""

_THROUGH = int(Nav2ErrorCode.THROUGH_UNKNOWN) - int(Nav2ErrorCode.COMPUTE_PATH_UNKNOWN)


@dataclass(frozen=True, slots=True)
class ComputePathGoal:
    """A request for a path through *goals* (map) from *start*, or from the robot's pose.

    *through* stands for a request of ComputePathThroughPoses, which has error codes of its own.
    """

    goals: tuple[Pose2D, ...]
    start: Pose2D | None = None
    planner_id: str = ""
    through: bool = False


class PlannerServer(ActionServer[ComputePathGoal, None, NavPath]):
    """The server of `ComputePathGoal`. It plans within a step, once *pose* returns a pose instead of None."""

    name = "compute_path"

    def __init__(self, planner: Planner, pose: Callable[[], Pose2D | None]) -> None:
        super().__init__()
        self.planner = planner
        self.pose = pose
        self.latest_path: NavPath | None = None
        """The last path that was found; public for displays."""
        self._accepted = 0

    def start(
        self,
        handle: GoalHandle[ComputePathGoal, None, NavPath],
        now: int,
        previous: GoalHandle[ComputePathGoal, None, NavPath] | None,
    ) -> None:
        """Remember the time of acceptance."""
        self._accepted = now

    def work(self, handle: GoalHandle[ComputePathGoal, None, NavPath], now: int) -> None:
        """Plan, or wait for the robot's pose."""
        goal = handle.goal
        offset = _THROUGH if goal.through else 0
        if not goal.goals:
            handle.abort(int(Nav2ErrorCode.NO_VIAPOINTS_GIVEN), "the list of goals is empty")
            return
        if goal.planner_id not in ("", PLANNER_ID):
            code = int(Nav2ErrorCode.INVALID_PLANNER) + offset
            handle.abort(code, f"unknown planner '{goal.planner_id}': use {PLANNER_ID}")
            return
        start = goal.start if goal.start is not None else self.pose()
        if start is None:
            if now - self._accepted <= POSE_WITHIN:
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
