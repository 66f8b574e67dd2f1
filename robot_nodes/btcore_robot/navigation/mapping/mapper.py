"""The mapper: where the robot is, and the map around it, both from laser and odometry alone."""

import numpy as np

from btcore_robot.navigation.mapping.correlative_matcher import (
    NEARBY,
    CorrelationGrid,
    MatchResult,
    PoseUncertainty,
)
from btcore_robot.navigation.mapping.key_scan import KeyScan, Sweep, far_apart, key_scan
from btcore_robot.navigation.mapping.log_odds_grid import LogOddsGrid, trimmed
from btcore_robot.navigation.mapping.loop_closure import LoopClosureDetector, edge_from
from btcore_robot.navigation.mapping.pose_arrays import (
    Floats,
    compose,
    pose_to_row,
    relative_pose,
    row_to_pose,
)
from btcore_robot.navigation.mapping.pose_graph import PoseGraph
from btcore_robot.navigation.occupancy_map import OccupancyMap, Rectangle
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import NS_PER_S, Pose2D, Robot, TransformStamped
from btcore_robot.transforms import TransformError, TransformTree

WAY, TURN = 0.5, 0.25
"""How far (m, rad) a key scan is from the one before: slam_toolbox's minimum_travel_distance, and half its
minimum_travel_heading, as Tiago's laser sees little twice when it turns by more."""
WAY_AT_REST, TURN_AT_REST = 0.15, 0.15
"""The same where the robot stands: it has come to look."""
SWEEPS = 5
"""How many scans, the key scan being the last, are matched together against noise."""
RECENT = 25
"""How many scans a new one is matched to."""
WITHIN = 6.0
"""How near (m) these were taken."""
FEWEST = 20
"""From fewer points nothing is concluded: odometry goes on alone."""
ALIKE = 0.35
"""The least score of a match with the scans before."""
HOLDS = NS_PER_S
"""How long (ns) after a scan the place of ``odom`` still counts (slam_toolbox's transform_timeout)."""
_REDRAWN = 0.02  # m that a pose has to move for the map to be drawn anew
_STANDS = 0.01  # m/s, rad/s


