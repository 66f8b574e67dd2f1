"""Simultaneous localisation and mapping from laser scans and odometry."""

from dataclasses import replace

import numpy as np

from btcore.clock import NS_PER_S
from btcore_navigation.mapping.correlative_matcher import (
    NEARBY,
    CorrelationGrid,
    MatchResult,
    PoseUncertainty,
)
from btcore_navigation.mapping.key_scan import KeyScan, LocalisedScan, are_far_apart, key_scan
from btcore_navigation.mapping.log_odds_grid import LogOddsGrid, trim_map
from btcore_navigation.mapping.loop_closure import LoopClosureDetector, relative_edge
from btcore_navigation.mapping.map_quality import MapQuality, map_quality
from btcore_navigation.mapping.pose_arrays import (
    Floats,
    compose,
    pose_to_row,
    relative_pose,
    row_to_pose,
)
from btcore_navigation.mapping.pose_graph import PoseGraph
from btcore_robot.occupancy_map import OccupancyMap, Rectangle
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import BASE_FRAME, MAP_FRAME, ODOM_FRAME, LaserScan, Pose2D, Robot, TransformStamped
from btcore_robot.time_limits import MAP_TRANSFORM_VALIDITY_S, MAX_ODOMETRY_AGE_S, is_stale
from btcore_robot.transform_filter import TransformFilter
from btcore_robot.transforms import TransformTree

__all__ = ["Mapper"]

MIN_TRAVEL, MIN_TURN = 0.5, 0.25
"""A key scan is taken after this travel (m) or turn (rad) since the previous key scan.

The travel is slam_toolbox's minimum_travel_distance. The turn is half of its minimum_travel_heading, because
two scans of Tiago's laser overlap little after a larger turn.
"""
MIN_TRAVEL_AT_REST, MIN_TURN_AT_REST = 0.15, 0.15
"""The travel (m) and turn (rad) after which a key scan is taken where the robot has come to rest."""
SCANS_PER_KEY = 5
"""The number of scans that are matched together to reduce noise; the key scan is the last of them."""
MATCHED_SCANS = 25
"""The number of previous key scans that a new key scan is matched with."""
MATCH_RADIUS = 6.0
"""Previous key scans farther (m) than this from the new key scan are not matched."""
MIN_POINTS = 20
"""A scan with fewer points is not matched; the pose is then taken from odometry alone."""
MIN_SCORE = 0.35
"""The minimum score (0 … 1) of a match with the previous key scans."""
OUTAGE_UNCERTAINTY = PoseUncertainty(0.3, 0.2)
"""The standard deviation (m, rad) of the motion during an outage of the odometry."""
_REDRAW_DISTANCE = 0.02  # m: the map is redrawn if a pose moves farther than this
_STANDSTILL_SPEED = 0.01  # m/s, rad/s
# The standard deviation of odometry between two key scans: its minimum (m, rad), and its growth with the
# distance and the turn.
_MIN_DISTANCE_ERROR, _DISTANCE_ERROR_SHARE = 0.02, 0.05
_MIN_TURN_ERROR, _TURN_ERROR_SHARE = 0.01, 0.06


