"""The localiser: adaptive Monte Carlo localisation by Nav2's rules, which notices when it is wrong."""

import math

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.distance_field import SignedDistanceField
from btcore_robot.navigation.global_search import SearchSpace
from btcore_robot.navigation.likelihood import LikelihoodField, beams
from btcore_robot.navigation.motion_model import sample_motion_model
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.navigation.parameters import AmclParameters
from btcore_robot.navigation.particles import Cluster, best_cluster, cloud, resampled
from btcore_robot.navigation.pose_validation import FITS, PoseValidator, contradicted
from btcore_robot.navigation.ray_casting import RayCaster
from btcore_robot.navigation.relocalisation import Relocaliser
from btcore_robot.rigid_transform import Transform, wrap_angle
from btcore_robot.robot import NS_PER_S, LaserScan, Pose2D, Robot, TransformStamped
from btcore_robot.transforms import TransformError, TransformTree

INITIAL_DEVIATION = (0.5, 0.5, 0.26)
"""How sure (m, m, rad; one deviation) a given pose is taken to be (nav2_amcl)."""
FOUND_DEVIATION = (0.15, 0.15, 0.1)
"""The same for a pose that was searched and found."""
FEWEST_BEAMS = 10
"""From fewer beams than that nothing is concluded."""
CARRIED_DEVIATION = (0.05, 0.05)
"""How far off (m, rad; one deviation) odometry is from one update to the next, with a few percent of slip."""
CARRIED_SCALES = (0.5, 0.3, 0.2, 0.15, 0.1, 0.1)
"""The scales (m) for matching from there: narrow, so that who stands before a wall doesn't pull it."""
CLUSTER_AHEAD = 0.1
"""By how much the cluster has to explain a scan better than odometry for its pose to be taken instead."""
BETTER_BY = 0.2
"""By how much another place has to explain a scan better than the present one for the robot to be lost."""
BEARABLE = 0.3
"""The least score of a present pose that is kept when no other place explains the scan better."""
SETTLED_FOR = 5 * NS_PER_S
"""After a doubt was dismissed it is not raised again for so long (ns), unless the fit was good in between."""


