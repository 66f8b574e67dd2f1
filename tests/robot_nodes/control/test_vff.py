"""VFF avoidance: the cases of the book's tests (chapter 5.1), and its exercise."""

import math

import numpy as np
import pytest

from btcore_robot.components.component import Component, ComponentOptions
from btcore_robot.components.messages import BLUE, GREEN, RED, Arrows
from btcore_robot.control.vff import (
    Avoidance,
    AvoidanceFromAll,
    forces_from_all,
    forces_from_nearest,
    velocity,
)
from btcore_robot.robot import LaserScan, Twist2D
from tests.robot_nodes.conftest import ComponentRig, RecordingRobot

PI = math.pi
SECOND = 10**9


def scan_of(*, others: float = 5.0, stamp: int = 0, **near: float) -> LaserScan:
    """Return a scan of 16 readings all around: *others*, except readings named like ``k10=0.3``."""
    ranges = np.full(16, others, dtype=np.float32)
    for name, distance in near.items():
        ranges[int(name[1:])] = distance
    return LaserScan(ranges, stamp, -PI, 2 * PI / 16, 0.0, 20.0, "base_laser_link")


CASES = {
    "1 nothing in sight": scan_of(others=math.inf),
    "2 all at zero": scan_of(others=0.0),
    "3 behind to the right": scan_of(k2=0.3),
    "4 ahead to the right": scan_of(k6=0.3),
    "5 ahead to the left": scan_of(k10=0.3),
    "6 ahead to the left, and all else at 0.5 m": scan_of(others=0.5, k10=0.3),
    "7 behind to the left": scan_of(k14=0.3),
    "8 right ahead": scan_of(k8=0.01),
}


def angle(vector: np.ndarray) -> float:
    return math.atan2(vector[1], vector[0])


def test_1_nothing_in_sight_the_vectors_are_exact() -> None:
    found = forces_from_nearest(CASES["1 nothing in sight"])
    assert found.attractive.tolist() == [1.0, 0.0]
    assert found.repulsive.tolist() == [0.0, 0.0]
    assert found.result.tolist() == [1.0, 0.0]


def test_2_all_at_zero_the_first_reading_is_used() -> None:
    found = forces_from_nearest(CASES["2 all at zero"])
    assert found.attractive.tolist() == [1.0, 0.0]
    assert found.repulsive.tolist() == pytest.approx([1.0, 0.0], abs=1e-5)
    assert found.result.tolist() == pytest.approx([2.0, 0.0], abs=1e-5)


QUADRANTS = [
    # case, signs of the push, angles of the push, angles of the sum
    ("3 behind to the right", (1, 1), (0.1, PI / 2), (0.1, PI / 2)),
    ("4 ahead to the right", (-1, 1), (PI / 2, PI), (0.0, PI / 2)),
    ("5 ahead to the left", (-1, -1), (-PI, -PI / 2), (-PI / 2, 0.0)),
    ("6 ahead to the left, and all else at 0.5 m", (-1, -1), (-PI, -PI / 2), (-PI / 2, 0.0)),
    ("7 behind to the left", (1, -1), (-PI / 2, 0.0), (-PI / 2, 0.0)),
]


@pytest.mark.parametrize(("case", "signs", "push", "sum_"), QUADRANTS)
def test_3_to_7_an_obstacle_pushes_away(
    case: str, signs: tuple[int, int], push: tuple[float, float], sum_: tuple[float, float]
) -> None:
    found = forces_from_nearest(CASES[case])
    assert found.attractive.tolist() == [1.0, 0.0]
    assert np.sign(found.repulsive).tolist() == list(signs)
    assert push[0] < angle(found.repulsive) < push[1]
    assert sum_[0] < angle(found.result) < sum_[1]


def test_8_right_ahead_the_remainder_has_the_sign_of_single_precision() -> None:
    found = forces_from_nearest(CASES["8 right ahead"])
    assert found.repulsive[0] == pytest.approx(-1.0, abs=0.1)
    assert found.repulsive[1] == pytest.approx(0.0, abs=1e-4)
    assert np.all(np.abs(found.result) <= 0.01)
    assert found.result[1] < 0.0
    assert {found.attractive.dtype, found.repulsive.dtype, found.result.dtype} == {np.dtype("float32")}


VELOCITIES = {
    "1 nothing in sight": lambda v, w: v == pytest.approx(0.3, abs=1e-4) and w == pytest.approx(0, abs=1e-4),
    "2 all at zero": lambda v, w: v == pytest.approx(0.3, abs=1e-4) and w == pytest.approx(0, abs=1e-4),
    "3 behind to the right": lambda v, w: 0 < v <= 0.3 and 0 < w < PI / 2,
    "4 ahead to the right": lambda v, w: 0 < v <= 0.3 and w > 0,
    "5 ahead to the left": lambda v, w: 0 < v <= 0.3 and w < 0,
    "6 ahead to the left, and all else at 0.5 m": lambda v, w: 0 < v <= 0.3 and w < 0,
    "7 behind to the left": lambda v, w: 0 < v <= 0.3 and w < 0,
    "8 right ahead": lambda v, w: abs(v) < 0.1 and -PI / 2 < w < 0,
}


