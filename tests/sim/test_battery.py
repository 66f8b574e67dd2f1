"""The simulated battery: the book's formula for its charge, the empty battery, and recharging."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_robot.robot import Twist2D
from btcore_sim.battery import BatteryModel
from tests.sim.conftest import RobotAt, Steer


@given(st.floats(-2.0, 2.0), st.floats(-2.0, 2.0), st.floats(0.0, 60.0))
def test_battery_drains_by_half_speed_and_hundredth_second(v: float, w: float, seconds: float) -> None:
    cells = BatteryModel()
    cells.drain(Twist2D(v, w), seconds)
    expected = 100.0 - (0.5 * (v**2 + w**2) ** 0.5 + 0.01) * seconds
    assert cells.level == pytest.approx(max(0.0, expected))


def test_the_level_is_never_below_zero() -> None:
    cells = BatteryModel(0.05)
    cells.drain(Twist2D(1.0, 0.0), 1.0)
    assert (cells.level, cells.lowest, cells.is_empty) == (0.0, 0.0, True)


def test_the_lowest_level_is_kept_when_the_battery_is_recharged() -> None:
    cells = BatteryModel(20.0)
    cells.drain(Twist2D(0.0, 0.0), 100.0)
    cells.fill()
    assert (cells.level, cells.recharges) == (100.0, 1)
    assert cells.lowest == pytest.approx(19.0)


def test_standing_drains_a_hundredth_a_second(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    steer(body, 10.0, None)
    assert body.battery().level == pytest.approx(99.9)
    assert body.battery().stamp == body.world.now()


def test_battery_drains_by_commanded_and_not_by_driven_velocity(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    steer(body, 10.0, (-0.3, 0.4))  # the base backs no faster than 0.2 m/s
    assert body.commanded_velocity() == Twist2D(-0.3, 0.4)
    assert body.battery().level == pytest.approx(100.0 - 10.0 * (0.25 + 0.01), abs=0.01)


def test_a_command_drains_the_battery_until_it_expires(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    body.drive(1.0, 0.0)
    steer(body, 2.0, None)
    assert body.battery().level == pytest.approx(100.0 - 0.25 * 0.5 - 2.0 * 0.01, abs=0.005)
    assert body.commanded_velocity() == Twist2D(0.0, 0.0)


def test_an_empty_battery_stops_the_robot_until_it_is_recharged(
    robot_at: RobotAt, steer: Steer, caplog: pytest.LogCaptureFixture
) -> None:
    body = robot_at(battery=0.3)
    steer(body, 6.0, (0.3, 0.0))
    assert [record.getMessage() for record in caplog.records] == [
        "the robot's battery is empty: the robot stands until it is recharged"
    ]
    assert body.battery().level == 0.0
    assert body.odometry().twist.v == pytest.approx(0.0, abs=0.005)
    body.recharge()
    steer(body, 1.0, (0.3, 0.0))
    assert body.odometry().twist.v == pytest.approx(0.3, abs=0.02)
    assert (body.battery_model.lowest, body.battery_model.recharges) == (0.0, 1)
