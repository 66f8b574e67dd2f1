"""The localiser of a robot with inaccurate odometry, in a flat of three rooms."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from btcore_navigation.localiser import Localiser
from btcore_navigation.parameters import AmclParameters
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.robot import LaserInfo, LaserScan, Odometry, Pose2D, TransformStamped, Twist2D
from btcore_robot.transforms import FrameBroadcaster, TransformTree
from tests.robot_nodes.navigation.conftest import LASER_X, Box, box_distances

SECOND = 1_000_000_000
WALLS = (  # x and y from, to (m): a flat of 12 m × 8 m
    (0.0, 0.0, 12.0, 0.2), (0.0, 7.8, 12.0, 8.0), (0.0, 0.0, 0.2, 8.0), (11.8, 0.0, 12.0, 8.0),
    (5.0, 0.0, 5.2, 3.0), (5.0, 4.5, 5.2, 8.0), (5.2, 5.0, 8.5, 5.2), (9.8, 5.0, 12.0, 5.2),
    (1.0, 1.0, 2.2, 1.6), (0.2, 5.5, 1.2, 7.0), (7.5, 1.5, 8.3, 2.3), (10.8, 2.0, 11.8, 3.4),
    (6.0, 7.0, 7.5, 7.8),
)  # fmt: skip
HALL = (  # a hall of 34 m with thin walls, at the edge of its map
    (0.0, 0.0, 34.0, 0.1), (0.0, 33.9, 34.0, 34.0), (0.0, 0.0, 0.1, 34.0), (33.9, 0.0, 34.0, 34.0),
    (31.0, 31.0, 33.0, 32.0), (2.0, 2.0, 3.0, 5.0),
)  # fmt: skip
START = Pose2D(3.0, 4.0, 0.0)


class NoisyRobot:
    """A robot among *walls* whose laser has noise, and odometry errors (left wheel 2 %, turns 5 %)."""

    def __init__(
        self,
        seed: int = 0,
        walls: tuple[Box, ...] = WALLS,
        start: Pose2D = START,
        range_noise: float = 0.0,
    ) -> None:
        self.walls = walls
        self.random = np.random.default_rng(seed)
        self.time = 0
        self.true = [start.x, start.y, start.yaw]
        self.reported = [0.0, 0.0, 0.0]
        self.people = []
        step = math.radians(220.0) / 665
        self.laser_info = LaserInfo(
            666, -math.radians(110.0), step, 0.05, 25.0, 10.0, 0.06, "laser", range_noise
        )
        self.newest = None

    def odometry(self):
        return Odometry(Pose2D(*self.reported), Twist2D(0.0, 0.0), self.time)

    def frames(self):
        unrotated = (0.0, 0.0, 0.0, 1.0)
        return [TransformStamped("laser", "base_footprint", (LASER_X, 0.0, 0.1), unrotated, self.time)]

    moving_frames = frames

    def scan(self):
        return self.newest

    def drive(self, v: float, w: float, seconds: float) -> None:
        self.time += round(seconds * SECOND)
        left, right = 1.02 * (v - 0.2 * w), v + 0.2 * w
        wrong = ((left + right) / 2, (right - left) / 0.4 * 1.05)
        for pose, (speed, turn) in ((self.true, (v, w)), (self.reported, wrong)):
            pose[2] += turn * seconds
            pose[0] += speed * math.cos(pose[2]) * seconds
            pose[1] += speed * math.sin(pose[2]) * seconds

    def update_scan(self) -> None:
        x, y, yaw = self.true
        info = self.laser_info
        angles = yaw + info.angle_min + info.angle_increment * np.arange(info.rays)
        x, y = x + LASER_X * math.cos(yaw), y + LASER_X * math.sin(yaw)
        people = ((a - 0.25, b - 0.25, a + 0.25, b + 0.25) for a, b in self.people)
        ranges = box_distances((*self.walls, *people), x, y, angles)
        ranges += self.random.normal(0.0, 1.0, info.rays) * info.deviation(ranges)
        ranges[ranges < info.range_min] = -np.inf
        ranges[ranges > info.range_max] = np.inf
        self.newest = LaserScan(
            ranges.astype(np.float32), self.time, info.angle_min, info.angle_increment, 0.05, 25.0, info.frame
        )


def drawn(walls: tuple[Box, ...], length: float, width: float) -> OccupancyMap:
    cells = np.zeros((round(width / 0.05), round(length / 0.05)), dtype=np.uint8)
    for box in walls:
        low, high = (round(box[0] / 0.05), round(box[1] / 0.05)), (round(box[2] / 0.05), round(box[3] / 0.05))
        cv2.rectangle(cells, low, (high[0] - 1, high[1] - 1), 100, -1)
    return OccupancyMap(cells.astype(np.int8), 0.05, (0.0, 0.0))


FLAT = drawn(WALLS, 12.0, 8.0)
AT_START = AmclParameters(initial_pose_x=START.x, initial_pose_y=START.y)


class LocaliserRig:
    """A driving robot and its localiser, stepped at 10 Hz."""

    def __init__(
        self, parameters: AmclParameters = AT_START, seed: int = 0, field_map: OccupancyMap = FLAT, **robot
    ) -> None:
        self.robot = NoisyRobot(seed, **robot)
        self.transforms = TransformTree()
        self.frames = FrameBroadcaster(self.robot, self.transforms)
        self.localiser = Localiser(
            self.robot, field_map, self.transforms, np.random.default_rng([seed, 1]), parameters
        )

    def go(self, v: float, w: float, seconds: float):
        """Drive with a velocity; return the error (m, rad) after each step."""
        errors = []
        for _ in range(round(seconds * 10)):
            self.step(v, w)
            errors.append(self.error())
        return np.array(errors)

    def step(self, v: float, w: float) -> None:
        for _ in range(5):
            self.robot.drive(v, w, 0.02)
            self.frames.step(self.robot.time)
        self.robot.update_scan()
        self.localiser.step(self.robot.time)

    def error(self):
        reported, (x, y, yaw) = self.localiser.pose(), self.robot.true
        return math.hypot(reported.x - x, reported.y - y), abs(
            math.remainder(reported.yaw - yaw, 2 * math.pi)
        )

    def turn_and_drive(self):
        """Turn once, and drive into another room."""
        return np.concatenate([self.go(0.0, 0.5, 12.6), self.go(0.3, 0.0, 17.0)])

    def until_found(self, seconds: float = 60.0) -> float:
        """Stand during doubt, turn during the search; return the seconds until the localiser is confident."""
        for step in range(round(seconds * 10)):
            self.step(0.0, 0.5 if self.localiser.is_searching else 0.0)
            if self.localiser.is_confident:
                return step / 10
        return math.inf


def test_a_robot_in_a_large_hall_knows_its_pose_although_noise_grows_with_the_range() -> None:
    """At 17 m the noise has a standard deviation of 18 cm, more than the thickness of the walls."""
    start = Pose2D(17.0, 17.0, 0.0)
    parameters = AmclParameters(initial_pose_x=start.x, initial_pose_y=start.y)
    hall = drawn(HALL, 34.0, 34.0)
    rig = LocaliserRig(parameters, field_map=hall, walls=HALL, start=start, range_noise=0.01)
    errors, confident, fits = [], [], []
    for v, w, seconds in ((0.3, 0.0, 5.0), (0.0, 0.5, 3.0), (0.3, 0.0, 3.0)):
        for _ in range(round(seconds * 10)):
            rig.step(v, w)
            errors.append(rig.error()[0])
            confident.append(rig.localiser.is_confident)
            fits.append(rig.localiser._validator.fit)
    assert all(confident)
    assert min(fits) > 0.97
    assert np.mean(errors) < 0.08
    assert max(errors) < 0.15
    rig.robot.true[:2] = 24.0, 20.0  # kidnapped
    for _ in range(20):
        rig.step(0.0, 0.0)
    assert not rig.localiser.is_confident


def test_the_pose_is_accurate_to_centimetres_while_odometry_drifts() -> None:
    rig = LocaliserRig()
    errors = rig.turn_and_drive()
    drift = Pose2D(*rig.robot.reported)
    true_x, true_y, _ = rig.robot.true
    assert math.hypot(START.x + drift.x - true_x, START.y + drift.y - true_y) > 1.0
    assert np.median(errors[:, 0]) < 0.05
    assert errors.max(axis=0)[0] < 0.15
    assert errors.max(axis=0)[1] < 0.08
    assert rig.localiser.is_confident


def test_the_same_seed_gives_the_same_particles() -> None:
    first, second, different = (LocaliserRig(seed=seed) for seed in (4, 4, 5))
    for rig in (first, second, different):
        rig.go(0.2, 0.3, 5.0)
    assert np.array_equal(first.localiser.particles, second.localiser.particles)
    assert first.localiser.pose() == second.localiser.pose()
    assert not np.array_equal(first.localiser.particles[:400], different.localiser.particles[:400])


def test_the_number_of_particles_is_limited_and_only_motion_updates_them() -> None:
    rig = LocaliserRig()
    rig.go(0.0, 0.0, 1.0)
    before = rig.localiser.particles
    assert 500 <= len(before) <= 2000
    rig.go(0.0, 0.0, 5.0)
    assert rig.localiser.particles is before
    rig.go(0.3, 0.0, 1.0)
    assert rig.localiser.particles is not before
    assert rig.localiser.weights.sum() == pytest.approx(1.0)


def test_a_rough_initial_pose_is_refined() -> None:
    rig = LocaliserRig(
        replace(AT_START, initial_pose_x=START.x + 0.3, initial_pose_y=START.y - 0.2, initial_pose_yaw=0.15)
    )
    rig.go(0.0, 0.0, 2.0)
    rig.go(0.0, 0.5, 6.0)
    assert rig.error()[0] < 0.1
    assert rig.error()[1] < 0.05


def test_map_to_odom_has_the_scans_time_and_is_valid_for_the_tolerance() -> None:
    rig = LocaliserRig()
    rig.go(0.3, 0.0, 2.0)
    stamp = rig.robot.newest.stamp
    reported = rig.transforms.lookup("map", "base_footprint", stamp).to_pose()
    assert (reported.x, reported.y) == pytest.approx((rig.localiser.pose().x, rig.localiser.pose().y))
    assert rig.transforms.lookup("map", "odom", stamp + SECOND) == rig.localiser.map_to_odom
    assert not rig.transforms.can_transform("map", "odom", stamp + SECOND + 1)


def test_between_two_scans_the_pose_follows_odometry() -> None:
    rig = LocaliserRig()
    rig.go(0.3, 0.0, 2.0)
    before = rig.localiser.pose()
    rig.robot.drive(0.3, 0.0, 0.1)
    assert rig.localiser.pose().x - before.x == pytest.approx(0.03, abs=0.005)


def test_scans_without_echoes_do_not_change_the_particles() -> None:
    rig = LocaliserRig()
    rig.go(0.3, 0.0, 1.0)
    rig.robot.update_scan = lambda: None
    empty = replace(rig.robot.newest, ranges=np.full(666, np.inf, dtype=np.float32))
    particles = rig.localiser.particles
    for _ in range(30):
        rig.robot.newest = replace(empty, stamp=rig.robot.time + SECOND // 10)
        rig.step(0.3, 0.0)
    assert rig.localiser.particles is particles
    assert rig.localiser.is_confident
    assert rig.error()[0] < 0.1


@pytest.mark.parametrize("seed", [0, 3])
def test_kidnapping_is_noticed_at_once_and_the_pose_is_found_again(seed: int) -> None:
    rig = LocaliserRig(seed=seed)
    rig.go(0.3, 0.0, 4.0)
    random = np.random.default_rng(seed)
    places = [(2.5, 6.5), (6.5, 3.5), (10.0, 6.5), (9.5, 1.2)]
    rig.robot.true = [*places[seed], random.uniform(-math.pi, math.pi)]
    steps = 0
    while rig.localiser.is_confident:
        rig.step(0.3, 0.0)
        steps += 1
        assert steps <= 5
    assert rig.until_found() < 60.0
    assert rig.error()[0] < 0.1
    assert rig.go(0.0, 0.5, 5.0).max() < 0.1


def test_without_an_initial_pose_the_whole_free_space_is_searched() -> None:
    rig = LocaliserRig(replace(AT_START, set_initial_pose=False))
    assert rig.localiser.is_searching
    assert not rig.localiser.is_confident
    assert rig.localiser.covariance.tolist() == np.zeros((3, 3)).tolist()
    spread = rig.localiser.particles
    rows, columns = FLAT.indices(spread[:, :2]).T
    assert FLAT.free[rows, columns].all()
    assert np.std(spread[:, 0]) > 2.0
    assert rig.until_found() < 60.0
    assert rig.error()[0] < 0.1


def test_a_given_pose_is_used_until_the_laser_contradicts_it() -> None:
    rig = LocaliserRig()
    rig.go(0.0, 0.0, 1.0)
    rig.localiser.set_pose(Pose2D(10.0, 6.5, 1.0))
    assert rig.localiser.is_confident
    assert rig.error()[0] > 5.0
    rig.go(0.0, 0.0, 0.5)
    assert not rig.localiser.is_confident
    assert rig.until_found() < 60.0
    assert rig.error()[0] < 0.1


def test_people_and_a_new_box_do_not_end_the_confidence() -> None:
    rig = LocaliserRig()
    errors = []
    for step in range(160):
        x, y, yaw = rig.robot.true
        gap = max(0.75, 2.5 - step * 0.05)
        rig.robot.people = [
            (x + gap * math.cos(yaw + 0.5), y + gap * math.sin(yaw + 0.5)),
            (x + gap * math.cos(yaw - 0.9), y + gap * math.sin(yaw - 0.9)),
        ]
        if step > 100:
            rig.robot.people.append((4.5, 4.0))
        rig.step(0.0, 0.4)
        errors.append(rig.error())
        assert rig.localiser.is_confident
    assert np.max(errors) < 0.15
