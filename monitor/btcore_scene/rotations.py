"""Rotations as unit quaternions (x, y, z, w) of plain floats, because numpy is slower for a single one."""

import math

from btcore_scene import Quaternion, Vector


def rotated(quaternion: Quaternion, vector: Vector) -> Vector:
    """Return *vector* rotated by *quaternion*: v + 2w(q×v) + 2q×(q×v)."""
    x, y, z, w = quaternion
    vx, vy, vz = vector
    tx, ty, tz = 2.0 * (y * vz - z * vy), 2.0 * (z * vx - x * vz), 2.0 * (x * vy - y * vx)
    return (
        vx + w * tx + y * tz - z * ty,
        vy + w * ty + z * tx - x * tz,
        vz + w * tz + x * ty - y * tx,
    )


def product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return the rotation *second* followed by *first*."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def yaw_of(quaternion: Quaternion) -> float:
    """Return the heading (rad, in [-π, π]): the rotation about z in roll, pitch and yaw."""
    x, y, z, w = quaternion
    return math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
