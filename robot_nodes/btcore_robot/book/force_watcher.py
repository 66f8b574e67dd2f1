"""Reports of the virtual force field (VFF): smallest range, and a picture of the strongest repulsion."""

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

import btcore_scene
from btcore_robot.book.top_view import TopView
from btcore_robot.book.trail import scan_points_in
from btcore_robot.components.component import Component, ComponentContext
from btcore_robot.components.messages import Arrow, Arrows
from btcore_robot.robot import BASE_FRAME, Phase, Pose2D
from btcore_scene import MovingScene, SceneSource

REACH = 2.0
"""The distance (m) from the robot that the picture covers on each side."""
_NAMES = {0: "repulsive", 1: "result", 2: "attractive"}


class ForceWatcher(Component, SceneSource):
    """A component that stores the forces, published as arrows on `vff_debug`, at the strongest repulsion."""

    def __init__(self, context: ComponentContext) -> None:
        super().__init__("vff_watcher", context)
        self.arrows: tuple[Arrow, ...] = ()
        self.strongest: tuple[Arrow, ...] = ()
        self.nearest = math.inf
        self._points: NDArray[np.float64] = np.zeros((0, 2))
        self.create_subscription("vff_debug", Arrows, self.on_arrows)
        context.schedule.add_task(10.0, Phase.EVALUATION, self._record_nearest)

    def on_arrows(self, message: Arrows) -> None:
        """Store the arrows and, if the repulsion is the strongest so far, the laser's points."""
        self.arrows = message.arrows
        assert self.context.robot is not None
        scan = self.context.robot.scan()
        if scan is not None and (
            not self.strongest or _repulsion(message.arrows) > _repulsion(self.strongest)
        ):
            self.strongest = message.arrows
            self._points = scan_points_in(self.context, BASE_FRAME, scan)

    def results(self) -> Mapping[str, object]:
        """Return the smallest range (m) that the laser measured."""
        return {"nearest_m": round(self.nearest, 3)}

    def draw(self) -> NDArray[np.uint8]:
        """Return a picture (RGB) of the strongest repulsion: laser points, robot and forces; ahead is up."""
        view = TopView((-REACH, -REACH), (REACH, REACH), (480, 480))
        view.points(_ahead_up(self._points))
        assert self.context.robot is not None
        view.robot(Pose2D(0.0, 0.0, math.pi / 2), self.context.robot.base_info.radius)
        colours = {}
        for arrow in self.strongest:
            colour = tuple(round(230 * part) for part in arrow.colour[:3])
            rgb = colours[_NAMES[arrow.number]] = (colour[0], colour[1], colour[2])
            end = _ahead_up(np.array([arrow.end[:2]]))[0]
            view.arrow((0.0, 0.0), (float(end[0]), float(end[1])), rgb)
        view.legend(colours, "VFF: forces at the nearest moment; a square is 1 m")
        return view.image

    def moving_scene(self) -> MovingScene:
        """Return the forces as arrows."""
        return MovingScene(arrows=[scene_arrow(arrow, _NAMES[arrow.number]) for arrow in self.arrows])

    def _record_nearest(self, now: int) -> None:
        assert self.context.robot is not None
        scan = self.context.robot.scan()
        if scan is not None:
            finite = scan.ranges[np.isfinite(scan.ranges)]
            self.nearest = min(self.nearest, float(finite.min())) if len(finite) else self.nearest


def scene_arrow(arrow: Arrow, name: str) -> btcore_scene.Arrow:
    """Convert *arrow* to an arrow named *name* for the viewers."""
    red, green, blue, opacity = (round(255 * part) for part in arrow.colour)
    color = (red, green, blue, opacity)
    return btcore_scene.Arrow(name=name, frame=arrow.frame, start=arrow.start, end=arrow.end, color=color)


def _repulsion(arrows: tuple[Arrow, ...]) -> float:
    return max(math.hypot(arrow.end[0], arrow.end[1]) for arrow in arrows if arrow.number == 0)


def _ahead_up(points: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.stack((-points[:, 1], points[:, 0]), axis=1)
