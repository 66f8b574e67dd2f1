"""The localiser: adaptive Monte Carlo localisation as in Nav2, with pose validation and relocalisation."""

import math
from enum import Enum, auto

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_S
from btcore_navigation.distance_field import SignedDistanceField
from btcore_navigation.global_search import SearchSpace
from btcore_navigation.likelihood import LikelihoodField, beam_endpoints
from btcore_navigation.parameters import AmclParameters
from btcore_navigation.particles import (
    Cluster,
    best_cluster,
    resample,
    sample_motion_model,
    sample_particles,
)
from btcore_navigation.pose_validation import MIN_FIT, PoseValidator, contradicts_pose
from btcore_navigation.ray_casting import RayCaster
from btcore_navigation.relocalisation import Relocaliser
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import (
    BASE_FRAME,
    MAP_FRAME,
    ODOM_FRAME,
    LaserScan,
    Odometry,
    Pose2D,
    Robot,
    TransformStamped,
)
from btcore_robot.time_limits import MAX_ODOMETRY_AGE_S, is_stale
from btcore_robot.transform_filter import TransformFilter
from btcore_robot.transforms import TransformTree

__all__ = ["Localiser"]

INITIAL_DEVIATION = (0.5, 0.5, 0.26)
"""The standard deviation (m, m, rad) of a given pose (nav2_amcl's default)."""
FOUND_DEVIATION = (0.15, 0.15, 0.1)
"""The standard deviation (m, m, rad) of a pose that was found by relocalisation."""
OUTAGE_MATCH = (0.3, 0.15)
"""The standard deviation (m, rad) of a pose that is assumed after an outage of the odometry."""
MIN_BEAMS = 10
"""Scans with fewer valid beams are ignored."""
ODOMETRY_DEVIATION = (0.05, 0.05)
"""The standard deviation (m, rad) of odometry's motion since the last update, with some wheel slip."""
ODOMETRY_SCALES = (0.5, 0.3, 0.2, 0.15, 0.1, 0.1)
"""The scales (m) of `SignedDistanceField.match` for a match that starts at the pose by odometry.

They shrink faster than the default scales, so that people in front of a wall don't pull the pose.
"""
CLUSTER_LEAD = 0.1
"""The cluster's pose replaces the pose by odometry if the cluster's score is higher by more than this."""
LOST_LEAD = 0.2
"""The robot is lost if the score of another pose is higher by more than this."""
MIN_PRESENT_SCORE = 0.3
"""The robot is also lost if the score of the present pose is lower than this."""
DOUBT_PAUSE_NS = 5 * NS_PER_S
"""The time (ns) after a dismissed doubt in which no new doubt begins.

The time ends early when the scan fits the pose well again, or changes abruptly.
"""
_MIN_CLUSTER_DEVIATION = (0.1, 0.05)  # m, rad: the least standard deviation of a cluster's pose in a match
_MIN_WEIGHT = 0.01  # of a hypothesis that is displayed


class _State(Enum):
    TRACKING = auto()
    DOUBTING = auto()
    """The pose may be wrong: the robot stands while the map is searched for a better pose."""
    SEARCHING = auto()
    """The pose is unknown: the robot turns while the map is searched."""


