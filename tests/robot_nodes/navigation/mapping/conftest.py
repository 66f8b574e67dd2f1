"""A flat of boxes, the scans of a laser like Tiago's, and a robot that is moved through the flat."""

import math
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_S
from btcore_navigation.mapping.key_scan import KeyScan, LocalisedScan, key_scan
from btcore_navigation.mapping.mapper import SCANS_PER_KEY, Mapper
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import LaserInfo, LaserScan, Odometry, Pose2D, TransformStamped, Twist2D
from btcore_robot.transforms import TransformTree
from tests.robot_nodes.conftest import RecordingRobot
from tests.robot_nodes.navigation.conftest import LASER_X, Box, box_distances

RAYS = 666

ROOM: tuple[Box, ...] = (
    (-3.2, -2.2, -3.0, 2.2),
    (3.0, -2.2, 3.2, 2.2),
    (-3.2, -2.2, 3.2, -2.0),
    (-3.2, 2.0, 3.2, 2.2),
    (1.2, 0.8, 1.8, 1.2),
    (-1.6, -1.5, -1.1, -1.2),
)
"""A room of 6 m by 4 m around (0, 0) with two boxes."""

RING: tuple[Box, ...] = (
    (-15.2, -10.2, 15.2, -10.0),
    (-15.2, 10.0, 15.2, 10.2),
    (-15.2, -10.2, -15.0, 10.2),
    (15.0, -10.2, 15.2, 10.2),
    (-13.5, -8.5, 13.5, 8.5),
    (-1.0, -10.0, -0.5, -9.8),
)
"""An empty corridor of 1.5 m around a block of 27 m by 17 m, with a single edge."""


def scan_at(
    boxes: Sequence[Box], pose: Pose2D, random: np.random.Generator, sigma: float = 0.06, stamp: int = 0
) -> LaserScan:
    """Return a scan with noise, of a robot at *pose*."""
    half = math.radians(110.0)
    angles = np.linspace(-half, half, RAYS) + pose.yaw
    x, y = pose.x + LASER_X * math.cos(pose.yaw), pose.y + LASER_X * math.sin(pose.yaw)
    ranges = box_distances(boxes, x, y, angles)
    ranges = ranges + sigma * random.standard_normal(RAYS)
    ranges = np.where(ranges < 0.05, -np.inf, ranges)
    return LaserScan(
        ranges.astype(np.float32), stamp, -half, 2 * half / (RAYS - 1), 0.05, 25.0, "base_laser_link"
    )


class MovedRobot(RecordingRobot):
    """A robot that the rig moves, and whose odometry the rig sets."""

    def __init__(self) -> None:
        super().__init__()
        self.reported = Odometry(Pose2D(0.0, 0.0, 0.0), Twist2D(0.3, 0.0), 0)

    @property
    def laser_info(self) -> LaserInfo:
        half = math.radians(110.0)
        return LaserInfo(RAYS, -half, 2 * half / (RAYS - 1), 0.05, 25.0, 10.0, 0.06, "base_laser_link")

    def frames(self) -> list[TransformStamped]:
        return []

    def odometry(self) -> Odometry:
        return self.reported


