"""FollowPath, on the floor robot: paths, obstacles, people, tolerances, failures of sensors and new goals."""

import math
from typing import Any

import numpy as np
import pytest

from btcore_navigation import sensor_watch
from btcore_navigation.action import GoalStatus
from btcore_navigation.controller import FollowPathGoal
from btcore_navigation.error_codes import Nav2ErrorCode
from btcore_navigation.path import empty_path
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.conftest import Person, polyline_path, rig_on_floor

CORRIDOR = (-1.0, -1.2, 7.0, -1.0), (-1.0, 1.0, 7.0, 1.2)


def commands(robot: Any):
    """Return the times (s), speeds (m/s) and turning rates (rad/s) of all commands."""
    return np.array([(stamp / 1e9, v, w) for stamp, v, w in robot.commands]).T


def test_a_path_is_followed_to_its_end_and_heading() -> None:
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (3, 0), (3, 2), yaw=math.pi)))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    pose = rig.robot.pose
    assert math.hypot(pose.x - 3, pose.y - 2) <= 0.25 + 0.05
    assert abs(math.remainder(pose.yaw - math.pi, 2 * math.pi)) <= 0.25


@pytest.mark.parametrize("tolerance", [0.1, 0.25])
def test_the_goal_tolerance_is_a_parameter(tolerance: float) -> None:
    rig = rig_on_floor(xy_goal_tolerance=tolerance)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (2, 1))))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert math.hypot(rig.robot.pose.x - 2, rig.robot.pose.y - 1) <= tolerance + 0.03


def test_an_s_shaped_path_is_followed_closely() -> None:
    rig = rig_on_floor()
    beside = []
    handle = rig.follow_path.send_goal(
        FollowPathGoal(polyline_path((0, 0), (2, 0), (2, 2), (4, 2), (4, 0), (6, 0)))
    )

    def done():
        beside.append(abs(handle.feedback.position_error) if handle.feedback else 0.0)
        return handle.done

    seconds = rig.run(60.0, done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert max(beside) < 0.2
    assert seconds < 10.0 / 0.3 + 5.0


def test_speeds_and_accelerations_stay_within_the_limits() -> None:
    rig = rig_on_floor(*CORRIDOR, (2.0, -0.3, 2.5, 0.2), seed=3)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0), yaw=2.0)))
    rig.run(60.0, lambda: handle.done)
    times, v, w = commands(rig.robot)
    limits = rig.follow_path.parameters
    assert v.min() >= 0.0
    assert v.max() <= limits.max_vel_x
    assert np.abs(w).max() <= limits.max_vel_theta
    periods = np.diff(times)
    base = rig.robot.base_info
    assert (np.abs(np.diff(v)) <= min(limits.acc_lim_x, base.v_rate) * periods + 1e-9).all()
    assert (np.abs(np.diff(w)) <= min(limits.acc_lim_theta, base.w_rate) * periods + 1e-9).all()


def test_a_robot_that_faces_away_turns_before_it_drives() -> None:
    rig = rig_on_floor(start=Pose2D(0.0, 0.0, math.pi))
    rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (3, 0))))
    rig.run(4.0)
    assert math.hypot(rig.robot.pose.x, rig.robot.pose.y) < 0.02
    assert abs(math.remainder(rig.robot.pose.yaw - math.pi, 2 * math.pi)) > 1.0


def test_a_path_in_the_map_frame_is_followed_in_odom() -> None:
    rig = rig_on_floor()
    rig.map_at((1.0, 2.0, math.pi / 2))
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((1, 2), (1, 4), yaw=math.pi / 2)))
    rig.run(30.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.pose.x == pytest.approx(2.0, abs=0.3)
    assert rig.robot.pose.y == pytest.approx(0.0, abs=0.1)


def test_the_local_plan_leads_from_the_robot_along_the_path() -> None:
    rig = rig_on_floor()
    rig.map_at((1.0, 2.0, math.pi / 2))
    assert rig.follow_path.local_plan() is None
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((1, 2), (1, 4), yaw=math.pi / 2)))
    rig.run(2.0)
    plan, pose = rig.follow_path.local_plan(), rig.robot.pose
    assert plan.frame == "odom"
    assert (plan[0].x, plan[0].y) == (pose.x, pose.y)
    assert plan[-1].x == pytest.approx(pose.x + 1.3, abs=0.1)
    assert np.abs(plan.poses[:, 1:]).max() < 0.05
    rig.run(60.0, lambda: handle.done)
    assert rig.follow_path.local_plan() is None


