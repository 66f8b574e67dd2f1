"""Bump and go by a state machine: the book's figures (chapter 3) and its exercises."""

import math
import threading

import numpy as np
import pytest

from tests.robot_nodes.conftest import ComponentRig, RecordingRobot

pytest.importorskip("pybullet")

from btcore_robot.components.component import Component, ComponentContext, ComponentOptions, Executor
from btcore_robot.components.robot_bridge import RobotBridge
from btcore_robot.control.bumpgo_fsm import (
    BumpGo,
    BumpGoState,
    ClosedLoop,
    Diagonals,
    OpenLoop,
    freest_direction,
    is_lane_blocked,
)
from btcore_robot.robot import LaserScan, Twist2D
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

SECOND = 10**9
AHEAD, BACK, LEFT, STAND = Twist2D(0.3, 0.0), Twist2D(-0.3, 0.0), Twist2D(0.0, 0.3), Twist2D(0.0, 0.0)


class BumpGoRig(ComponentRig):
    """The component, a laser whose ranges the test sets, and the component's messages with the time (s)."""

    def __init__(self, robot: RecordingRobot, kind: type[BumpGo] = BumpGo) -> None:
        super().__init__(robot)
        self.component = kind(self.context)
        self.laser = Component("laser", self.context)
        self.scans = self.laser.create_publisher("input_scan", LaserScan)
        self.commands: list[tuple[float, Twist2D]] = []
        self.laser.create_subscription("output_vel", Twist2D, self.on_command)
        self.ranges = [5.0] * 9
        self.laser_failed = False
        self.add(self.component, self.laser)

    def on_command(self, twist: Twist2D) -> None:
        self.commands.append((self.clock.now() / SECOND, twist))

    def run(self, seconds: float) -> None:
        """Advance the time, with a scan each tenth of a second."""
        for _ in range(round(10 * seconds)):
            if not self.laser_failed:
                self.scans.publish(self.scan())
            self.clock.sleep(0.1)

    def scan(self) -> LaserScan:
        ranges = np.array(self.ranges, dtype=np.float32)
        return LaserScan(ranges, self.clock.now(), -math.pi / 2, math.pi / 8, 0.05, 25.0, "laser")

    def ahead(self, distance: float) -> None:
        self.ranges[4] = distance


