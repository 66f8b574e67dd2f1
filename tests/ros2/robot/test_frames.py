"""Frames of a robot below its base, from transforms or from a URDF."""

import math

import pytest

from btcore_robot.errors import RobotError
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import TransformStamped
from btcore_robot.urdf import read_urdf
from btcore_ros2.robot.frames import FrameStore
from btcore_scene import Cylinder
from btcore_sim.kinematics import Kinematics, complete_urdf
from btcore_sim.robot_description import load_robot_description


def poses(frames: list[TransformStamped]) -> dict[str, tuple[str, list[float]]]:
    return {frame.child: (frame.parent, [*frame.position, *frame.quaternion]) for frame in frames}


def test_frames_above_and_beside_the_base_are_turned_around() -> None:
    store = FrameStore("base_footprint", "odom")
    store.set("/base_link", "odom", Transform((5.0, 0.0, 0.0)), 10)
    store.set("base_footprint", "base_link", Transform((0.0, 0.0, -0.1)), None)
    store.set("laser", "/base_link", Transform((0.2, 0.0, 0.1), (0.0, 0.0, 2.0, 0.0)), None)
    store.set("odom", "map", Transform((1.0, 0.0, 0.0)), 10)
    store.set("other", "island", Transform(), None)
    assert poses(store.frames(99)) == {
        "base_link": ("base_footprint", [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 1.0]),
        "laser": ("base_link", [0.2, 0.0, 0.1, 0.0, 0.0, 1.0, 0.0]),
    }
    assert {frame.stamp for frame in store.frames(99)} == {99}


def test_base_of_another_name_becomes_base_footprint() -> None:
    store = FrameStore("base_link", "odom")
    store.set("base_link", "odom", Transform((5.0, 0.0, 0.0)), 10)
    store.set("head", "base_link", Transform((0.0, 0.0, 1.0)), 20)
    (frame,) = store.frames(99)
    assert (frame.child, frame.parent, frame.stamp) == ("head", "base_footprint", 20)


def test_frame_that_moves_to_another_parent() -> None:
    store = FrameStore("base_footprint", "odom")
    store.set("tool", "rack", Transform(), 1)
    assert store.frames(2) == []
    store.set("tool", "base_footprint", Transform(), 2)
    assert [frame.child for frame in store.frames(2)] == ["tool"]


def test_invalid_poses_are_ignored() -> None:
    store = FrameStore("base_footprint", "odom")
    store.set("a", "base_footprint", Transform(quaternion=(0.0, 0.0, 0.0, 0.0)), 1)
    store.set("b", "base_footprint", Transform((math.nan, 0.0, 0.0)), 1)
    store.set("c", "d", Transform(), 1)
    store.set("d", "c", Transform(), 1)
    assert store.frames(2) == []


def test_urdf_has_the_poses_of_the_simulator() -> None:
    description = load_robot_description()
    kinematics = Kinematics(description)
    positions = dict(zip(kinematics.joints, (0.3, -0.4, 0.2, 0.1), strict=False))
    expected = poses(kinematics.frames(list(positions.values()), 7))
    store = FrameStore("base_footprint", "odom")
    for joint in read_urdf(complete_urdf(description)).joints:
        if not joint.is_movable:
            store.set(joint.child, joint.parent, joint.origin, None)
        elif joint.name in positions:
            store.set(joint.child, joint.parent, joint.pose(positions[joint.name]), 7)
    found = poses(store.frames(7))
    assert len(expected) > 10
    for child, (parent, numbers) in expected.items():
        assert found[child][0] == parent
        assert found[child][1] == pytest.approx(numbers, abs=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("no XML", "not a valid URDF"),
        ("<robot><joint name='a'><child link='b'/></joint></robot>", "the joint 'a' has no parent link"),
        (
            "<robot><joint name='a'><parent link='c'/><child link='b'/><origin xyz='1 2'/></joint></robot>",
            'origin xyz="1 2" does not have three numbers',
        ),
    ],
)
def test_invalid_urdf_is_reported(text: str, message: str) -> None:
    with pytest.raises(RobotError, match=message):
        read_urdf(text)


def test_shapes_of_a_urdf() -> None:
    shapes = read_urdf(complete_urdf(load_robot_description())).shapes
    assert {"box", "cylinder"} <= {shape.kind for shape in shapes}
    assert {"base_link", "wheel_left_link", "torso_lift_link"} <= {shape.frame for shape in shapes}
    body = shapes[0]
    assert body == Cylinder(
        frame="base_link",
        radius=0.263,
        length=0.197,
        position=(0.0, 0.0, 0.03),
        quaternion=(0.0, 0.0, 0.0, 1.0),
        color=(33, 36, 41, 255),
    )
    mesh = (
        "<robot><link name='a'><visual><geometry><mesh filename='a.dae'/></geometry></visual></link></robot>"
    )
    assert read_urdf(mesh).shapes == []
