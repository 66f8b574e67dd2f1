"""The exercises of the book's chapter 4: what a transform tree tells about motion and about an obstacle."""

import math

from btcore_robot.perception.obstacle_detector import BASE, OBSTACLE, ODOM, PERIOD
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.transforms import Transform, TransformError

SECOND = 1.0
FRAMES = (ODOM, BASE, "head_2_link")
"""The frames in which the obstacle is told."""


class Displacement(Process):
    """Says each second how far the robot has moved since the last time, by its odometry."""

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("displacement", context, options)
        self.before: Transform | None = None
        self.timer(SECOND, self.look)

    def look(self) -> None:
        """Compare where it is with where it was."""
        try:
            now = self.context.transforms.lookup(ODOM, BASE)
        except TransformError as fault:
            self.warn(str(fault))
            return
        if self.before is not None:
            moved = self.before.inverse() * now
            x, y, _ = moved.position
            self.info(f"moved {math.hypot(x, y):.3f} m (x {x:.3f}, y {y:.3f}), turned {moved.yaw:.3f} rad")
        self.before = now


class ObstacleInFrames(Process):
    """Says twice a second where the obstacle is in ``odom``, ``base_footprint`` and ``head_2_link``."""

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("obstacle_in_frames", context, options)
        self.timer(PERIOD, self.look)

    def look(self) -> None:
        """Say where it is, in each frame that knows it."""
        for frame in FRAMES:
            try:
                x, y, z = self.context.transforms.lookup(frame, OBSTACLE).position
            except TransformError as fault:
                self.warn(f"Obstacle transform not found: {fault}")
            else:
                self.info(f"Obstacle in {frame}: ({x:.3f} m, {y:.3f} m, {z:.3f} m)")
