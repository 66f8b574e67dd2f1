"""Relocalisation of a lost robot: find poses that explain a scan, and track them until a pose is certain."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.distance_field import SignedDistanceField
from btcore_navigation.global_search import GlobalSearch, SearchSpace
from btcore_navigation.ray_casting import RayCaster
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

HEADINGS_A_STEP = 24
"""The number of headings that a search tries per scan: a fifth of all headings, in about 15 ms."""
MAX_HYPOTHESES = 40
"""The maximum number of poses found by the search that become hypotheses."""
TURN_A_VIEW, DISTANCE_A_VIEW, TIME_A_VIEW_NS = 0.35, 0.2, 1_000_000_000
"""The hypotheses are scored again after this turn (rad), distance (m) or time (ns)."""
VIEWS = 4
"""The number of scores that a hypothesis needs before it can be accepted."""
MIN_SCORE = 0.6
"""The least mean score of an accepted hypothesis: true poses have 0.7 to 1, others mostly less than 0.4."""
DISCARD_MARGIN = 0.3
"""A hypothesis whose score is lower than the best score by more than this is discarded."""
LOOKED_AROUND = 4.0
"""After this turn (rad), Tiago's laser (field of view 220 degrees) has covered all directions."""
MARGIN, MARGIN_AT_FIRST = 0.15, 0.3
"""The least lead of the best score over all other scores.

MARGIN holds after the robot has turned by LOOKED_AROUND, MARGIN_AT_FIRST until then.
"""
FULL_TURN = 7.0
"""If no hypothesis is accepted after this turn (rad), the search starts again with another scan."""
SEARCH_TIMEOUT_NS = 20_000_000_000
"""If no hypothesis is accepted after this time (ns), the search starts again, too."""
SAME_PLACE, SAME_HEADING = 0.75, 0.35
"""Hypotheses nearer to each other than this (m, rad) count as the same hypothesis."""
_SCORE_TOLERANCE = 0.1  # by which a single score, or a mean that is not final, may be less than MIN_SCORE
# The standard deviations (m, rad) of poses before the fit to a scan. The poses of the search are coarse.
_SEARCH_DEVIATION = (0.3, 0.15)
_GIVEN_DEVIATION = (0.1, 0.05)
_MOTION_DEVIATION = (0.15, 0.1)


@dataclass(slots=True)
class PoseHypothesis:
    """A possible pose of the robot in the map, and its score for each scan since the search."""

    pose: Pose2D
    scores: list[float] = field(default_factory=list)

    @property
    def score(self) -> float:
        """The mean of the scores."""
        return sum(self.scores) / len(self.scores)

    def is_near(self, other: "PoseHypothesis") -> bool:
        """Return whether both hypotheses stand for the same pose."""
        apart = math.hypot(self.pose.x - other.pose.x, self.pose.y - other.pose.y)
        return apart < SAME_PLACE and abs(wrap_angle(self.pose.yaw - other.pose.yaw)) < SAME_HEADING


