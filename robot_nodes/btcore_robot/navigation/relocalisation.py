"""Finding a lost robot again: places that explain one scan, followed while it turns until one is left."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.distance_field import SignedDistanceField
from btcore_robot.navigation.global_search import GlobalSearch, SearchSpace
from btcore_robot.navigation.ray_casting import RayCaster
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

HEADINGS_A_STEP = 24
"""A fifth of a search: some 15 ms."""
PLACES = 40
"""How many places of the search are looked at closely."""
TURN_A_VIEW, WAY_A_VIEW, TIME_A_VIEW = 0.35, 0.2, 1_000_000_000
"""A place is looked at again after this turn (rad), or way (m), or time (ns)."""
VIEWS = 4
"""How often a place has to agree with what is seen before it is believed."""
ENOUGH = 0.6
"""The mean score of a place that can be believed: at a true pose it is 0.7 to 1, elsewhere mostly < 0.4."""
HOPELESS = 0.3
"""A place that scores so much less than the best one is given up."""
LOOKED_AROUND = 4.0
"""After this turn (rad) everything was in view once, with Tiago's 220 degrees and more."""
MARGIN, MARGIN_AT_FIRST = 0.15, 0.3
"""By how much the best place has to be ahead of every other one, after that and before."""
FULL_TURN = 7.0
"""Who has turned so far (rad) and still can't tell begins anew with another scan."""
LONGEST = 20_000_000_000
"""So does who has looked for so long (ns)."""
SAME_PLACE, SAME_HEADING = 0.75, 0.35
"""Places nearer than that (m, rad) are told apart by tracking, not by searching."""


@dataclass(slots=True)
class PoseHypothesis:
    """A pose in the map where the robot may be, and how well it agreed with each scan since."""

    pose: Pose2D
    scores: list[float] = field(default_factory=list)

    @property
    def score(self) -> float:
        """The mean of its scores."""
        return sum(self.scores) / len(self.scores)

    def near(self, other: "PoseHypothesis") -> bool:
        """Whether the two are one place."""
        apart = math.hypot(self.pose.x - other.pose.x, self.pose.y - other.pose.y)
        return apart < SAME_PLACE and abs(wrap_angle(self.pose.yaw - other.pose.yaw)) < SAME_HEADING


class Relocaliser:
    """A search over the whole map and what follows from it; give it every scan by `see`."""

    def __init__(self, space: SearchSpace, faces: SignedDistanceField, visibility: RayCaster) -> None:
        self._space = space
        self._faces = faces
        self._visibility = visibility
        self._search: GlobalSearch | None = None
        self._points: Floats = np.zeros((0, 2))
        self._odometry = Pose2D(0.0, 0.0, 0.0)
        self._stamp = self._began = 0
        self._turned = 0.0
        self.places: list[PoseHypothesis] = []
        """Where the robot may be, the likeliest first; empty until the first search is through."""

    @property
    def best(self) -> PoseHypothesis | None:
        """The likeliest place, once there is one."""
        return self.places[0] if self.places else None

    def restart(self) -> None:
        """Forget what was found, and search with the next scan."""
        self._search = None
        self.places = []

    def see(self, points: Floats, eye: tuple[float, float], odometry: Pose2D, stamp: int) -> Pose2D | None:
        """A scan's beams end at *points* of the robot's frame, *eye* is the laser; where it is, once found.

        *odometry* is the pose in the frame odom at the scan's *stamp* (ns), and so is the answer in map.
        """
        if self.places:
            return self._follow(points, eye, odometry, stamp)
        if self._search is None:
            self._search = GlobalSearch(self._space, points)
            self._points, self._odometry, self._stamp = points, odometry, stamp
        if self._search.advance(HEADINGS_A_STEP):
            found = self._search.candidates(PLACES)
            self._search = None
            self._began, self._turned = stamp, 0.0
            self._look([PoseHypothesis(one.pose) for one in found], self._points, eye, trust=(0.3, 0.15))
        return None

    def consider(self, pose: Pose2D, eye: tuple[float, float]) -> PoseHypothesis:
        """Take *pose*, at the moment of the search's scan, for a place too."""
        place = PoseHypothesis(pose)
        self._fit([place], self._points, eye, trust=(0.1, 0.05))
        self._keep([place, *self.places])
        return place

    @property
    def odometry(self) -> Pose2D:
        """The odometry at the moment that `places` stand for."""
        return self._odometry

    def _follow(
        self, points: Floats, eye: tuple[float, float], odometry: Pose2D, stamp: int
    ) -> Pose2D | None:
        turn = wrap_angle(odometry.yaw - self._odometry.yaw)
        way = math.hypot(odometry.x - self._odometry.x, odometry.y - self._odometry.y)
        if abs(turn) < TURN_A_VIEW and way < WAY_A_VIEW and stamp - self._stamp < TIME_A_VIEW:
            return None
        step = Transform.from_pose(self._odometry).inverse() * Transform.from_pose(odometry)
        for place in self.places:
            place.pose = (Transform.from_pose(place.pose) * step).to_pose()
        self._turned += abs(turn)
        self._odometry, self._stamp = odometry, stamp
        self._look(self.places, points, eye, trust=(0.15, 0.1))
        return self._verdict(stamp)

    def _look(
        self,
        places: list[PoseHypothesis],
        points: Floats,
        eye: tuple[float, float],
        trust: tuple[float, float],
    ) -> None:
        """Fit every place to what is seen, note how well that goes, and keep the ones with hope."""
        self._fit(places, points, eye, trust)
        self._keep(places)

    def _fit(
        self,
        places: list[PoseHypothesis],
        points: Floats,
        eye: tuple[float, float],
        trust: tuple[float, float],
    ) -> None:
        for place in places:
            place.pose = self._faces.match(place.pose, points, eye, trust=trust).pose
        views = self._visibility.agreement([place.pose for place in places], eye, points)
        for place, view in zip(places, views, strict=True):
            place.scores.append(view.score)

    def _keep(self, places: list[PoseHypothesis]) -> None:
        kept: list[PoseHypothesis] = []
        for place in sorted(places, key=lambda one: -one.score):
            hopeless = bool(kept) and place.score < kept[0].score - HOPELESS
            if not hopeless and not any(place.near(other) for other in kept):
                kept.append(place)
        self.places = kept

    def _verdict(self, stamp: int) -> Pose2D | None:
        best = self.places[0]
        if len(best.scores) >= VIEWS:
            ahead = best.score - self.places[1].score if len(self.places) > 1 else 1.0
            margin = MARGIN if self._turned >= LOOKED_AROUND else MARGIN_AT_FIRST
            if best.score >= ENOUGH and best.scores[-1] >= ENOUGH - 0.1 and ahead >= margin:
                return best.pose
            if best.score < ENOUGH - 0.1 or self._turned > FULL_TURN or stamp - self._began > LONGEST:
                self.restart()
        return None
