"""Poses in the plane as rows of numbers: x, y (m) and yaw (rad), shape `(…, 3)`."""

import math

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import wrap_angle, wrap_angles
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]


def pose_to_row(pose: Pose2D) -> Floats:
    """Return *pose* as an array of x, y (m) and yaw (rad), shape `(3,)`."""
    return np.array((pose.x, pose.y, pose.yaw))


def row_to_pose(row: Floats) -> Pose2D:
    """Return an array of x, y (m) and yaw (rad) as a pose, with the yaw in (-π, π]."""
    return Pose2D(float(row[0]), float(row[1]), wrap_angle(float(row[2])))


def compose(start: Floats, step: Floats) -> Floats:
    """Return the pose that is at *step* relative to the pose *start*.

    The result is in the frame in which *start* is given, like the product of transforms `a2b * b2c`.

    Args:
        start: The first poses: x, y (m) and yaw (rad), shape `(…, 3)`.
        step: The second poses, relative to *start*. The shapes are broadcast against each other.
    """
    cos, sin = np.cos(start[..., 2]), np.sin(start[..., 2])
    return np.stack(
        (
            start[..., 0] + cos * step[..., 0] - sin * step[..., 1],
            start[..., 1] + sin * step[..., 0] + cos * step[..., 1],
            wrap_angles(start[..., 2] + step[..., 2]),
        ),
        axis=-1,
    )


def relative_pose(start: Floats, end: Floats) -> Floats:
    """Return *end* relative to *start*: the step for which `compose(start, step)` is *end*.

    Args:
        start: The first poses: x, y (m) and yaw (rad), shape `(…, 3)`.
        end: The second poses, in the same frame as *start*. The shapes are broadcast against each other.
    """
    cos, sin = np.cos(start[..., 2]), np.sin(start[..., 2])
    x, y = end[..., 0] - start[..., 0], end[..., 1] - start[..., 1]
    return np.stack((cos * x + sin * y, cos * y - sin * x, wrap_angles(end[..., 2] - start[..., 2])), axis=-1)


def transform_points(points: Floats, at: Floats) -> Floats:
    """Return points, given relative to a pose, in the frame in which the pose is given.

    Args:
        points: The points (m) relative to the pose, shape `(k, 2)`.
        at: The pose: x, y (m) and yaw (rad), shape `(3,)`.

    Returns:
        The points (m), shape `(k, 2)`.
    """
    cos, sin = math.cos(at[2]), math.sin(at[2])
    moved: Floats = points @ np.array(((cos, sin), (-sin, cos)))
    moved += at[:2]
    return moved
