"""The frames of a simulated robot: those of the data sheet, at the poses of the physics engine."""

import json
import math
import threading
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from btcore.clock import NS_PER_S
from btcore_robot.rigid_transform import Transform, from_rpy
from btcore_robot.robot import BASE_FRAME
from btcore_sim.errors import SimError
from btcore_sim.kinematics import Kinematics, complete_urdf
from btcore_sim.robot_description import TIAGO, load_robot_description
from tests.sim.conftest import RobotAt, Steer

LEVEL = {"base_link", "base_laser_link", "torso_fixed_link"}


def pose(frames: Any, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the pose of a frame in ``base_footprint``: rotation (3, 3) and position (m)."""
    known = {frame.child: frame for frame in frames}
    rotation, position = np.eye(3), np.zeros(3)
    while name != "base_footprint":
        frame = known[name]
        rotation, position = (
            Transform(quaternion=frame.quaternion).rotation @ rotation,
            Transform(quaternion=frame.quaternion).rotation @ position,
        )
        position = position + frame.position
        name = frame.parent
    return rotation, position


def test_every_frame_is_connected_to_the_footprint_once(robot_at: RobotAt) -> None:
    frames = robot_at().frames()
    children = [frame.child for frame in frames]
    assert len(children) == len(set(children))
    for frame in frames:
        pose(frames, frame.child)
        assert np.linalg.norm(frame.quaternion) == pytest.approx(1.0)


def test_only_the_moving_frames_move(robot_at: RobotAt) -> None:
    body = robot_at()
    before = {frame.child: (frame.position, frame.quaternion) for frame in body.frames()}
    body.lift(0.2)
    body.move_head(0.5, -0.3)
    body.world.wait_until(NS_PER_S, threading.Event())
    moved = [frame for frame in body.frames() if before[frame.child] != (frame.position, frame.quaternion)]
    assert moved == body.moving_frames()
    assert [frame.child for frame in moved] == ["torso_lift_link", "head_1_link", "head_2_link"]


def test_the_names_are_those_of_the_data_sheet(robot_at: RobotAt) -> None:
    assert {frame.child for frame in robot_at().frames()} == {
        "base_link",
        "base_laser_link",
        "base_sonar_01_link",
        "base_sonar_02_link",
        "base_sonar_03_link",
        "torso_fixed_link",
        "torso_lift_link",
        "head_1_link",
        "head_2_link",
        "head_front_camera_link",
        "head_front_camera_rgb_frame",
        "head_front_camera_rgb_optical_frame",
        "head_front_camera_depth_frame",
        "head_front_camera_depth_optical_frame",
    }


@pytest.mark.parametrize(
    ("name", "position"),
    [
        ("base_laser_link", (0.202, 0.0, 0.0945)),
        ("torso_lift_link", (-0.062, 0.0, 0.8885)),
        ("head_2_link", (0.125, 0.0, 0.9865)),
        ("head_front_camera_rgb_frame", (0.2158, 0.022, 1.0665)),
        ("base_sonar_02_link", (-0.259, 0.0, 0.2715)),
    ],
)
def test_frames_have_the_positions_of_the_data_sheet(
    robot_at: RobotAt, name: str, position: tuple[float, float, float]
) -> None:
    assert pose(robot_at().frames(), name)[1] == pytest.approx(position, abs=0.002)


def test_in_the_optical_frame_z_is_ahead_and_x_to_the_right(robot_at: RobotAt) -> None:
    rotation, _ = pose(robot_at().frames(), "head_front_camera_rgb_optical_frame")
    assert rotation[:, 2] == pytest.approx([1.0, 0.0, 0.0], abs=0.02)
    assert rotation[:, 0] == pytest.approx([0.0, -1.0, 0.0], abs=0.02)


def test_frames_agree_with_the_engines_links_when_head_and_torso_move(
    robot_at: RobotAt, steer: Steer
) -> None:
    body = robot_at()
    body.move_head(0.7, -0.5)
    body.lift(0.2)
    steer(body, 4.0, None)
    frames = body.frames()
    assert {frame.stamp for frame in frames} == {body.world.now()}
    base_place, base_turned = body.physics_body.pose()
    for name in ("torso_lift_link", "head_1_link", "head_2_link"):
        place, turned = body.physics_body.link_pose(body.physics_body.link(name))
        base = Transform(quaternion=base_turned).rotation
        expected = base.T @ (np.array(place) - base_place) + (0.0, 0.0, 0.0985)
        rotation, position = pose(frames, name)
        assert position == pytest.approx(expected, abs=1e-4)
        assert rotation == pytest.approx(base.T @ Transform(quaternion=turned).rotation, abs=1e-4)


def test_the_camera_sees_from_its_optical_frame(robot_at: RobotAt, steer: Steer) -> None:
    from btcore_sim.camera import CameraSettings

    body = robot_at(camera=CameraSettings(32, 24, 10.0))
    body.move_head(-0.4, 0.3)
    steer(body, 2.0, None)
    eye, turned = body._camera.pose(body.physics_body, body._camera_link)
    rotation, position = pose(body.frames(), body.camera_info.frame)
    base_place, base_turned = body.physics_body.pose()
    base = Transform(quaternion=base_turned).rotation
    assert base @ (position - (0.0, 0.0, 0.0985)) + base_place == pytest.approx(eye, abs=1e-4)
    assert (base @ rotation)[:, 2] == pytest.approx(Transform(quaternion=turned).rotation[:, 0], abs=1e-4)


def described(folder: Path, change: Any) -> Any:
    data = json.loads(TIAGO.read_text())
    data["urdf"] = str(TIAGO.with_name("tiago.urdf"))
    change(data)
    path = folder / "mine.json"
    path.write_text(json.dumps(data))
    return load_robot_description(path)


def test_a_sensor_has_a_frame_even_without_a_description_of_it(tmp_path: Path) -> None:
    bare = Kinematics(described(tmp_path, lambda data: data.pop("frames")))
    reported = Kinematics(load_robot_description())
    zeros = [0.0] * len(reported.joints)
    name = "head_front_camera_rgb_optical_frame"
    for actual, expected in zip(
        pose(bare.frames(zeros, 0), name), pose(reported.frames(zeros, 0), name), strict=True
    ):
        assert actual == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize(
    ("frame", "message"),
    [
        ({"name": "hat", "parent": "head_3_link"}, "'hat' is fixed to 'head_3_link'.*; did you mean 'head_"),
        ({"name": "base_link", "parent": "head_2_link"}, "there are two frames 'base_link'"),
        ({"name": "hat", "parent": "hat"}, "'hat' is fixed to itself"),
    ],
)
def test_frame_with_invalid_name_or_parent_fails(tmp_path: Path, frame: dict[str, str], message: str) -> None:
    with pytest.raises(SimError, match=message):
        Kinematics(described(tmp_path, lambda data: data["frames"].append(frame)))


def test_turns_about_fixed_axes_are_applied_in_the_order_x_y_z() -> None:
    turned = Transform(quaternion=from_rpy((0.0, math.pi / 2, math.pi / 2)))
    assert (turned * Transform((1.0, 0.0, 0.0))).position == pytest.approx((0.0, 0.0, -1.0))
    assert (turned * Transform((0.0, 0.0, 1.0))).position == pytest.approx((0.0, 1.0, 0.0))
    assert (turned * turned).rotation == pytest.approx(turned.rotation @ turned.rotation)


def test_complete_urdf_has_a_link_for_each_frame() -> None:
    description = load_robot_description()
    robot = ElementTree.fromstring(complete_urdf(description))
    kinematics = Kinematics(description)
    frames = kinematics.frames([0.0] * len(kinematics.joints), 0)
    parents = {
        str(joint.find("child").get("link")): joint.find("parent").get("link")
        for joint in robot.iterfind("joint")
    }
    assert {frame.child: frame.parent for frame in frames}.items() <= parents.items()
    assert {link.get("name") for link in robot.iterfind("link")} == {BASE_FRAME, *parents}
    turning = robot.iterfind("joint[@type='revolute']/child")
    assert {child.get("link") for child in turning} < kinematics.moving_frames
