"""Transforms, the transform tree over time, and readings that wait for their transforms."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D, TransformStamped
from btcore_robot.transform_filter import MAX_WAITING, TransformFilter
from btcore_robot.transforms import (
    CACHE_TIME,
    ConnectivityError,
    ExtrapolationError,
    FrameBroadcaster,
    Transform,
    TransformError,
    TransformTree,
    UnknownFrameError,
)
from tests.robot_nodes.conftest import RecordingRobot

SECOND = 1_000_000_000
STILL = (0.0, 0.0, 0.0, 1.0)


def frame(child: str, parent: str, x: float = 0.0, yaw: float = 0.0, stamp: int = 0) -> TransformStamped:
    return TransformStamped(
        child, parent, (x, 0.0, 0.0), (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2)), stamp
    )


def chain() -> TransformTree:
    """map → odom → base_footprint → base_laser_link, where the base drives 1 m/s from 0 to 10 s."""
    tree = TransformTree()
    tree.set_static(frame("base_laser_link", "base_footprint", 0.2))
    for second in range(11):
        tree.set(frame("odom", "map", 100.0, stamp=second * SECOND))
        tree.set(frame("base_footprint", "odom", float(second), stamp=second * SECOND))
    return tree


coordinates = st.floats(-50.0, 50.0)


@st.composite
def quaternions(draw: st.DrawFn) -> tuple[float, float, float, float]:
    parts = np.array([draw(st.floats(-1.0, 1.0)) for _ in range(4)])
    length = float(np.linalg.norm(parts))
    if length < 0.1:
        return STILL
    x, y, z, w = (parts / length).tolist()
    return (x, y, z, w)


transforms = st.builds(Transform, st.tuples(coordinates, coordinates, coordinates), quaternions())


def same(first: Transform, second: Transform) -> bool:
    """Compare transforms with a tolerance; a quaternion and its opposite are the same rotation."""
    turn = abs(float(np.dot(first.quaternion, second.quaternion)))
    return bool(np.allclose(first.position, second.position, atol=1e-9)) and abs(turn - 1.0) < 1e-9


@given(transforms)
def test_a_transform_times_its_inverse_is_the_identity(a2b: Transform) -> None:
    assert same(a2b * a2b.inverse(), Transform())
    assert same(a2b.inverse() * a2b, Transform())


@given(transforms, transforms, transforms)
def test_composition_is_associative(a2b: Transform, b2c: Transform, c2d: Transform) -> None:
    assert same((a2b * b2c) * c2d, a2b * (b2c * c2d))
    assert a2b.compose(b2c) == a2b * b2c


@given(transforms, transforms, st.tuples(coordinates, coordinates, coordinates))
def test_a2c_is_a2b_times_b2c(a2b: Transform, b2c: Transform, point: tuple[float, float, float]) -> None:
    points = np.array([point])
    assert np.allclose((a2b * b2c).apply(points), a2b.apply(b2c.apply(points)), atol=1e-9)


@given(transforms, transforms, st.floats(0.0, 1.0))
def test_interpolation_stays_between_its_ends(a: Transform, b: Transform, share: float) -> None:
    between = a.interpolate(b, share)
    for value, low, high in zip(between.position, a.position, b.position, strict=True):
        assert min(low, high) - 1e-9 <= value <= max(low, high) + 1e-9
    whole, part = angle(a, b), angle(a, between)
    assert math.isclose(part, share * whole, abs_tol=1e-3)
    assert math.isclose(float(np.linalg.norm(between.quaternion)), 1.0, abs_tol=1e-12)


@given(transforms, transforms)
def test_interpolation_begins_and_ends_at_its_ends(a: Transform, b: Transform) -> None:
    assert same(a.interpolate(b, 0.0), a)
    assert same(a.interpolate(b, 1.0), b)


def angle(a: Transform, b: Transform) -> float:
    """Return the angle (rad) of the shorter rotation between two quaternions."""
    return 2.0 * math.acos(min(1.0, abs(float(np.dot(a.quaternion, b.quaternion)))))


@given(coordinates, coordinates, st.floats(-3.1, 3.1))
def test_a_pose_is_unchanged_after_conversion_to_a_transform_and_back(x: float, y: float, yaw: float) -> None:
    back = Transform.from_pose(Pose2D(x, y, yaw)).to_pose()
    assert (back.x, back.y) == (x, y)
    assert math.isclose(back.yaw, yaw, abs_tol=1e-12)


def test_applying_a_transform_keeps_the_dimension_of_the_points() -> None:
    laser = Transform.from_pose(Pose2D(1.0, 2.0, math.pi / 2))
    assert np.allclose(laser.apply(np.array([[3.0, 0.0]])), [[1.0, 5.0]])
    assert np.allclose(laser.apply(np.array([[3.0, 0.0, 7.0]])), [[1.0, 5.0, 7.0]])


def test_look_up_gives_the_pose_of_the_source_in_the_target() -> None:
    tree = chain()
    assert math.isclose(tree.lookup("map", "base_laser_link").position[0], 110.2)
    assert math.isclose(tree.lookup("base_laser_link", "map").position[0], -110.2)
    assert tree.lookup("odom", "odom") == Transform()


def test_look_up_between_two_stamps_interpolates() -> None:
    assert math.isclose(chain().lookup("map", "base_footprint", 2_250_000_000).position[0], 102.25)


def test_look_up_interpolates_along_the_shorter_turn() -> None:
    tree = TransformTree()
    tree.set(frame("base_footprint", "odom", yaw=3.0, stamp=0))
    tree.set(frame("base_footprint", "odom", yaw=-3.0, stamp=SECOND))
    assert math.isclose(abs(tree.lookup("odom", "base_footprint", SECOND // 2).yaw), math.pi, abs_tol=1e-9)


def test_look_up_goes_through_the_common_ancestor() -> None:
    tree = chain()
    tree.set_static(frame("kitchen", "map", 90.0))
    assert math.isclose(tree.lookup("kitchen", "base_footprint", 3 * SECOND).position[0], 13.0)


def test_without_a_stamp_the_newest_time_known_to_all_frames_is_used() -> None:
    tree = chain()
    tree.set(frame("base_footprint", "odom", 12.0, stamp=12 * SECOND))
    assert math.isclose(tree.lookup("map", "base_footprint").position[0], 110.0)
    tree.set(frame("odom", "map", 200.0, stamp=10 * SECOND), holds=5 * SECOND)
    assert math.isclose(tree.lookup("map", "base_footprint").position[0], 212.0)


def test_a_transform_that_holds_is_valid_only_until_the_end_of_its_duration() -> None:
    tree = TransformTree()
    tree.set(frame("odom", "map", 3.0, stamp=SECOND), holds=SECOND)
    assert tree.lookup("map", "odom", 2 * SECOND).position[0] == 3.0
    with pytest.raises(ExtrapolationError):
        tree.lookup("map", "odom", 2 * SECOND + 1)


def test_the_past_is_kept_for_ten_seconds_and_static_frames_for_ever() -> None:
    tree = chain()
    tree.set(frame("base_footprint", "odom", 13.0, stamp=13 * SECOND))
    assert tree.lookup("odom", "base_footprint", 13 * SECOND - CACHE_TIME).position[0] == 3.0
    with pytest.raises(
        ExtrapolationError, match=r"from 3\.000 s to 13\.000 s, but 2\.000 s is 1\.000 s before"
    ) as raised:
        tree.lookup("odom", "base_footprint", 2 * SECOND)
    assert not raised.value.future
    assert tree.lookup("base_footprint", "base_laser_link", 1_000_000 * SECOND).position[0] == 0.2


def test_a_time_in_the_future_raises() -> None:
    with pytest.raises(
        ExtrapolationError, match=r"10\.500 s is 0\.500 s after that; wait for newer data"
    ) as raised:
        chain().lookup("map", "base_footprint", 10_500_000_000)
    assert raised.value.future


def test_a_late_transform_is_inserted_by_its_stamp() -> None:
    tree = TransformTree()
    for second in (1, 3, 2):
        tree.set(frame("base_footprint", "odom", second * 10.0, stamp=second * SECOND))
    assert tree.lookup("odom", "base_footprint", 2_500_000_000).position[0] == 25.0
    tree.set(frame("base_footprint", "odom", 99.0, stamp=3 * SECOND - CACHE_TIME - 1))
    with pytest.raises(ExtrapolationError):
        tree.lookup("odom", "base_footprint", 0)


def test_an_unknown_frame_raises_with_a_suggestion() -> None:
    with pytest.raises(UnknownFrameError, match="no frame 'base_lazer_link'; did you mean 'base_laser_link'"):
        chain().lookup("map", "base_lazer_link")
    with pytest.raises(UnknownFrameError, match="no frame is known yet"):
        TransformTree().lookup("map", "odom")


def test_frames_without_a_common_root_are_not_connected() -> None:
    tree = chain()
    tree.set_static(frame("hand", "arm"))
    with pytest.raises(
        ConnectivityError, match="'hand' and 'map' are not connected: their roots are 'arm' and 'map'"
    ):
        tree.lookup("map", "hand")
    assert not tree.can_transform("map", "hand")
    assert tree.can_transform("map", "base_footprint", 5 * SECOND)


def test_a_cycle_of_frames_is_refused() -> None:
    tree = chain()
    with pytest.raises(
        TransformError, match="'map' can't be placed in 'base_footprint', which is somewhere below it"
    ):
        tree.set(frame("map", "base_footprint"))
    with pytest.raises(TransformError, match="'map' can't be placed in itself"):
        tree.set(frame("map", "map"))


@pytest.mark.parametrize(
    "quaternion", [(0.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, math.nan), (0.0, 0.0, 1.0, 1.0)]
)
def test_a_quaternion_without_length_one_is_refused(quaternion: tuple[float, float, float, float]) -> None:
    with pytest.raises(TransformError, match="a rotation has length 1"):
        TransformTree().set(TransformStamped("odom", "map", (0.0, 0.0, 0.0), quaternion, 0))


def test_a_position_that_is_not_finite_is_refused() -> None:
    with pytest.raises(TransformError, match="is not finite"):
        TransformTree().set_static(TransformStamped("odom", "map", (math.inf, 0.0, 0.0), STILL, 0))


def test_a_frame_under_a_new_parent_is_moved_there() -> None:
    tree = chain()
    tree.set(frame("base_laser_link", "head", 1.0, stamp=SECOND))
    with pytest.raises(ConnectivityError):
        tree.lookup("map", "base_laser_link")
    assert tree.parent("base_laser_link") == "head"
    assert tree.frames() == ["base_footprint", "base_laser_link", "head", "map", "odom"]


def test_the_broadcaster_publishes_odometry_and_the_robots_links(robot: RecordingRobot) -> None:
    class Linked(type(robot)):
        def frames(self) -> list[TransformStamped]:
            return [frame("base_link", "base_footprint", 0.1, stamp=self.clock.now())]

    tree = TransformTree()
    FrameBroadcaster(Linked(), tree).step(0)
    assert math.isclose(tree.lookup("odom", "base_link", 0).position[0], 0.1)


def test_the_broadcaster_writes_fixed_frames_once(robot: RecordingRobot) -> None:
    class Tall(type(robot)):
        def frames(self) -> list[TransformStamped]:
            return [frame("torso", "base_footprint", 0.1, stamp=self.clock.now()), *self.moving_frames()]

        def moving_frames(self) -> list[TransformStamped]:
            now = self.clock.now()
            return [frame("head", "torso", 0.2 + now / SECOND, stamp=now)]

    body, tree = Tall(), TransformTree()
    broadcaster = FrameBroadcaster(body, tree)
    broadcaster.step(0)
    body.clock.time = SECOND
    broadcaster.step(SECOND)
    assert tree.lookup("base_footprint", "head", SECOND).position[0] == pytest.approx(1.3)
    assert tree.lookup("base_footprint", "torso", 20 * SECOND).position[0] == 0.1


@given(st.floats(-100.0, 100.0))
def test_wrapped_angles_are_the_same_direction(angle: float) -> None:
    wrapped = wrap_angle(angle)
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped - angle) == pytest.approx(1.0)


@dataclass(frozen=True)
class Reading:
    frame: str
    stamp: int


def reading(second: float) -> Reading:
    return Reading("base_laser_link", round(second * SECOND))


def test_readings_wait_for_their_transforms_and_are_returned_once() -> None:
    tree = chain()  # until 10 s
    readings = TransformFilter[Reading](tree, "odom")
    assert readings.newest(None) is None
    early, first, second, third = (reading(at) for at in (9.0, 10.5, 11.0, 11.5))
    assert readings.newest(early) == early
    assert readings.newest(early) is None
    assert [readings.newest(late) for late in (first, second, second, third)] == [None] * 4
    tree.set(frame("base_footprint", "odom", 11.0, stamp=11 * SECOND))
    assert readings.newest(third) == second  # the first is discarded
    assert readings.newest(third) is None
    tree.set(frame("base_footprint", "odom", 12.0, stamp=12 * SECOND))
    assert readings.newest(None) == third


def test_only_the_newest_readings_wait() -> None:
    tree = chain()
    readings = TransformFilter[Reading](tree, "odom")
    for second in range(11, 12 + MAX_WAITING):
        assert readings.newest(reading(second)) is None
    tree.set(frame("base_footprint", "odom", 11.0, stamp=11 * SECOND))
    assert readings.newest(None) is None
    tree.set(frame("base_footprint", "odom", 12.0, stamp=12 * SECOND))
    assert readings.newest(None) == reading(12)