class MappingRig:
    """A robot that is moved through *boxes*, and its mapper.

    Odometry reports *stretch* metres for every metre, and *slip* radians for every radian.
    """

    def __init__(
        self,
        boxes: Sequence[Box],
        start: Pose2D,
        *,
        stretch: float = 1.0,
        slip: float = 1.0,
        seed: int = 0,
    ) -> None:
        self.boxes = boxes
        self.true = start
        self.stretch, self.slip = stretch, slip
        self.random = np.random.default_rng([seed, 7])
        self.robot = MovedRobot()
        self.transforms = TransformTree()
        unrotated = (0.0, 0.0, 0.0, 1.0)
        self.transforms.set_static(
            TransformStamped("base_laser_link", "base_footprint", (LASER_X, 0.0, 0.0945), unrotated, 0)
        )
        self.time = 0
        self.mapper = Mapper(self.robot, self.transforms, start=start)
        self.key_poses: list[Pose2D] = []
        for _ in range(SCANS_PER_KEY):
            self._move(0.0, 0.0)

    def along(self, *places: tuple[float, float], step: float = 0.1) -> "MappingRig":
        """Move the robot from place to place, with turns on the spot in between."""
        for (x0, y0), (x1, y1) in pairwise([(self.true.x, self.true.y), *places]):
            self.turn(math.remainder(math.atan2(y1 - y0, x1 - x0) - self.true.yaw, math.tau))
            count = max(1, round(math.hypot(x1 - x0, y1 - y0) / step))
            for _ in range(count):
                self._move(math.hypot(x1 - x0, y1 - y0) / count, 0.0)
        return self

    def turn(self, angle: float) -> None:
        """Turn the robot by *angle* (rad)."""
        count = max(1, math.ceil(abs(angle) / 0.1))
        for _ in range(count):
            self._move(0.0, angle / count)

    def interrupt(self, restarted: Pose2D | None) -> None:
        """Stop the odometry for a second. Then it starts at *restarted*, or continues if that is None."""
        self.time += NS_PER_S
        self.robot.newest_scan = scan_at(self.boxes, self.true, self.random, stamp=self.time)
        self.mapper.step(self.time)
        if restarted is not None:
            self.robot.reported = Odometry(restarted, Twist2D(0.0, 0.0), self.time)

    def error(self) -> float:
        """Return the present error (m) of the mapper's pose."""
        reported = self.mapper.pose()
        return math.hypot(reported.x - self.true.x, reported.y - self.true.y)

    def key_errors(self) -> NDArray[np.float64]:
        """Return the errors (m) of the key scans' poses."""
        true = np.array([(pose.x, pose.y) for pose in self.key_poses])
        return np.asarray(np.hypot(*(self.mapper.poses[:, :2] - true).T))

    def odometry_error(self) -> float:
        """Return the error (m) of odometry since the start."""
        start, reported = (
            Transform.from_pose(self.key_poses[0]),
            Transform.from_pose(self.robot.reported.pose),
        )
        x, y, _ = (start * reported).position
        return math.hypot(x - self.true.x, y - self.true.y)

    def _move(self, distance: float, angle: float) -> None:
        self.time += NS_PER_S // 10
        self.true = _moved(self.true, distance, angle)
        pose = _moved(self.robot.reported.pose, distance * self.stretch, angle * self.slip)
        self.robot.reported = Odometry(pose, Twist2D(10 * distance, 10 * angle), self.time)
        self._update_scan()

    def _update_scan(self) -> None:
        pose = self.robot.reported.pose
        rotation = (0.0, 0.0, math.sin(pose.yaw / 2), math.cos(pose.yaw / 2))
        odometry = TransformStamped("base_footprint", "odom", (pose.x, pose.y, 0.0), rotation, self.time)
        self.transforms.set(odometry)
        self.robot.newest_scan = scan_at(self.boxes, self.true, self.random, stamp=self.time)
        before = len(self.mapper.scans)
        self.mapper.step(self.time)
        if len(self.mapper.scans) > before:
            self.key_poses.append(self.true)


def _moved(pose: Pose2D, distance: float, angle: float) -> Pose2D:
    return Pose2D(
        pose.x + distance * math.cos(pose.yaw),
        pose.y + distance * math.sin(pose.yaw),
        math.remainder(pose.yaw + angle, math.tau),
    )


def key_scan_at(boxes: Sequence[Box], pose: Pose2D, seed: int = 0) -> KeyScan:
    """Return the key scan of a robot at *pose*."""
    scan = scan_at(boxes, pose, np.random.default_rng([seed, 3]))
    localised = LocalisedScan(scan, Transform((LASER_X, 0.0, 0.0945)), Pose2D(0.0, 0.0, 0.0))
    return key_scan([localised], 0.0)
