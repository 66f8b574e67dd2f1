"""The simulated Tiago: the checks of the `Robot` protocol, and the accuracy of its driving."""

import math
import threading
from dataclasses import replace

import numpy as np
import pybullet
import pytest

from btcore_robot.robot import Pose2D, Robot
from btcore_robot.testing import check_robot
from btcore_sim.camera import CameraSettings, parse_camera
from btcore_sim.errors import SimError
from btcore_sim.robot_description import RobotDescription
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import MakeObject, RobotAt, Steer

SECOND = 1_000_000_000


@pytest.mark.parametrize("camera", [None, CameraSettings(64, 48, 10.0)])
def test_the_simulated_robot_fulfils_the_contract_of_every_robot(camera: CameraSettings | None) -> None:
    seeds = iter(range(100))
    check_robot(
        lambda: SimulatedRobot(World(load_world_description("arena"), seed=next(seeds)), camera=camera)
    )


def test_the_simulated_robot_is_a_robot(robot_at: RobotAt) -> None:
    assert isinstance(robot_at(), Robot)


def test_a_world_has_at_most_one_robot(robot_at: RobotAt) -> None:
    body = robot_at()
    with pytest.raises(SimError, match="'test' has a robot already"):
        SimulatedRobot(body.world)


def test_commands_that_are_not_numbers_are_refused(robot_at: RobotAt) -> None:
    with pytest.raises(ValueError, match="v=nan m/s"):
        robot_at().drive(math.nan, 0.0)


@pytest.mark.parametrize("rate", [120, 240])
@pytest.mark.parametrize(("v", "w"), [(0.3, 0.0), (-0.2, 0.0), (0.0, 0.5), (0.3, 0.5), (1.0, 1.0)])
def test_the_robot_drives_as_commanded_and_odometry_without_errors_agrees_with_the_true_pose(
    robot_at: RobotAt, steer: Steer, noiseless_tiago: RobotDescription, v: float, w: float, rate: int
) -> None:
    body = robot_at(description=noiseless_tiago, physics_rate=rate)
    steer(body, 10.0, (v, w))
    true, message = body.true_pose(), body.odometry().pose
    assert math.hypot(true.x - message.x, true.y - message.y) < 0.02
    assert math.remainder(true.yaw - message.yaw, 2 * math.pi) == pytest.approx(0.0, abs=0.01)
    # The ramps take 0.045 m of the way at 0.3 m/s, and 0.059 rad of the angle at 0.5 rad/s.
    if (v, w) == (0.3, 0.0):
        assert true.x == pytest.approx(3.0 - 0.045, abs=0.02)
        assert body.distance == pytest.approx(3.0 - 0.045, abs=0.02)
    elif (v, w) == (0.0, 0.5):
        assert true.yaw == pytest.approx(4.941 - 2 * math.pi, abs=0.02)
        assert math.hypot(true.x, true.y) < 0.01