def test_before_the_first_scan_no_command_is_sent(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.laser_failed = True
    rig.run(3.0)
    assert rig.commands == []


def test_a_command_is_sent_twenty_times_a_second(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.run(2.0)
    assert [twist for _, twist in rig.commands] == [AHEAD] * 40


@pytest.mark.parametrize(("distance", "state"), [(1.01, BumpGoState.FORWARD), (0.99, BumpGoState.BACK)])
def test_reading_below_1_m_is_an_obstacle(robot: RecordingRobot, distance: float, state: BumpGoState) -> None:
    rig = BumpGoRig(robot)
    rig.ahead(distance)
    rig.run(0.2)
    assert rig.component.state is state


def test_only_the_middle_reading_is_used(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.ranges = [0.2] * 9
    rig.ahead(5.0)
    rig.run(1.0)
    assert rig.component.state is BumpGoState.FORWARD


def test_the_robot_drives_back_for_2_s_turns_left_for_2_s_and_goes_on(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.ahead(0.5)
    rig.run(0.1)
    rig.ahead(5.0)
    rig.run(6.0)
    commands = [twist for _, twist in rig.commands]
    backs, turns = commands.count(BACK), commands.count(LEFT)
    # "after more than 2 s", and in the cycle of the change the velocity is still the old state's
    assert (backs, turns) == (41, 41)
    first, back, turn = commands.index(AHEAD), commands.index(BACK), commands.index(LEFT)
    assert first < back < turn
    assert set(commands[back:turn]) == {BACK}
    assert commands[-1] == AHEAD


def test_the_cycle_of_a_state_change_still_sends_the_old_velocity(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.ahead(0.5)
    rig.run(0.1)
    assert rig.commands[0] == (0.05, AHEAD)
    assert rig.commands[1] == (0.1, BACK)


def test_the_robot_stops_while_the_scan_is_older_than_a_second(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.run(1.0)
    rig.laser_failed = True
    rig.run(2.0)
    assert rig.component.state is BumpGoState.STOP
    # the last scan is of 0.9 s; at 1.95 s it is too old; that cycle still sends the old state's command
    assert next(time for time, twist in rig.commands if twist == STAND) == pytest.approx(2.0)
    rig.laser_failed = False
    rig.run(0.3)
    assert rig.component.state is BumpGoState.FORWARD
    assert rig.commands[-1][1] == AHEAD


def test_back_has_priority_over_stop(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot)
    rig.ahead(0.5)
    rig.scans.publish(rig.scan())
    late = LaserScan(np.array([0.5], dtype=np.float32), -2 * SECOND, 0.0, 0.1, 0.05, 25.0, "laser")
    rig.scans.publish(late)
    rig.clock.sleep(0.05)
    assert rig.component.state is BumpGoState.BACK


# --- exercises


@pytest.mark.parametrize(("index", "side"), [(6, -1.0), (2, 1.0)])
def test_exercise_robot_turns_to_freer_diagonal(robot: RecordingRobot, index: int, side: float) -> None:
    rig = BumpGoRig(robot, Diagonals)
    rig.ranges[index] = 0.4
    rig.run(3.0)
    assert rig.component.state is BumpGoState.TURN
    assert rig.commands[-1][1] == Twist2D(0.0, side * 0.3)


def test_exercise_the_freest_direction_has_room_to_both_sides(robot: RecordingRobot) -> None:
    ranges = np.full(181, 1.0, dtype=np.float32)
    ranges[90] = 20.0  # a slit, straight ahead
    ranges[120:181] = 4.0
    scan = LaserScan(ranges, 0, -math.pi / 2, math.pi / 180, 0.05, 25.0, "laser")
    assert freest_direction(scan) == pytest.approx(math.radians(60.0), abs=0.02)


@pytest.mark.parametrize(
    ("ahead", "aside", "blocked"),
    [
        (0.5, 0.0, True),
        (0.9, 0.35, True),
        (0.9, -0.35, True),
        (0.05, 0.39, True),
        (0.5, 0.45, False),
        (1.05, 0.0, False),
        (-0.1, 0.3, False),
    ],
)
def test_exercise_obstacle_anywhere_in_lane_blocks_it(ahead: float, aside: float, blocked: bool) -> None:
    ranges = np.full(1081, np.inf, dtype=np.float32)
    ranges[::7] = np.nan
    increment = math.radians(0.25)
    ray = round((math.atan2(aside, ahead) + math.radians(135.0)) / increment)
    ranges[ray] = math.hypot(ahead, aside)
    scan = LaserScan(ranges, 0, -math.radians(135.0), increment, 0.05, 25.0, "laser")
    assert is_lane_blocked(scan) is blocked
    ranges[540] = -math.inf
    assert is_lane_blocked(scan)


def turned(kind: type[BumpGo], seconds: float, seed: int) -> tuple[SimulatedRobot, BumpGo, float]:
    """Run the component in the simulator; return the robot, the component, and the distance."""
    body = SimulatedRobot(World(load_world_description("arena_boxes"), seed=seed))
    context = ComponentContext(body.clock, body.schedule, lambda line: None, robot=body)
    executor = Executor(body.schedule, body.clock)
    component = kind(context, ComponentOptions(remap={"input_scan": "scan_raw", "output_vel": "nav_vel"}))
    executor.add(RobotBridge(context))
    executor.add(component)
    body.world.wait_until(round(seconds * SECOND), threading.Event())
    return body, component, body.distance


@pytest.mark.parametrize("kind", [BumpGo, Diagonals, OpenLoop, ClosedLoop])
def test_in_the_simulator_the_robot_avoids_obstacles(kind: type[BumpGo]) -> None:
    body, component, distance = turned(kind, 14.0, seed=0)
    assert distance > 1.0
    assert component.changes >= 3
    assert body.contacts.collisions == 0
    body.world.close()


def test_exercise_closed_loop_the_robot_does_not_run_into_corners_beside_the_middle_beam() -> None:
    # With seed 15, a box covers half of the robot's width after 1.3 m, and the middle beam misses the box.
    body, _, distance = turned(ClosedLoop, 8.0, seed=15)
    assert distance > 1.3
    assert (body.contacts.collisions, body.contacts.grazes) == (0, 0)
    body.world.close()


def test_exercise_open_loop_the_turning_time_is_angle_over_speed(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot, OpenLoop)
    rig.ranges = [0.5] * 9
    rig.ranges[6:] = [8.0, 8.0, 8.0]
    rig.run(2.3)
    rig.ranges = [8.0] * 9
    rig.run(6.0)
    turns = [time for time, twist in rig.commands if twist == LEFT]
    assert rig.component.angle > 0.5
    assert turns[-1] - turns[0] == pytest.approx(rig.component.angle / 0.3, abs=0.15)


def test_exercise_closed_loop_the_robot_turns_until_the_way_is_clear(robot: RecordingRobot) -> None:
    rig = BumpGoRig(robot, ClosedLoop)
    rig.ranges = [0.5] * 9
    rig.ranges[8] = 8.0
    rig.run(8.0)
    assert rig.component.state is BumpGoState.TURN
    rig.ranges = [8.0] * 9
    rig.run(0.2)
    assert rig.component.state is BumpGoState.FORWARD
