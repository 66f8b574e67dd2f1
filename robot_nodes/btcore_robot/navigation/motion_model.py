"""The motion model: samples of the motion of a differential base, given the odometry."""

import math

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import wrap_angle, wrap_angles
from btcore_robot.robot import Pose2D

_STANDS = 0.01
"""A move shorter than this (m) has no direction: it is a turn on the spot (nav2_amcl)."""


def decompose_motion(before: Pose2D, after: Pose2D) -> tuple[float, float, float]:
    """Return the motion between two poses as a turn (rad), a straight line (m) and another turn (rad)."""
    dx, dy = after.x - before.x, after.y - before.y
    straight = math.hypot(dx, dy)
    first = 0.0 if straight < _STANDS else wrap_angle(math.atan2(dy, dx) - before.yaw)
    return first, straight, wrap_angle(after.yaw - before.yaw - first)


def sample_motion_model(
    particles: NDArray[np.float64],
    before: Pose2D,
    after: Pose2D,
    alphas: tuple[float, float, float, float],
    random: np.random.Generator,
) -> NDArray[np.float64]:
    """Move each particle by the odometry with its own noise.

    Source: Thrun, Burgard, Fox: Probabilistic Robotics, table 5.6, in nav2_amcl's form: a turn counts as its
    distance from 0 or π, whichever is nearer, so that driving backward is as certain as driving forward.

    Args:
        particles: the poses (x, y, yaw), shape ``(n, 3)``.
        before: the odometry's pose at the last update.
        after: the odometry's pose now.
        alphas: α1 (noise of turns by turns), α2 (of turns by distance), α3 (of distance by distance) and α4
            (of distance by turns).
        random: the source of the noise.

    Returns:
        The moved particles, shape ``(n, 3)``.

    """
    turn, way, turn_after = decompose_motion(before, after)
    a1, a2, a3, a4 = alphas
    folded = min(abs(turn), abs(wrap_angle(turn - math.pi)))
    folded_after = min(abs(turn_after), abs(wrap_angle(turn_after - math.pi)))
    noise = random.standard_normal((3, len(particles)))
    first = turn - noise[0] * math.sqrt(a1 * folded**2 + a2 * way**2)
    straight = way - noise[1] * math.sqrt(a3 * way**2 + a4 * (folded**2 + folded_after**2))
    second = turn_after - noise[2] * math.sqrt(a1 * folded_after**2 + a2 * way**2)
    heading = particles[:, 2] + first
    result = np.empty_like(particles)
    result[:, 0] = particles[:, 0] + straight * np.cos(heading)
    result[:, 1] = particles[:, 1] + straight * np.sin(heading)
    result[:, 2] = wrap_angles(heading + second)
    return result
