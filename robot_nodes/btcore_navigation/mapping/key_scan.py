"""Key scans: the selected scans from which a map is made."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from btcore_navigation.clearance import smooth_scan
from btcore_navigation.mapping.correlative_matcher import Outline
from btcore_navigation.mapping.pose_arrays import (
    Floats,
    compose,
    pose_to_row,
    relative_pose,
    transform_points,
)
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import LaserScan, Pose2D

MAX_RANGE = 10.0
"""The maximum range (m) that is used: at this distance the rays of Tiago's laser are one cell apart."""
SPACING = 0.06
"""The minimum distance (m) between matched points, so that near walls do not outweigh the others."""
_NEIGHBOURS = 3  # number of points on each side that determine the direction of a wall
_MARGIN = 0.05  # m: the last part of a ray before an obstacle, which does not count as free floor
_MAX_SPAN = 4 * _NEIGHBOURS * SPACING  # m; points farther apart are not on the same wall


@dataclass(frozen=True, slots=True)
class KeyScan:
    """A scan in the frame of the robot's base.

    *odometry* is the pose of the base by odometry. *ends* are the end points (m) of all rays that hit
    something, *free_outline* is the polygon (m) of the floor that the scan shows to be free, both of shape
    `(k, 2)`. *outline* contains the points to match. *travelled* is the distance (m) driven so far, *stamp*
    the time (ns).
    """

    odometry: Pose2D
    ends: Floats
    free_outline: Floats
    outline: Outline
    travelled: float
    stamp: int


@dataclass(frozen=True, slots=True)
class LocalisedScan:
    """A *scan*, the pose of the *laser* in the base's frame, and the base's pose by *odometry*."""

    scan: LaserScan
    laser: Transform
    odometry: Pose2D


def key_scan(scans: Sequence[LocalisedScan], travelled: float) -> KeyScan:
    """Return a key scan from the last of *scans*; the scans just before it reduce the noise.

    The outline to match contains the points of all scans. The end points and the free floor are those of the
    last scan. A ray without an echo shows free floor up to `MAX_RANGE`; a ray that is too short shows
    nothing.

    Args:
        scans: At least one scan, oldest first.
        travelled: The distance (m) driven so far.
    """
    last = scans[-1]
    outlines = []
    for localised in scans:
        clean = smooth_scan(localised.scan)
        ranges = clean.ranges.astype(np.float64)
        angles = clean.angles()
        rays = np.stack((np.cos(angles), np.sin(angles)), axis=1)
        hit = (ranges >= clean.range_min) & (ranges < MAX_RANGE)
        ends, laser_pose = rays[hit] * ranges[hit, None], pose_to_row(localised.laser.to_pose())
        base_pose = relative_pose(pose_to_row(last.odometry), pose_to_row(localised.odometry))
        outlines.append(_outline(ends).at(compose(base_pose, laser_pose)))
    # The free part of each ray: up to the obstacle, up to the maximum range, or none if the echo is too near.
    free = np.where(hit, np.maximum(ranges - _MARGIN, 0.0), np.where(ranges >= MAX_RANGE, MAX_RANGE, 0.0))
    return KeyScan(
        # `ends`, `rays` and `ranges` are now those of the last scan, whose pose is the origin.
        last.odometry,
        transform_points(ends, laser_pose),
        np.vstack((laser_pose[None, :2], transform_points(rays * free[:, None], laser_pose))),
        Outline(
            np.concatenate([outline.points for outline in outlines]),
            np.concatenate([outline.normals for outline in outlines]),
            1.0 / len(outlines),
        ),
        travelled,
        last.scan.stamp,
    )


def _outline(ends: Floats) -> Outline:
    """Return evenly spaced points of *ends* and the walls' normals there; the laser is at (0, 0)."""
    steps = np.hypot(*np.diff(ends, axis=0, prepend=ends[:1]).T)
    # At most one point per `SPACING` of length along a wall; a gap counts as one spacing.
    walked = np.floor(np.cumsum(np.minimum(steps, SPACING)) / SPACING)
    points = ends[np.flatnonzero(np.diff(walked, prepend=-1.0) > 0)]
    if len(points) < 2 * _NEIGHBOURS + 1:
        return Outline(points, np.zeros_like(points))
    padded = np.pad(points, ((_NEIGHBOURS, _NEIGHBOURS), (0, 0)), mode="edge")
    along = padded[2 * _NEIGHBOURS :] - padded[: -2 * _NEIGHBOURS]
    length = np.hypot(along[:, 0], along[:, 1])
    known = (length > SPACING) & (length < _MAX_SPAN)
    unit = np.where(known, 1.0 / np.maximum(length, SPACING), 0.0)[:, None] * along
    normals = np.stack((-unit[:, 1], unit[:, 0]), axis=1)
    # Normals point towards the laser, which is at (0, 0).
    away = (normals * points).sum(axis=1) > 0.0
    normals[away] *= -1.0
    return Outline(points, normals)


def are_far_apart(first: Pose2D, second: Pose2D, distance: float, turn: float) -> bool:
    """Return whether two poses differ by at least a distance or an angle.

    Args:
        second: The other pose, in the same frame.
        distance: The minimum distance (m) between the positions.
        turn: The minimum angle (rad) between the headings.
    """
    turned = abs(wrap_angle(second.yaw - first.yaw))
    return math.hypot(second.x - first.x, second.y - first.y) >= distance or turned >= turn
