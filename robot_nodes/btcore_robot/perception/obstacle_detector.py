"""Components that publish an obstacle as a frame of the transform tree, and log its position.

They are from chapter 4 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

import math

from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.components.messages import RED, Arrow, Arrows, Colour
from btcore_robot.robot import BASE_FRAME, ODOM_FRAME, LaserScan, TransformStamped
from btcore_robot.transforms import Transform, TransformError

__all__ = [
    "Displacement",
    "ObstacleDetector",
    "ObstacleDetectorImproved",
    "ObstacleInFrames",
    "ObstacleMonitor",
]

OBSTACLE_FRAME = "detected_obstacle"

PERIOD_S = 0.5
"""The period (s) of the reports of the obstacle's position."""
LIFETIME = 1.0
"""The time (s) for which an arrow is shown."""
NEAR, FAR = 0.5, 3.0
"""The distances (m) at which an arrow coloured by distance is entirely red and entirely green."""

REPORT_PERIOD_S = 1.0  # s
FRAMES = (ODOM_FRAME, BASE_FRAME, "head_2_link")
"""The frames in which the obstacle's position is reported."""


class ObstacleDetector(Component):
    """Publish the obstacle at the middle ray as a static frame below the laser's frame.

    A static frame stays at the same place relative to the laser, so the obstacle seems to move with the
    robot. `ObstacleDetectorImproved` corrects this.
    """

    default_name = "obstacle_detector"

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__(self.default_name, context, options)
        self.create_subscription("input_scan", LaserScan, self.on_scan)

    def on_scan(self, scan: LaserScan) -> None:
        """Publish the obstacle that the middle ray hits, if any."""
        distance = float(scan.ranges[len(scan.ranges) // 2])
        if math.isfinite(distance):
            self.on_detection(scan, Transform((distance, 0.0, 0.0)))

    def on_detection(self, scan: LaserScan, laser2object: Transform) -> None:
        """Publish the obstacle's frame as a static frame below the laser's frame.

        Args:
            scan: The scan with the obstacle.
            laser2object: The obstacle's pose in the laser's frame.
        """
        self.context.transforms.set_static(_frame(scan.frame, laser2object, scan.stamp))


class ObstacleDetectorImproved(ObstacleDetector):
    """Publish the obstacle at the middle ray as a frame below `odom`.

    The frame stays at the obstacle when the robot moves.
    """

    default_name = "obstacle_detector_improved"

    def on_detection(self, scan: LaserScan, laser2object: Transform) -> None:
        """Publish the obstacle's frame below `odom`, with the laser's pose at the stamp of *scan*."""
        transforms = self.context.transforms
        try:
            odom2laser = transforms.lookup(ODOM_FRAME, scan.frame, scan.stamp)
        except TransformError as error:
            self.warn(f"Obstacle transform not found: {error}")
            return
        transforms.set(_frame(ODOM_FRAME, odom2laser * laser2object, scan.stamp))


class ObstacleMonitor(Component):
    """Report the obstacle's position twice a second, and publish an arrow to it on `obstacle_marker`."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("obstacle_monitor", context, options)
        self.by_distance = self.parameters.declare("colour_by_distance", False)
        self.markers = self.create_publisher("obstacle_marker", Arrows)
        self.create_timer(PERIOD_S, self.report)
        self.position: tuple[float, float, float] | None = None
        """The last position (m) of the obstacle in `base_footprint`."""

    def report(self) -> None:
        """Log the obstacle's position and publish the arrow."""
        try:
            obstacle = self.context.transforms.lookup(BASE_FRAME, OBSTACLE_FRAME)
        except TransformError as error:
            self.warn(f"Obstacle transform not found: {error}")
            return
        x, y, z = self.position = obstacle.position
        angle = math.atan2(y, x)
        self.info(f"Obstacle detected at ({x:.3f} m, {y:.3f} m, {z:.3f} m) = {angle:.3f} rad")
        colour = distance_colour(math.hypot(x, y)) if self.by_distance else RED
        arrow = Arrow(1, BASE_FRAME, self.now(), (0.0, 0.0, 0.0), (x, y, z), colour, 0.02, 0.1, LIFETIME)
        self.markers.publish(Arrows((arrow,)))


def distance_colour(distance: float) -> Colour:
    """Return green for a *distance* of 3 m or more, red for 0.5 m or less, and a mixture in between."""
    share = min(max((distance - NEAR) / (FAR - NEAR), 0.0), 1.0)
    return 1.0 - share, share, 0.0, 1.0


def _frame(parent: str, pose: Transform, stamp: int) -> TransformStamped:
    return TransformStamped(OBSTACLE_FRAME, parent, pose.position, pose.quaternion, stamp)


class Displacement(Component):
    """Report each second how far the robot has moved since the last report, by odometry."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("displacement", context, options)
        self.previous: Transform | None = None
        self.create_timer(REPORT_PERIOD_S, self.report)

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


class ObstacleInFrames(Component):
    """Report the obstacle's position twice a second in `odom`, `base_footprint` and `head_2_link`."""

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("obstacle_in_frames", context, options)
        self.create_timer(PERIOD_S, self.report)

    def report(self) -> None:
        """Log the position in each frame that is connected to the obstacle's frame."""
        for frame in FRAMES:
            try:
                x, y, z = self.context.transforms.lookup(frame, OBSTACLE_FRAME).position
            except TransformError as error:
                self.warn(f"Obstacle transform not found: {error}")
            else:
                self.info(f"Obstacle in {frame}: ({x:.3f} m, {y:.3f} m, {z:.3f} m)")
