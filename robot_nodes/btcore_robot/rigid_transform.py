"""Rigid transforms from one frame to another, with ROS's names and conventions.

A transform named `a2b` is the pose of frame b in frame a, and transforms points of b to a; therefore
`a2c = a2b * b2c`. Its numbers are plain floats: for a single transform numpy is several times slower.
"""

import math

import numpy as np
from numpy.typing import NDArray

from btcore_robot.robot import Pose2D
from btcore_scene import Quaternion, Vector
from btcore_scene.rotations import product, rotated, yaw_of

_LINEAR_COSINE = 0.9995  # above it the divisor of slerp is close to 0, and linear interpolation is as good


class Transform:
    """The pose of a frame in another frame: *position* (m) and a unit *quaternion* (x, y, z, w)."""

    __slots__ = ("position", "quaternion")

    def __init__(
        self, position: Vector = (0.0, 0.0, 0.0), quaternion: Quaternion = (0.0, 0.0, 0.0, 1.0)
    ) -> None:
        self.position = position
        self.quaternion = quaternion

    @classmethod
    def from_pose(cls, pose: Pose2D) -> "Transform":
        """Return the transform of a frame at *pose* in the x-y plane of its parent frame."""
        half = pose.yaw / 2.0
        return cls((pose.x, pose.y, 0.0), (0.0, 0.0, math.sin(half), math.cos(half)))

    @property
    def yaw(self) -> float:
        """The heading (rad, in [-π, π]): the rotation about z in roll, pitch and yaw."""
        return yaw_of(self.quaternion)

    def to_pose(self) -> Pose2D:
        """Return the position and heading on the floor, without height, roll and pitch."""
        return Pose2D(self.position[0], self.position[1], self.yaw)

    def __mul__(self, other: "Transform") -> "Transform":
        """Return `a2c` for `a2b * b2c`."""
        rx, ry, rz = rotated(self.quaternion, other.position)
        px, py, pz = self.position
        return Transform((px + rx, py + ry, pz + rz), product(self.quaternion, other.quaternion))

    def compose(self, other: "Transform") -> "Transform":
        """Return `a2c` for `a2b.compose(b2c)`, the same as `a2b * b2c`."""
        return self * other

    def inverse(self) -> "Transform":
        """Return `b2a` for `a2b`."""
        x, y, z, w = self.quaternion
        inverse = (-x, -y, -z, w)
        rx, ry, rz = rotated(inverse, self.position)
        return Transform((-rx, -ry, -rz), inverse)

    @property
    def rotation(self) -> NDArray[np.float64]:
        """The rotation matrix, shape `(3, 3)`."""
        x, y, z, w = self.quaternion
        return np.array(
            (
                (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
                (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
                (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
            )
        )

    def apply(self, points: NDArray[np.floating]) -> NDArray[np.float64]:
        """Return *points* (m) of the child's frame in the parent's frame; both of shape `(…, 3)`.

        Points of shape `(…, 2)` lie in the plane z = 0; the result then consists of x and y.
        """
        columns = points.shape[-1]
        moved: NDArray[np.float64] = points @ self.rotation[:columns, :columns].T
        moved += self.position[:columns]
        return moved

    def interpolate(self, other: "Transform", fraction: float) -> "Transform":
        """Return the transform at *fraction* (0 … 1) between this transform and *other*.

        The position is on a straight line, the rotation on the shorter arc.
        """
        ax, ay, az, aw = self.quaternion
        bx, by, bz, bw = other.quaternion
        cosine = ax * bx + ay * by + az * bz + aw * bw
        if cosine < 0.0:
            bx, by, bz, bw, cosine = -bx, -by, -bz, -bw, -cosine
        if cosine > _LINEAR_COSINE:
            first, second = 1.0 - fraction, fraction
        else:
            angle = math.acos(cosine)
            sine = math.sin(angle)
            first, second = math.sin((1.0 - fraction) * angle) / sine, math.sin(fraction * angle) / sine
        x, y, z, w = (
            first * ax + second * bx,
            first * ay + second * by,
            first * az + second * bz,
            first * aw + second * bw,
        )
        length = math.sqrt(x * x + y * y + z * z + w * w)
        px, py, pz = self.position
        qx, qy, qz = other.position
        return Transform(
            (px + fraction * (qx - px), py + fraction * (qy - py), pz + fraction * (qz - pz)),
            (x / length, y / length, z / length, w / length),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Transform):
            return NotImplemented
        return self.position == other.position and self.quaternion == other.quaternion

    def __hash__(self) -> int:
        return hash((self.position, self.quaternion))

    def __repr__(self) -> str:
        return f"Transform({self.position}, {self.quaternion})"


def from_rpy(rpy: Vector) -> Quaternion:
    """Return the quaternion (x, y, z, w) of a URDF's roll, pitch, yaw (rad; fixed axes x, then y, then z)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle / 2), math.cos(angle / 2)) for angle in rpy)
    return (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def wrap_angle(angle: float) -> float:
    """Return *angle* (rad) in (-π, π]."""
    wrapped = math.remainder(angle, math.tau)
    return wrapped if wrapped > -math.pi else math.pi


def wrap_angles(angles: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return *angles* (rad) in [-π, π)."""
    wrapped: NDArray[np.float64] = (angles + math.pi) % math.tau - math.pi
    return wrapped