class Mapper:
    """Simultaneous localisation and mapping. Call `step` periodically at the laser's rate.

    A key scan is taken every 0.5 m or 0.25 rad, and where the robot comes to rest. The key scan and the four
    scans just before it are matched with the most recent key scans. Between key scans the pose follows
    odometry. When the robot returns to a place after 8 m or more, the key scan is also matched with the key
    scans taken there earlier. Such a match closes a loop: all poses are adjusted to the matches, and the map
    is redrawn.

    Without recent odometry the pose is unknown. When the odometry arrives again, the robot may have been
    moved, or the odometry may have started anew. Either the robot has stood since, or it has moved as the
    odometry reports; the match with the previous key scans decides. If neither pose matches, `is_searching`
    is True until a later scan matches.

    With each scan the transform from `map` to `odom` is published in *tree*. A mapper has the same
    attributes as a `Localiser`, so that navigation can use either.

    Args:
        robot: The robot whose scans and odometry are used.
        tree: The transform tree to look up the laser's pose and to publish map→odom.
        start: The initial pose of the base in the frame `map`; the origin if omitted.
        resolution: The side (m) of a map cell.
        keepout: Rectangles that are added to the map because the laser cannot detect them.
        odometry_limit: The age (s) from which on the odometry has an outage.

    Attributes:
        is_contradicted: Always False.
    """

    is_contradicted = False

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        *,
        start: Pose2D | None = None,
        resolution: float = 0.05,
        keepout: tuple[Rectangle, ...] = (),
        odometry_limit: float = MAX_ODOMETRY_AGE_S,
    ) -> None:
        self._robot = robot
        self._tree = tree
        self._scans = TransformFilter[LaserScan](tree, ODOM_FRAME)
        self._start = pose_to_row(start) if start is not None else np.zeros(3)
        self._grid = LogOddsGrid(resolution, robot.base_info.radius, keepout)
        self._loop_detector = LoopClosureDetector()
        self.is_searching = False
        """Whether the robot has to turn, because no scan since an outage of the odometry matches the map."""
        self._odometry_limit = odometry_limit
        self._interrupted = False
        """Whether no pose since the last outage of the odometry is confirmed."""
        self._resumed_at: tuple[int, Pose2D] | None = None
        """Stamp (ns) and pose of the first odometry after an outage."""
        self._correction: Transform | None = None
        """The pose of the present frame odom in the frame odom before all outages; None if they are equal."""
        self._travelled = 0.0
        self._last_odometry: Pose2D | None = None
        self._recent_scans: list[LocalisedScan] = []
        self.scans: list[KeyScan] = []
        """The key scans, oldest first."""
        self.graph: PoseGraph | None = None
        """The poses of the key scans and the constraints between them; None before the first key scan."""
        self.map_to_odom = Transform()
        """The pose of the frame `odom` in the frame `map`."""
        self.stamp = -1
        """The stamp (ns) of the last processed scan; -1 before the first."""
        self.version = 0
        """The number of changes of the map so far."""
        self.loops_closed = 0
        """The number of loops closed so far."""

    @property
    def is_confident(self) -> bool:
        """Whether the pose is known: from the first key scan on (after five scans), except during outages."""
        return self.graph is not None and not self._interrupted

    @property
    def poses(self) -> Floats:
        """The poses of the key scans in the map: x, y (m) and yaw (rad), shape `(n, 3)`."""
        return self.graph.poses if self.graph is not None else np.zeros((0, 3))

    def pose(self) -> Pose2D:
        """Return the current pose of the base in `map`, by the last key scan and the newest odometry."""
        return (self.map_to_odom * Transform.from_pose(self._robot.odometry().pose)).to_pose()

    def reinitialise_global_localisation(self) -> None:
        """Do nothing: a growing map has no other places where the robot could be."""

    def map(self) -> OccupancyMap:
        """Return the map in the frame `map`; before the first key scan it is a single unknown cell."""
        if not self.scans:
            unknown = np.full((1, 1), -1, dtype=np.int8)
            return OccupancyMap(
                unknown, self._grid.resolution, (float(self._start[0]), float(self._start[1]))
            )
        return trim_map(self._grid.map())

    def quality(self) -> MapQuality | None:
        """Return the quality of the map so far, or None before the first key scan."""
        return None if self.graph is None else map_quality(self.map(), self.scans, self.graph)

    def step(self, now: int) -> None:
        """Process the newest scan whose transforms are available, unless it was processed before.

        Args:
            now: The time (ns).
        """
        newest = self._robot.odometry()
        if is_stale(newest, now, self._odometry_limit):
            self._interrupted, self._resumed_at = True, None
            self._recent_scans = []
            return
        scan = self._scans.newest(self._robot.scan())
        if scan is None or scan.stamp == self.stamp:
            return
        if self._interrupted:
            self._resumed_at = self._resumed_at or (newest.stamp, newest.pose)
            if scan.stamp < self._resumed_at[0]:
                return  # taken during the outage: its pose by odometry is not known
        odometry = self._tree.lookup(ODOM_FRAME, BASE_FRAME, scan.stamp).to_pose()
        laser = self._tree.lookup(BASE_FRAME, scan.frame, scan.stamp)
        self.stamp = scan.stamp
        if self._interrupted:
            self._resume(LocalisedScan(scan, laser, odometry))
            return
        if self._correction is not None:
            odometry = (self._correction * Transform.from_pose(odometry)).to_pose()
        if self._last_odometry is not None:
            self._travelled += float(
                np.hypot(odometry.x - self._last_odometry.x, odometry.y - self._last_odometry.y)
            )
        self._last_odometry = odometry
        # The last scans, of which the newest may become a key scan.
        self._recent_scans = [*self._recent_scans[1 - SCANS_PER_KEY :], LocalisedScan(scan, laser, odometry)]
        if self._is_key(odometry):
            self._add_key_scan(key_scan(self._recent_scans, self._travelled))
        self._publish_transform()

    def _resume(self, scan: LocalisedScan) -> None:
        """Collect scans after an outage of the odometry, and take the pose that matches the map."""
        self._recent_scans.append(scan)
        if len(self._recent_scans) < SCANS_PER_KEY:
            return
        scans, self._recent_scans = self._recent_scans, []
        before, resumed_at = self._last_odometry, self._resumed_at
        if self.graph is None or before is None or resumed_at is None:
            self._interrupted = False
            return
        jumped = self._correction or Transform()
        stood = Transform.from_pose(before) * Transform.from_pose(resumed_at[1]).inverse()
        best: tuple[float, Transform, KeyScan] | None = None
        for correction in (jumped, stood):
            moved = [
                replace(scan, odometry=(correction * Transform.from_pose(scan.odometry)).to_pose())
                for scan in scans
            ]
            candidate = key_scan(moved, self._travelled)
            match = self._match_recent(candidate, self._step_to(candidate), OUTAGE_UNCERTAINTY)
            if match is not None and (best is None or match.score > best[0]):
                best = match.score, correction, candidate
        self.is_searching = best is None
        if best is not None:
            self._interrupted = False
            self._correction, self._last_odometry = best[1], best[2].odometry
            self._add_key_scan(best[2], OUTAGE_UNCERTAINTY)
            self._publish_transform()

    def _is_key(self, odometry: Pose2D) -> bool:
        if not self.scans:
            return len(self._recent_scans) == SCANS_PER_KEY
        last = self.scans[-1].odometry
        if are_far_apart(last, odometry, MIN_TRAVEL, MIN_TURN):
            return True
        twist = self._robot.odometry().twist
        rests = abs(twist.v) < _STANDSTILL_SPEED and abs(twist.w) < _STANDSTILL_SPEED
        return rests and are_far_apart(last, odometry, MIN_TRAVEL_AT_REST, MIN_TURN_AT_REST)

    def _add_key_scan(self, scan: KeyScan, uncertainty: PoseUncertainty | None = None) -> None:
        """Add a key scan to the graph and draw it. The default *uncertainty* is odometry's."""
        if self.graph is None:
            first = pose_to_row(self._recent_scans[0].odometry)
            self.graph = PoseGraph(compose(self._start, relative_pose(first, pose_to_row(scan.odometry))))
            self.scans.append(scan)
        else:
            self.graph.add(*self._match(scan, self._step_to(scan), uncertainty))
            self.scans.append(scan)
        graph = self.graph
        # The map is only redrawn if the poses moved visibly; otherwise the new scan is added to it.
        if self._close_loop() and graph.optimise() > _REDRAW_DISTANCE:
            self._grid.draw(self.scans, graph.poses)
        else:
            self._grid.add(scan, graph.poses[-1])
        # Odometry carries the pose on from here until the next key scan.
        base_in_map = Transform.from_pose(row_to_pose(graph.poses[-1]))
        self.map_to_odom = base_in_map * Transform.from_pose(scan.odometry).inverse()
        if self._correction is not None:
            self.map_to_odom = self.map_to_odom * self._correction
        self.version += 1

    def _step_to(self, scan: KeyScan) -> Floats:
        """Return the pose of *scan* relative to the last key scan by odometry: x, y (m) and yaw (rad)."""
        return relative_pose(pose_to_row(self.scans[-1].odometry), pose_to_row(scan.odometry))

    def _match(
        self, scan: KeyScan, step: Floats, uncertainty: PoseUncertainty | None
    ) -> tuple[Floats, Floats]:
        """Return the pose of *scan* relative to the previous key scan, and its information matrix.

        *step* is this pose by odometry, with the *uncertainty*: by default that of odometry.
        """
        assert self.graph is not None
        if uncertainty is None:
            uncertainty = PoseUncertainty(
                _MIN_DISTANCE_ERROR + _DISTANCE_ERROR_SHARE * float(np.hypot(step[0], step[1])),
                _MIN_TURN_ERROR + _TURN_ERROR_SHARE * abs(float(step[2])),
            )
        prior = uncertainty.information()
        match = self._match_recent(scan, step, uncertainty)
        if match is None:
            return step, prior
        last = self.graph.poses[-1]
        return relative_edge(last, MatchResult(match.pose, match.score, match.information + prior))

    def _match_recent(self, scan: KeyScan, step: Floats, uncertainty: PoseUncertainty) -> MatchResult | None:
        """Return the match of *scan* with the previous key scans, or None. It begins at the pose *step*."""
        graph = self.graph
        assert graph is not None
        predicted = compose(graph.poses[-1], step)
        if len(scan.outline.points) < MIN_POINTS:
            return None
        recent = [
            earlier.outline.at(pose)
            for earlier, pose in zip(self.scans[-MATCHED_SCANS:], graph.poses[-MATCHED_SCANS:], strict=True)
            if len(earlier.outline.points) and np.hypot(*(pose[:2] - predicted[:2])) < MATCH_RADIUS
        ]
        if not recent:
            return None
        grid = CorrelationGrid(recent)
        # The search needs few points; all points are used to refine its result.
        best = grid.search(predicted, scan.outline.points[:: 2 * SCANS_PER_KEY], NEARBY)
        match = grid.refine(best, scan.outline, predicted, uncertainty)
        return match if match.score >= MIN_SCORE else None

    def _close_loop(self) -> bool:
        """Close a loop if the newest key scan is at a known place; return whether a loop was closed."""
        graph = self.graph
        if graph is None:
            return False
        loop = self._loop_detector.find(self.scans, graph)
        if loop is None:
            return False
        first, match = loop
        graph.add_loop_edge(first, len(self.scans) - 1, *relative_edge(graph.poses[first], match))
        self.loops_closed += 1
        return True

    def _publish_transform(self) -> None:
        if self.graph is None:
            return
        transform = self.map_to_odom
        stamped = TransformStamped(
            ODOM_FRAME, MAP_FRAME, transform.position, transform.quaternion, self.stamp
        )
        self._tree.set(stamped, holds=round(MAP_TRANSFORM_VALIDITY_S * NS_PER_S))
