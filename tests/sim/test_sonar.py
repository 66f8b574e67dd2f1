"""The three sonars at the Tiago's back."""

import math
from dataclasses import replace

import pytest

from btcore_sim.simulated_robot import SimulatedRobot
from tests.sim.conftest import MakeObject, RobotAt, Steer

SECOND = 1_000_000_000
BACK = -0.259  # m: the middle sonar's place; it is 0.2715 m above the floor


def ranges_of(body: SimulatedRobot) -> dict[str, float]:
    return {
        reading.frame.removeprefix("base_").removesuffix("_link"): reading.range for reading in body.sonars()
    }


def test_the_three_sonars_have_no_echo_in_the_open(robot_at: RobotAt) -> None:
    assert ranges_of(robot_at()) == {"sonar_01": math.inf, "sonar_02": math.inf, "sonar_03": math.inf}


def test_the_sonars_have_the_figures_of_the_data_sheet(robot_at: RobotAt) -> None:
    for reading in robot_at().sonars():
        assert (reading.range_min, reading.range_max, reading.fov) == (0.02, 1.0, 0.5)


def test_a_wall_behind_is_measured_at_its_distance(robot_at: RobotAt, box: MakeObject) -> None:
    body = robot_at(box(-1.0, 0.0, (0.2, 4.0, 2.0)))
    assert ranges_of(body)["sonar_02"] == pytest.approx(0.9 + BACK, abs=0.005)


def test_a_wall_ahead_is_not_measured(robot_at: RobotAt, box: MakeObject) -> None:
    assert set(ranges_of(robot_at(box(0.6, 0.0, (0.2, 4.0, 2.0)))).values()) == {math.inf}


def test_beyond_a_metre_there_is_no_echo(robot_at: RobotAt, box: MakeObject) -> None:
    assert ranges_of(robot_at(box(-1.5, 0.0, (0.2, 4.0, 2.0))))["sonar_02"] == math.inf


def test_range_below_minimum_is_minus_infinite(robot_at: RobotAt, box: MakeObject) -> None:
    assert ranges_of(robot_at(box(-0.375, 0.0, (0.2, 0.2, 2.0))))["sonar_02"] == -math.inf


@pytest.mark.parametrize(("y", "sonar"), [(-0.6, "sonar_01"), (0.6, "sonar_03")])
def test_the_outer_sonars_point_to_the_rear_corners(
    robot_at: RobotAt, drum: MakeObject, y: float, sonar: str
) -> None:
    found = ranges_of(robot_at(drum(-0.6, y, 0.1)))
    assert found.pop(sonar) == pytest.approx(math.hypot(0.6 - 0.183, 0.6 - 0.183) - 0.1, abs=0.01)
    assert set(found.values()) == {math.inf}


def test_table_top_hidden_from_laser_is_measured(robot_at: RobotAt, box: MakeObject) -> None:
    top = replace(box(-0.9, 0.0, (0.6, 1.0, 0.05)), position=(-0.9, 0.0, 0.3))
    assert ranges_of(robot_at(top))["sonar_02"] < 0.45


def test_sonars_measure_at_5_hertz(robot_at: RobotAt, steer: Steer, box: MakeObject) -> None:
    body = robot_at(box(-1.0, 0.0, (0.2, 4.0, 2.0)))
    stamps = set()
    for _ in range(10):
        steer(body, 0.1, None)
        stamps.add(body.sonars()[0].stamp)
    assert stamps == {0, *(k * SECOND // 5 for k in range(1, 6))}


def test_the_range_decreases_while_the_robot_backs_towards_a_wall(
    robot_at: RobotAt, steer: Steer, box: MakeObject
) -> None:
    body = robot_at(box(-1.0, 0.0, (0.2, 4.0, 2.0)))
    before = ranges_of(body)["sonar_02"]
    steer(body, 1.0, (-0.2, 0.0))
    assert ranges_of(body)["sonar_02"] == pytest.approx(before + body.true_pose().x, abs=0.01)
