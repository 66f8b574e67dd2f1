"""Detection of loop closures: places that the robot has visited before."""

import math
from collections.abc import Sequence

import numpy as np

from btcore_navigation.mapping.correlative_matcher import CorrelationGrid, MatchResult, SearchWindow
from btcore_navigation.mapping.key_scan import KeyScan
from btcore_navigation.mapping.pose_arrays import Floats, relative_pose
from btcore_navigation.mapping.pose_graph import PoseGraph

MIN_LOOP_LENGTH = 8.0
"""The distance (m) that must be driven before a return to a place counts as a loop."""
MAX_DISTANCE = 3.0
"""The maximum distance (m) between the estimated poses of the newest and the nearest old key scan."""
CHAIN_RADIUS = 10
"""The newest key scan is matched with this many key scans before and after the nearest old key scan."""
MIN_CHAIN = 6
"""The minimum number of old key scans for a match: fewer show too little of a place."""
MIN_SCORE = 0.5
"""The minimum score (0 … 1) of a match that closes a loop."""
MIN_DRIFT, DRIFT, MAX_DRIFT = 0.25, 0.015, 1.5
"""The assumed drift (m): minimum, growth per metre driven since the last correction, and maximum."""
MIN_CERTAINTY_RATIO = 0.15
"""The minimum ratio of a match's certainty in its least and in its most certain direction.

In a corridor the ratio is lower, and no loop is closed.
"""
_MIN_POINTS = 60  # scans with fewer points are not matched
# The assumed error of the yaw (rad): minimum, growth per metre since the last correction, and maximum.
_MIN_TURN, _TURN_DRIFT, _MAX_TURN = 0.1, 0.005, 0.5
_SEARCH_DISTANCE = 1.0  # m driven between two searches
_SEARCH_POINTS = 150  # of a scan: about so many are enough for a search
_CELL_STEP, _TURN_STEP = 2, 0.035  # cells and rad between the searched poses


class LoopClosureDetector:
    """A search for loop closures: match the newest key scan with old key scans, once per metre driven."""

    def __init__(self) -> None:
        self._closed_after = 0.0
        self._tried_after = -math.inf

    def find(self, scans: Sequence[KeyScan], graph: PoseGraph) -> tuple[int, MatchResult] | None:
        """Look for a loop closure by the newest key scan.

        Args:
            scans: The key scans, oldest first.
            graph: The pose graph with the poses of the key scans.

        Returns:
            The index of the nearest old key scan and the match of the newest key scan; None without a
            certain match.
        """
        newest, here = scans[-1], graph.poses[-1]
        if (
            newest.travelled - self._tried_after < _SEARCH_DISTANCE
            or len(newest.outline.points) < _MIN_POINTS
        ):
            return None
        old = [
            index for index, scan in enumerate(scans) if newest.travelled - scan.travelled >= MIN_LOOP_LENGTH
        ]
        if not old:
            return None
        distances = np.hypot(*(graph.poses[old][:, :2] - here[:2]).T)
        nearest = int(np.argmin(distances))
        if distances[nearest] > MAX_DISTANCE:
            return None
        self._tried_after = newest.travelled
        chain = range(max(0, nearest - CHAIN_RADIUS), min(len(old), nearest + CHAIN_RADIUS + 1))
        if len(chain) < MIN_CHAIN:
            return None
        grid = CorrelationGrid([scans[index].outline.at(graph.poses[index]) for index in chain])
        # The drift since the pose was last corrected, or since the old key scan if that is more recent.
        since = newest.travelled - max(self._closed_after, scans[nearest].travelled)
        drift = min(MAX_DRIFT, MIN_DRIFT + DRIFT * since)
        turn = min(_MAX_TURN, _MIN_TURN + _TURN_DRIFT * since)
        points = newest.outline.points[:: max(1, len(newest.outline.points) // _SEARCH_POINTS)]
        guess = grid.search(here, points, SearchWindow(drift, turn, _CELL_STEP, _TURN_STEP))
        match = grid.refine(guess, newest.outline)
        shift = relative_pose(here, match.pose)
        if np.hypot(shift[0], shift[1]) > drift or abs(shift[2]) > turn:
            return None
        if match.score < MIN_SCORE or _is_ambiguous(match):
            return None
        self._closed_after = newest.travelled
        return nearest, match


def _is_ambiguous(match: MatchResult) -> bool:
    """Return whether the match could be shifted along some direction, as in a corridor."""
    lowest, highest = np.linalg.eigvalsh(match.information[:2, :2])
    return bool(lowest < MIN_CERTAINTY_RATIO * highest)


def relative_edge(first: Floats, match: MatchResult) -> tuple[Floats, Floats]:
    """Return the values for an edge of the pose graph, in the frame of the edge's first pose.

    Args:
        first: The first pose: x, y (m) and yaw (rad), shape `(3,)`.
        match: The match of the second pose, in the same frame as *first*.

    Returns:
        The pose of the match relative to *first*, shape `(3,)`, and its information matrix (the inverse
        covariance), shape `(3, 3)`.
    """
    cos, sin = math.cos(first[2]), math.sin(first[2])
    turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
    return relative_pose(first, match.pose), turn.T @ match.information @ turn
