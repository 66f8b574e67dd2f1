"""IsObstacle and WaitForScan: the book's tests (chapter 6.2), the corridor, and a laser that fails."""

import math

import pytest

import btcore
from btcore import Registry, Status, Tree
from tests.robot_nodes.conftest import RecordingRobot

SECOND = 1_000_000_000
INF = math.inf


def tree_of(robot: RecordingRobot, leaf: str = "IsObstacle", **ports: float) -> Tree:
    nodes = Registry.standard()
    nodes.add_plugin("btcore_robot.leaves")
    written = " ".join(f'{port}="{value}"' for port, value in ports.items())
    text = f'<root main_tree_to_execute="T"><BehaviorTree ID="T"><{leaf} {written}/></BehaviorTree></root>'
    return btcore.loads(text, nodes=nodes, resources=[robot])


def obstacle(robot: RecordingRobot, **ports: float) -> bool:
    return tree_of(robot, **ports).tick_once() is Status.SUCCESS


@pytest.mark.parametrize(
    ("reading", "ports", "found"),
    [(2.0, {}, False), (0.3, {}, True), (0.3, {"distance": 0.5}, True), (0.6, {"distance": 0.5}, False)],
)
def test_is_obstacle_with_the_books_readings(
    robot: RecordingRobot, reading: float, ports: dict[str, float], found: bool
) -> None:
    robot.see(reading)
    assert obstacle(robot, **ports) is found


def test_before_the_first_scan_there_is_no_obstacle(robot: RecordingRobot) -> None:
    assert not obstacle(robot)
    assert not obstacle(robot, corridor=0.8)


def test_the_middle_beam_is_the_upper_of_two(robot: RecordingRobot) -> None:
    robot.see(5.0, 5.0, 0.5, 5.0)
    assert obstacle(robot)
    robot.see(5.0, 0.5, 5.0, 5.0)
    assert not obstacle(robot)


def test_a_reading_below_the_minimum_is_an_obstacle_and_no_echo_is_not(robot: RecordingRobot) -> None:
    robot.see(-INF)
    assert obstacle(robot)
    robot.see(INF)
    assert not obstacle(robot)


CASES = [
    # x, y (m) of the only echo; whether it is found in a corridor of 0.8 m up to 1 m
    (0.9, 0.0, True),
    (0.9, 0.39, True),
    (0.9, -0.39, True),
    (0.9, 0.41, False),
    (1.01, 0.0, False),
    (0.1, -0.3, True),
    (-0.1, 0.2, False),
]


@pytest.mark.parametrize(("x", "y", "found"), CASES)
def test_corridor_is_rectangle_ahead_of_laser(robot: RecordingRobot, x: float, y: float, found: bool) -> None:
    robot.see(math.hypot(x, y), angle_min=math.atan2(y, x))
    assert obstacle(robot, corridor=0.8) is found


def test_in_the_corridor_only_finite_readings_count(robot: RecordingRobot) -> None:
    robot.see(INF, -INF, math.nan)
    assert not obstacle(robot, corridor=0.8)
    robot.see(INF, -INF, 0.5)
    assert obstacle(robot, corridor=0.8)


def test_a_scan_older_than_the_timeout_counts_as_an_obstacle(robot: RecordingRobot) -> None:
    robot.see(5.0)
    robot.clock.time = SECOND // 2
    assert not obstacle(robot, timeout=0.5)
    robot.clock.time += 1
    assert obstacle(robot, timeout=0.5)
    assert not obstacle(robot)


def test_with_a_timeout_a_missing_scan_counts_as_an_obstacle(robot: RecordingRobot) -> None:
    assert obstacle(robot, timeout=0.5)


def test_wait_for_scan_stops_the_robot_until_there_is_a_new_scan(robot: RecordingRobot) -> None:
    tree = tree_of(robot, "WaitForScan", timeout=0.5)
    assert tree.tick_once() is Status.RUNNING
    assert robot.commands == [(0.0, 0.0)]
    robot.see(5.0)
    assert tree.tick_once() is Status.SUCCESS
    assert len(robot.commands) == 1
    robot.clock.time = SECOND // 2 + 1
    assert tree.tick_once() is Status.RUNNING
    assert len(robot.commands) == 2