class AvoidanceRig(ComponentRig):
    """The avoidance component with a scan at 30 Hz, and its messages."""

    def __init__(self, robot: RecordingRobot, kind: type[Avoidance] = Avoidance) -> None:
        super().__init__(robot)
        self.component = kind(
            self.context, ComponentOptions(remap={"input_scan": "/scan_raw", "output_vel": "/nav_vel"})
        )
        self.laser = Component("laser", self.context)
        self.commands: list[Twist2D] = []
        self.scans = self.laser.create_publisher("/scan_raw", LaserScan)
        self.laser.create_subscription("/nav_vel", Twist2D, self.commands.append)
        self.add(self.component, self.laser)

    def run(self, scan: LaserScan, seconds: float) -> None:
        for _ in range(round(30 * seconds)):
            stamp = self.robot.clock.now()
            self.scans.publish(
                LaserScan(scan.ranges, stamp, scan.angle_min, scan.angle_increment, 0.0, 20.0, scan.frame)
            )
            self.robot.clock.time = stamp + SECOND // 30


@pytest.mark.parametrize("case", CASES)
def test_the_velocity_after_a_second_of_scans_at_30_hz(robot: RecordingRobot, case: str) -> None:
    rig = AvoidanceRig(robot)
    rig.run(CASES[case], 1.0)
    last = rig.commands[-1]
    assert len(rig.commands) == pytest.approx(20, abs=1)
    assert VELOCITIES[case](last.v, last.w), last


def test_no_command_is_sent_for_a_scan_older_than_a_second(robot: RecordingRobot) -> None:
    rig = AvoidanceRig(robot)
    rig.scans.publish(scan_of())
    robot.clock.sleep(1.0)
    assert len(rig.commands) == 20
    rig.commands.clear()
    robot.clock.sleep(2.0)
    assert rig.commands == []


def test_no_command_is_sent_without_a_scan(robot: RecordingRobot) -> None:
    rig = AvoidanceRig(robot)
    robot.clock.sleep(1.0)
    assert rig.commands == []


def test_the_arrows_are_published_for_subscribers_only(robot: RecordingRobot) -> None:
    rig = AvoidanceRig(robot)
    rig.run(CASES["4 ahead to the right"], 0.5)
    received: list[Arrows] = []
    assert not rig.component.arrows.has_subscribers
    rig.laser.create_subscription("vff_debug", Arrows, received.append)
    rig.run(CASES["4 ahead to the right"], 0.5)
    arrows = {arrow.number: arrow for arrow in received[-1].arrows}
    assert {number: arrow.colour for number, arrow in arrows.items()} == {2: BLUE, 0: RED, 1: GREEN}
    assert {arrow.frame for arrow in arrows.values()} == {"base_footprint"}
    assert (arrows[2].shaft, arrows[2].head, arrows[2].end) == (0.05, 0.1, (1.0, 0.0, 0.0))
    total = np.array(arrows[2].end) + np.array(arrows[0].end)
    assert arrows[1].end == pytest.approx(tuple(total), abs=1e-6)


def test_the_velocity_keeps_to_the_books_limits() -> None:
    assert velocity(np.array([5.0, 0.0], dtype=np.float32)) == Twist2D(0.3, 0.0)
    assert velocity(np.array([0.0, 5.0], dtype=np.float32)) == Twist2D(0.3, 0.5)
    assert velocity(np.array([0.1, -5.0], dtype=np.float32)).w == -0.5


def test_nan_is_ignored_and_minus_infinity_is_the_nearest_reading() -> None:
    ranges = scan_of(k10=math.nan, k6=0.5).ranges
    blind = LaserScan(ranges, 0, -PI, 2 * PI / 16, 0.0, 20.0, "laser")
    assert forces_from_nearest(blind).result.tolist() == forces_from_nearest(scan_of(k6=0.5)).result.tolist()
    assert (
        forces_from_nearest(scan_of(k6=-math.inf)).result.tolist()
        == forces_from_nearest(scan_of(k6=0.0)).result.tolist()
    )


# --- the exercise: forces from all near obstacles


def test_exercise_obstacles_at_both_sides_cancel_their_sideways_forces() -> None:
    between = scan_of(k6=0.3, k10=0.301)
    assert forces_from_nearest(between).result[1] > 0.1
    both = forces_from_all(between)
    assert both.repulsive[1] == pytest.approx(0.0, abs=0.01)
    assert both.repulsive[0] == pytest.approx(-0.99, abs=0.01)


def test_exercise_a_single_obstacle_gives_the_books_result() -> None:
    for case in ("3 behind to the right", "4 ahead to the right", "5 ahead to the left"):
        assert forces_from_all(CASES[case]).result == pytest.approx(
            forces_from_nearest(CASES[case]).result, abs=1e-6
        )


def test_exercise_the_robot_does_not_drive_forward_if_the_sum_points_back(robot: RecordingRobot) -> None:
    rig = AvoidanceRig(robot, AvoidanceFromAll)
    rig.run(scan_of(k6=0.2, k7=0.2, k8=0.2, k9=0.25), 0.5)
    assert rig.component.forces is not None
    assert rig.component.forces.result[0] < 0.0
    assert rig.commands[-1].v == 0.0
    assert abs(rig.commands[-1].w) == 0.5
