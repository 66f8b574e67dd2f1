"""The measures of a run: always battery and odometry, and with a navigator localisation and goals."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import pytest

from btcore_robot.robot import GoalOutcome, NavigationReporter, Odometry, Pose2D
from btcore_sim.faults import parse_fault
from btcore_sim.robot_description import load_robot_description
from btcore_sim.run_metrics import RunMetrics, odometry_error
from btcore_sim.worlds import load_world_description


class Navigator:
    """A navigator whose estimate has a constant error, and whose outcomes the test sets."""

    def __init__(self, body: Any, error: Pose2D | None = None) -> None:
        self.body = body
        self.error = error
        self.ended: list[GoalOutcome] = []

    def estimate(self) -> Pose2D | None:
        true = self.body.true_pose()
        if self.error is None:
            return None
        return Pose2D(true.x + self.error.x, true.y + self.error.y, true.yaw + self.error.yaw)

    def outcomes(self) -> Sequence[GoalOutcome]:
        return self.ended

    def end(self, x: float, y: float, status: str) -> None:
        cause = "no path" if status == "ABORTED" else ""
        self.ended.append(GoalOutcome(Pose2D(x, y, 0.0), status, self.body.world.now(), cause))


@pytest.fixture
def body(robot_at: Any) -> Any:
    robot = robot_at()
    robot.world.description = replace(
        robot.world.description, waypoints={"wp1": (0.2, 0.1), "recharge": (0.1, 0.0)}
    )
    return robot


def test_without_a_navigator_battery_and_odometry_are_reported(body: Any, steer: Any) -> None:
    metrics = RunMetrics(body, [])
    steer(body, 10.0, (0.0, 0.5))
    figures = metrics.figures()
    assert list(figures) == ["battery_min", "odometry_error_m"]
    assert figures["battery_min"] == pytest.approx(100.0 - 10.0 * 0.26, abs=0.01)


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (2.0, -1.0, 2.2)])
def test_the_odometry_error_is_measured_from_the_true_start(
    robot_at: Any, steer: Any, noiseless_tiago: Any, start: tuple[float, ...]
) -> None:
    body = robot_at(pose=start, description=noiseless_tiago)
    steer(body, 8.0, (0.3, 0.2))
    assert odometry_error(body) < 0.03
    message: Odometry = body.odometry()
    body.odometry = lambda: replace(message, pose=replace(message.pose, x=message.pose.x + 2.0))
    assert odometry_error(body) == pytest.approx(2.0, abs=0.04)


def test_localisation_errors_are_measured_from_first_second_on_also_at_rest(body: Any, steer: Any) -> None:
    navigator = Navigator(body, Pose2D(3.0, 4.0, -0.2))
    metrics = RunMetrics(body, [navigator])
    steer(body, 0.9, None)
    assert metrics.figures()["localization_error_m"] == {"median": None, "max": None}
    steer(body, 1.0, None)
    navigator.error = Pose2D(0.0, 6.0, 0.1)
    steer(body, 0.1, (1.0, 0.5))
    figures = metrics.figures()
    assert figures["localization_error_m"] == pytest.approx({"median": 5.0, "max": 6.0})
    assert figures["localization_yaw_error_rad"] == {"max": pytest.approx(0.2)}
    assert figures["unlocalized_s"] == 0.0


def test_time_without_a_pose_is_counted_and_is_not_an_error(body: Any, steer: Any) -> None:
    metrics = RunMetrics(body, [Navigator(body)])
    steer(body, 3.0, None)
    figures = metrics.figures()
    assert figures["localization_error_m"] == {"median": None, "max": None}
    assert figures["unlocalized_s"] == pytest.approx(2.0, abs=0.11)


def test_failures_that_have_begun_are_reported(robot_at: Any, steer: Any) -> None:
    faults = [parse_fault(text) for text in ("wheel:0.5-1.5", "laser:0.7-", "camera:60-70")]
    body = robot_at(faults=faults)
    metrics = RunMetrics(body, [])
    assert "faults" not in metrics.figures()
    steer(body, 2.0, (0.3, 0.0))
    assert metrics.figures()["faults"] == ["wheel:0.5-1.5", "laser:0.7-"]


def test_goals_are_reported_by_their_results_and_the_robots_places(body: Any, steer: Any) -> None:
    navigator = Navigator(body, Pose2D(0.0, 0.0, 0.0))
    metrics = RunMetrics(body, [navigator])
    navigator.end(0.2, 0.1, "SUCCEEDED")
    navigator.end(0.1, 0.0, "SUCCEEDED")
    navigator.end(0.3, 0.3, "SUCCEEDED")
    navigator.end(0.2, 0.1, "ABORTED")
    navigator.end(0.5, 0.1, "ABORTED")
    navigator.end(0.2, 0.1, "CANCELED")
    steer(body, 0.1, None)
    body.recharge()
    steer(body, 4.0, (0.3, 0.0))
    navigator.end(0.2, 0.1, "SUCCEEDED")  # it reports success a metre away from the goal
    figures = metrics.figures()
    assert (figures["waypoints_visited"], figures["goals_failed"], figures["recharges"]) == (["wp1"], 2, 1)
    assert figures["failed_goals"] == [
        {"goal": "wp1", "x": 0.2, "y": 0.1, "time_s": 0.0, "cause": "no path"},
        {"goal": None, "x": 0.5, "y": 0.1, "time_s": 0.0, "cause": "no path"},
    ]


def test_a_navigator_is_recognised_by_its_methods_at_the_first_measurement(body: Any, steer: Any) -> None:
    resources = [object(), body]
    metrics = RunMetrics(body, resources)
    resources.append(Navigator(body))
    steer(body, 0.1, None)
    assert "unlocalized_s" in metrics.figures()
    assert isinstance(resources[-1], NavigationReporter)


@pytest.mark.parametrize("world", ["house", "aws_house"])
def test_the_waypoints_of_the_houses_are_recognised_by_their_places(world: str) -> None:
    waypoints = load_world_description(world).waypoint_poses()
    assert {"recharge", "wp1", "wp2", "wp3"} <= set(waypoints.places)
    for name, place in waypoints.places.items():
        assert waypoints.name_at(replace(place, yaw=math.pi)) == name
        assert waypoints.name_at(replace(place, x=place.x + 0.1)) is None


def test_the_tiagos_odometry_errors_are_in_the_expected_ranges() -> None:
    info = load_robot_description().odometry
    assert 0.0005 <= info.scale_sigma <= 0.005
    assert 0.01 <= info.slip <= 0.04
    assert 0.01 <= info.slip_sigma <= 0.05


def test_odometry_is_wrong_by_some_degrees_after_turning_on_the_spot(robot_at: Any, steer: Any) -> None:
    wrong = []
    for seed in range(3):
        body = robot_at(seed=seed)
        steer(body, 15.0, (0.0, 0.5))
        off = math.remainder(body.odometry().pose.yaw - body.true_pose().yaw, 2 * math.pi)
        wrong.append(math.degrees(off))
    # 7.5 rad with a slip of 4 %, give or take the wheels' own errors.
    assert all(12.0 < distance < 22.0 for distance in wrong)
    assert len(set(wrong)) == 3


def test_the_times_to_notice_a_kidnapping_and_find_the_pose_are_reported(body: Any, steer: Any) -> None:
    navigator = Navigator(body, Pose2D(0.0, 0.0, 0.0))
    metrics = RunMetrics(body, [navigator])
    steer(body, 2.0, (0.5, 0.0))
    assert "kidnappings" not in metrics.figures()
    body.kidnap(Pose2D(3.0, 3.0, 0.0))
    navigator.error = Pose2D(3.0, 0.0, 0.0)
    steer(body, 1.0, (0.5, 0.0))
    navigator.error = None
    steer(body, 2.0, (0.0, 0.5))
    navigator.error = Pose2D(0.4, 0.0, 0.0)
    steer(body, 1.0, (0.5, 0.0))
    navigator.error = Pose2D(0.1, 0.0, 0.0)
    steer(body, 1.0, (0.5, 0.0))
    (kidnapping,) = metrics.figures()["kidnappings"]
    assert kidnapping["t"] == pytest.approx(2.0)
    assert kidnapping["noticed_s"] == pytest.approx(1.0, abs=0.11)
    assert kidnapping["found_s"] == pytest.approx(4.0, abs=0.11)
    assert kidnapping["astray_m"] == pytest.approx(0.5, abs=0.1)


def test_the_distance_driven_after_an_unnoticed_kidnapping_is_reported(body: Any, steer: Any) -> None:
    metrics = RunMetrics(body, [Navigator(body, Pose2D(0.0, 2.0, 0.0))])
    body.kidnap(Pose2D(3.0, 3.0, 0.0))
    steer(body, 4.0, (0.5, 0.0))
    (kidnapping,) = metrics.figures()["kidnappings"]
    assert kidnapping["noticed_s"] is kidnapping["found_s"] is None
    assert kidnapping["astray_m"] == pytest.approx(2.0, abs=0.2)


def test_a_carried_robot_has_found_its_pose_only_after_it_was_put_down(body: Any, steer: Any) -> None:
    navigator = Navigator(body, Pose2D(0.0, 0.0, 0.0))
    metrics = RunMetrics(body, [navigator])
    start = body.true_pose()
    body.carry([start, Pose2D(start.x + 2.0, start.y, start.yaw)], 1.0)
    steer(body, 1.0, None)
    assert metrics.figures()["kidnappings"] == [
        {"t": 0.0, "noticed_s": None, "found_s": None, "astray_m": 0.0}
    ]
    steer(body, 1.5, None)
    assert metrics.figures()["kidnappings"][0]["found_s"] == pytest.approx(2.0, abs=0.11)