class Relocaliser:
    """A search of the whole map for the robot's pose, and the tracking of the poses found.

    Call `process_scan` with every scan.
    """

    def __init__(self, space: SearchSpace, surfaces: SignedDistanceField, visibility: RayCaster) -> None:
        self._space = space
        self._surfaces = surfaces
        self._visibility = visibility
        self._search: GlobalSearch | None = None
        self._points: Floats = np.zeros((0, 2))
        self.odometry = Pose2D(0.0, 0.0, 0.0)
        """The pose by odometry at the moment for which the poses of `hypotheses` are valid."""
        self._stamp = self._began = 0
        self._turned = 0.0
        self.hypotheses: list[PoseHypothesis] = []
        """The possible poses, the likeliest first; empty until the first search has ended."""

    def restart(self) -> None:
        """Remove all hypotheses, and start a search with the next scan."""
        self._search = None
        self.hypotheses = []

    def process_scan(
        self, points: Floats, laser: tuple[float, float], odometry: Pose2D, stamp: int
    ) -> Pose2D | None:
        """Process a scan; return the robot's pose once a hypothesis is accepted.

        Args:
            points: The ends of the scan's beams in the robot's frame (m), shape `(k, 2)`.
            laser: The laser's position in the robot's frame (m).
            odometry: The pose in the frame odom at the scan's stamp.
            stamp: The scan's stamp (ns).

        Returns:
            The pose in the frame map at the scan's stamp, or None.
        """
        if self.hypotheses:
            return self._follow(points, laser, odometry, stamp)
        if self._search is None:
            self._search = GlobalSearch(self._space, points)
            self._points, self.odometry, self._stamp = points, odometry, stamp
        if self._search.advance(HEADINGS_A_STEP):
            candidates = self._search.candidates(MAX_HYPOTHESES)
            self._search = None
            self._began, self._turned = stamp, 0.0
            hypotheses = [PoseHypothesis(candidate.pose) for candidate in candidates]
            self._fit(hypotheses, self._points, laser, deviation=_SEARCH_DEVIATION)
            self._keep(hypotheses)
        return None

    def add_hypothesis(self, pose: Pose2D, laser: tuple[float, float]) -> PoseHypothesis:
        """Add a hypothesis and return it with its score for the scan of the search.

        Args:
            pose: The pose in the map at the moment of the search's scan.
            laser: The laser's position in the robot's frame (m).
        """
        hypothesis = PoseHypothesis(pose)
        self._fit([hypothesis], self._points, laser, deviation=_GIVEN_DEVIATION)
        self._keep([hypothesis, *self.hypotheses])
        return hypothesis

    def _follow(
        self, points: Floats, laser: tuple[float, float], odometry: Pose2D, stamp: int
    ) -> Pose2D | None:
        turn = wrap_angle(odometry.yaw - self.odometry.yaw)
        distance = math.hypot(odometry.x - self.odometry.x, odometry.y - self.odometry.y)
        if abs(turn) < TURN_A_VIEW and distance < DISTANCE_A_VIEW and stamp - self._stamp < TIME_A_VIEW_NS:
            return None
        step = Transform.from_pose(self.odometry).inverse() * Transform.from_pose(odometry)
        for hypothesis in self.hypotheses:
            hypothesis.pose = (Transform.from_pose(hypothesis.pose) * step).to_pose()
        self._turned += abs(turn)
        self.odometry, self._stamp = odometry, stamp
        self._fit(self.hypotheses, points, laser, deviation=_MOTION_DEVIATION)
        self._keep(self.hypotheses)
        return self._accept_or_restart(stamp)

    def _fit(
        self,
        hypotheses: list[PoseHypothesis],
        points: Floats,
        laser: tuple[float, float],
        deviation: tuple[float, float],
    ) -> None:
        """Fit every hypothesis to a scan, and add its score."""
        for hypothesis in hypotheses:
            hypothesis.pose = self._surfaces.match(hypothesis.pose, points, laser, deviation=deviation).pose
        views = self._visibility.agreement([hypothesis.pose for hypothesis in hypotheses], laser, points)
        for hypothesis, view in zip(hypotheses, views, strict=True):
            hypothesis.scores.append(view.score)

    def _keep(self, hypotheses: list[PoseHypothesis]) -> None:
        """Keep the promising hypotheses, the likeliest first, without duplicates."""
        kept: list[PoseHypothesis] = []
        for hypothesis in sorted(hypotheses, key=lambda hypothesis: -hypothesis.score):
            is_hopeless = bool(kept) and hypothesis.score < kept[0].score - DISCARD_MARGIN
            if not is_hopeless and not any(hypothesis.is_near(other) for other in kept):
                kept.append(hypothesis)
        self.hypotheses = kept

    def _accept_or_restart(self, stamp: int) -> Pose2D | None:
        """Return the pose of an accepted hypothesis, or start again if none can be accepted."""
        best = self.hypotheses[0]
        if len(best.scores) >= VIEWS:
            ahead = best.score - self.hypotheses[1].score if len(self.hypotheses) > 1 else 1.0
            margin = MARGIN if self._turned >= LOOKED_AROUND else MARGIN_AT_FIRST
            if (
                best.score >= MIN_SCORE
                and best.scores[-1] >= MIN_SCORE - _SCORE_TOLERANCE
                and ahead >= margin
            ):
                return best.pose
            is_expired = self._turned > FULL_TURN or stamp - self._began > SEARCH_TIMEOUT_NS
            if best.score < MIN_SCORE - _SCORE_TOLERANCE or is_expired:
                self.restart()
        return None
