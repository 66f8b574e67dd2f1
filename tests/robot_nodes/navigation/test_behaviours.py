"""The behaviours, on the floor robot: motion, limits, collisions, timeouts and failures of sensors."""

import math
from typing import Any

import numpy as np
import pytest

from btcore_navigation import sensor_watch
from btcore_navigation.action import GoalStatus
from btcore_navigation.behaviours import (
    AssistedTeleopGoal,
    BackUpGoal,
    DriveOnHeadingGoal,
    SpinGoal,
    WaitGoal,
)
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_robot.robot import SonarReading, Twist2D
from tests.robot_nodes.navigation.conftest import NavigationRig, rig_on_floor


def run_to_end(rig: NavigationRig, handle: Any, seconds: float = 30.0):
    """Advance the time until the goal has ended; return the seconds that this took."""
    return rig.run(seconds, lambda: handle.done)


@pytest.mark.parametrize("angle", [1.57, -1.57, 4.0, 7.5])
def test_spin_turns_by_its_angle(angle: float) -> None:
    rig = rig_on_floor()
    turned, last = 0.0, 0.0
    handle = rig.spin.send_goal(SpinGoal(angle))

    def add_turn():
        nonlocal turned, last
        turned += math.remainder(rig.robot.pose.yaw - last, 2 * math.pi)
        last = rig.robot.pose.yaw
        return handle.done

    rig.run(30.0, add_turn)
    rig.run(0.5, lambda: add_turn() and False)
    assert handle.status == GoalStatus.SUCCEEDED
    assert turned == pytest.approx(angle, abs=0.1)


def test_spin_keeps_to_nav2s_rates() -> None:
    rig = rig_on_floor()
    run_to_end(rig, rig.spin.send_goal(SpinGoal(3.0)))
    rates = np.array([w for _, _, w in rig.robot.commands])
    assert rates.max() == pytest.approx(1.0)
    assert np.abs(np.diff(rates)).max() <= 2.09 * 0.1 + 1e-9


def test_back_up_goes_straight_back() -> None:
    rig = rig_on_floor()
    handle = rig.back_up.send_goal(BackUpGoal(0.3, 0.15))
    run_to_end(rig, handle)
    rig.run(0.5)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.pose.x == pytest.approx(-0.3, abs=0.02)
    assert rig.robot.pose.y == pytest.approx(0.0, abs=0.001)


def test_back_up_commands_no_more_than_the_bases_backward_speed() -> None:
    rig = rig_on_floor()
    run_to_end(rig, rig.back_up.send_goal(BackUpGoal(0.5, 0.5)))
    assert min(v for _, v, _ in rig.robot.commands) >= rig.robot.base_info.v_min


def test_drive_on_heading_ends_at_its_distance() -> None:
    rig = rig_on_floor()
    handle = rig.drive_on_heading.send_goal(DriveOnHeadingGoal(0.5, 0.2))
    run_to_end(rig, handle)
    rig.run(0.5)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.pose.x == pytest.approx(0.5, abs=0.03)


def test_drive_on_heading_stops_two_seconds_before_a_wall() -> None:
    rig = rig_on_floor((1.5, -1.0, 1.7, 1.0))
    handle = rig.drive_on_heading.send_goal(DriveOnHeadingGoal(3.0, 0.2, 60.0))
    run_to_end(rig, handle, 60.0)
    rig.run(0.5)
    assert handle.result.code == Nav2ErrorCode.DRIVE_ON_HEADING_COLLISION_AHEAD
    assert 0.25 < rig.robot.nearest < 0.6


def test_back_up_remembers_a_wall_that_was_seen_before_a_turn() -> None:
    rig = rig_on_floor((0.8, -1.0, 1.0, 1.0))
    run_to_end(rig, rig.spin.send_goal(SpinGoal(math.pi)))
    handle = rig.back_up.send_goal(BackUpGoal(1.0, 0.2, 20.0))
    run_to_end(rig, handle)
    rig.run(0.5)
    assert handle.result.code == Nav2ErrorCode.BACKUP_COLLISION_AHEAD
    assert rig.robot.nearest > 0.1


def test_back_up_uses_the_sonars() -> None:
    rig = rig_on_floor()
    rig.run(0.1)
    rig.robot.sonar_readings.append(SonarReading(0.2, 0, 0.5, 0.03, 1.0, "sonar_link"))
    handle = rig.back_up.send_goal(BackUpGoal(0.5, 0.2))
    run_to_end(rig, handle)
    assert handle.result.code == Nav2ErrorCode.BACKUP_COLLISION_AHEAD
    assert rig.robot.pose.x > -0.05


def test_assisted_teleop_drives_by_commands_and_stops_at_wall() -> None:
    rig = rig_on_floor((2.0, -1.0, 2.2, 1.0))
    handle = rig.assisted_teleop.send_goal(AssistedTeleopGoal(0.0))
    rig.run(0.5)
    assert rig.robot.pose.x == 0.0
    rig.assisted_teleop.command(Twist2D(0.4, 0.0))
    rig.run(3.0)
    assert 0.5 < rig.robot.pose.x < 1.2
    rig.run(20.0)
    assert handle.status == GoalStatus.EXECUTING
    assert rig.robot.pose.x > 1.0
    assert rig.robot.nearest > 0.02
    rig.assisted_teleop.finish()
    rig.run(1.0)
    assert handle.status == GoalStatus.SUCCEEDED
    assert handle.feedback.progress == pytest.approx(23.5, abs=0.3)
    # A command of an earlier goal has no effect.
    still = rig.robot.pose
    handle = rig.assisted_teleop.send_goal(AssistedTeleopGoal(1.0))
    rig.run(2.0)
    assert handle.result.code == Nav2ErrorCode.ASSISTED_TELEOP_TIMEOUT
    assert rig.robot.pose == still


