"""Obstacle avoidance by a virtual force field (VFF).

The algorithm is from chapter 5.1 of the book *A Concise Introduction to Robot Programming with ROS2*.
A vector attracts the robot forward, near obstacles repel it, and the sum determines the velocity. All
numbers, including angles, are `numpy.float32`: in the book's test with an obstacle straight ahead, the sign
of the remaining lateral force depends on single precision.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.components.messages import BLUE, GREEN, RED, Arrow, Arrows, Colour
from btcore_robot.robot import BASE_FRAME, LaserScan, Twist2D
from btcore_robot.time_limits import MAX_BOOK_SCAN_AGE_S, is_stale

__all__ = [
    "Avoidance",
    "AvoidanceFromAll",
    "Forces",
    "Vector",
    "force_arrows",
    "forces_from_all",
    "forces_from_nearest",
    "velocity",
]

Vector = NDArray[np.float32]
"""A vector in the plane, float32 of shape `(2,)`."""


PERIOD_S = 0.05
"""The period (s) of the control cycle: 20 Hz."""
OBSTACLE_DISTANCE = np.float32(1.0)
"""The distance (m) below which an obstacle repels the robot."""
SPEED_MAX = 0.3
"""The maximum speed (m/s)."""
TURN_MAX = 0.5
"""The maximum angular speed (rad/s)."""


@dataclass(frozen=True, slots=True)
class Forces:
    """The three force vectors, float32 of shape `(2,)`: x forward, y left.

    Attributes:
        attractive: The attraction of the goal, straight ahead.
        repulsive: The repulsion of the obstacles.
        result: The sum of both.
    """

    attractive: Vector
    repulsive: Vector
    result: Vector


def forces_from_nearest(scan: LaserScan) -> Forces:
    """Return the forces if only the nearest reading repels the robot.

    Of several nearest readings the first is used. NaN is ignored.
    """
    ranges, angles = _readings(scan)
    index = int(np.argmin(ranges))
    return _sum(_push(ranges[index : index + 1], angles[index : index + 1]))


def forces_from_all(scan: LaserScan) -> Forces:
    """Return the forces if all near readings repel the robot: an exercise of the book.

    The repulsion is the sum over eight sectors of the mean repulsion of the near readings in each sector.
    A wall therefore does not repel more strongly because many rays hit it, and an obstacle on the opposite
    side still has an effect.
    """
    ranges, angles = _readings(scan)
    sectors = np.floor(angles / np.float32(np.pi / 4)).astype(np.int64)
    push = np.zeros(2, dtype=np.float32)
    for sector in np.unique(sectors[ranges < OBSTACLE_DISTANCE]):
        chosen = (sectors == sector) & (ranges < OBSTACLE_DISTANCE)
        push += _push(ranges[chosen], angles[chosen]) / np.float32(np.count_nonzero(chosen))
    return _sum(push)


def velocity(result: Vector) -> Twist2D:
    """Return the velocity for the vector *result*.

    The speed is the length of the vector, at most `SPEED_MAX`. The angular speed is its angle, at most
    `TURN_MAX` in each direction.
    """
    v = np.hypot(result[0], result[1])
    w = np.arctan2(result[1], result[0])
    return Twist2D(min(max(float(v), 0.0), SPEED_MAX), min(max(float(w), -TURN_MAX), TURN_MAX))


def _readings(scan: LaserScan) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    ranges = np.where(np.isnan(scan.ranges), np.float32(np.inf), scan.ranges)
    # -inf means nearer than the laser's minimum range, that is, distance 0.
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


class Avoidance(Component):
    """Drives by the force field, 20 times a second, while the newest scan is younger than 1 s.

    The component subscribes to `input_scan` and publishes on `output_vel`. Without a recent scan it
    publishes nothing, and the base stops because it receives no new commands. On `vff_debug` it publishes
    the forces as arrows if there is a subscriber: blue is the attraction, red the repulsion, green the sum.
    """

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("avoidance_vff", context, options)
        self.velocities = self.create_publisher("output_vel", Twist2D)
        self.arrows = self.create_publisher("vff_debug", Arrows)
        self.create_subscription("input_scan", LaserScan, self.on_scan)
        self.create_timer(PERIOD_S, self.control_cycle)
        self.scan: LaserScan | None = None
        self.forces: Forces | None = None
        """The forces of the last velocity command; None after a cycle without a recent scan."""

    def on_scan(self, scan: LaserScan) -> None:
        """Store the newest scan."""
        self.scan = scan

    def field(self, scan: LaserScan) -> Forces:
        """Return the forces if only the nearest reading of *scan* repels the robot."""
        return forces_from_nearest(scan)

    def velocity(self, result: Vector) -> Twist2D:
        """Return the velocity for the vector *result*."""
        return velocity(result)

    def control_cycle(self) -> None:
        """Publish the velocity and the arrows."""
        scan = self.scan
        if scan is None or not len(scan.ranges) or is_stale(scan, self.now(), MAX_BOOK_SCAN_AGE_S):
            self.forces = None
            return
        self.forces = self.field(scan)
        self.velocities.publish(self.velocity(self.forces.result))
        if self.arrows.has_subscribers:
            self.arrows.publish(force_arrows(self.forces, self.now()))


class AvoidanceFromAll(Avoidance):
    """Drives like `Avoidance`, but all near readings repel the robot, not only the nearest.

    The forward speed is at most the forward component of the sum. In the book the speed is the length of the
    sum even if the sum points backwards, so that `Avoidance` drives into a wall that it approaches head-on.
    """

    def field(self, scan: LaserScan) -> Forces:
        """Return the forces if all near readings of *scan* repel the robot."""
        return forces_from_all(scan)

    def velocity(self, result: Vector) -> Twist2D:
        """Return the velocity for the vector *result*; its forward component limits the speed."""
        twist = velocity(result)
        return Twist2D(min(max(float(result[0]), 0.0), twist.v), twist.w)


def force_arrows(field: Forces, stamp: int) -> Arrows:
    """Return the forces as arrows in `base_footprint`, with the colours and numbers of the book.

    Args:
        field: The forces to draw. An arrow is as long (m) as its force.
        stamp: The time (ns) to which the arrows belong.

    Returns:
        The attractive force (number 2, blue), the repulsive force (0, red) and their sum (1, green).
    """

    def arrow(number: int, vector: Vector, colour: Colour) -> Arrow:
        end = (float(vector[0]), float(vector[1]), 0.0)
        return Arrow(number, BASE_FRAME, stamp, (0.0, 0.0, 0.0), end, colour, 0.05, 0.1)

    return Arrows(
        (arrow(2, field.attractive, BLUE), arrow(0, field.repulsive, RED), arrow(1, field.result, GREEN))
    )