@pytest.mark.parametrize("rate", [120, 240])
def test_the_velocity_follows_the_ramp(robot_at: RobotAt, rate: int) -> None:
    body = robot_at(physics_rate=rate)
    for tick in range(1, 11):
        body.drive(1.0, 0.0)
        body.world.wait_until(tick * SECOND // 10, threading.Event())
        speed = pybullet.getBaseVelocity(body.physics_body.body_id, physicsClientId=body.world.client)[0][0]
        assert speed == pytest.approx(tick / 10, abs=0.05)


def test_without_a_command_the_robot_stops_by_itself(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    steer(body, 1.0, (0.3, 0.0))
    steer(body, 0.1, None)
    assert body.odometry().twist.v == pytest.approx(0.3, abs=0.02)
    steer(body, 0.6, None)
    assert body.odometry().twist.v == pytest.approx(0.0, abs=0.005)
    assert body.true_pose().x == pytest.approx(0.3 - 0.045 + 0.05 + 0.045, abs=0.03)


def test_the_robot_has_the_mass_of_the_data_sheet(robot_at: RobotAt) -> None:
    number, client = robot_at().physics_body.body_id, robot_at().world.client
    masses = [
        pybullet.getDynamicsInfo(number, link, physicsClientId=client)[0]
        for link in range(-1, pybullet.getNumJoints(number, physicsClientId=client))
    ]
    assert sum(masses) == pytest.approx(75.2, abs=0.3)


def test_casters_slide_and_wheels_grip(robot_at: RobotAt) -> None:
    body = robot_at()
    friction = {
        name: pybullet.getDynamicsInfo(body.physics_body.body_id, link, physicsClientId=body.world.client)[1]
        for name, link in body.physics_body.links.items()
    }
    assert {friction[name] for name in friction if name.startswith("caster")} == {0.0}
    assert {friction[name] for name in friction if name.startswith("wheel")} == {1.0}


def test_the_robot_stands_upright_on_its_wheels(robot_at: RobotAt) -> None:
    place, turned = robot_at().physics_body.pose()
    roll, pitch, _ = pybullet.getEulerFromQuaternion(turned)
    assert place[2] == pytest.approx(0.0985, abs=0.001)
    assert (roll, pitch) == pytest.approx((0.0, 0.0), abs=math.radians(0.4))


def test_the_head_turns_at_its_speed(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    body.move_head(1.2, 0.0)
    steer(body, 0.2, None)
    assert 0.3 < body.head().pan < 0.7
    steer(body, 0.8, None)
    assert body.head().pan == pytest.approx(1.2, abs=0.02)


def test_the_torso_lifts_at_its_speed_and_stays_within_its_limits(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at()
    assert body.torso_height() == pytest.approx(0.0, abs=0.001)
    body.lift(0.15)
    steer(body, 1.0, None)
    assert body.torso_height() == pytest.approx(0.07, abs=0.01)
    steer(body, 1.5, None)
    assert body.torso_height() == pytest.approx(0.15, abs=0.002)
    body.lift(9.0)
    steer(body, 4.0, None)
    assert body.torso_height() == pytest.approx(0.35, abs=0.002)
    assert body.torso_info.lift_max == 0.35


def test_the_camera_has_the_place_of_the_data_sheet(robot_at: RobotAt, steer: Steer) -> None:
    body = robot_at(camera=CameraSettings(32, 24, 10.0))
    eye, _ = body._camera.pose(body.physics_body, body._camera_link)
    assert eye == pytest.approx((0.2158, 0.022, 1.0665), abs=0.006)
    body.lift(0.2)
    steer(body, 4.0, None)
    eye, _ = body._camera.pose(body.physics_body, body._camera_link)
    assert eye[2] == pytest.approx(1.2665, abs=0.006)


def test_the_camera_sees_an_object_ahead(box: MakeObject) -> None:
    description = load_world_description("arena")
    red = replace(box(2.0, 0.0, (0.5, 1.5, 2.0), name="red"), color=(230, 20, 20, 255))
    world = World(replace(description, objects=(*description.objects, red), pose=Pose2D(0.0, 0.0, 0.0)))
    body = SimulatedRobot(world, camera=CameraSettings(64, 48, 10.0))
    ahead = body.camera().rgb[24, 32].astype(int)
    assert ahead[0] > ahead[1] + 40
    body.move_head(1.3, 0.0)
    world.wait_until(SECOND, threading.Event())
    aside = body.camera().rgb[24, 32].astype(int)
    assert abs(aside[0] - aside[1]) < 40
    world.close()


def test_a_picture_is_drawn_once_for_its_period(robot_at: RobotAt) -> None:
    world = World(robot_at().world.description)
    body = SimulatedRobot(world, camera=CameraSettings(32, 24, 10.0))
    first = body.camera()
    world.wait_until(SECOND // 20, threading.Event())
    assert body.camera() is first
    world.wait_until(SECOND // 10, threading.Event())
    assert body.camera().stamp == SECOND // 10
    assert first.rgb.shape == (24, 32, 3)
    assert first.rgb.dtype == np.uint8
    world.close()


def test_camera_options_are_parsed() -> None:
    assert parse_camera("off") is None
    assert parse_camera("320x240@10") == CameraSettings(320, 240, 10.0)
    assert parse_camera("64x48") == CameraSettings(64, 48, 10.0)
    for text in ("on", "320", "0x10", "99999x10", "320x240@0"):
        with pytest.raises(SimError, match="off, or WxH@HZ"):
            parse_camera(text)


def test_a_scan_is_read_only(robot_at: RobotAt) -> None:
    with pytest.raises(ValueError, match="read-only"):
        robot_at().scan().ranges[0] = 0.0


def test_the_static_scene_has_shapes_and_the_moving_scene_has_poses(
    robot_at: RobotAt, steer: Steer, box: MakeObject, noiseless_tiago: RobotDescription
) -> None:
    body = robot_at(
        box(1.0, 2.0, (0.5, 0.4, 0.3), yaw=0.5),
        box(3.0, 0.0, (0.3, 0.3, 0.3), mass=1.0, name="crate"),
        description=noiseless_tiago,
    )
    static = body.static_scene()
    parts = {part.name: part for part in static.parts}
    assert parts["test/box"].position == (1.0, 2.0, 0.15)
    assert parts["test/box"].quaternion == pytest.approx([0.0, 0.0, math.sin(0.25), math.cos(0.25)])
    assert parts["test/crate"].frame == "crate"
    assert static.laser.frame == "base_laser_link"
    steer(body, 2.0, (0.2, 0.0))
    moving = body.moving_scene()
    frames = {frame[0]: frame for frame in moving.frames}
    assert frames["base_link"][2][0] == pytest.approx(body.true_pose().x)
    assert frames["crate"][2] == pytest.approx([3.0, 0.0, 0.15], abs=0.005)
    assert {part.frame for part in (*static.parts, *static.meshes)} - {"map"} <= set(frames)
    assert moving.stamp == moving.scan.stamp == 2 * SECOND
    assert np.frombuffer(moving.scan.ranges, "<f4") == pytest.approx(body.scan().ranges)
    assert moving.velocity == pytest.approx([0.2, 0.0], abs=0.01)
    assert (moving.collisions, moving.grazes) == (0, 0)
