"""The exercises of the book's chapter 4: motion and obstacles as reported by the transform tree."""

import math

from btcore_robot.perception.obstacle_detector import BASE_FRAME, OBSTACLE_FRAME, ODOM_FRAME, PERIOD
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.transforms import Transform, TransformError

REPORT_PERIOD = 1.0  # s
FRAMES = (ODOM_FRAME, BASE_FRAME, "head_2_link")
"""The frames in which the obstacle's position is reported."""


class Displacement(Process):
    """Report each second how far the robot has moved since the last report, by odometry."""

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("displacement", context, options)
        self.previous: Transform | None = None
        self.create_timer(REPORT_PERIOD, self.report)

    def report(self) -> None:
        """Compare the current pose with the pose at the last report."""
        try:
            now = self.context.transforms.lookup(ODOM_FRAME, BASE_FRAME)
        except TransformError as error:
            self.warn(str(error))
            return
        if self.previous is not None:
            moved = self.previous.inverse() * now
            x, y, _ = moved.position
            self.info(f"moved {math.hypot(x, y):.3f} m (x {x:.3f}, y {y:.3f}), turned {moved.yaw:.3f} rad")
        self.previous = now


class ObstacleInFrames(Process):
    """Report the obstacle's position twice a second in ``odom``, ``base_footprint`` and ``head_2_link``."""

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("obstacle_in_frames", context, options)
        self.create_timer(PERIOD, self.report)

    def report(self) -> None:
        """Log the position in each frame that is connected to the obstacle's frame."""
        for frame in FRAMES:
            try:
                x, y, z = self.context.transforms.lookup(frame, OBSTACLE_FRAME).position
            except TransformError as error:
                self.warn(f"Obstacle transform not found: {error}")
            else:
                self.info(f"Obstacle in {frame}: ({x:.3f} m, {y:.3f} m, {z:.3f} m)")
