"""A planar laser: exact distances by geometry, plus noise, with the special values of REP 117.

REP 117: -inf is a return nearer than the minimum range, +inf is no return.

Upright objects are intersected analytically with numpy, many times faster than the physics engine's rays
(which need 13 to 18 ms for 666 rays and 250 boxes). The engine's rays are used only for objects that have
been tipped over.
"""

import math
from collections.abc import Mapping

import numpy as np

from btcore_robot.rigid_transform import wrap_angles
from btcore_robot.robot import LaserInfo, LaserScan
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.ray_casting import Floats, RayCaster
from btcore_sim.scene import SceneObject

_UPRIGHT = 0.9999  # cosine of the greatest tilt (0.8°) at which an object is treated as upright


class MovableObstacles:
    """Intersections of rays with movable objects at their present poses.

    *things* maps the engine's body numbers to the objects.
    """

    def __init__(self, client: int, things: Mapping[int, SceneObject]) -> None:
        self._client = client
        self._things = things

    def shorten(self, x: float, y: float, z: float, angles: Floats, distances: Floats) -> None:
        """Shorten rays that hit a movable object.

        Args:
            x: The rays' origin in the world frame (m).
            y: As *x*.
            z: As *x*; the rays are horizontal.
            angles: The rays' directions in the world frame (rad), ascending, shape ``(rays,)``.
            distances: The rays' lengths (m), shape ``(rays,)``; changed in place.
        """
        placed = []
        for body, thing in self._things.items():
            (bx, by, bz), turned = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._client)
            # The z component of the body's z axis: the cosine of its tilt.
            if 1.0 - 2.0 * (turned[0] ** 2 + turned[1] ** 2) > _UPRIGHT:
                yaw = 2.0 * math.atan2(turned[2], turned[3])
                placed.append((thing, bx, by, bz - thing.size[2] / 2, yaw))
            else:
                self._by_rays(body, x, y, z, angles, distances)
        if placed:
            np.minimum(distances, RayCaster.placed(placed).distances(x, y, z, angles), out=distances)

    def _by_rays(self, body: int, x: float, y: float, z: float, angles: Floats, distances: Floats) -> None:
        low, high = pybullet.getAABB(body, physicsClientId=self._client)
        if not low[2] <= z <= high[2]:
            return
        middle_x, middle_y = (low[0] + high[0]) / 2 - x, (low[1] + high[1]) / 2 - y
        distance = math.hypot(middle_x, middle_y)
        reach = math.hypot(high[0] - low[0], high[1] - low[1]) / 2
        # Only rays within the angle under which the circle around the bounding box is visible can hit.
        if distance > reach:
            off = wrap_angles(angles - math.atan2(middle_y, middle_x))
            rays = np.flatnonzero(np.abs(off) <= math.asin(reach / distance))
        else:
            rays = np.arange(len(angles))
        if not len(rays):
            return
        length = distance + reach
        ends = np.full((len(rays), 3), z)
        ends[:, 0] = x + length * np.cos(angles[rays])
        ends[:, 1] = y + length * np.sin(angles[rays])
        starts = np.tile((x, y, z), (len(rays), 1))
        hits = pybullet.rayTestBatch(starts.tolist(), ends.tolist(), physicsClientId=self._client)
        for ray, hit in zip(rays, hits, strict=True):
            if hit[0] == body:
                distances[ray] = min(distances[ray], hit[2] * length)  # hit[2] is a fraction of the ray


class Laser:
    """A robot's laser: its geometry, and noise from its own random generator."""

    def __init__(
        self,
        facts: LaserInfo,
        still: RayCaster,
        random: np.random.Generator,
        moved: MovableObstacles | None = None,
    ) -> None:
        self.facts = facts
        self._still = still
        self._random = random
        self._moved = moved
        self._angles: Floats = facts.angle_min + facts.angle_increment * np.arange(
            facts.rays, dtype=np.float64
        )

    def sweep(self, x: float, y: float, z: float, yaw: float, stamp: int) -> LaserScan:
        """Return a scan with normally distributed noise.

        Args:
            x: The laser's position in the world frame (m).
            y: As *x*.
            z: As *x*.
            yaw: The laser's heading (rad).
            stamp: The time of the scan (ns).
        """
        ranges = self.distances(x, y, z, yaw)
        # Noise is drawn for every ray, hit or not, so that an additional hit does not change all later scans.
        ranges += self._random.normal(0.0, self.facts.sigma, len(ranges))
        ranges[ranges < self.facts.range_min] = -np.inf
        ranges[ranges > self.facts.range_max] = np.inf
        return LaserScan(
            ranges=ranges.astype(np.float32),
            stamp=stamp,
            angle_min=self.facts.angle_min,
            angle_increment=self.facts.angle_increment,
            range_min=self.facts.range_min,
            range_max=self.facts.range_max,
            frame=self.facts.frame,
        )

    def distances(self, x: float, y: float, z: float, yaw: float) -> Floats:
        """Return the true distance along each ray.

        Args:
            x: The laser's position in the world frame (m).
            y: As *x*.
            z: As *x*.
            yaw: The laser's heading (rad).

        Returns:
            The distances (m), shape ``(rays,)``; inf where a ray hits nothing.
        """
        angles = self._angles + yaw
        distances = self._still.distances(x, y, z, angles)
        if self._moved is not None:
            self._moved.shorten(x, y, z, angles, distances)
        return distances