def test_the_local_plan_leads_around_an_obstacle() -> None:
    rig = rig_on_floor(*CORRIDOR, (2.0, -0.3, 2.5, 0.2))
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (5, 0))))

    def leads_aside():
        plan = rig.follow_path.local_plan()
        return plan is not None and np.abs(plan.poses[:, 1]).max() > 0.3

    rig.run(60.0, lambda: handle.done or leads_aside())
    assert leads_aside()


def test_feedback_has_the_remaining_distance_and_the_speed() -> None:
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0))))
    rig.run(5.0)
    left = handle.feedback.distance_to_goal
    assert left == pytest.approx(4.0 - rig.robot.pose.x, abs=0.05)
    assert handle.feedback.speed == pytest.approx(0.3)
    assert abs(handle.feedback.position_error) < 0.02


@pytest.mark.parametrize("seed", range(2))
def test_a_box_on_the_path_is_passed_on_the_side_with_room(seed: int) -> None:
    rig = rig_on_floor((-1.0, -0.7, 7.0, -0.5), (-1.0, 1.15, 7.0, 1.3), (1.5, -0.25, 2.0, 0.25), seed=seed)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0))))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.nearest > 0.0


def test_a_box_dropped_in_front_of_the_driving_robot_is_passed() -> None:
    rig = rig_on_floor(*CORRIDOR)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (5, 0))))
    rig.run(3.0)
    ahead = rig.robot.pose.x + 1.5
    rig.robot.boxes.append((ahead, -0.6, ahead + 0.5, -0.1))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.nearest > 0.05


def test_the_robot_stands_while_the_pose_of_the_laser_is_unknown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sensor_watch, "MAX_OUTAGE_S", 5.0)
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (3, 0))))
    rig.run(2.0)
    monkeypatch.setattr(rig.robot, "frames", lambda: ())
    rig.run(1.2)
    assert rig.robot.speed == 0.0
    stood = rig.robot.pose
    rig.run(3.0)
    assert not handle.done
    rig.run(3.0, lambda: handle.done)
    assert rig.robot.pose == stood
    assert handle.result.message == (
        "no transform of the laser's frame 'base_laser_link' for 5.0 s: "
        "the robot stands until it arrives again"
    )


def test_a_wall_across_the_path_is_not_touched_and_the_goal_fails() -> None:
    rig = rig_on_floor((2.0, -3.0, 2.2, 3.0))
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (5, 0))))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.ABORTED
    assert handle.result.code in (Nav2ErrorCode.PATIENCE_EXCEEDED, Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS)
    assert rig.robot.nearest > 0.05
    assert rig.robot.pose.x > 1.2


def test_zero_failure_tolerance_fails_soon_at_a_wall() -> None:
    rig = rig_on_floor((0.6, -3.0, 0.8, 3.0), failure_tolerance=0.0)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (5, 0))))
    seconds = rig.run(60.0, lambda: handle.done)
    assert handle.result.code == Nav2ErrorCode.NO_VALID_CONTROL
    assert seconds < 5.0


def test_no_progress_fails_after_ten_seconds() -> None:
    rig = rig_on_floor((0.6, -3.0, 0.8, 3.0), failure_tolerance=-1.0)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (5, 0))))
    seconds = rig.run(60.0, lambda: handle.done)
    assert handle.result.code == Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS
    assert 10.0 <= seconds < 16.0


@pytest.mark.parametrize("place", [(5.0, 0.3, -0.5, 0.0), (2.0, 3.2, 0.0, -0.5), (4.0, 0.0, -0.5, 0.0)])
def test_people_are_never_touched_and_the_goal_is_reached(place: tuple[float, ...]) -> None:
    rig = rig_on_floor(seed=1)
    rig.robot.people.append(Person(*place))
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (5, 0))))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.nearest > 0.03