class Localiser:
    """Where the robot is on a map, by its laser and odometry. `step` belongs on the schedule.

    The particles are Nav2's: differential motion model, likelihood field with its cube sum, an update after
    each ``update_min_d`` or ``update_min_a``, KLD sampling with systematic resampling. Their heaviest cluster
    is good to a few cells; so the pose that is told is carried on by odometry from update to update and
    fitted to the faces of what is mapped. Where it is contradicted, the cluster takes its place.

    Each scan is also held against the pose. When too few beams end on what is mapped the pose is in doubt:
    the whole map is searched, and if another place explains the scan better the robot is `lost`. Then it is
    `searching` until one place has stood the test of several views. Whoever drives the robot has to stop it
    while `confident` is False, and, while `searching`, to turn it on the spot (at 0.5 rad/s, say), as rooms
    that look alike on one side differ on the other; once `confident` is True again it may go on. `pose` gives
    the last belief meanwhile, which may be wrong. People and things that are not on the map raise a doubt at
    most, which is settled within a second.

    It tells *tree* where ``odom`` is in ``map`` with each scan, as of the scan's stamp; that counts for
    ``transform_tolerance`` longer.
    """

    def __init__(
        self,
        robot: Robot,
        field_map: OccupancyMap,
        tree: TransformTree,
        random: np.random.Generator,
        parameters: AmclParameters | None = None,
    ) -> None:
        self.parameters = AmclParameters() if parameters is None else parameters
        given = self.parameters
        self._robot = robot
        self._tree = tree
        self._random = random
        self._least_range = max(robot.laser.range_min, given.laser_min_range)
        self._most_range = min(robot.laser.range_max, given.laser_max_range)
        self._field = LikelihoodField(
            field_map,
            sigma_hit=given.sigma_hit,
            z_hit=given.z_hit,
            z_rand=given.z_rand,
            max_distance=given.laser_likelihood_max_dist,
            range_max=self._most_range,
        )
        self._faces = SignedDistanceField(field_map)
        self._visibility = RayCaster(field_map, self._most_range)
        self._doubt = PoseValidator(self._faces, self._visibility)
        self._relocation = Relocaliser(SearchSpace(field_map), self._faces, self._visibility)
        self._alphas = (given.alpha1, given.alpha2, given.alpha3, given.alpha4)
        self._free = np.argwhere(field_map.free)
        self._map = field_map
        self.map_to_odom = Transform()
        """Where ``odom`` is in ``map``."""
        self.particles: NDArray[np.float64] = np.zeros((0, 3))
        """x, y (m) and yaw (rad) of every particle in the map, shape ``(n, 3)``."""
        self.weights: NDArray[np.float64] = np.zeros(0)
        """Their weights, shape ``(n,)``; the sum is 1."""
        self.covariance: NDArray[np.float64] = np.zeros((3, 3))
        """Of x, y and yaw over the heaviest cluster of particles."""
        self.stamp = 0
        """The stamp (ns) of the last scan that was looked at."""
        self.lost = False
        """Whether the robot is known to be somewhere else than it was taken to be."""
        self.searching = False
        """Whether the whole map is being searched: the robot has to turn on the spot."""
        self._doubting = False
        self._dismissed: int | None = None
        self._updated_at: Pose2D | None = None
        self._updates = 0
        self._confirmed = False
        if given.set_initial_pose:
            self.set_pose(Pose2D(given.initial_pose_x, given.initial_pose_y, given.initial_pose_yaw))
        else:
            self.global_localisation()

    @property
    def confident(self) -> bool:
        """Whether the pose may be driven by: neither lost nor searching, nor in doubt."""
        return not (self.lost or self.searching or self._doubting)

    @property
    def contradicted(self) -> bool:
        """Whether the last scans speak against the pose, though perhaps no other place is better."""
        return self._doubt.contradicted

    @property
    def fit(self) -> float:
        """The share (0 … 1) of the beams that end on what is mapped, over the last scans."""
        return self._doubt.fit

    def pose(self) -> Pose2D:
        """Where ``base_footprint`` is in ``map`` now, by the last belief and the newest odometry."""
        return (self.map_to_odom * Transform.from_pose(self._robot.odometry().pose)).to_pose()

    def set_pose(self, pose: Pose2D, covariance: NDArray[np.float64] | None = None) -> None:
        """The robot is at *pose* in the map now, with *covariance* (x, y, yaw; ``(3, 3)``)."""
        spread = np.diag(np.square(INITIAL_DEVIATION)) if covariance is None else covariance
        self._settle(pose, self._robot.odometry().pose, spread)

    def global_localisation(self) -> None:
        """Forget the pose, and search the whole map for it."""
        self._begin_search()
        self._relocation.restart()
        count = self.parameters.max_particles
        chosen = self._free[self._random.integers(len(self._free), size=count)]
        self.particles = np.empty((count, 3))
        self.particles[:, :2] = self._map.centers(chosen[:, 0], chosen[:, 1])
        self.particles[:, 2] = self._random.uniform(-math.pi, math.pi, count)
        self.weights = np.full(count, 1.0 / count)

    def step(self, now: int) -> None:
        """Look at the newest scan, if it is a new one, as soon as its frames are known."""
        scan = self._robot.scan()
        if scan is None or scan.stamp == self.stamp:
            return
        names = self.parameters
        try:
            odometry = self._tree.lookup(names.odom_frame_id, names.base_frame_id, scan.stamp).to_pose()
            laser = self._tree.lookup(names.base_frame_id, scan.frame, scan.stamp)
        except TransformError:
            return
        self.stamp = scan.stamp
        eye = (laser.position[0], laser.position[1])
        points = laser.apply(beams(scan, names.max_beams, self._least_range, self._most_range))
        if len(points) >= FEWEST_BEAMS:
            if self.searching:
                self._search(points, eye, odometry)
            else:
                self._watch(scan, points, eye, odometry)
                self._track(scan, points, laser, odometry)
        self._publish()

    def _believed(self, odometry: Pose2D) -> Pose2D:
        return (self.map_to_odom * Transform.from_pose(odometry)).to_pose()

    def _believe(self, pose: Pose2D, odometry: Pose2D) -> None:
        self.map_to_odom = Transform.from_pose(pose) * Transform.from_pose(odometry).inverse()

    def _settle(self, pose: Pose2D, odometry: Pose2D, covariance: NDArray[np.float64]) -> None:
        """Be sure of *pose*, at *odometry*."""
        count = self.parameters.max_particles
        self.particles = cloud(pose, covariance, count, self._random)
        self.weights = np.full(count, 1.0 / count)
        self.covariance = covariance
        self._believe(pose, odometry)
        self._updated_at = None
        self._updates = 0
        self._confirmed = False
        self._doubt.forget()
        self._relocation.restart()
        self._dismissed = None
        self.lost = self.searching = self._doubting = False

    def _begin_search(self) -> None:
        self.searching, self._doubting = True, False
        self._doubt.forget()

    def _search(self, points: NDArray[np.float64], eye: tuple[float, float], odometry: Pose2D) -> None:
        found = self._relocation.see(points, eye, odometry, self.stamp)
        if found is not None:
            self._settle(found, odometry, np.diag(np.square(FOUND_DEVIATION)))
        elif self._relocation.places:
            self._show_places()

    def _show_places(self) -> None:
        """Let the particles stand for the places where the robot may be."""
        places = self._relocation.places
        each = max(1, self.parameters.min_particles // len(places))
        spread = np.diag(np.square(FOUND_DEVIATION))
        self.particles = np.concatenate([cloud(one.pose, spread, each, self._random) for one in places])
        self.weights = np.repeat([max(one.score, 0.01) for one in places], each)
        self.weights /= self.weights.sum()

    def _watch(
        self, scan: LaserScan, points: NDArray[np.float64], eye: tuple[float, float], odometry: Pose2D
    ) -> None:
        """Hold the scan against the pose; raise a doubt, settle it, or be lost."""
        raised = self._doubt.is_pose_doubtful(scan, points, eye, odometry, self._believed(odometry))
        if self._dismissed is not None:
            recent = self.stamp - self._dismissed < SETTLED_FOR
            if recent and self._doubt.fit < FITS and not self._doubt.jumped:
                return
            self._dismissed = None
        if raised or self._doubting:
            self._doubting = True
            self._relocation.see(points, eye, odometry, self.stamp)
            if self._relocation.places:
                self._judge(eye)

    def _judge(self, eye: tuple[float, float]) -> None:
        """The map was searched because of a doubt: is another place better than the one believed in?"""
        best = self._relocation.best
        assert best is not None
        present = self._relocation.consider(self._believed(self._relocation.odometry), eye)
        if best.near(present):
            self._believe(best.pose, self._relocation.odometry)
            present = best
        if present.score >= best.score - BETTER_BY and present.score >= BEARABLE:
            self._relocation.restart()
            self._doubt.forget()
            self._doubting, self._dismissed = False, self.stamp
        else:
            self.lost = True
            self._begin_search()

    def _track(
        self, scan: LaserScan, points: NDArray[np.float64], laser: Transform, odometry: Pose2D
    ) -> None:
        """Move and weigh the particles when the robot has moved enough, and correct the pose."""
        given, last = self.parameters, self._updated_at
        if self.searching or self._doubting:
            return
        if last is not None:
            if not (
                abs(odometry.x - last.x) > given.update_min_d
                or abs(odometry.y - last.y) > given.update_min_d
                or abs(wrap_angle(odometry.yaw - last.yaw)) > given.update_min_a
            ):
                return
            self.particles = sample_motion_model(self.particles, last, odometry, self._alphas, self._random)
        self._updated_at = odometry
        weights = self.weights * self._field.weights(self.particles, points)
        self.weights = weights / weights.sum()
        cluster = best_cluster(self.particles, self.weights)
        self.covariance = cluster.covariance
        self._updates += 1
        if self._updates % given.resample_interval == 0:
            self._resample()
        dense = laser.apply(beams(scan, 2 * given.max_beams, self._least_range, self._most_range))
        eye = (laser.position[0], laser.position[1])
        self._believe(self._corrected(dense, eye, odometry, cluster), odometry)

    def _resample(self) -> None:
        given = self.parameters
        self.particles = resampled(
            self.particles,
            self.weights,
            self._random,
            err=given.pf_err,
            z=given.pf_z,
            least=given.min_particles,
            most=given.max_particles,
        )
        self.weights = np.full(len(self.particles), 1.0 / len(self.particles))

    def _corrected(
        self, points: NDArray[np.float64], eye: tuple[float, float], odometry: Pose2D, cluster: Cluster
    ) -> Pose2D:
        """The pose by odometry since the last update, moved to where the beams end on faces.

        The cluster takes its place when that is contradicted, or has yet to be confirmed, and it fits better.
        """
        believed, open_points = self._believed(odometry), points
        if self._confirmed and self._faces.fit(believed, points) < FITS:
            open_points = points[self._visibility.unhindered(believed, eye, points)]
        carried = self._faces.match(
            believed, open_points, eye, trust=CARRIED_DEVIATION, scales=CARRIED_SCALES
        )
        if carried.share >= FITS:
            self._confirmed = True
            return carried.pose
        if self._confirmed:
            present = self._visibility.agreement([carried.pose], eye, points[::2])[0]
            if not contradicted(present):
                return carried.pose
        deviation = np.sqrt(np.diag(cluster.covariance))
        trust = (max(0.1, float(deviation[:2].max())), max(0.05, float(deviation[2])))
        other = self._faces.match(cluster.pose, points, eye, trust=trust)
        views = self._visibility.agreement([carried.pose, other.pose], eye, points[::2])
        return other.pose if views[1].score > views[0].score + CLUSTER_AHEAD else carried.pose

    def _publish(self) -> None:
        if not self.parameters.tf_broadcast:
            return
        names, placed = self.parameters, self.map_to_odom
        self._tree.set(
            TransformStamped(
                names.odom_frame_id, names.global_frame_id, placed.position, placed.quaternion, self.stamp
            ),
            holds=int(names.transform_tolerance * NS_PER_S),
        )
