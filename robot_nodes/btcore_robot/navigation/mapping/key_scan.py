"""What is kept of a scan that a map is made of."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from btcore_robot.navigation.mapping.correlative_matcher import Outline
from btcore_robot.navigation.mapping.pose_arrays import (
    Floats,
    compose,
    pose_to_row,
    relative_pose,
    transform_points,
)
from btcore_robot.navigation.scan_filter import smooth_scan
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import LaserScan, Pose2D

REACH = 10.0
"""How far (m) a scan is believed. At that distance the rays of Tiago's laser are a cell apart."""
SPACING = 0.06
"""The least distance (m) between points that are matched, so that what is near doesn't outvote the rest."""
_ASIDE = 3  # points on either side that a wall's direction is taken from
_TOGETHER = 4 * _ASIDE * SPACING  # m; what is further apart is not one wall


@dataclass(frozen=True, slots=True)
class KeyScan:
    """One scan in the frame ``base_footprint``.

    *odometry* is where the robot took itself to be by its wheels; *ends* are the ends of all rays that hit
    something, *rim* the corners of the floor that the scan shows to be free, both ``(k, 2)`` (m). *outline*
    is what is matched. *travelled* is the way (m) driven so far.
    """

    odometry: Pose2D
    ends: Floats
    rim: Floats
    outline: Outline
    travelled: float
    stamp: int


@dataclass(frozen=True, slots=True)
class Sweep:
    """A *scan*, where the *laser* was in the robot's frame, and where the robot was by its *odometry*."""

    scan: LaserScan
    laser: Transform
    odometry: Pose2D


def key_scan(sweeps: Sequence[Sweep], travelled: float, *, margin: float = 0.05) -> KeyScan:
    """What is kept of *sweeps*, of which the last is the key scan; those just before it take out noise.

    What is matched is of all, what is drawn of the last. The floor is free up to *margin* (m) before what was
    hit; a ray without an echo frees it as far as the laser is believed, one that is too near says nothing.
    """
    last = sweeps[-1]
    outlines = []
    for sweep in sweeps:
        clean = smooth_scan(sweep.scan)
        ranges = clean.ranges.astype(np.float64)
        angles = clean.angles()
        rays = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        hit = (ranges >= clean.range_min) & (ranges < REACH)
        ends, eye = rays[hit] * ranges[hit, None], pose_to_row(sweep.laser.to_pose())
        apart = relative_pose(pose_to_row(last.odometry), pose_to_row(sweep.odometry))
        outlines.append(_outline(ends).at(compose(apart, eye)))
    free = np.where(hit, np.maximum(ranges - margin, 0.0), np.where(ranges >= REACH, REACH, 0.0))
    return KeyScan(
        last.odometry,
        transform_points(ends, eye),
        np.vstack((eye[None, :2], transform_points(rays * free[:, None], eye))),
        Outline(
            np.concatenate([one.points for one in outlines]),
            np.concatenate([one.normals for one in outlines]),
            1.0 / len(outlines),
        ),
        travelled,
        last.scan.stamp,
    )


def _outline(ends: Floats) -> Outline:
    """Some of *ends*, which follow one another along walls seen from (0, 0), and the normals there."""
    steps = np.hypot(*np.diff(ends, axis=0, prepend=ends[:1]).T)
    walked = np.floor(np.cumsum(np.minimum(steps, SPACING)) / SPACING)
    points = ends[np.flatnonzero(np.diff(walked, prepend=-1.0) > 0)]
    if len(points) < 2 * _ASIDE + 1:
        return Outline(points, np.zeros_like(points))
    padded = np.pad(points, ((_ASIDE, _ASIDE), (0, 0)), mode="edge")
    along = padded[2 * _ASIDE :] - padded[: -2 * _ASIDE]
    length = np.hypot(along[:, 0], along[:, 1])
    sure = (length > SPACING) & (length < _TOGETHER)
    unit = np.where(sure, 1.0 / np.maximum(length, SPACING), 0.0)[:, None] * along
    normals = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
    away = (normals * points).sum(axis=1) > 0.0
    normals[away] *= -1.0
    return Outline(points, normals)


def far_apart(one: Pose2D, other: Pose2D, way: float, turn: float) -> bool:
    """Whether two poses differ by at least *way* (m) or *turn* (rad)."""
    turned = abs(wrap_angle(other.yaw - one.yaw))
    return math.hypot(other.x - one.x, other.y - one.y) >= way or turned >= turn
