"""Simulated failures of parts."""

import pytest

from btcore_sim.errors import SimError
from btcore_sim.faults import Fault, FaultSchedule, parse_fault
from tests.sim.conftest import RobotAt, Steer

SECOND = 1_000_000_000


def fault_list(text: str) -> list[Fault]:
    return [parse_fault(text)]


def test_a_fault_lasts_from_its_start_to_its_end() -> None:
    faults = FaultSchedule([parse_fault("laser:20-25"), parse_fault("laser:30-30.5")])
    moments = [19.9, 20.0, 24.9, 25.0, 30.4, 30.5]
    assert [faults.has_failed("laser", int(t * SECOND)) for t in moments] == [
        False,
        True,
        True,
        False,
        True,
        False,
    ]
    assert not faults.has_failed("camera", 22 * SECOND)


def test_a_fault_without_an_end_does_not_end() -> None:
    assert FaultSchedule([parse_fault("wheel:3-")]).has_failed("wheel", 10**6 * SECOND)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("lasr:20-25", "did you mean 'laser'"),
        ("arm:1-2", "parts are laser, odometry, camera, wheel"),
        ("laser", "PART:START-END"),
        ("laser:5", "PART:START-END"),
        ("laser:-1-2", "PART:START-END"),
        ("laser:25-20", "ends before it starts"),
    ],
)
def test_an_invalid_fault_raises_with_an_explanation(text: str, message: str) -> None:
    with pytest.raises(SimError, match=message):
        parse_fault(text)


def test_a_failed_laser_keeps_its_last_scan_with_the_old_stamp(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(faults=fault_list("laser:1-2"))
    steer(body, 1.9, None)
    assert body.scan().stamp == 9 * SECOND // 10
    steer(body, 0.2, None)
    assert body.scan().stamp == 2 * SECOND


def test_failed_odometry_keeps_its_last_reading(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(faults=fault_list("odometry:1-2"))
    steer(body, 1.9, (0.3, 0.0))
    stuck = body.odometry()
    assert stuck.stamp == 980 * SECOND // 1000
    steer(body, 0.2, (0.3, 0.0))
    assert body.odometry().pose.x > stuck.pose.x + 0.3


def test_with_a_failed_wheel_a_straight_command_turns_the_robot(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(faults=fault_list("wheel:0-"))
    steer(body, 2.0, (0.2, 0.0))
    assert body.true_pose().yaw > 0.5


def test_a_failed_camera_keeps_its_last_picture(robot_at: RobotAt, steer: Steer) -> None:
    from btcore_sim.camera import CameraSettings
    from btcore_sim.simulated_robot import SimulatedRobot
    from btcore_sim.world import World

    world = World(robot_at().world.description)
    body = SimulatedRobot(world, camera=CameraSettings(32, 24, 10.0), faults=fault_list("camera:0.5-1"))
    first = body.camera()
    steer(body, 0.7, None)
    assert body.camera() is first
    steer(body, 0.4, None)
    assert body.camera().stamp == 11 * SECOND // 10
    world.close()
