"""Measures of a run from the simulator's ground truth: battery, odometry, localisation and goals."""

import math
from collections.abc import Sequence
from functools import cached_property
from statistics import median
from typing import TYPE_CHECKING

from btcore.clock import NS_PER_S
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import GoalOutcome, NavigationReporter, Phase, Pose2D

if TYPE_CHECKING:
    from btcore_sim.simulated_robot import SimulatedRobot

FIRST_MEASUREMENT = NS_PER_S
"""Time (ns) of the first measurement: until then every navigator waits for its first scans."""

RELOCALISED_ERROR = 0.3
"""Localisation error (m) up to which a robot counts as relocalised after it was kidnapped."""

LOST_ERROR = 0.5
"""Localisation error (m) above which the estimate is too wrong for driving."""

REACHED = 0.5
"""Greatest distance (m) between the true pose and a goal that counts as reached."""

_RATE = 10.0  # Hz of the measurements


class KidnapRecovery:
    """The recovery of the localisation after the robot was kidnapped (see `btcore_sim.events`).

    *began* (ns) is the time at which this began, *driven* (m) the distance that it had driven before.
    """

    def __init__(self, began: int, driven: float) -> None:
        self._began = began
        self._driven = driven
        self._noticed: float | None = None
        self._relocalised: float | None = None
        self._astray = 0.0

    def watch(self, now: int, driven: float, off: float | None, is_carried: bool) -> None:
        """Record a measurement of the localisation.

        Args:
            now: The simulated time (ns).
            driven: The total distance driven (m).
            off: The localisation error (m), or None if the robot reports that it is lost.
            is_carried: Whether the robot is being carried: the error is then small at first, and grows.
        """
        seconds = (now - self._began) / NS_PER_S
        if off is None:
            self._noticed = seconds if self._noticed is None else self._noticed
        elif off <= RELOCALISED_ERROR and not is_carried:
            self._relocalised = seconds if self._relocalised is None else self._relocalised
        elif off > LOST_ERROR:
            self._astray += driven - self._driven
        self._driven = driven

    def figures(self) -> dict[str, float | None]:
        """Return the values of an entry of `kidnappings`; see `RunMetrics.figures`."""
        return {
            "t": self._began / NS_PER_S,
            "noticed_s": None if self._noticed is None else round(self._noticed, 3),
            "found_s": None if self._relocalised is None else round(self._relocalised, 3),
            "astray_m": round(self._astray, 4),
        }


