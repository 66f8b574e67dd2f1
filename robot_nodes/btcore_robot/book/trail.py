"""A record of a robot's poses and laser points, ten times a second, for a picture from above."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from btcore_robot.book.top_view import Colour, TopView
from btcore_robot.components.component import ComponentContext
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import ODOM_FRAME, LaserScan, Phase, Pose2D
from btcore_robot.transform_filter import TransformFilter
from btcore_robot.transforms import TransformError

RATE = 10.0
"""The rate (Hz) of the record."""
_CELL = 0.08  # m: the side of a square in which only the first laser point is kept


class Trail:
    """Records the odometry poses and the laser points of a robot, both in the frame `odom`.

    *state* returns the text that is stored with each pose, for example the state of a controller.
    """

    def __init__(self, context: ComponentContext, state: Callable[[], str] = lambda: "") -> None:
        assert context.robot is not None
        self._context = context
        self._robot = context.robot
        self._state = state
        self.poses: list[Pose2D] = []
        self.states: list[str] = []
        self._laser_points: dict[tuple[int, int], tuple[float, float]] = {}
        self._scans = TransformFilter[LaserScan](context.transforms, ODOM_FRAME)
        context.schedule.add_task(RATE, Phase.EVALUATION, self._record)

    def draw(
        self, colours: dict[str, Colour], title: str, extra: Sequence[tuple[float, float]] = ()
    ) -> TopView:
        """Return a top view of the trail, coloured by state, with the laser points and the robot's last pose.

        Args:
            colours: The colour of each state.
            title: The title of the picture.
            extra: Further positions (m) that the picture must cover.
        """
        laser_points = self.laser_points()
        positions = np.array([(pose.x, pose.y) for pose in self.poses] or [(0.0, 0.0)])
        covered = np.concatenate((positions, laser_points, np.array(extra).reshape(-1, 2)))
        corner, opposite = covered.min(axis=0), covered.max(axis=0)
        view = TopView(tuple(corner), tuple(np.maximum(opposite, corner + 1.0)))
        view.points(laser_points)
        for index in range(1, len(positions)):
            colour = colours.get(self.states[index], (120, 120, 120))
            view.line(positions[index - 1 : index + 1], colour, 3)
        if self.poses:
            view.robot(self.poses[-1], self._robot.base_info.radius)
        view.legend(colours, title)
        return view

    def laser_points(self) -> NDArray[np.float64]:
        """Return the laser points, one per square of 8 cm: x, y (m) in `odom`, shape `(n, 2)`."""
        return np.array(list(self._laser_points.values()), dtype=np.float64).reshape(-1, 2)

    def _record(self, now: int) -> None:
        self.poses.append(self._robot.odometry().pose)
        self.states.append(self._state())
        scan = self._scans.newest(self._robot.scan())
        if scan is None:
            return
        for x, y in scan_points_in(self._context, ODOM_FRAME, scan):
            self._laser_points.setdefault((round(x / _CELL), round(y / _CELL)), (x, y))


def scan_points_in(context: ComponentContext, frame: str, scan: LaserScan) -> NDArray[np.float64]:
    """Return the points of *scan* in *frame*, shape `(n, 2)` (m); empty if the frame is not available.

    Args:
        context: The context with the transform tree.
        frame: The frame of the points.
        scan: The scan to convert.
    """
    try:
        laser_pose: Transform = context.transforms.lookup(frame, scan.frame, scan.stamp)
    except TransformError:
        return np.zeros((0, 2))
    return laser_pose.apply(scan.points())
