"""How well a run went, by the truth that only the simulator knows: battery, odometry, localisation, goals."""

import math
from collections.abc import Mapping, Sequence
from statistics import median

from robot_nodes.robot import GoalOutcome, Navigating, Pose2D, Rank
from sim.body import Body

WARMED_UP = 10.0
"""m driven before localisation is judged."""

REACHED = 0.5
"""m between the true pose and a goal that may count as reached."""

_RATE = 10.0  # Hz
_SAME_PLACE = 0.05  # m between a goal and the waypoint that it is


class Judge:
    """Watches *body* while it drives, and *navigator* if there is one, ten times a second."""

    def __init__(self, body: Body, navigator: Navigating | None) -> None:
        self._body = body
        self._navigator = navigator
        self._errors: list[float] = []
        self._yaw_error = 0.0
        self._unknown = 0
        self._taken = 0
        self._failed = 0
        self._visited: list[str] = []
        if navigator is not None:
            body.schedule.every(_RATE, Rank.JUDGE, lambda now: self._watch(navigator))

    def figures(self) -> dict[str, object]:
        """``battery_min`` (percent) and ``odometry_error_m``; the rest only when somebody navigates.

        ``localization_error_m`` has ``median`` and ``max`` (None when nothing was judged), as
        ``localization_yaw_error_rad`` has ``max``; ``unlocalized_s`` is how long the navigator said that it
        doesn't know where it is.
        """
        body = self._body
        found: dict[str, object] = {
            "battery_min": round(body.cells.lowest, 4),
            "odometry_error_m": round(odometry_error(body), 4),
        }
        if self._navigator is None:
            return found
        self._take(self._navigator.outcomes())
        errors = self._errors
        return found | {
            "localization_error_m": {
                "median": round(median(errors), 4) if errors else None,
                "max": round(max(errors), 4) if errors else None,
            },
            "localization_yaw_error_rad": {"max": round(self._yaw_error, 4) if errors else None},
            "unlocalized_s": self._unknown / _RATE,
            "waypoints_visited": list(self._visited),
            "recharges": body.cells.recharges,
            "goals_failed": self._failed,
        }

    def _watch(self, navigator: Navigating) -> None:
        self._take(navigator.outcomes())
        if self._body.distance < WARMED_UP:
            return
        estimate = navigator.estimate()
        if estimate is None:
            self._unknown += 1
            return
        true = self._body.true_pose()
        self._errors.append(math.hypot(estimate.x - true.x, estimate.y - true.y))
        self._yaw_error = max(self._yaw_error, abs(math.remainder(estimate.yaw - true.yaw, 2 * math.pi)))

    def _take(self, outcomes: Sequence[GoalOutcome]) -> None:
        """Look at the goals that have ended since the last time."""
        for outcome in outcomes[self._taken :]:
            self._taken += 1
            if outcome.status == "ABORTED":
                self._failed += 1
            elif outcome.status == "SUCCEEDED" and _apart(self._body.true_pose(), outcome.goal) <= REACHED:
                name = waypoint(outcome.goal, self._body.world.scene.waypoints)
                if name is not None and name != "recharge":
                    self._visited.append(name)


def odometry_error(body: Body) -> float:
    """How far (m) the place that odometry tells, begun at the true start, is from the true place."""
    start, said, true = body.started, body.odometry().pose, body.true_pose()
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    x, y = start.x + cos * said.x - sin * said.y, start.y + sin * said.x + cos * said.y
    return math.hypot(x - true.x, y - true.y)


def waypoint(goal: Pose2D, waypoints: Mapping[str, tuple[float, float]]) -> str | None:
    """The name of the waypoint at *goal*, or None when it is somewhere else."""
    for name, (x, y) in waypoints.items():
        if math.hypot(goal.x - x, goal.y - y) <= _SAME_PLACE:
            return name
    return None


def navigator_among(resources: Sequence[object]) -> Navigating | None:
    """The first of *resources* that navigates."""
    return next((one for one in resources if isinstance(one, Navigating)), None)


def _apart(one: Pose2D, other: Pose2D) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)