class RunMetrics:
    """Measures a run of the robot *body*.

    If a `NavigationReporter` is among *resources*, its pose estimate is compared with the true pose ten times
    a second. It is searched at the first measurement: the resources of a run are not complete before.
    """

    def __init__(self, body: "SimulatedRobot", resources: Sequence[object]) -> None:
        self._body = body
        self._resources = resources
        self._errors: list[float] = []
        self._yaw_error = 0.0
        self._unknown = 0
        self._outcomes_seen = 0
        self._failed: list[GoalOutcome] = []
        self._visited: list[str] = []
        self._recoveries: list[KidnapRecovery] = []
        body.schedule.add_task(_RATE, Phase.EVALUATION, self._measure)

    @cached_property
    def _navigator(self) -> NavigationReporter | None:
        return next(
            (resource for resource in self._resources if isinstance(resource, NavigationReporter)), None
        )

    def figures(self) -> dict[str, object]:
        """Return the measures of the run, for its report.

        `battery_min` (percent) and `odometry_error_m` are always present, the other values only with a
        navigator. If a part of the robot failed, `faults` lists the failures that began in the run, like
        `wheel:20-30`. The localisation is measured from 1 s on. `localization_error_m` has `median` and
        `max`, `localization_yaw_error_rad` has `max`; they are None without measurements. `unlocalized_s` is
        the time during which the navigator had no pose estimate. `waypoints_visited` lists the names of the
        waypoints that the robot reached, except `recharge`. `recharges` and `goals_failed` are numbers.
        `failed_goals` has an entry for each failed goal: the name of the waypoint as `goal` (None at any
        other place), its position `x`, `y` (m), the time `time_s` (s) at which navigation gave up, and its
        reason as `cause`.

        If the robot was kidnapped, `kidnappings` has an entry for each time: `t` (s) is the time at
        which this began, `noticed_s` the duration until the navigator noticed it, `found_s`
        the duration until the estimate was correct again, and `astray_m` the distance driven with a wrong
        estimate. A duration is None if the event did not happen.
        """
        body = self._body
        figures: dict[str, object] = {
            "battery_min": round(body.battery_model.lowest, 4),
            "odometry_error_m": round(odometry_error(body), 4),
        }
        faults = [str(fault) for fault in body.faults.begun(body.world.now())]
        if faults:
            figures["faults"] = faults
        if self._navigator is None:
            return figures
        self._evaluate(self._navigator.outcomes())
        errors = self._errors
        if self._recoveries:
            figures["kidnappings"] = [recovery.figures() for recovery in self._recoveries]
        return figures | {
            "localization_error_m": {
                "median": round(median(errors), 4) if errors else None,
                "max": round(max(errors), 4) if errors else None,
            },
            "localization_yaw_error_rad": {"max": round(self._yaw_error, 4) if errors else None},
            "unlocalized_s": self._unknown / _RATE,
            "waypoints_visited": list(self._visited),
            "recharges": body.battery_model.recharges,
            "goals_failed": len(self._failed),
            "failed_goals": [self._failed_goal(outcome) for outcome in self._failed],
        }

    def _measure(self, now: int) -> None:
        navigator = self._navigator
        if navigator is None:
            return
        self._evaluate(navigator.outcomes())
        body, estimate = self._body, navigator.estimate()
        true = body.true_pose()
        off = None if estimate is None else _apart(true, estimate)
        for began in body.kidnap_times[len(self._recoveries) :]:
            self._recoveries.append(KidnapRecovery(began, body.distance))
        if self._recoveries:
            self._recoveries[-1].watch(now, body.distance, off, body.is_carried)
        if now < FIRST_MEASUREMENT:
            return
        if estimate is None or off is None:
            self._unknown += 1
            return
        self._errors.append(off)
        self._yaw_error = max(self._yaw_error, abs(wrap_angle(estimate.yaw - true.yaw)))

    def _evaluate(self, outcomes: Sequence[GoalOutcome]) -> None:
        """Record the failed goals and the reached waypoints since the last call."""
        for outcome in outcomes[self._outcomes_seen :]:
            self._outcomes_seen += 1
            if outcome.status == "ABORTED":
                self._failed.append(outcome)
            elif outcome.status == "SUCCEEDED" and _apart(self._body.true_pose(), outcome.goal) <= REACHED:
                name = self._body.world.description.waypoint_poses().name_at(outcome.goal)
                if name is not None and name != "recharge":
                    self._visited.append(name)

    def _failed_goal(self, outcome: GoalOutcome) -> dict[str, object]:
        """Return the entry of `failed_goals` for an aborted goal."""
        return {
            "goal": self._body.world.description.waypoint_poses().name_at(outcome.goal),
            "x": round(outcome.goal.x, 4),
            "y": round(outcome.goal.y, 4),
            "time_s": round(outcome.stamp / NS_PER_S, 3),
            "cause": outcome.cause,
        }


def odometry_error(body: "SimulatedRobot") -> float:
    """Return the distance (m) between the true position and the position by odometry from the true start."""
    start, pose, true = body.start_pose, body.odometry().pose, body.true_pose()
    cos, sin = math.cos(start.yaw), math.sin(start.yaw)
    x, y = start.x + cos * pose.x - sin * pose.y, start.y + sin * pose.x + cos * pose.y
    return math.hypot(x - true.x, y - true.y)


def _apart(first: Pose2D, second: Pose2D) -> float:
    return math.hypot(first.x - second.x, first.y - second.y)
