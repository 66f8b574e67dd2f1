"""Avoiding obstacles by a virtual force field (the book's chapter 5.1).

A vector pulls the robot forward, what is near pushes it away, and the sum says where to go. The numbers are
``numpy.float32``, angles included, as in the book's test of an obstacle right ahead: what is left over there
has the sign that single precision gives it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.process.messages import BLUE, GREEN, RED, Arrow, Arrows, Colour
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import NS_PER_S, LaserScan, Twist2D

Vector = NDArray[np.float32]


PERIOD = 0.05
"""How often (s) it decides: 20 Hz."""
OBSTACLE_DISTANCE = np.float32(1.0)
"""How near (m) something has to be to push."""
SPEED_MAX = 0.3
"""m/s."""
TURN_MAX = 0.5
"""rad/s."""
SCAN_TIMEOUT = NS_PER_S


@dataclass(frozen=True, slots=True)
class Forces:
    """The three vectors, float32 of shape ``(2,)``: x forward, y left."""

    attractive: Vector
    repulsive: Vector
    result: Vector


def forces(scan: LaserScan) -> Forces:
    """The forces by the nearest reading alone, the first one of equals; those that are NaN don't count."""
    ranges, angles = _readings(scan)
    index = int(np.argmin(ranges))
    return _sum(_push(ranges[index : index + 1], angles[index : index + 1]))


def forces_of_all(scan: LaserScan) -> Forces:
    """The forces when everything near pushes: the exercise.

    The push is the mean of the readings' pushes in each of eight sectors, all summed: so a wall pushes no
    more for being seen by many rays, and something opposite does push back.
    """
    ranges, angles = _readings(scan)
    sectors = np.floor(angles / np.float32(np.pi / 4)).astype(np.int64)
    push = np.zeros(2, dtype=np.float32)
    for sector in np.unique(sectors[ranges < OBSTACLE_DISTANCE]):
        chosen = (sectors == sector) & (ranges < OBSTACLE_DISTANCE)
        push += _push(ranges[chosen], angles[chosen]) / np.float32(np.count_nonzero(chosen))
    return _sum(push)


def velocity(result: Vector) -> Twist2D:
    """The velocity that the vector *result* asks for: its length forward, its direction as the turn."""
    v = np.hypot(result[0], result[1])
    w = np.arctan2(result[1], result[0])
    return Twist2D(min(max(float(v), 0.0), SPEED_MAX), min(max(float(w), -TURN_MAX), TURN_MAX))


def _readings(scan: LaserScan) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    ranges = np.where(np.isnan(scan.ranges), np.float32(np.inf), scan.ranges)
    # Nearer than can be measured (-inf) is as near as can be.
    ranges = np.maximum(ranges, np.float32(0.0))
    steps = np.arange(len(ranges), dtype=np.float32)
    return ranges, np.float32(scan.angle_min) + np.float32(scan.angle_increment) * steps


def _push(ranges: NDArray[np.float32], angles: NDArray[np.float32]) -> Vector:
    near = ranges < OBSTACLE_DISTANCE
    away = angles[near] + np.float32(np.pi)
    sizes = OBSTACLE_DISTANCE - ranges[near]
    return np.array([np.sum(sizes * np.cos(away)), np.sum(sizes * np.sin(away))], dtype=np.float32)


def _sum(repulsive: Vector) -> Forces:
    attractive = np.array([1.0, 0.0], dtype=np.float32)
    return Forces(attractive, repulsive, attractive + repulsive)


class Avoidance(Process):
    """Drives by the forces, 20 times a second, while there is a scan younger than 1 s.

    It hears ``input_scan`` and publishes on ``output_vel``. Without a scan it says nothing: a base stops by
    itself. On ``vff_debug`` it shows the forces as arrows, if somebody listens: blue pulls, red pushes,
    green is the sum.
    """

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("avoidance_vff", context, options)
        self.velocities = self.publisher("output_vel", Twist2D)
        self.arrows = self.publisher("vff_debug", Arrows)
        self.subscribe("input_scan", LaserScan, self.scanned)
        self.timer(PERIOD, self.cycle)
        self.scan: LaserScan | None = None
        self.forces: Forces | None = None
        """What moved it last."""

    def scanned(self, scan: LaserScan) -> None:
        """Keep the newest scan."""
        self.scan = scan

    def field(self, scan: LaserScan) -> Forces:
        """The forces that *scan* gives."""
        return forces(scan)

    def velocity(self, result: Vector) -> Twist2D:
        """The velocity that *result* asks for."""
        return velocity(result)

    def cycle(self) -> None:
        """Publish the velocity, and the arrows."""
        scan = self.scan
        if scan is None or not len(scan.ranges) or self.now() - scan.stamp > SCAN_TIMEOUT:
            self.forces = None
            return
        self.forces = self.field(scan)
        self.velocities.publish(self.velocity(self.forces.result))
        if self.arrows.has_subscribers:
            self.arrows.publish(arrows(self.forces, self.now()))


class AvoidanceOfAll(Avoidance):
    """As Avoidance, but all that is near pushes, not only the nearest.

    It goes forward only as far as the sum points forward. The book's speed is the sum's length, also when it
    points back, which is what drives Avoidance into a wall that it meets head-on.
    """

    def field(self, scan: LaserScan) -> Forces:
        """The forces that *scan* gives."""
        return forces_of_all(scan)

    def velocity(self, result: Vector) -> Twist2D:
        """The velocity that *result* asks for: x forward, its direction as the turn."""
        asked = velocity(result)
        return Twist2D(min(max(float(result[0]), 0.0), asked.v), asked.w)


def arrows(field: Forces, stamp: int) -> Arrows:
    """The forces as arrows in ``base_footprint``, in the book's colours and numbers."""

    def arrow(number: int, vector: Vector, colour: Colour) -> Arrow:
        end = (float(vector[0]), float(vector[1]), 0.0)
        return Arrow(number, "base_footprint", stamp, (0.0, 0.0, 0.0), end, colour, 0.05, 0.1)

    return Arrows(
        (arrow(2, field.attractive, BLUE), arrow(0, field.repulsive, RED), arrow(1, field.result, GREEN))
    )
