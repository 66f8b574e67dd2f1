"""What is kept of a scan that a map is made of."""

import math
from dataclasses import dataclass

import numpy as np

from robot_nodes.navigation.mapping.placing import Floats, placed, row
from robot_nodes.navigation.scan_filter import smoothed
from robot_nodes.rigid_transform import Transform
from robot_nodes.robot import LaserScan, Pose2D

REACH = 10.0
"""How far (m) a scan is believed. At that distance the rays of Tiago's laser are a cell apart."""
SPACING = 0.06
"""The least distance (m) between points that are matched, so that what is near doesn't outvote the rest."""
_ASIDE = 3  # points on either side that a wall's direction is taken from
_TOGETHER = 0.5  # m; what is further apart is not one wall


@dataclass(frozen=True, slots=True)
class KeyScan:
    """One scan in the frame ``base_footprint``.

    *odometry* is where the robot took itself to be by its wheels; *ends* are the ends of all rays that hit
    something, *rim* the corners of the floor that the scan shows to be free, both ``(k, 2)`` (m). *points* are
    the ends that are matched, with the *normals* of the walls there, ``(m, 2)``; a normal is (0, 0) where that
    isn't known. *travelled* is the way (m) driven so far.
    """

    odometry: Pose2D
    ends: Floats
    rim: Floats
    points: Floats
    normals: Floats
    travelled: float
    stamp: int


def key_scan(
    scan: LaserScan, laser: Transform, odometry: Pose2D, travelled: float, *, margin: float = 0.05
) -> KeyScan:
    """What is kept of *scan*, taken with the laser at *laser* in the robot's frame.

    The noise is taken out first. The floor is free up to *margin* (m) before what was hit; a ray without an
    echo frees it as far as the laser is believed, one that is too near says nothing.
    """
    clean = smoothed(scan)
    ranges = clean.ranges.astype(np.float64)
    eye = row(laser.to_pose())
    angles = clean.angles()
    rays = np.stack((np.cos(angles), np.sin(angles)), axis=1)
    hit = (ranges >= clean.range_min) & (ranges < REACH)
    free = np.where(hit, np.maximum(ranges - margin, 0.0), np.where(ranges >= REACH, REACH, 0.0))
    ends = rays[hit] * ranges[hit, None]
    points, normals = _thinned(ends)
    return KeyScan(
        odometry,
        placed(ends, eye),
        np.vstack((eye[None, :2], placed(rays * free[:, None], eye))),
        placed(points, eye),
        placed(normals, np.array((0.0, 0.0, eye[2]))),
        travelled,
        scan.stamp,
    )


def _thinned(ends: Floats) -> tuple[Floats, Floats]:
    """Some of *ends*, which follow one another along walls, and the normals there."""
    if len(ends) < 2 * _ASIDE + 1:
        return ends, np.zeros_like(ends)
    padded = np.pad(ends, ((_ASIDE, _ASIDE), (0, 0)), mode="edge")
    along = padded[2 * _ASIDE :] - padded[: -2 * _ASIDE]
    length = np.hypot(along[:, 0], along[:, 1])
    sure = (length > 1e-6) & (length < _TOGETHER)
    unit = np.where(sure[:, None], along / np.maximum(length, 1e-6)[:, None], 0.0)
    normals = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
    steps = np.hypot(*np.diff(ends, axis=0, prepend=ends[:1]).T)
    walked = np.floor(np.cumsum(np.minimum(steps, SPACING)) / SPACING)
    chosen = np.flatnonzero(np.diff(walked, prepend=-1.0) > 0)
    return ends[chosen], normals[chosen]


def far_apart(one: Pose2D, other: Pose2D, way: float, turn: float) -> bool:
    """Whether two poses differ by at least *way* (m) or *turn* (rad)."""
    turned = abs(math.remainder(other.yaw - one.yaw, math.tau))
    return math.hypot(other.x - one.x, other.y - one.y) >= way or turned >= turn
