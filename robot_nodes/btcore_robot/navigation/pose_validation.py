"""Whether a pose can still be believed: what a scan shows against it, and what merely stands in the way."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.distance_field import SignedDistanceField
from btcore_robot.navigation.ray_casting import Agreement, RayCaster
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import LaserScan, Pose2D

RECENT = 3
"""Over how many scans the fit is averaged."""
FITS = 0.8
"""While this share of the beams ends on what is mapped, nothing speaks against the pose.

True poses have 0.75 to 1 without people about; a robot put somewhere else has 0.5 at the very most.
"""
THROUGH = 0.12
"""More beams than this share through mapped walls are a contradiction; at a true pose there are 0 to 0.07."""
MET = 0.2
"""When a smaller share of beams than this ends on what is mapped, next to nothing speaks for the pose."""
IN_A_ROW = 2
"""So many scans in a row have to contradict the pose."""
JUMPED = 0.5
"""When a larger share of beams than this changes at once, the robot was put elsewhere. A person who appears
from nowhere right before the laser changes a quarter."""
JUMPED_BOTH_WAYS, EACH_WAY = 0.35, 0.1
"""So many are enough when some of them, the second share at least, get longer and as many get shorter."""

_BEAMS = 60
_CHANGED = 0.4  # m; what noise (σ 0.06 m) and a step of 0.03 m don't do
_NEIGHBOURS = np.arange(-3, 4)  # a beam beside an edge may fall on its other side
_PAUSE = 500_000_000  # ns; after a longer one a scan isn't compared with the one before


def changed(before: LaserScan, after: LaserScan, turn: float) -> tuple[float, float]:
    """The shares (0 … 1) of beams that see farther than before, and less far, after a *turn* (rad)."""
    chosen = np.arange(0, len(after.ranges), max(1, len(after.ranges) // _BEAMS))
    earlier = np.rint(chosen + turn / after.angle_increment).astype(np.intp)[:, None] + _NEIGHBOURS
    known = (earlier[:, 0] >= 0) & (earlier[:, -1] < len(before.ranges))
    if not known.any():
        return 0.0, 0.0
    then = np.clip(before.ranges[earlier[known]], 0.0, after.range_max)
    now = np.clip(after.ranges[chosen[known]], 0.0, after.range_max)
    return (
        float(np.mean(now > then.max(axis=1) + _CHANGED)),
        float(np.mean(now < then.min(axis=1) - _CHANGED)),
    )


class PoseValidator:
    """Holds every scan against the pose that is believed in.

    Somebody in the way makes beams shorter than the map says, and none longer; the rest still fits. So a pose
    is in doubt when beams go through walls, when next to nothing fits, or when all that is seen changes from
    one scan to the next.
    """

    def __init__(self, faces: SignedDistanceField, visibility: RayCaster) -> None:
        self._faces = faces
        self._visibility = visibility
        self._before: tuple[LaserScan, float] | None = None
        self.forget()

    def forget(self) -> None:
        """Begin anew, with a pose that is believed."""
        self._fits: deque[float] = deque(maxlen=RECENT)
        self._contradictions = 0
        self.jumped = False
        """Whether what is seen changed at once."""

    @property
    def contradicted(self) -> bool:
        """Whether the last scans show what can't be seen from the pose, whoever stands in the way."""
        return self._contradictions >= IN_A_ROW

    @property
    def fit(self) -> float:
        """The share (0 … 1) of beams that end on what is mapped, over the last scans."""
        return sum(self._fits) / len(self._fits) if self._fits else 1.0

    def is_pose_doubtful(
        self,
        scan: LaserScan,
        points: NDArray[np.float64],
        eye: tuple[float, float],
        odometry: Pose2D,
        believed: Pose2D,
    ) -> bool:
        """Whether *scan* puts the pose *believed* in doubt.

        Its beams end at *points* of the robot's frame (m; ``(k, 2)``), *eye* is the laser; *odometry* is the
        pose in odom at the scan's stamp.
        """
        before, self._before = self._before, (scan, odometry.yaw)
        if before is not None and scan.stamp - before[0].stamp <= _PAUSE:
            turn = wrap_angle(odometry.yaw - before[1])
            farther, nearer = changed(before[0], scan, turn)
            both_ways = min(farther, nearer) > EACH_WAY
            if farther + nearer > (JUMPED_BOTH_WAYS if both_ways else JUMPED):
                self.jumped = True
        self._fits.append(self._faces.fit(believed, points))
        if self.fit >= FITS:
            self._contradictions = 0
            return False
        if contradicted(self._visibility.agreement([believed], eye, points)[0]):
            self._contradictions += 1
        else:
            self._contradictions = 0
        return self.jumped or self.contradicted


def contradicted(view: Agreement) -> bool:
    """Whether what a scan shows can't come from people and things in the way."""
    return view.through > THROUGH or view.met < MET
