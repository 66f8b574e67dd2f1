"""The differential base: limits, ramps, time-out, priorities, dead reckoning."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_robot.command_multiplexer import CommandMultiplexer
from btcore_robot.robot import BaseInfo, Odometry, Pose2D, Twist2D
from btcore_sim.differential_drive import DifferentialDrive, WheelErrorModel, WheelOdometry
from btcore_sim.robot_description import OdometryInfo

SECOND = 1_000_000_000
STEP = 1 / 240
FACTS = BaseInfo(-0.2, 1.0, 2.09, 1.0, 2.09, 0.25, 0.27)

speeds = st.floats(-5.0, 5.0)


def base() -> DifferentialDrive:
    return DifferentialDrive(FACTS, 0.0985, 0.4044)


def run(drive: DifferentialDrive, seconds: float, start: int = 0) -> list[Twist2D]:
    return [drive.step(start + round(k * SECOND / 240), STEP) for k in range(1, round(seconds * 240) + 1)]


def test_the_books_backward_speed_is_limited_to_the_bases() -> None:
    assert base().limited(-0.3, 0.0) == Twist2D(-0.2, 0.0)


@given(speeds, speeds)
def test_limiting_stays_within_the_limits_and_keeps_the_turning_radius(v: float, w: float) -> None:
    twist = base().limited(v, w)
    assert FACTS.v_min - 1e-9 <= twist.v <= FACTS.v_max + 1e-9
    assert abs(twist.w) <= FACTS.w_max + 1e-9
    assert twist.v * w == pytest.approx(twist.w * v, abs=1e-9)


@given(speeds, speeds, speeds, speeds)
def test_speed_changes_no_faster_than_the_base_can(v0: float, w0: float, v1: float, w1: float) -> None:
    drive = base()
    drive.command(v0, w0, 0)
    twists = [Twist2D(0.0, 0.0), *run(drive, 0.2)]
    drive.command(v1, w1, SECOND // 5)
    twists += run(drive, 0.2, SECOND // 5)
    for twist, next_twist in itertools.pairwise(twists):
        assert abs(next_twist.v - twist.v) <= FACTS.v_rate * STEP + 1e-9
        assert abs(next_twist.w - twist.w) <= FACTS.w_rate * STEP + 1e-9


def test_a_ramp_from_standing_keeps_the_turning_radius() -> None:
    drive = base()
    drive.command(0.6, 0.3, 0)
    for twist in run(drive, 0.2):
        assert twist.v == pytest.approx(2.0 * twist.w)


def test_a_command_is_reached_and_held() -> None:
    drive = base()
    drive.command(0.2, 0.0, 0)
    assert run(drive, 0.25)[-1] == Twist2D(0.2, 0.0)


def test_a_command_expires_after_a_quarter_of_a_second() -> None:
    drive = base()
    drive.command(0.2, 0.0, 0)
    assert drive.step(SECOND // 4, 1.0).v == 0.2
    assert drive.step(SECOND // 4 + 1, 1.0).v == 0.0


def test_the_wheel_rates_produce_the_twist() -> None:
    drive = base()
    drive.command(0.3, 0.5, 0)
    drive.step(1, 10.0)
    left, right = drive.wheel_rates()
    assert left * 0.0985 == pytest.approx(0.3 - 0.5 * 0.2022)
    assert right * 0.0985 == pytest.approx(0.3 + 0.5 * 0.2022)


def test_the_higher_priority_wins_for_half_a_second() -> None:
    sources = CommandMultiplexer()
    assert sources.admits(90, 0)
    assert not sources.admits(10, SECOND // 2)
    assert sources.admits(10, SECOND // 2 + 1)
    assert sources.admits(100, SECOND // 2 + 2)


def test_dead_reckoning_of_a_circle_returns_to_the_start() -> None:
    odometry = WheelOdometry(0.1, 0.4, (0.0, 0.0))
    turns = 1000
    for k in range(1, turns + 1):  # radius 1 m: the wheels run on 0.8 m and 1.2 m
        angle = 2 * math.pi * k / turns
        reading = odometry.update((0.8 * angle / 0.1, 1.2 * angle / 0.1), k * SECOND)
        if k == turns // 2:
            assert (reading.pose.x, reading.pose.y) == pytest.approx((0.0, 2.0), abs=1e-4)
    assert (reading.pose.x, reading.pose.y, reading.pose.yaw) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert reading.twist.v == pytest.approx(2 * math.pi / turns)


def noisy(seed: int, info: OdometryInfo, left: float, right: float) -> Odometry:
    """Return the odometry after a thousand readings; *left* and *right* are the wheels' total turns (rad)."""
    errors = WheelErrorModel(info, np.random.default_rng(seed))
    odometry = WheelOdometry(0.1, 0.4, (0.0, 0.0), errors)
    for k in range(1, 1001):
        reading = odometry.update((left * k / 1000, right * k / 1000), k * SECOND // 50)
    return reading


def test_wheel_size_errors_make_the_yaw_drift() -> None:
    info = OdometryInfo(50.0, 0.01, 0.0, 0.0)
    ways = [noisy(seed, info, 10.0, 10.0) for seed in range(200)]
    drifts = [reading.pose.yaw for reading in ways]
    assert np.std(drifts) == pytest.approx(0.01 * math.sqrt(2.0) / 0.4, rel=0.2)
    assert np.mean(drifts) == pytest.approx(0.0, abs=0.01)


def test_slip_makes_odometry_report_more_turning() -> None:
    info = OdometryInfo(50.0, 0.0, 0.02, 0.03)
    turned = [noisy(seed, info, -5.0, 5.0).pose.yaw for seed in range(100)]
    assert np.mean(turned) == pytest.approx(2.5 * 1.02, rel=0.001)
    assert np.std(turned) == pytest.approx(2.5 * 0.03 / math.sqrt(1000), rel=0.3)


def test_straight_ahead_nothing_slips() -> None:
    assert noisy(1, OdometryInfo(50.0, 0.0, 0.02, 0.03), 10.0, 10.0).pose == Pose2D(
        pytest.approx(1.0), 0.0, 0.0
    )


def test_the_same_seed_gives_the_same_errors() -> None:
    info = OdometryInfo(50.0, 0.001, 0.02, 0.03)
    assert noisy(3, info, 8.0, 9.0) == noisy(3, info, 8.0, 9.0)
    assert noisy(3, info, 8.0, 9.0) != noisy(4, info, 8.0, 9.0)


def test_the_commanded_twist_is_the_given_twist_until_it_expires() -> None:
    drive = base()
    drive.command(3.0, -0.5, SECOND)
    assert drive.commanded_twist(SECOND + SECOND // 4) == Twist2D(3.0, -0.5)
    assert drive.commanded_twist(SECOND + SECOND // 4 + 1) == Twist2D(0.0, 0.0)


def test_a_base_that_does_not_obey_comes_to_rest() -> None:
    drive = base()
    drive.command(0.2, 0.0, 0)
    drive.step(1, 1.0)
    assert drive.step(2, 0.1, accepts_commands=False).v == pytest.approx(0.1)
    assert drive.step(3, 0.1, accepts_commands=False) == Twist2D(0.0, 0.0)