def test_the_robot_drives_slower_beside_a_wall() -> None:
    rig = rig_on_floor((-1.0, -0.6, 7.0, -0.36))
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (3, 0))))
    rig.run(60.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED
    assert rig.robot.nearest > 0.05
    assert commands(rig.robot)[1].max() < 0.25


def test_a_robot_without_scans_stops_within_a_second_until_scans_return() -> None:
    rig = rig_on_floor(*CORRIDOR)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0))))
    rig.run(4.0)
    rig.robot.laser_failed = True
    rig.run(1.0)
    assert rig.robot.speed == 0.0
    rig.run(4.0)
    assert handle.status == GoalStatus.EXECUTING
    rig.robot.laser_failed = False
    rig.run(1.0)
    assert rig.robot.speed > 0.1
    rig.run(30.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED


def test_a_held_robot_does_not_fail_for_lack_of_progress() -> None:
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0))))
    rig.run(2.0)
    rig.held = True
    rig.run(15.0)
    assert handle.status == GoalStatus.EXECUTING
    assert rig.robot.speed == 0.0
    rig.held = False
    rig.run(30.0, lambda: handle.done)
    assert handle.status == GoalStatus.SUCCEEDED


def test_a_cancelled_robot_brakes_within_its_limits() -> None:
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0))))
    rig.run(4.0)
    handle.cancel()
    rig.run(0.5)
    assert handle.status == GoalStatus.CANCELED
    assert rig.robot.speed == 0.0
    assert commands(rig.robot)[1][-1] == 0.0
    assert np.diff(commands(rig.robot)[1]).min() >= -0.05 - 1e-9


def test_a_new_path_is_followed_without_a_stop() -> None:
    rig = rig_on_floor()
    first = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (4, 0))))
    rig.run(4.0)
    second = rig.follow_path.send_goal(FollowPathGoal(polyline_path((1.1, 0), (2, 0), (3, 1))))
    rig.run(1.0)
    assert first.status == GoalStatus.CANCELED
    assert commands(rig.robot)[1][-20:].min() > 0.25
    rig.run(30.0, lambda: second.done)
    assert second.status == GoalStatus.SUCCEEDED


def test_replanning_once_a_second_does_not_hide_a_lack_of_progress() -> None:
    rig = rig_on_floor((0.6, -3.0, 0.8, 3.0), failure_tolerance=-1.0)
    for _ in range(20):
        handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((rig.robot.pose.x, 0), (5, 0))))
        rig.run(1.0)
        if handle.done:
            break
    assert handle.result.code == Nav2ErrorCode.FAILED_TO_MAKE_PROGRESS


def test_a_path_without_poses_is_refused() -> None:
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(empty_path(0)))
    rig.run(0.1)
    assert handle.result.code == Nav2ErrorCode.INVALID_PATH


def test_a_path_in_an_unknown_frame_fails_with_the_frames_name() -> None:
    rig = rig_on_floor(failure_tolerance=0.0)
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (1, 0), frame="mapp")))
    rig.run(0.2)
    assert handle.result.code == Nav2ErrorCode.FOLLOW_PATH_TF_ERROR
    assert "did you mean 'map'?" in handle.result.message


def test_an_idle_controller_sends_no_commands() -> None:
    rig = rig_on_floor()
    rig.run(1.0)
    assert rig.robot.commands == []


@pytest.mark.parametrize(
    ("ids", "code"),
    [
        ({"controller_id": "Other"}, Nav2ErrorCode.INVALID_CONTROLLER),
        ({"goal_checker_id": "other"}, Nav2ErrorCode.FOLLOW_PATH_UNKNOWN),
        ({"progress_checker_id": "other"}, Nav2ErrorCode.FOLLOW_PATH_UNKNOWN),
        ({"controller_id": "FollowPath", "goal_checker_id": "general_goal_checker"}, 0),
        ({"goal_checker_id": "goal_checker", "progress_checker_id": "progress_checker"}, 0),
    ],
)
def test_goals_name_plug_ins_of_the_parameters(ids: dict[str, str], code: Nav2ErrorCode | int) -> None:
    rig = rig_on_floor()
    handle = rig.follow_path.send_goal(FollowPathGoal(polyline_path((0, 0), (1, 0)), **ids))
    rig.run(0.1)
    assert (handle.result.code if handle.result is not None else 0) == code