def test_disabled_collision_checks_ignore_a_wall() -> None:
    rig = rig_on_floor((1.0, -1.0, 1.2, 1.0))
    handle = rig.drive_on_heading.send_goal(DriveOnHeadingGoal(0.5, 0.2, 10.0, True))
    run_to_end(rig, handle)
    assert handle.status == GoalStatus.SUCCEEDED


@pytest.mark.parametrize(
    ("server", "goal", "code"),
    [
        ("spin", SpinGoal(6.0, 1.0), Nav2ErrorCode.SPIN_TIMEOUT),
        ("back_up", BackUpGoal(1.0, 0.05, 1.0), Nav2ErrorCode.BACKUP_TIMEOUT),
        ("drive_on_heading", DriveOnHeadingGoal(1.0, 0.05, 1.0), Nav2ErrorCode.DRIVE_ON_HEADING_TIMEOUT),
    ],
)
def test_a_timeout_ends_the_behaviour_and_stops_the_robot(
    server: str, goal: Any, code: Nav2ErrorCode
) -> None:
    rig = rig_on_floor()
    handle = getattr(rig, server).send_goal(goal)
    assert run_to_end(rig, handle) == pytest.approx(1.15, abs=0.1)
    assert handle.result.code == code
    rig.run(0.6)
    assert rig.robot.commands[-1][1:] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("server", "goal", "code"),
    [
        ("drive_on_heading", DriveOnHeadingGoal(0.5, -0.1), Nav2ErrorCode.DRIVE_ON_HEADING_INVALID_INPUT),
        ("drive_on_heading", DriveOnHeadingGoal(0.5, 0.0), Nav2ErrorCode.DRIVE_ON_HEADING_INVALID_INPUT),
        ("back_up", BackUpGoal(0.5, 0.0), Nav2ErrorCode.BACKUP_INVALID_INPUT),
        ("spin", SpinGoal(math.nan), Nav2ErrorCode.SPIN_UNKNOWN),
        ("wait", WaitGoal(math.inf), Nav2ErrorCode.WAIT_UNKNOWN),
    ],
)
def test_never_ending_goal_is_refused(server: str, goal: Any, code: Nav2ErrorCode) -> None:
    rig = rig_on_floor()
    handle = getattr(rig, server).send_goal(goal)
    run_to_end(rig, handle)
    assert handle.result.code == code
    assert all(command[1:] == (0.0, 0.0) for command in rig.robot.commands)


def test_a_robot_without_scans_stops_until_scans_return() -> None:
    rig = rig_on_floor()
    handle = rig.back_up.send_goal(BackUpGoal(0.3, 0.1, 20.0))
    rig.run(1.0)
    rig.robot.laser_failed = True
    rig.run(2.0)
    assert rig.robot.speed == 0.0
    rig.robot.laser_failed = False
    run_to_end(rig, handle)
    assert handle.status == GoalStatus.SUCCEEDED


def test_wait_takes_its_duration_and_sends_no_commands() -> None:
    rig = rig_on_floor()
    handle = rig.wait.send_goal(WaitGoal(2.0))
    rig.run(1.05)
    assert handle.feedback.progress == pytest.approx(1.0, abs=0.15)
    assert 0.9 < run_to_end(rig, handle) < 1.2
    assert rig.robot.commands == []


def test_a_cancelled_behaviour_stops() -> None:
    rig = rig_on_floor()
    handle = rig.spin.send_goal(SpinGoal(6.0))
    rig.run(2.0)
    handle.cancel()
    rig.run(0.8)
    assert handle.status == GoalStatus.CANCELED
    assert rig.robot.commands[-1][1:] == (0.0, 0.0)


@pytest.mark.parametrize(
    ("action", "goal", "amount"),
    [("spin", SpinGoal(2.0, 0.0), 2.0), ("back_up", BackUpGoal(0.8, 0.2, 0.0, True), 0.8)],
)
def test_a_behaviour_waits_without_odometry_and_ignores_a_jump_after_it(
    action: str, goal: BackUpGoal | SpinGoal, amount: float
) -> None:
    rig = rig_on_floor()
    robot = rig.robot
    handle = getattr(rig, action).send_goal(goal)
    rig.run(1.0)
    robot.odometry_failed = True
    rig.run(0.3)
    assert robot.commands[-1][1:] == (0.0, 0.0)
    rig.run(8.0)
    robot.odometry_failed, robot.odometry_error_m, robot.odometry_error_rad = False, -0.3, -0.3
    run_to_end(rig, handle)
    rig.run(0.5)
    assert handle.status == GoalStatus.SUCCEEDED
    # What the robot moved while it braked during the outage doesn't count.
    moved = robot.pose.yaw if action == "spin" else robot.pose.x
    assert amount - 0.1 < abs(moved) < amount + 0.6


def test_a_behaviour_fails_after_a_long_outage_of_the_laser(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor_watch, "MAX_OUTAGE_S", 3.0)
    rig = rig_on_floor()
    handle = rig.back_up.send_goal(BackUpGoal(1.0, 0.1, 5.0))
    rig.robot.laser_failed = True
    assert run_to_end(rig, handle) == pytest.approx(3.1, abs=0.15)
    assert handle.result.code == Nav2ErrorCode.BACKUP_TF_ERROR
    assert handle.result.message == "no laser scan for 3.1 s: the robot stands until it arrives again"
