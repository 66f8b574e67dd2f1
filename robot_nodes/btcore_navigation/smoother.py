"""The smoother: Nav2's action server `smooth_path` for paths that another program has planned."""

from btcore_navigation.action import ActionServer, GoalHandle
from btcore_navigation.costmap import INSCRIBED, UNKNOWN
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.navigation_servers import SmoothedPath, SmoothPathGoal
from btcore_navigation.path import NavPath
from btcore_navigation.planner import Planner
from btcore_robot.robot import Pose2D

SMOOTHER_ID = "simple_smoother"
"""The name of the only plug-in, as in Nav2's files."""

SmoothPathHandle = GoalHandle[SmoothPathGoal, None, SmoothedPath]
"""The handle of a `SmoothPathGoal`."""


class SmootherServer(ActionServer[SmoothPathGoal, None, SmoothedPath]):
    """The server of `SmoothPathGoal`. It smooths within a step, so that no time passes on the robot's clock.

    A path that leads through obstacles or leaves the map stays as it is, with `was_completed` False.
    """

    name = "smooth_path"
    node = "smoother_server"

    def __init__(self, planner: Planner) -> None:
        super().__init__()
        self._planner = planner

    def work(self, handle: SmoothPathHandle, now: int) -> None:
        """Smooth the path, or abort the goal."""
        goal, frame = handle.goal, self._planner.costmap.frame
        if goal.smoother_id not in ("", SMOOTHER_ID):
            handle.abort(
                Nav2ErrorCode.INVALID_SMOOTHER, f"unknown smoother '{goal.smoother_id}': use {SMOOTHER_ID}"
            )
        elif not len(goal.path):
            handle.abort(Nav2ErrorCode.SMOOTH_INVALID_PATH, "the path is empty")
        elif goal.path.frame != frame:
            handle.abort(
                Nav2ErrorCode.SMOOTH_INVALID_PATH,
                f"the path is in the frame '{goal.path.frame}', but it must be in '{frame}'",
            )
        else:
            smooth = self._planner.smooth(goal.path, now)
            path = goal.path if smooth is None else smooth
            collision = self._collision(path) if goal.check_for_collisions else None
            if collision is not None:
                handle.abort(
                    Nav2ErrorCode.SMOOTHED_PATH_IN_COLLISION,
                    f"the path is in collision at ({collision.x:.2f}, {collision.y:.2f})",
                )
            else:
                handle.succeed(SmoothedPath(path, 0.0, smooth is not None))

    def _collision(self, path: NavPath) -> Pose2D | None:
        costs = self._planner.costmap.costs_at(path.poses[:, :2])
        blocked = ((costs >= INSCRIBED) & (costs != UNKNOWN)).nonzero()[0]
        return path[int(blocked[0])] if len(blocked) else None
