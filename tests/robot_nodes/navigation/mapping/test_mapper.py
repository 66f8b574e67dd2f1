"""The mapper on robots that are moved along a path, with errors of odometry."""

import numpy as np
import pytest

from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.mapping.conftest import RING, ROOM, MappingRig

ROUND = ((14.25, -9.25), (14.25, 9.25), (-14.25, 9.25), (-14.25, -9.25), (6.0, -9.25))
START = Pose2D(11.0, -9.25, 0.0)


def test_the_pose_in_a_room_is_right_despite_odometry_errors() -> None:
    rig = MappingRig(ROOM, Pose2D(-2.0, 0.0, 0.0), stretch=1.03, slip=1.05)
    for _ in range(2):
        rig.along((2.0, -0.8), (2.4, 0.3), (0.0, 1.2), (-2.2, 0.0))
    assert rig.odometry_error() > 0.5
    assert rig.error() < 0.08
    assert rig.key_errors().max() < 0.1


@pytest.mark.parametrize("odometry", ["goes on", "starts anew"])
def test_pose_is_right_after_outage_of_odometry(odometry: str) -> None:
    rig = MappingRig(ROOM, Pose2D(-2.0, 0.0, 0.0), slip=1.05).along((2.0, -0.8), (2.4, 0.3))
    rig.interrupt(Pose2D(0.0, 0.0, 0.0) if odometry == "starts anew" else None)
    assert not rig.mapper.is_confident
    for _ in range(5):
        rig.turn(0.0)
    assert rig.mapper.is_confident
    assert rig.error() < 0.08
    rig.along((0.0, 1.2), (-2.2, 0.0))
    assert rig.error() < 0.1


def test_mapper_searches_after_robot_was_carried_without_odometry() -> None:
    rig = MappingRig(ROOM, Pose2D(-2.0, 0.0, 0.0)).along((2.0, -0.8))
    rig.interrupt(None)
    rig.true, back = Pose2D(-1.8, 1.4, 2.2), rig.true
    for _ in range(5):
        rig.turn(0.0)
    assert rig.mapper.is_searching
    assert not rig.mapper.is_confident
    rig.true = back
    for _ in range(5):
        rig.turn(0.0)
    assert not rig.mapper.is_searching
    assert rig.error() < 0.08


def test_closing_a_loop_improves_the_map() -> None:
    # The corridor is longer than the laser's range, and odometry stretches only its first half.
    rig = MappingRig(RING, START, stretch=1.04, slip=1.02).along(*ROUND[:2], step=0.3)
    rig.stretch = 0.96
    rig.along(*ROUND[2:], step=0.3)
    assert rig.mapper.loops_closed == 0
    error, key_error = rig.error(), rig.key_errors().mean()
    assert error > 0.4
    rig.along((12.0, -9.25), step=0.3)
    assert rig.mapper.loops_closed >= 1
    assert rig.error() < 0.15
    assert rig.key_errors().mean() < 0.7 * key_error


def test_a_uniform_corridor_closes_no_loop() -> None:
    corridor = ((-40.0, 0.8, 40.0, 1.0), (-40.0, -1.0, 40.0, -0.8))
    rig = MappingRig(corridor, Pose2D(0.0, 0.0, 0.0)).along((6.0, 0.0), (0.0, 0.0), step=0.3)
    assert rig.mapper.loops_closed == 0
    assert rig.error() < 0.1


def test_nearly_all_occupied_cells_are_walls_of_the_room() -> None:
    rig = MappingRig(ROOM, Pose2D(-2.0, 0.0, 0.0), stretch=1.02, slip=1.03)
    map = rig.along((2.0, -0.8), (2.4, 0.3), (0.0, 1.2), (-2.2, 0.0)).mapper.map()
    places = map.centers(*np.nonzero(map.occupied))
    off = [
        min(np.hypot(max(x0 - x, 0, x - x1), max(y0 - y, 0, y - y1)) for x0, y0, x1, y1 in ROOM)
        for x, y in places
    ]
    assert len(places) > 300
    assert np.mean(np.array(off) <= 0.1) >= 0.97


def test_the_mapper_publishes_the_transform_from_map_to_odom() -> None:
    rig = MappingRig(ROOM, Pose2D(-2.0, 0.5, 0.3), slip=1.05).along((1.0, -0.5))
    mapper = rig.mapper
    assert rig.transforms.lookup("map", "odom", mapper.stamp) == mapper.map_to_odom
    reported = rig.transforms.lookup("map", "base_footprint", mapper.stamp).to_pose()
    assert (reported.x, reported.y) == pytest.approx((mapper.pose().x, mapper.pose().y))


def test_key_scans_are_half_a_metre_or_a_quarter_of_a_radian_apart() -> None:
    rig = MappingRig(ROOM, Pose2D(-2.0, 0.0, 0.0))
    assert len(rig.mapper.scans) == 1
    rig.along((0.05, 0.0))
    assert len(rig.mapper.scans) == 5
    rig.turn(1.0)
    assert len(rig.mapper.scans) in (8, 9)


def test_the_same_drive_gives_the_same_map() -> None:
    first, second = (
        MappingRig(ROOM, Pose2D(-2.5, -0.5, 0.0), slip=1.03, seed=4).along((-2.0, 0.0), (1.0, 0.5))
        for _ in range(2)
    )
    assert np.array_equal(first.mapper.poses, second.mapper.poses)
    assert np.array_equal(first.mapper.map().cells, second.mapper.map().cells)


def test_before_the_first_scan_the_map_is_unknown() -> None:
    from btcore_navigation.mapping.mapper import Mapper

    rig = MappingRig(ROOM, Pose2D(0.0, 0.0, 0.0))
    fresh = Mapper(rig.robot, rig.transforms)
    assert not fresh.is_confident
    assert fresh.map().unknown.all()
    assert rig.mapper.is_confident


def test_without_echoes_the_pose_follows_odometry() -> None:
    rig = MappingRig((), Pose2D(1.0, 2.0, 0.0)).along((3.0, 2.0))
    assert rig.mapper.pose().x == pytest.approx(3.0, abs=1e-6)
    assert rig.mapper.loops_closed == 0
