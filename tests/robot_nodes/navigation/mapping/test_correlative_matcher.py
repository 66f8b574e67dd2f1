"""Scan matching: a known offset is found, and undetermined directions are reported as such."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from btcore_navigation.mapping.correlative_matcher import (
    NEARBY,
    CorrelationGrid,
    PoseUncertainty,
    SearchWindow,
)
from btcore_navigation.mapping.pose_arrays import pose_to_row, relative_pose
from btcore_robot.robot import Pose2D
from tests.robot_nodes.navigation.mapping.conftest import ROOM, key_scan_at

AROUND = (Pose2D(0.0, 0.0, 0.0), Pose2D(0.3, -0.2, 0.8), Pose2D(-0.4, 0.1, -0.9), Pose2D(0.1, 0.3, 2.5))


@pytest.fixture(scope="module")
def walls() -> CorrelationGrid:
    """Return the grid of four scans of the room."""
    scans = [(key_scan_at(ROOM, pose, seed), pose) for seed, pose in enumerate(AROUND, 10)]
    return CorrelationGrid([scan.outline.at(pose_to_row(pose)) for scan, pose in scans])


offsets = st.tuples(st.floats(-0.28, 0.28, allow_nan=False), st.floats(-0.28, 0.28), st.floats(-0.19, 0.19))
places = st.tuples(st.floats(-0.6, 0.6), st.floats(-0.6, 0.6), st.floats(-math.pi, math.pi))


@given(offset=offsets, place=places, seed=st.integers(0, 1000))
def test_an_offset_within_the_window_is_recovered(
    walls: CorrelationGrid,
    offset: tuple[float, float, float],
    place: tuple[float, float, float],
    seed: int,
) -> None:
    scan = key_scan_at(ROOM, Pose2D(*place), seed)
    guess = np.array(place) + np.array(offset)
    best = walls.search(guess, scan.outline.points, NEARBY)
    found = walls.refine(best, scan.outline)
    off = relative_pose(np.array(place), found.pose)
    assert math.hypot(off[0], off[1]) < 0.04
    assert abs(off[2]) < 0.015
    assert found.score > 0.5


def test_a_wider_window_finds_a_larger_offset(walls: CorrelationGrid) -> None:
    scan, true = key_scan_at(ROOM, Pose2D(0.2, 0.1, 0.4), 1), np.array((0.2, 0.1, 0.4))
    guess = true + np.array((0.9, -0.7, 0.3))
    best = walls.search(guess, scan.outline.points, SearchWindow(1.2, 0.4, 2, 0.035))
    assert np.abs(relative_pose(true, walls.refine(best, scan.outline).pose)).max() < 0.03
    near = walls.search(guess, scan.outline.points, NEARBY)
    assert np.abs(relative_pose(true, near)).max() > 0.3


def test_score_distinguishes_match_from_mismatch(walls: CorrelationGrid) -> None:
    scan, true = key_scan_at(ROOM, Pose2D(0.2, 0.1, 0.4), 1), np.array((0.2, 0.1, 0.4))
    assert walls.score(true, scan.outline.points) > 2 * walls.score(
        true + np.array((0.4, 0.3, 0.2)), scan.outline.points
    )
    assert walls.score(true + np.array((50.0, 0.0, 0.0)), scan.outline.points) == 0.0


def test_along_a_bare_corridor_the_guess_stays_with_little_information() -> None:
    corridor = ((-40.0, 0.8, 40.0, 1.0), (-40.0, -1.0, 40.0, -0.8))
    walls = CorrelationGrid(
        [
            key_scan_at(corridor, Pose2D(x, 0.0, 0.0), 5).outline.at(np.array((x, 0.0, 0.0)))
            for x in (0.0, 0.5)
        ]
    )
    scan = key_scan_at(corridor, Pose2D(0.9, 0.1, 0.0), 6)
    guess = np.array((1.0, 0.0, 0.05))
    found = walls.refine(guess, scan.outline, guess, PoseUncertainty(0.05, 0.05))
    assert found.pose[0] == pytest.approx(1.0, abs=0.02)
    assert found.pose[1:] == pytest.approx((0.1, 0.0), abs=0.03)
    assert found.information[0, 0] < 0.02 * found.information[1, 1]


def test_the_two_sides_of_a_thin_wall_are_not_confused() -> None:
    thin = ((1.0, -5.0, 1.1, 5.0), (-3.0, 2.0, 5.0, 2.1), (-3.0, -2.1, 5.0, -2.0))
    walls = CorrelationGrid([key_scan_at(thin, Pose2D(0.0, 0.0, 0.0), 7).outline])
    true = np.array((2.1, 0.0, math.pi))
    found = walls.refine(
        true, key_scan_at(thin, Pose2D(*true), 8).outline, uncertainty=PoseUncertainty(0.05, 0.05)
    )
    # The point is on another face of the wall, so that the observed face 0.1 m away must not attract it.
    assert found.pose[0] == pytest.approx(2.1, abs=0.02)
