"""A floor with boxes and people, and a robot on it whose base and laser are like Tiago's."""

import math
import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from btcore.clock import NS_PER_S
from btcore_navigation.behaviours import (
    AssistedTeleopBehaviour,
    BackUpBehaviour,
    DriveOnHeadingBehaviour,
    SpinBehaviour,
    WaitBehaviour,
)
from btcore_navigation.clearance import ClearanceGrid, laser_pose, smooth_scan
from btcore_navigation.controller import ControllerServer
from btcore_navigation.costmap import LocalCostmap
from btcore_navigation.parameters import (
    BehaviourParameters,
    ControllerParameters,
    LocalCostmapParameters,
    min_clearance,
)
from btcore_navigation.path import NavPath
from btcore_navigation.sensor_watch import SensorWatch
from btcore_robot.robot import (
    CMD_VEL,
    BaseInfo,
    LaserInfo,
    LaserScan,
    Odometry,
    Phase,
    Pose2D,
    Robot,
    SonarReading,
    TransformStamped,
    Twist2D,
)
from btcore_robot.schedule import SimulatedSchedule
from btcore_robot.transforms import FrameBroadcaster, TransformTree
from btcore_sim.differential_drive import DifferentialDrive

Box = tuple[float, float, float, float]
LASER_X = 0.202  # m, from the centre of the base to the laser
PERSON_RADIUS = 0.25  # m
MIN_PERSON_GAP = 0.5  # m, the distance that a person keeps from a robot


