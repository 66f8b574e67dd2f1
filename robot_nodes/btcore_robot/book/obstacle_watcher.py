"""Reports of the obstacle detector: the obstacle's positions while the robot moves."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from btcore_robot.book.force_watcher import scene_arrow
from btcore_robot.book.trail import Trail
from btcore_robot.components.component import Component, ComponentContext
from btcore_robot.components.messages import Arrow, Arrows
from btcore_robot.perception.obstacle_detector import OBSTACLE_FRAME
from btcore_robot.robot import ODOM_FRAME, Twist2D
from btcore_robot.transforms import TransformError
from btcore_scene import MovingScene, SceneSource

_KEY_VEL = "/key_vel"
OBSTACLES = (205, 50, 40)
TRAIL = (46, 130, 80)


class ObstacleWatcher(Component, SceneSource):
    """A component that drives at *v* (m/s) and *w* (rad/s), and records where the obstacle is in `odom`."""

    def __init__(self, context: ComponentContext, v: float, w: float) -> None:
        super().__init__("obstacle_watcher", context)
        self.twist = Twist2D(v, w)
        self.positions: list[tuple[float, float]] = []
        self.arrows: tuple[Arrow, ...] = ()
        self._keys = self.create_publisher(_KEY_VEL, Twist2D)
        self._trail = Trail(context)
        self.create_subscription("obstacle_marker", Arrows, self.on_arrows)
        self.create_timer(0.1, self.drive_and_record)

    def on_arrows(self, message: Arrows) -> None:
        """Store the arrow to the obstacle."""
        self.arrows = message.arrows

    def drive_and_record(self) -> None:
        """Send the velocity and record the obstacle's position."""
        if self.twist.v or self.twist.w:
            self._keys.publish(self.twist)
        try:
            x, y, _ = self.context.transforms.lookup(ODOM_FRAME, OBSTACLE_FRAME).position
        except TransformError:
            return
        self.positions.append((x, y))

    def results(self) -> Mapping[str, object]:
        """Return the last position (m) of the obstacle in `odom`, and the spread (m) of all positions.

        The spread is the diagonal of the smallest rectangle, along the axes, that contains all positions.
        """
        if not self.positions:
            return {"obstacle": None}
        positions = np.array(self.positions)
        spread = float(np.hypot(*np.ptp(positions, axis=0)))
        x, y = self.positions[-1]
        return {"obstacle": {"x": round(x, 3), "y": round(y, 3)}, "spread_m": round(spread, 3)}

    def draw(self) -> NDArray[np.uint8]:
        """Return a top view (RGB) of the robot's trail, the laser points and the obstacle's positions."""
        view = self._trail.draw({"": TRAIL}, "the obstacle's places in odom, ten a second", self.positions)
        view.points(self.positions, OBSTACLES, 4.0)
        view.legend({"detected_obstacle": OBSTACLES, "the robot's way": TRAIL})
        return view.image

    def moving_scene(self) -> MovingScene:
        """Return the arrow to the obstacle."""
        return MovingScene(arrows=[scene_arrow(arrow, OBSTACLE_FRAME) for arrow in self.arrows])
