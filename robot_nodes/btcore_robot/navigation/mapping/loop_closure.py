"""Noticing that the robot is where it has been before."""

import math
from collections.abc import Sequence

import numpy as np

from btcore_robot.navigation.mapping.correlative_matcher import CorrelationGrid, MatchResult, SearchWindow
from btcore_robot.navigation.mapping.key_scan import KeyScan
from btcore_robot.navigation.mapping.pose_arrays import Floats, relative_pose
from btcore_robot.navigation.mapping.pose_graph import PoseGraph

LATER = 8.0
"""The way (m) after which a place that is come to again is come to by a loop."""
NEAR = 3.0
"""How far (m) off it may seem to be."""
CHAIN = 10
"""How many scans before and after the nearest old one it is matched to."""
LEAST_CHAIN = 6
"""How many these are at least: fewer show too little of a place."""
ALIKE = 0.5
"""The least score of a match that closes a loop."""
LEAST_DRIFT, DRIFT, MOST_DRIFT = 0.25, 0.015, 1.5
"""How far off (m) the robot may be: at least, for each metre since it knew better, and at most."""
SLIDES = 0.15
"""Where the walls tell one direction so much less than the other, as in a corridor, no loop is closed."""
_FEWEST = 60  # points; from fewer no loop is concluded
_TURN = 0.005  # rad of drift for each metre
_MOST_TURN = 0.5


class LoopClosureDetector:
    """Holds a key scan against those from long before; tells of each place once a metre."""

    def __init__(self) -> None:
        self._closed_at = 0.0
        self._tried_at = -math.inf

    def find(self, scans: Sequence[KeyScan], graph: PoseGraph) -> tuple[int, MatchResult] | None:
        """The old scan near which the newest one was taken, and where that is; None where nothing is sure."""
        newest, here = scans[-1], graph.poses[-1]
        if newest.travelled - self._tried_at < 1.0 or len(newest.outline.points) < _FEWEST:
            return None
        old = [index for index, one in enumerate(scans) if newest.travelled - one.travelled >= LATER]
        if not old:
            return None
        away = np.hypot(*(graph.poses[old][:, :2] - here[:2]).T)
        nearest = int(np.argmin(away))
        if away[nearest] > NEAR:
            return None
        self._tried_at = newest.travelled
        chain = range(max(0, nearest - CHAIN), min(len(old), nearest + CHAIN + 1))
        if len(chain) < LEAST_CHAIN:
            return None
        walls = CorrelationGrid([scans[one].outline.at(graph.poses[one]) for one in chain])
        since = newest.travelled - max(self._closed_at, scans[nearest].travelled)
        way = min(MOST_DRIFT, LEAST_DRIFT + DRIFT * since)
        turn = min(_MOST_TURN, 0.1 + _TURN * since)
        points = newest.outline.points[:: max(1, len(newest.outline.points) // 150)]
        guess = walls.search(here, points, SearchWindow(way, turn, 2, 0.035))
        found = walls.refine(guess, newest.outline)
        shift = relative_pose(here, found.pose)
        if np.hypot(shift[0], shift[1]) > way or abs(shift[2]) > turn:
            return None
        if found.score < ALIKE or _slides(found):
            return None
        self._closed_at = newest.travelled
        return nearest, found


def _slides(found: MatchResult) -> bool:
    """Whether the match could as well lie further along some direction."""
    least, most = np.linalg.eigvalsh(found.information[:2, :2])
    return bool(least < SLIDES * most)


def edge_from(first: Floats, found: MatchResult) -> tuple[Floats, Floats]:
    """How *found* lies as seen from the pose *first*, and its information in that frame."""
    cos, sin = math.cos(first[2]), math.sin(first[2])
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    return relative_pose(first, found.pose), turn.T @ found.information @ turn
