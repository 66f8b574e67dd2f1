"""Validation of the estimated pose: whether a scan contradicts it, despite people and objects in the way."""

from collections import deque

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.distance_field import SignedDistanceField
from btcore_navigation.ray_casting import RayCaster, ScanAgreement
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import LaserScan, Pose2D
from btcore_robot.time_limits import MAX_SCAN_GAP_S, is_stale

AVERAGED_SCANS = 3
"""The number of scans over which the fit is averaged."""
MIN_FIT = 0.8
"""While at least this share of the beams ends on occupied cells, the pose is valid.

Measured: 0.75 to 1 at true poses without people around, and at most 0.5 for a robot that was moved elsewhere.
"""
MAX_THROUGH_SHARE = 0.12
"""A larger share of beams through walls contradicts the pose; at true poses it is 0 to 0.07."""
MIN_HIT_SHARE = 0.2
"""A smaller share of beams on occupied cells contradicts the pose: almost nothing supports it."""
MIN_CONTRADICTIONS = 2
"""The number of consecutive scans that have to contradict the pose."""
MAX_CHANGED_SHARE = 0.5
"""If a larger share of beams changes between two scans, the robot was moved elsewhere.

For comparison: a person who suddenly appears right in front of the laser changes a quarter of the beams.
"""
MAX_CHANGED_SHARE_BOTH_WAYS = 0.35
"""The limit in place of MAX_CHANGED_SHARE if many beams became longer and many became shorter."""
MIN_SHARE_EACH_WAY = 0.1
"""The share of beams that counts as many in MAX_CHANGED_SHARE_BOTH_WAYS, for each of the two changes."""

_BEAMS = 60  # of a scan: about so many are compared
_CHANGED = 0.4  # m: more than noise (σ 0.06 m) and a step of 0.03 m
_NEIGHBOURS = np.arange(-3, 4)  # a beam beside an edge may fall on the edge's other side


def changed_beam_shares(before: LaserScan, after: LaserScan, turn: float) -> tuple[float, float]:
    """Return the shares (0 … 1) of beams that became longer and that became shorter between two scans.

    Args:
        before: The earlier scan.
        after: The later scan.
        turn: The robot's turn (rad, positive to the left) between the two scans.
    """
    chosen = np.arange(0, len(after.ranges), max(1, len(after.ranges) // _BEAMS))
    earlier = np.rint(chosen + turn / after.angle_increment).astype(np.intp)[:, None] + _NEIGHBOURS
    known = (earlier[:, 0] >= 0) & (earlier[:, -1] < len(before.ranges))
    if not known.any():
        return 0.0, 0.0
    # np.clip and np.mean take several times as long for so few numbers.
    then = np.minimum(np.maximum(before.ranges[earlier[known]], 0.0), after.range_max)
    now = np.minimum(np.maximum(after.ranges[chosen[known]], 0.0), after.range_max)
    return (
        np.count_nonzero(now > then.max(axis=1) + _CHANGED) / len(now),
        np.count_nonzero(now < then.min(axis=1) - _CHANGED) / len(now),
    )


class PoseValidator:
    """A check of the estimated pose against every scan.

    People and objects in the way make some beams shorter than on the map, but none longer; the other beams
    still fit. So a pose is doubtful when beams go through walls, when almost no beam fits, or when most beams
    change between two scans.

    Attributes:
        has_scan_jumped: Whether most beams changed between two scans.
    """

    def __init__(self, surfaces: SignedDistanceField, visibility: RayCaster) -> None:
        self._surfaces = surfaces
        self._visibility = visibility
        self._before: tuple[LaserScan, float] | None = None
        self.reset()

    def reset(self) -> None:
        """Forget the previous scans' results and start again with a pose that is taken as valid."""
        self._fits: deque[float] = deque(maxlen=AVERAGED_SCANS)
        self._contradictions = 0
        self.has_scan_jumped = False

    @property
    def is_contradicted(self) -> bool:
        """Whether the last scans don't fit the pose, despite people and objects in the way."""
        return self._contradictions >= MIN_CONTRADICTIONS

    @property
    def fit(self) -> float:
        """The share (0 … 1) of beams that end on occupied cells, the mean over `AVERAGED_SCANS` scans."""
        return sum(self._fits) / len(self._fits) if self._fits else 1.0

    @property
    def is_doubtful(self) -> bool:
        """Whether the last scans make the pose doubtful."""
        return self.fit < MIN_FIT and (self.has_scan_jumped or self.is_contradicted)

    def add_scan(
        self,
        scan: LaserScan,
        points: NDArray[np.float64],
        laser: tuple[float, float],
        odometry: Pose2D,
        pose: Pose2D,
    ) -> None:
        """Compare a scan with the estimated pose and with the previous scan.

        Args:
            scan: The newest scan.
            points: The ends of the scan's beams in the robot's frame (m), shape `(k, 2)`.
            laser: The laser's position in the robot's frame (m).
            odometry: The robot's pose in odom at the scan's stamp.
            pose: The estimated pose in the map at the scan's stamp.
        """
        before, self._before = self._before, (scan, odometry.yaw)
        if before is not None and not is_stale(before[0], scan.stamp, MAX_SCAN_GAP_S):
            turn = wrap_angle(odometry.yaw - before[1])
            farther, nearer = changed_beam_shares(before[0], scan, turn)
            both_ways = min(farther, nearer) > MIN_SHARE_EACH_WAY
            if farther + nearer > (MAX_CHANGED_SHARE_BOTH_WAYS if both_ways else MAX_CHANGED_SHARE):
                self.has_scan_jumped = True
        self._fits.append(self._surfaces.fit(pose, points))
        # The slower check by ray casting is needed only for a bad fit.
        if self.fit < MIN_FIT and contradicts_pose(self._visibility.agreement([pose], laser, points)[0]):
            self._contradictions += 1
        else:
            self._contradictions = 0


def contradicts_pose(view: ScanAgreement) -> bool:
    """Return whether *view* contradicts the pose: people and objects in the way can't explain such a scan."""
    return view.through_share > MAX_THROUGH_SHARE or view.hit_share < MIN_HIT_SHARE