def box_distances(
    boxes: Sequence[Box], x: float, y: float, angles: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the distance (m) from (*x*, *y*) to the nearest box in each direction, or infinity."""
    cos, sin = np.cos(angles), np.sin(angles)
    ranges = np.full(len(angles), np.inf)
    with np.errstate(divide="ignore"):
        for xmin, ymin, xmax, ymax in boxes:
            tx = np.sort(np.stack(((xmin - x) / cos, (xmax - x) / cos)), axis=0)
            ty = np.sort(np.stack(((ymin - y) / sin, (ymax - y) / sin)), axis=0)
            enters, leaves = np.maximum(tx[0], ty[0]), np.minimum(tx[1], ty[1])
            ranges = np.where((enters <= leaves) & (enters > 0.0), np.minimum(ranges, enters), ranges)
    return ranges


@dataclass(slots=True)
class Person:
    """A person who walks from *x*, *y* (m) at *vx*, *vy* (m/s), but not closer to a robot than 0.5 m."""

    x: float
    y: float
    vx: float = 0.0
    vy: float = 0.0

    def gap(self, robot: Pose2D, robot_radius: float) -> float:
        """Return the distance (m) between the person and the robot's hull."""
        return math.hypot(self.x - robot.x, self.y - robot.y) - robot_radius - PERSON_RADIUS

    def walk(self, robot: Pose2D, robot_radius: float, seconds: float) -> None:
        moved = replace(self, x=self.x + self.vx * seconds, y=self.y + self.vy * seconds)
        gap = moved.gap(robot, robot_radius)
        if gap > MIN_PERSON_GAP or gap >= self.gap(robot, robot_radius):
            self.x, self.y = moved.x, moved.y


class FloorRobot(Robot):
    """A base that follows commands exactly within its limits, on a floor with *boxes* and *people*."""

    def __init__(
        self, boxes: Sequence[Box] = (), start: Pose2D | None = None, seed: int = 0, sigma: float = 0.06
    ) -> None:
        self._schedule = SimulatedSchedule()
        self.boxes = list(boxes)
        self.people: list[Person] = []
        self.laser_failed = False
        self.odometry_failed = False
        self.odometry_error_m = 0.0
        """The distance along x that is added to the odometry."""
        self.odometry_error_rad = 0.0
        """The angle that is added to the odometry."""
        self.pose = start or Pose2D(0.0, 0.0, 0.0)
        self.commands: list[tuple[int, float, float]] = []
        self.nearest = math.inf
        """The smallest distance (m) of the robot to a box or a person so far."""
        self._random = np.random.default_rng([seed, 5])
        self._sigma = sigma
        self.info = BaseInfo(-0.2, 1.0, 2.09, 1.0, 2.09, 0.25, 0.27)
        self._base = DifferentialDrive(self.info, 0.0985, 0.4044)
        self._scan: LaserScan | None = None
        self._odometry = Odometry(self.pose, Twist2D(0.0, 0.0), 0)
        self.sonar_readings: list[SonarReading] = []
        self._update_scan(0)
        self._schedule.add_task(100.0, Phase.PHYSICS, self._move)
        self._schedule.add_task(50.0, Phase.SENSORS, self._update_odometry)
        self._schedule.add_task(10.0, Phase.SENSORS, self._update_scan)

    @property
    def clock(self) -> SimulatedSchedule:
        return self._schedule

    @property
    def schedule(self) -> SimulatedSchedule:
        return self._schedule

    @property
    def base_info(self) -> BaseInfo:
        return self.info

    @property
    def laser_info(self) -> LaserInfo:
        step = math.radians(220.0) / 665
        return LaserInfo(666, -math.radians(110.0), step, 0.05, 25.0, 10.0, self._sigma, "base_laser_link")

    def frames(self) -> Sequence[TransformStamped]:
        now = self._schedule.now()
        unrotated = (0.0, 0.0, 0.0, 1.0)
        return (
            TransformStamped("base_laser_link", "base_footprint", (LASER_X, 0.0, 0.0945), unrotated, now),
            TransformStamped("sonar_link", "base_footprint", (-0.25, 0.0, 0.2), (0.0, 0.0, 1.0, 0.0), now),
        )

    def drive(self, v: float, w: float, *, priority: int = CMD_VEL) -> None:
        self.commands.append((self._schedule.now(), v, w))
        self._base.command(v, w, self._schedule.now())

    def stop(self) -> None:
        self.drive(0.0, 0.0)

    def commanded_velocity(self) -> Twist2D:
        return self._base.commanded_twist(self._schedule.now())

    def scan(self) -> LaserScan | None:
        return self._scan

    def odometry(self) -> Odometry:
        return self._odometry

    def sonars(self) -> Sequence[SonarReading]:
        return self.sonar_readings

    @property
    def speed(self) -> float:
        """Return the true speed (m/s)."""
        return self._base.twist.v

    def _move(self, now: int) -> None:
        twist = self._base.step(now, 0.01)
        yaw = self.pose.yaw + twist.w * 0.005
        self.pose = Pose2D(
            self.pose.x + twist.v * 0.01 * math.cos(yaw),
            self.pose.y + twist.v * 0.01 * math.sin(yaw),
            math.remainder(self.pose.yaw + twist.w * 0.01, 2 * math.pi),
        )
        for xmin, ymin, xmax, ymax in self.boxes:
            east = max(xmin - self.pose.x, 0.0, self.pose.x - xmax)
            north = max(ymin - self.pose.y, 0.0, self.pose.y - ymax)
            self.nearest = min(self.nearest, math.hypot(east, north) - self.info.radius)
        for person in self.people:
            person.walk(self.pose, self.info.radius, 0.01)
            self.nearest = min(self.nearest, person.gap(self.pose, self.info.radius))

    def _update_odometry(self, now: int) -> None:
        if not self.odometry_failed:
            x, yaw = self.pose.x + self.odometry_error_m, self.pose.yaw + self.odometry_error_rad
            pose = replace(self.pose, x=x, yaw=yaw)
            self._odometry = Odometry(pose, self._base.twist, now)

    def _update_scan(self, now: int) -> None:
        if self.laser_failed:
            return
        info = self.laser_info
        angles = info.angle_min + info.angle_increment * np.arange(info.rays) + self.pose.yaw
        cos, sin = np.cos(angles), np.sin(angles)
        x = self.pose.x + LASER_X * math.cos(self.pose.yaw)
        y = self.pose.y + LASER_X * math.sin(self.pose.yaw)
        ranges = box_distances(self.boxes, x, y, angles)
        for person in self.people:
            ahead = (person.x - x) * cos + (person.y - y) * sin
            beside = (person.x - x) * sin - (person.y - y) * cos
            inside = np.maximum(PERSON_RADIUS**2 - beside**2, 0.0)
            hit = (np.abs(beside) < PERSON_RADIUS) & (ahead > 0.0)
            ranges = np.where(hit, np.minimum(ranges, ahead - np.sqrt(inside)), ranges)
        ranges += self._sigma * self._random.standard_normal(info.rays)
        ranges = np.where(ranges < info.range_min, -np.inf, ranges)
        ranges = np.where(ranges > info.range_max, np.inf, ranges)
        self._scan = LaserScan(
            ranges.astype(np.float32),
            now,
            info.angle_min,
            info.angle_increment,
            info.range_min,
            info.range_max,
            info.frame,
        )


class NavigationRig:
    """A robot with all navigation servers, on a map whose origin is the start of odometry."""

    def __init__(self, robot: Robot, parameters: ControllerParameters | None = None) -> None:
        self.robot = robot
        self.transforms = TransformTree()
        radius = min_clearance(robot.base_info, 0.0)
        self.costmap = LocalCostmap(LocalCostmapParameters(robot_radius=radius))
        self.held = False  # whether the controller keeps the robot still
        self.map_at((0.0, 0.0, 0.0))
        broadcaster = FrameBroadcaster(robot, self.transforms)
        broadcaster.step(robot.clock.now())
        parameters = parameters or ControllerParameters()
        sensors = SensorWatch(robot, self.transforms, parameters.scan_timeout, parameters.odometry_timeout)
        motion = robot, self.transforms, ClearanceGrid(self.costmap), sensors
        recovery = *motion, BehaviourParameters()
        self.follow_path = ControllerServer(*motion, parameters, lambda: self.held)
        self.spin = SpinBehaviour(*recovery)
        self.back_up = BackUpBehaviour(*recovery)
        self.drive_on_heading = DriveOnHeadingBehaviour(*recovery)
        self.wait = WaitBehaviour()
        self.assisted_teleop = AssistedTeleopBehaviour(*recovery)
        add_task = robot.schedule.add_task
        add_task(50.0, Phase.TRANSFORMS, broadcaster.step)
        add_task(5.0, Phase.COSTMAPS, self._update_costmap)
        add_task(20.0, Phase.CONTROLLER, self.follow_path.step)
        behaviours = (self.spin, self.back_up, self.drive_on_heading, self.wait, self.assisted_teleop)
        for behaviour in behaviours:
            add_task(10.0, Phase.CONTROLLER, behaviour.step)

    def map_at(self, pose: tuple[float, float, float]) -> None:
        """Set the pose of odom in the map."""
        x, y, yaw = pose
        rotation = (0.0, 0.0, math.sin(yaw / 2), math.cos(yaw / 2))
        self.transforms.set_static(TransformStamped("odom", "map", (x, y, 0.0), rotation, 0))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> float:
        """Advance the time until a condition is true; return the seconds that this took."""
        start = self.robot.clock.now()
        end = start + round(seconds * NS_PER_S)
        while self.robot.clock.now() < end and not until():
            self.robot.clock.wait_until(self.robot.clock.now() + NS_PER_S // 20, threading.Event())
        return (self.robot.clock.now() - start) / NS_PER_S

    def _update_costmap(self, now: int) -> None:
        scan = self.robot.scan()
        if scan is not None:
            self.costmap.observe(smooth_scan(scan), laser_pose(self.transforms, "odom", scan))
        self.costmap.update(now, self.robot.odometry().pose)


def polyline_path(*points: tuple[float, float], yaw: float = 0.0, frame: str = "map") -> NavPath:
    """Return a path along straight lines between *points*, a pose every 5 cm, with final heading *yaw*."""
    places = [np.array(points[:1])]
    for (x0, y0), (x1, y1) in pairwise(points):
        count = max(round(math.hypot(x1 - x0, y1 - y0) / 0.05), 1)
        shares = np.arange(1, count + 1)[:, None] / count
        places.append(np.array([[x0, y0]]) + shares * np.array([[x1 - x0, y1 - y0]]))
    line = np.concatenate(places)
    poses = np.column_stack((line, np.zeros(len(line))))
    poses[:-1, 2] = np.arctan2(*np.diff(line, axis=0).T[::-1])
    poses[-1, 2] = yaw
    return NavPath(poses, 0, frame)


def rig_on_floor(
    *boxes: Box, start: Pose2D | None = None, seed: int = 0, **parameters: float
) -> NavigationRig:
    """Return the rig of a robot on a floor with *boxes*; *parameters* are those of the controller."""
    return NavigationRig(FloorRobot(boxes, start, seed), replace(ControllerParameters(), **parameters))