class Localiser:
    """The robot's pose on a map, estimated from laser and odometry. `step` is a task for the schedule.

    The particle filter is the same as in nav2_amcl: differential motion model, likelihood field with the sum
    of cubes, an update after each `update_min_d` or `update_min_a`, KLD sampling, systematic resampling.
    The heaviest cluster of particles is accurate to a few cells. For a better estimate, odometry carries the
    pose from update to update, and a match with the surfaces of the map corrects the pose. If the scan
    contradicts the corrected pose, the cluster's pose replaces it.

    Each scan is also compared with the pose. If the scan contradicts the pose (see `PoseValidator`), the pose
    is in doubt, and the whole map is searched. If another pose explains the scan better, the robot is lost:
    `is_searching` is then True until a single pose has passed the comparison with several scans. People and
    objects that are not on the map cause at most a doubt, which is dismissed within a second.

    Without recent odometry the pose is unknown. When the odometry arrives again, the robot may have been
    moved in the meantime, or the odometry may have started anew. Either the last pose or the pose by odometry
    is assumed, whichever explains the scan better, and the assumed pose is in doubt until the search of the
    whole map has confirmed it.

    The navigation must stop the robot while `is_confident` is False. While `is_searching` is True, the
    navigation must turn the robot on the spot (for instance at 0.5 rad/s), because rooms that look alike in
    one direction differ in another direction. The robot may drive on once `is_confident` is True again. Until
    then, `pose` returns the last estimate, which may be wrong.

    Each scan sets the transform between `map` and `odom` in *tree*, with the scan's stamp. The transform
    stays valid for `transform_tolerance` (s) after that stamp.

    Args:
        robot: The robot.
        field_map: The map.
        random: The source of the samples.
        odometry_limit: The age (s) from which on the odometry has an outage.

    Attributes:
        parameters: The parameters of the filter.
        map_to_odom: The pose of `odom` in `map`.
        particles: The x, y (m) and yaw (rad) of every particle in the map, shape `(n, 3)`.
        weights: The particles' weights, shape `(n,)`; the sum is 1.
        covariance: The covariance of x, y and yaw over the heaviest cluster of particles.
        stamp: The stamp (ns) of the last scan that was processed.
    """

    def __init__(
        self,
        robot: Robot,
        field_map: OccupancyMap,
        tree: TransformTree,
        random: np.random.Generator,
        parameters: AmclParameters | None = None,
        odometry_limit: float = MAX_ODOMETRY_AGE_S,
    ) -> None:
        self.parameters = AmclParameters() if parameters is None else parameters
        settings = self.parameters
        self._odometry_limit = odometry_limit
        self._robot = robot
        self._tree = tree
        self._scans = TransformFilter[LaserScan](tree, ODOM_FRAME)
        self._random = random
        self._least_range = max(robot.laser_info.range_min, settings.laser_min_range)
        self._most_range = min(robot.laser_info.range_max, settings.laser_max_range)
        self._alphas = (settings.alpha1, settings.alpha2, settings.alpha3, settings.alpha4)
        self._use_map(field_map)
        self.map_to_odom = Transform()
        self._known_pose: tuple[Transform, Odometry | None, Pose2D]
        self._known_pose = (self.map_to_odom, None, Pose2D(0.0, 0.0, 0.0))
        self.particles: NDArray[np.float64] = np.zeros((0, 3))
        self.weights: NDArray[np.float64] = np.zeros(0)
        self.covariance: NDArray[np.float64] = np.zeros((3, 3))
        self.stamp = 0
        self._state = _State.TRACKING
        self._before_outage: Pose2D | None = None
        """The last pose before an outage of the odometry, until a scan after the outage is processed."""
        self._odometry_began: int | None = None
        """The stamp (ns) of the first odometry after an outage."""
        self._doubt_dismissed_at: int | None = None
        self._updated_at: Pose2D | None = None
        self._updates = 0
        self._is_confirmed = False
        """Whether a scan has confirmed the pose since it was set or found."""
        if settings.set_initial_pose:
            self.set_pose(Pose2D(settings.initial_pose_x, settings.initial_pose_y, settings.initial_pose_yaw))
        else:
            self.reinitialise_global_localisation()

    @property
    def is_confident(self) -> bool:
        """Whether the pose is reliable enough to drive.

        It is not while the pose is being searched for or is in doubt, and during an outage of the odometry.
        """
        return self._state is _State.TRACKING and self._before_outage is None

    @property
    def is_searching(self) -> bool:
        """Whether the whole map is being searched: the robot has to turn on the spot."""
        return self._state is _State.SEARCHING

    @property
    def is_contradicted(self) -> bool:
        """Whether the last scans contradict the pose, even if no other pose is known to be better."""
        return self._validator.is_contradicted

    def pose(self) -> Pose2D:
        """Return the pose of `base_footprint` in `map` by the last estimate and the newest odometry."""
        odometry = self._robot.odometry()
        map_to_odom, known_odometry, pose = self._known_pose
        # Clients ask more often than the odometry changes. Neither object changes its value.
        if odometry is not known_odometry or map_to_odom is not self.map_to_odom:
            pose = self._estimate(odometry.pose)
            self._known_pose = (self.map_to_odom, odometry, pose)
        return pose

    def change_map(self, field_map: OccupancyMap) -> None:
        """Replace the map, and keep the pose, which the next scans confirm or contradict.

        If the pose is unknown, the new map is searched for it.
        """
        self._use_map(field_map)
        if self.is_searching:
            self.reinitialise_global_localisation()
        else:
            self.set_pose(self.pose())

    def _use_map(self, field_map: OccupancyMap) -> None:
        self._field = LikelihoodField(field_map, self.parameters, self._most_range)
        self._visibility = RayCaster(field_map, self._most_range, self._robot.laser_info)
        self._surfaces = SignedDistanceField(field_map, self._robot.laser_info, self._visibility)
        self._validator = PoseValidator(self._surfaces, self._visibility)
        self._relocaliser = Relocaliser(SearchSpace(field_map), self._surfaces, self._visibility)
        self._free = np.argwhere(field_map.free)
        self._map = field_map

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64] | None = None) -> None:
        """Set the robot's present pose.

        Args:
            pose: The robot's pose in the frame map.
            covariance: The covariance of x, y and yaw, shape `(3, 3)`; by default from INITIAL_DEVIATION.
        """
        if self._before_outage is not None:
            self._before_outage = pose
        spread = np.diag(np.square(INITIAL_DEVIATION)) if covariance is None else covariance
        self._settle(pose, self._robot.odometry().pose, spread)

    def reinitialise_global_localisation(self) -> None:
        """Discard the pose and search the whole map (nav2_amcl's `reinitialize_global_localization`)."""
        self._begin_search()
        self._relocaliser.restart()
        count = self.parameters.max_particles
        chosen = self._free[self._random.integers(len(self._free), size=count)]
        self.particles = np.empty((count, 3))
        self.particles[:, :2] = self._map.centers(chosen[:, 0], chosen[:, 1])
        self.particles[:, 2] = self._random.uniform(-math.pi, math.pi, count)
        self.weights = np.full(count, 1.0 / count)

    def step(self, now: int) -> None:
        """Process the newest scan whose transforms are available, unless it was processed before."""
        newest = self._robot.odometry()
        if is_stale(newest, now, self._odometry_limit):
            if self._before_outage is None:
                self._before_outage = self._estimate(newest.pose)
            self._odometry_began = None
            return
        if self._odometry_began is None:
            self._odometry_began = newest.stamp
        scan = self._scans.newest(self._robot.scan())
        if scan is None or scan.stamp == self.stamp:
            return
        if self._before_outage is not None and scan.stamp < self._odometry_began:
            return  # taken during the outage: its pose by odometry is not known
        settings = self.parameters
        odometry = self._tree.lookup(ODOM_FRAME, BASE_FRAME, scan.stamp).to_pose()
        laser = self._tree.lookup(BASE_FRAME, scan.frame, scan.stamp)
        self.stamp = scan.stamp
        laser_xy = (laser.position[0], laser.position[1])
        points = laser.apply(beam_endpoints(scan, settings.max_beams, self._least_range, self._most_range))
        if len(points) >= MIN_BEAMS:
            if self._before_outage is not None:
                self._assume_pose(self._before_outage, points, laser_xy, odometry)
                self._before_outage = None
            if self.is_searching:
                self._search(points, laser_xy, odometry)
            else:
                self._validate(scan, points, laser_xy, odometry)
                if self._state is _State.TRACKING:
                    self._track(scan, points, laser, odometry)
        self._publish()

    def _estimate(self, odometry: Pose2D) -> Pose2D:
        return (self.map_to_odom * Transform.from_pose(odometry)).to_pose()

    def _set_estimate(self, pose: Pose2D, odometry: Pose2D) -> None:
        self.map_to_odom = Transform.from_pose(pose) * Transform.from_pose(odometry).inverse()

    def _settle(self, pose: Pose2D, odometry: Pose2D, covariance: NDArray[np.float64]) -> None:
        """Accept *pose*, which belongs to the pose *odometry* in odom, and end every search and doubt."""
        count = self.parameters.max_particles
        self.particles = sample_particles(pose, covariance, count, self._random)
        self.weights = np.full(count, 1.0 / count)
        self.covariance = covariance
        self._set_estimate(pose, odometry)
        self._updated_at = None
        self._updates = 0
        self._is_confirmed = False
        self._validator.reset()
        self._relocaliser.restart()
        self._doubt_dismissed_at = None
        self._state = _State.TRACKING

    def _assume_pose(
        self, before: Pose2D, points: NDArray[np.float64], laser_xy: tuple[float, float], odometry: Pose2D
    ) -> None:
        """Assume a pose after an outage of the odometry, and begin a doubt. *before* is the last pose."""
        if self.is_searching:
            self._relocaliser.restart()
            return
        poses = [self._estimate(odometry), before]
        matched = [
            self._surfaces.match(pose, points, laser_xy, deviation=OUTAGE_MATCH).pose for pose in poses
        ]
        views = self._visibility.agreement(matched, laser_xy, points)
        best = matched[0] if views[0].score >= views[1].score else matched[1]
        self._settle(best, odometry, np.diag(np.square(INITIAL_DEVIATION)))
        self._state = _State.DOUBTING

    def _begin_search(self) -> None:
        self._state = _State.SEARCHING
        self._validator.reset()

    def _search(self, points: NDArray[np.float64], laser_xy: tuple[float, float], odometry: Pose2D) -> None:
        pose = self._relocaliser.process_scan(points, laser_xy, odometry, self.stamp)
        if pose is not None:
            self._settle(pose, odometry, np.diag(np.square(FOUND_DEVIATION)))
        elif self._relocaliser.hypotheses:
            self._show_hypotheses()

    def _show_hypotheses(self) -> None:
        """Spread the particles over the hypotheses; only displays use them while the robot searches."""
        hypotheses = self._relocaliser.hypotheses
        count = max(1, self.parameters.min_particles // len(hypotheses))
        spread = np.diag(np.square(FOUND_DEVIATION))
        samples = [
            sample_particles(hypothesis.pose, spread, count, self._random) for hypothesis in hypotheses
        ]
        self.particles = np.concatenate(samples)
        self.weights = np.repeat([max(hypothesis.score, _MIN_WEIGHT) for hypothesis in hypotheses], count)
        self.weights /= self.weights.sum()

    def _validate(
        self, scan: LaserScan, points: NDArray[np.float64], laser_xy: tuple[float, float], odometry: Pose2D
    ) -> None:
        """Compare the scan with the pose: begin a doubt, or examine a doubt that has begun."""
        estimate = self._estimate(odometry)
        self._validator.add_scan(scan, points, laser_xy, odometry, estimate)
        if self._doubt_dismissed_at is not None:
            is_recent = self.stamp - self._doubt_dismissed_at < DOUBT_PAUSE_NS
            if is_recent and self._validator.fit < MIN_FIT and not self._validator.has_scan_jumped:
                return
            self._doubt_dismissed_at = None
        if self._validator.is_doubtful:
            self._state = _State.DOUBTING
        if self._state is _State.DOUBTING:
            self._relocaliser.process_scan(points, laser_xy, odometry, self.stamp)
            if self._relocaliser.hypotheses:
                self._resolve_doubt(laser_xy)

    def _resolve_doubt(self, laser_xy: tuple[float, float]) -> None:
        """Decide a doubt after the search of the map: dismiss the doubt, or treat the robot as lost."""
        best = self._relocaliser.hypotheses[0]
        present = self._relocaliser.add_hypothesis(self._estimate(self._relocaliser.odometry), laser_xy)
        if best.is_near(present):
            self._set_estimate(best.pose, self._relocaliser.odometry)
            present = best
        if present.score >= best.score - LOST_LEAD and present.score >= MIN_PRESENT_SCORE:
            self._relocaliser.restart()
            self._validator.reset()
            self._state, self._doubt_dismissed_at = _State.TRACKING, self.stamp
        else:
            self._begin_search()

    def _track(
        self, scan: LaserScan, points: NDArray[np.float64], laser: Transform, odometry: Pose2D
    ) -> None:
        """Move and weigh the particles when the robot has moved enough, and correct the pose."""
        settings, last = self.parameters, self._updated_at
        if last is not None:
            if not (
                abs(odometry.x - last.x) > settings.update_min_d
                or abs(odometry.y - last.y) > settings.update_min_d
                or abs(wrap_angle(odometry.yaw - last.yaw)) > settings.update_min_a
            ):
                return
            self.particles = sample_motion_model(self.particles, last, odometry, self._alphas, self._random)
        self._updated_at = odometry
        weights = self.weights * self._field.weights(self.particles, points)
        self.weights = weights / weights.sum()
        cluster = best_cluster(self.particles, self.weights)
        self.covariance = cluster.covariance
        self._updates += 1
        if self._updates % settings.resample_interval == 0:
            self._resample()
        # The match uses twice the beams: unlike the particles it runs for a single pose.
        dense = laser.apply(beam_endpoints(scan, 2 * settings.max_beams, self._least_range, self._most_range))
        laser_xy = (laser.position[0], laser.position[1])
        self._set_estimate(self._correct_estimate(dense, laser_xy, odometry, cluster), odometry)

    def _resample(self) -> None:
        settings = self.parameters
        self.particles = resample(
            self.particles,
            self.weights,
            self._random,
            err=settings.pf_err,
            z=settings.pf_z,
            least=settings.min_particles,
            most=settings.max_particles,
        )
        self.weights = np.full(len(self.particles), 1.0 / len(self.particles))

    def _correct_estimate(
        self, points: NDArray[np.float64], laser_xy: tuple[float, float], odometry: Pose2D, cluster: Cluster
    ) -> Pose2D:
        """Return the pose by odometry since the last update, corrected by a match with the surfaces.

        The cluster's pose is returned instead if it fits better, and if the scan contradicts the corrected
        pose or no scan has confirmed it yet.
        """
        estimate, open_points = self._estimate(odometry), points
        # People in the way would pull the match: leave out the beams that they shorten.
        if self._is_confirmed and self._surfaces.fit(estimate, points) < MIN_FIT:
            open_points = points[self._visibility.unobstructed_beams(estimate, laser_xy, points)]
        carried = self._surfaces.match(
            estimate, open_points, laser_xy, deviation=ODOMETRY_DEVIATION, scales=ODOMETRY_SCALES
        )
        if carried.share >= MIN_FIT:
            self._is_confirmed = True
            return carried.pose
        if self._is_confirmed:
            present = self._visibility.agreement([carried.pose], laser_xy, points[::2])[0]
            if not contradicts_pose(present):
                return carried.pose
        rematched = self._match_cluster(points, laser_xy, cluster)
        views = self._visibility.agreement([carried.pose, rematched], laser_xy, points[::2])
        return rematched if views[1].score > views[0].score + CLUSTER_LEAD else carried.pose

    def _match_cluster(
        self, points: NDArray[np.float64], laser_xy: tuple[float, float], cluster: Cluster
    ) -> Pose2D:
        deviation = np.sqrt(np.diag(cluster.covariance))
        prior = (
            max(_MIN_CLUSTER_DEVIATION[0], float(deviation[:2].max())),
            max(_MIN_CLUSTER_DEVIATION[1], float(deviation[2])),
        )
        return self._surfaces.match(cluster.pose, points, laser_xy, deviation=prior).pose

    def _publish(self) -> None:
        if not self.parameters.tf_broadcast:
            return
        pose = self.map_to_odom
        self._tree.set(
            TransformStamped(ODOM_FRAME, MAP_FRAME, pose.position, pose.quaternion, self.stamp),
            holds=int(self.parameters.transform_tolerance * NS_PER_S),
        )
