"""How well a run went, by the truth that only the simulator knows: battery, odometry, localisation, goals."""

import math
from collections.abc import Mapping, Sequence
from statistics import median

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import NS_PER_S, GoalOutcome, NavigationReporter, Phase, Pose2D
from btcore_sim.simulated_robot import SimulatedRobot

WARMED_UP = 10.0
"""m driven before localisation is judged."""

RELOCALISED_ERROR = 0.3
"""m between the true pose and the estimate within which a robot that was carried off has found itself."""

LOST_ERROR = 0.5
"""m between them from which on an estimate is no good to drive by."""

REACHED = 0.5
"""m between the true pose and a goal that may count as reached."""

_RATE = 10.0  # Hz
_SAME_PLACE = 0.05  # m between a goal and the waypoint that it is


class KidnapRecovery:
    """How a robot that was carried off after it had driven *driven* (m), at *began* (ns), got over it."""

    def __init__(self, began: int, driven: float) -> None:
        self._began = began
        self._driven = driven
        self._noticed: float | None = None
        self._found: float | None = None
        self._astray = 0.0

    def watch(self, now: int, driven: float, off: float | None) -> None:
        """At *now* (ns) it has driven *driven* (m), and its estimate is *off* (m) the truth, or None."""
        seconds = (now - self._began) / NS_PER_S
        if off is None:
            self._noticed = seconds if self._noticed is None else self._noticed
        elif off <= RELOCALISED_ERROR:
            self._found = seconds if self._found is None else self._found
        elif off > LOST_ERROR:
            self._astray += driven - self._driven
        self._driven = driven

    def figures(self) -> dict[str, float | None]:
        """``t`` (s), ``noticed_s``, ``found_s`` (None for never), ``astray_m``."""
        return {
            "t": self._began / NS_PER_S,
            "noticed_s": None if self._noticed is None else round(self._noticed, 3),
            "found_s": None if self._found is None else round(self._found, 3),
            "astray_m": round(self._astray, 4),
        }


class RunMetrics:
    """Watches *body* while it drives, and *navigator* if there is one, ten times a second."""

    def __init__(self, body: SimulatedRobot, navigator: NavigationReporter | None) -> None:
        self._body = body
        self._navigator = navigator
        self._errors: list[float] = []
        self._yaw_error = 0.0
        self._unknown = 0
        self._taken = 0
        self._failed = 0
        self._visited: list[str] = []
        self._carryings: list[KidnapRecovery] = []
        if navigator is not None:
            body.schedule.every(_RATE, Phase.JUDGE, lambda now: self._watch(navigator, now))

    def figures(self) -> dict[str, object]:
        """``battery_min`` (percent) and ``odometry_error_m``; the rest only when somebody navigates.

        ``localization_error_m`` has ``median`` and ``max`` (None when nothing was judged), as
        ``localization_yaw_error_rad`` has ``max``; ``unlocalized_s`` is how long the navigator said that it
        doesn't know where it is. Where the robot was carried off, ``carried`` lists for each time when
        (``t``, s), how long it took to notice and until the estimate was right again (``noticed_s``,
        ``found_s``; None for never), and how far it drove on an estimate that was wrong (``astray_m``).
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
        if self._carryings:
            found["carried"] = [one.figures() for one in self._carryings]
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

    def _watch(self, navigator: NavigationReporter, now: int) -> None:
        self._take(navigator.outcomes())
        body, estimate = self._body, navigator.estimate()
        true = body.true_pose()
        off = None if estimate is None else _apart(true, estimate)
        for began in body.teleport_times[len(self._carryings) :]:
            self._carryings.append(KidnapRecovery(began, body.distance))
        if self._carryings:
            self._carryings[-1].watch(now, body.distance, off)
        if body.distance < WARMED_UP:
            return
        if estimate is None or off is None:
            self._unknown += 1
            return
        self._errors.append(off)
        self._yaw_error = max(self._yaw_error, abs(wrap_angle(estimate.yaw - true.yaw)))

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


def odometry_error(body: SimulatedRobot) -> float:
    """How far (m) the place that odometry tells, begun at the true start, is from the true place."""
    start, said, true = body.start_pose, body.odometry().pose, body.true_pose()
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    x, y = start.x + cos * said.x - sin * said.y, start.y + sin * said.x + cos * said.y
    return math.hypot(x - true.x, y - true.y)


def waypoint(goal: Pose2D, waypoints: Mapping[str, tuple[float, float]]) -> str | None:
    """The name of the waypoint at *goal*, or None when it is somewhere else."""
    for name, (x, y) in waypoints.items():
        if math.hypot(goal.x - x, goal.y - y) <= _SAME_PLACE:
            return name
    return None


def navigator_among(resources: Sequence[object]) -> NavigationReporter | None:
    """The first of *resources* that navigates."""
    return next((one for one in resources if isinstance(one, NavigationReporter)), None)


def _apart(one: Pose2D, other: Pose2D) -> float:
    return math.hypot(one.x - other.x, one.y - other.y)
