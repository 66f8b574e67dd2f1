"""An obstacle as a frame of the transform tree (the book's chapter 4)."""

import math

from btcore_robot.process.messages import RED, Arrow, Arrows, Colour
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import LaserScan, TransformStamped
from btcore_robot.transforms import Transform, TransformError

OBSTACLE = "detected_obstacle"
BASE = "base_footprint"
ODOM = "odom"

PERIOD = 0.5
"""How often (s) the monitor looks: 2 Hz."""
LIFETIME = 1.0
"""How long (s) an arrow is shown."""
NEAR, FAR = 0.5, 3.0
"""At which distance (m) an arrow coloured by distance is all red, and from which on all green."""


class ObstacleDetector(Process):
    """Tells of what the middle ray hits as a frame below the laser's, for ever.

    The frame stays where the laser was told of it: in front of the robot, wherever that drives to. This is
    the flaw that `ObstacleDetectorImproved` mends.
    """

    name_of_its_own = "obstacle_detector"

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__(self.name_of_its_own, context, options)
        self.subscribe("input_scan", LaserScan, self.scanned)

    def scanned(self, scan: LaserScan) -> None:
        """Look along the middle ray."""
        distance = float(scan.ranges[len(scan.ranges) // 2])
        if math.isfinite(distance):
            self.detected(scan, Transform((distance, 0.0, 0.0)))

    def detected(self, scan: LaserScan, laser2object: Transform) -> None:
        """Something is at *laser2object*."""
        self.context.transforms.set_static(_frame(scan.frame, laser2object, scan.stamp))


class ObstacleDetectorImproved(ObstacleDetector):
    """Tells of what the middle ray hits as a frame below ``odom``: it stays there when the robot goes."""

    name_of_its_own = "obstacle_detector_improved"

    def detected(self, scan: LaserScan, laser2object: Transform) -> None:
        """Something is at *laser2object*, seen from where the laser was at that moment."""
        transforms = self.context.transforms
        try:
            odom2laser = transforms.lookup(ODOM, scan.frame, scan.stamp)
        except TransformError as fault:
            self.warn(f"Obstacle transform not found: {fault}")
            return
        transforms.set(_frame(ODOM, odom2laser * laser2object, scan.stamp))


class ObstacleMonitor(Process):
    """Says twice a second where the obstacle is, and points at it with an arrow on ``obstacle_marker``."""

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("obstacle_monitor", context, options)
        self.by_distance = self.parameters.declare("colour_by_distance", False)
        self.markers = self.publisher("obstacle_marker", Arrows)
        self.timer(PERIOD, self.look)
        self.place: tuple[float, float, float] | None = None
        """Where the obstacle was last, in ``base_footprint`` (m)."""

    def look(self) -> None:
        """Say where it is."""
        try:
            found = self.context.transforms.lookup(BASE, OBSTACLE)
        except TransformError as fault:
            self.warn(f"Obstacle transform not found: {fault}")
            return
        x, y, z = self.place = found.position
        angle = math.atan2(y, x)
        self.info(f"Obstacle detected at ({x:.3f} m, {y:.3f} m, {z:.3f} m) = {angle:.3f} rad")
        colour = colour_of(math.hypot(x, y)) if self.by_distance else RED
        arrow = Arrow(1, BASE, self.now(), (0.0, 0.0, 0.0), (x, y, z), colour, 0.02, 0.1, LIFETIME)
        self.markers.publish(Arrows((arrow,)))


def colour_of(distance: float) -> Colour:
    """Green for a *distance* of 3 m or more, red for 0.5 m or less, and between them a mixture."""
    share = min(max((distance - NEAR) / (FAR - NEAR), 0.0), 1.0)
    return 1.0 - share, share, 0.0, 1.0


def _frame(parent: str, place: Transform, stamp: int) -> TransformStamped:
    return TransformStamped(OBSTACLE, parent, place.position, place.quaternion, stamp)
