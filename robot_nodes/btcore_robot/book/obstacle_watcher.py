"""Watching the obstacle detector: where it says that the obstacle is, while the robot moves."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from btcore_robot.book.force_watcher import scene_arrow
from btcore_robot.book.trail import ODOM, Trail
from btcore_robot.perception.obstacle_detector import OBSTACLE_FRAME
from btcore_robot.process.messages import Arrow, Arrows
from btcore_robot.process.process import Process, ProcessContext
from btcore_robot.robot import Twist2D
from btcore_robot.transforms import TransformError
from btcore_scene import MovingScene, StaticScene

_KEY_VEL = "/key_vel"
OBSTACLES = (205, 50, 40)
WAY = (46, 130, 80)


class ObstacleWatcher(Process):
    """Drives on at *v* (m/s) and *w* (rad/s), and notes where the obstacle is in ``odom``."""

    def __init__(self, context: ProcessContext, v: float = 0.0, w: float = 0.0) -> None:
        super().__init__("obstacle_watcher", context)
        self.twist = Twist2D(v, w)
        self.places: list[tuple[float, float]] = []
        self.arrows: tuple[Arrow, ...] = ()
        self._keys = self.create_publisher(_KEY_VEL, Twist2D)
        self._trail = Trail(context)
        self.create_subscription("obstacle_marker", Arrows, self.heard)
        self.create_timer(0.1, self.look)

    def heard(self, message: Arrows) -> None:
        """Keep the arrow."""
        self.arrows = message.arrows

    def look(self) -> None:
        """Drive, and note."""
        if self.twist.v or self.twist.w:
            self._keys.publish(self.twist)
        try:
            x, y, _ = self.context.transforms.lookup(ODOM, OBSTACLE_FRAME).position
        except TransformError:
            return
        self.places.append((x, y))

    def figures(self) -> Mapping[str, object]:
        """Where the obstacle is at last in ``odom`` (m), and how far apart its places were."""
        if not self.places:
            return {"obstacle": None}
        places = np.array(self.places)
        spread = float(np.hypot(*np.ptp(places, axis=0)))
        x, y = self.places[-1]
        return {"obstacle": {"x": round(x, 3), "y": round(y, 3)}, "spread_m": round(spread, 3)}

    def picture(self) -> NDArray[np.uint8]:
        """From above: the way, what the laser saw, and every place at which the obstacle was said to be."""
        drawn = self._trail.picture({"": WAY}, "the obstacle's places in odom, ten a second", self.places)
        drawn.points(self.places, OBSTACLES, 4.0)
        drawn.legend({"detected_obstacle": OBSTACLES, "the robot's way": WAY})
        return drawn.image

    def scene_moving(self) -> MovingScene:
        """Return the arrow to the obstacle."""
        return MovingScene(arrows=[scene_arrow(arrow, OBSTACLE_FRAME) for arrow in self.arrows])

    def scene_static(self) -> StaticScene:
        """Return an empty scene: everything moves."""
        return StaticScene()
