"""Sonars: the distance of the nearest object in a cone, sampled with rays of the physics engine."""

import math
from collections.abc import Sequence

from btcore_robot.rigid_transform import from_rpy
from btcore_robot.robot import SonarReading
from btcore_sim.physics_body import Pose3D
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.robot_description import SonarMount
from btcore_sim.world import OBJECTS

_AROUND = 6  # number of rays on each ring of the cone
_RINGS = (0.5, 1.0)  # angles of the rings, as fractions of half the cone's angle


class Sonars:
    """All sonars of a robot.

    As in REP 117, a range of +inf means no echo, and -inf means an echo below the minimum range.
    """

    def __init__(self, client: int, mounts: Sequence[SonarMount]) -> None:
        self._client = client
        self._mounts = mounts
        self._rays = [_cone(mount) for mount in mounts]

    def read(self, places: Sequence[Pose3D], stamp: int) -> tuple[SonarReading, ...]:
        """Return a reading of every sonar.

        Args:
            places: The pose of each sonar's link in the world frame.
            stamp: The time of the readings (ns).
        """
        starts: list[Sequence[float]] = []
        ends: list[Sequence[float]] = []
        for mount, rays, (place, turned) in zip(self._mounts, self._rays, places, strict=True):
            facing = from_rpy((0.0, 0.0, mount.yaw))
            at, facing = pybullet.multiplyTransforms(place, turned, mount.position, facing)
            for ray in rays:
                starts.append(at)
                ends.append(pybullet.multiplyTransforms(at, facing, ray, (0.0, 0.0, 0.0, 1.0))[0])
        # The mask leaves out the robot itself, and the floor, which reflects the sound away from the sonar.
        hits = pybullet.rayTestBatch(starts, ends, collisionFilterMask=OBJECTS, physicsClientId=self._client)
        readings: list[SonarReading] = []
        begin = 0
        for mount, rays in zip(self._mounts, self._rays, strict=True):
            part = min(hit[2] if hit[0] >= 0 else math.inf for hit in hits[begin : begin + len(rays)])
            begin += len(rays)
            distance = part * mount.range_max
            if distance < mount.range_min:
                distance = -math.inf
            readings.append(
                SonarReading(distance, stamp, mount.fov, mount.range_min, mount.range_max, mount.frame)
            )
        return tuple(readings)


def _cone(mount: SonarMount) -> list[tuple[float, float, float]]:
    """Return the ends (m) of the rays of a sonar that faces x: its axis, and rings around the axis."""
    ends = [(mount.range_max, 0.0, 0.0)]
    for ring in _RINGS:
        off = ring * mount.fov / 2
        for k in range(_AROUND):
            around = 2 * math.pi * k / _AROUND
            wide = mount.range_max * math.sin(off)
            ends.append((mount.range_max * math.cos(off), wide * math.cos(around), wide * math.sin(around)))
    return ends