class Mapper:
    """Simultaneous localisation and mapping. `step` belongs on the schedule, at the laser's rate.

    A key scan is taken every 0.5 m or 0.25 rad, and where the robot comes to rest. It is matched, together
    with the four scans just before it, to the last ones; between them odometry carries the pose on. When the
    robot comes to a place again after 8 m or more, the scan is matched to those from then as well, which
    closes a loop: all poses are moved so that the whole agrees best, and the map is drawn anew. With *loops*
    False that is left out.

    It begins at *start* in the frame ``map``. *keepout* are places that the laser can't show. It tells *tree*
    where ``odom`` is in ``map`` with each scan, and has the same attributes as a `Localiser` for whoever
    drives by it.
    """

    lost = searching = is_contradicted = False

    def __init__(
        self,
        robot: Robot,
        tree: TransformTree,
        *,
        start: Pose2D | None = None,
        resolution: float = 0.05,
        keepout: tuple[Rectangle, ...] = (),
        loops: bool = True,
        frames: tuple[str, str, str] = ("map", "odom", "base_footprint"),
    ) -> None:
        self._robot = robot
        self._tree = tree
        self._frames = frames
        self._start = pose_to_row(start) if start is not None else np.zeros(3)
        self._chart = LogOddsGrid(resolution, robot.base.radius, keepout)
        self._finder = LoopClosureDetector() if loops else None
        self._travelled = 0.0
        self._last_seen: Pose2D | None = None
        self._sweeps: list[Sweep] = []
        self.scans: list[KeyScan] = []
        """The key scans, oldest first."""
        self.graph: PoseGraph | None = None
        """Where they were taken."""
        self.map_to_odom = Transform()
        """Where ``odom`` is in ``map``."""
        self.stamp = -1
        """The stamp (ns) of the last scan that was looked at."""
        self.version = 0
        """How often the map has changed."""
        self.loops_closed = 0
        """How many loops were closed."""

    @property
    def confident(self) -> bool:
        """Whether there is anything to drive by: True from the first key scan on, after five scans."""
        return self.graph is not None

    @property
    def poses(self) -> Floats:
        """Where the key scans were taken: x, y (m) and yaw (rad) in the map, ``(n, 3)``."""
        return self.graph.poses if self.graph is not None else np.zeros((0, 3))

    def pose(self) -> Pose2D:
        """Where ``base_footprint`` is in ``map`` now, by the last key scan and the newest odometry."""
        return (self.map_to_odom * Transform.from_pose(self._robot.odometry().pose)).to_pose()

    def reinitialise_global_localisation(self) -> None:
        """Nothing: on a map that grows around the robot there is nowhere else to look."""

    def map(self) -> OccupancyMap:
        """The map as far as it is known, in the frame ``map``; before the first scan one unknown cell."""
        if not self.scans:
            unknown = np.full((1, 1), -1, dtype=np.int8)
            return OccupancyMap(
                unknown, self._chart.resolution, (float(self._start[0]), float(self._start[1]))
            )
        return trimmed(self._chart.map())

    def step(self, now: int) -> None:
        """Look at the newest scan, if it is a new one, as soon as its frames are known."""
        scan = self._robot.scan()
        if scan is None or scan.stamp == self.stamp:
            return
        _, odom, base = self._frames
        try:
            odometry = self._tree.lookup(odom, base, scan.stamp).to_pose()
            laser = self._tree.lookup(base, scan.frame, scan.stamp)
        except TransformError:
            return
        self.stamp = scan.stamp
        if self._last_seen is not None:
            self._travelled += float(np.hypot(odometry.x - self._last_seen.x, odometry.y - self._last_seen.y))
        self._last_seen = odometry
        self._sweeps = [*self._sweeps[1 - SWEEPS :], Sweep(scan, laser, odometry)]
        if self._is_key(odometry):
            self._take(key_scan(self._sweeps, self._travelled))
        self._publish()

    def _is_key(self, odometry: Pose2D) -> bool:
        if not self.scans:
            return len(self._sweeps) == SWEEPS
        last = self.scans[-1].odometry
        if far_apart(last, odometry, WAY, TURN):
            return True
        twist = self._robot.odometry().twist
        rests = abs(twist.v) < _STANDS and abs(twist.w) < _STANDS
        return rests and far_apart(last, odometry, WAY_AT_REST, TURN_AT_REST)

    def _take(self, scan: KeyScan) -> None:
        """Place a key scan, and draw it."""
        if self.graph is None:
            first = pose_to_row(self._sweeps[0].odometry)
            self.graph = PoseGraph(compose(self._start, relative_pose(first, pose_to_row(scan.odometry))))
            self.scans.append(scan)
        else:
            step = relative_pose(pose_to_row(self.scans[-1].odometry), pose_to_row(scan.odometry))
            self.graph.add(*self._matched(scan, step))
            self.scans.append(scan)
        graph = self.graph
        if self._closed() and graph.optimise() > _REDRAWN:
            self._chart.draw(self.scans, graph.poses)
        else:
            self._chart.add(scan, graph.poses[-1])
        placed_at = Transform.from_pose(row_to_pose(graph.poses[-1]))
        self.map_to_odom = placed_at * Transform.from_pose(scan.odometry).inverse()
        self.version += 1

    def _matched(self, scan: KeyScan, step: Floats) -> tuple[Floats, Floats]:
        """How *scan* lies as seen from the last one, and how sure that is; *step* is what the wheels say."""
        graph = self.graph
        assert graph is not None
        trust = PoseUncertainty(
            0.02 + 0.05 * float(np.hypot(step[0], step[1])), 0.01 + 0.06 * abs(float(step[2]))
        )
        prior, last = trust.information(), graph.poses[-1]
        guess = compose(last, step)
        if len(scan.outline.points) < FEWEST:
            return step, prior
        recent = [
            one.outline.at(at)
            for one, at in zip(self.scans[-RECENT:], graph.poses[-RECENT:], strict=True)
            if len(one.outline.points) and np.hypot(*(at[:2] - guess[:2])) < WITHIN
        ]
        if not recent:
            return step, prior
        walls = CorrelationGrid(recent)
        best = walls.search(guess, scan.outline.points[:: 2 * SWEEPS], NEARBY)
        found = walls.refine(best, scan.outline, guess, trust)
        if found.score < ALIKE:
            return step, prior
        return edge_from(last, MatchResult(found.pose, found.score, found.information + prior))

    def _closed(self) -> bool:
        """Close a loop with the newest scan, if there is one; whether there was."""
        graph = self.graph
        if self._finder is None or graph is None:
            return False
        loop = self._finder.find(self.scans, graph)
        if loop is None:
            return False
        first, found = loop
        graph.close(first, len(self.scans) - 1, *edge_from(graph.poses[first], found))
        self.loops_closed += 1
        return True

    def _publish(self) -> None:
        if self.graph is None:
            return
        map, odom, _ = self._frames
        placed_at = self.map_to_odom
        self._tree.set(
            TransformStamped(odom, map, placed_at.position, placed_at.quaternion, self.stamp), holds=HOLDS
        )
