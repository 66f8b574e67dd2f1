"""What a robot went through, noted ten times a second, to be drawn from above afterwards."""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from btcore_robot.book.top_view import Colour, TopView
from btcore_robot.process.process import ProcessContext
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import LaserScan, Phase, Pose2D
from btcore_robot.transforms import TransformError

RATE = 10.0
"""Notes a second."""
ODOM = "odom"
_CELL = 0.08  # m; of the laser's points in one such square one is kept


class Trail:
    """Where the robot was by its odometry, in which *state*, and what its laser saw, all in ``odom``."""

    def __init__(self, context: ProcessContext, state: Callable[[], str] = lambda: "") -> None:
        assert context.robot is not None
        self._context = context
        self._robot = context.robot
        self._state = state
        self.poses: list[Pose2D] = []
        self.states: list[str] = []
        self._seen: dict[tuple[int, int], tuple[float, float]] = {}
        self._stamp = -1
        context.schedule.every(RATE, Phase.JUDGE, self._note)

    def picture(
        self, colours: dict[str, Colour], title: str, also: Sequence[tuple[float, float]] = ()
    ) -> TopView:
        """The way in the colour of each state, over all that the laser saw, and the robot at its end.

        The picture has room for the places in *also* (m).
        """
        seen = self.seen()
        places = np.array([(pose.x, pose.y) for pose in self.poses] or [(0.0, 0.0)])
        every = np.concatenate((places, seen, np.array(also).reshape(-1, 2)))
        corner, opposite = every.min(axis=0), every.max(axis=0)
        drawn = TopView(tuple(corner), tuple(np.maximum(opposite, corner + 1.0)))
        drawn.points(seen)
        for index in range(1, len(places)):
            colour = colours.get(self.states[index], (120, 120, 120))
            drawn.line(places[index - 1 : index + 1], colour, 3)
        if self.poses:
            drawn.robot(self.poses[-1], self._robot.base.radius)
        drawn.legend(colours, title)
        return drawn

    def seen(self) -> NDArray[np.float64]:
        """What the laser saw, thinned out: x, y (m) in ``odom``, shape ``(n, 2)``."""
        return np.array(list(self._seen.values()), dtype=np.float64).reshape(-1, 2)

    def _note(self, now: int) -> None:
        self.poses.append(self._robot.odometry().pose)
        self.states.append(self._state())
        scan = self._robot.scan()
        if scan is None or scan.stamp == self._stamp:
            return
        self._stamp = scan.stamp
        for x, y in points_in(self._context, ODOM, scan):
            self._seen.setdefault((round(x / _CELL), round(y / _CELL)), (x, y))


def points_in(context: ProcessContext, frame: str, scan: LaserScan) -> NDArray[np.float64]:
    """What *scan* hit, in *frame*: shape ``(n, 2)`` (m); nothing where the frame isn't known."""
    try:
        place: Transform = context.transforms.lookup(frame, scan.frame, scan.stamp)
    except TransformError:
        return np.zeros((0, 2))
    return place.apply(scan.points())
