"""The obstacle detector, basic and improved, compared with the book (chapter 4), and its exercises."""

import math

import numpy as np
import pytest

from btcore_robot.components.component import (
    Component,
    ComponentOptions,
)
from btcore_robot.components.messages import GREEN, RED, Arrow, Arrows
from btcore_robot.perception.obstacle_detector import (
    Displacement,
    ObstacleDetector,
    ObstacleDetectorImproved,
    ObstacleInFrames,
    ObstacleMonitor,
    distance_colour,
)
from btcore_robot.robot import LaserScan, Phase, Pose2D
from btcore_robot.transforms import FrameBroadcaster
from tests.robot_nodes.conftest import ComponentRig, RecordingRobot

LASER = "base_laser_link"


class DetectorRig(ComponentRig):
    """A robot whose laser is 0.2 m ahead of its middle, its transforms, and components around it."""

    def __init__(self, robot: RecordingRobot) -> None:
        super().__init__(robot)
        self.laser = Component("laser", self.context)
        self.scans = self.laser.create_publisher("input_scan", LaserScan)
        self.arrows: list[Arrow] = []
        self.laser.create_subscription(
            "obstacle_marker", Arrows, lambda message: self.arrows.extend(message.arrows), depth=1
        )
        self.executor.add(self.laser)

    def know_frames(self) -> None:
        broadcaster = FrameBroadcaster(self.robot, self.context.transforms)
        broadcaster.step(self.robot.clock.now())
        self.robot.schedule.add_task(50.0, Phase.TRANSFORMS, broadcaster.step)

    def create(self, kind: type, **parameters) -> Component:
        component = kind(self.context, ComponentOptions(parameters=parameters))
        self.add(component)
        return component

    def see(self, *ranges: float) -> None:
        stamp = self.robot.clock.now()
        self.scans.publish(LaserScan(np.array(ranges, dtype=np.float32), stamp, -0.1, 0.1, 0.05, 25.0, LASER))
        self.robot.clock.sleep(0.0)

    def where(self, frame: str) -> tuple[float, ...]:
        return self.context.transforms.lookup(frame, "detected_obstacle").position


@pytest.fixture
def rig(robot: RecordingRobot) -> DetectorRig:
    return DetectorRig(robot)


def test_the_detector_publishes_the_hit_of_the_middle_ray_in_the_lasers_frame(rig: DetectorRig) -> None:
    rig.create(ObstacleDetector)
    rig.see(0.3, 1.5, 0.4)
    found = rig.context.transforms.lookup(LASER, "detected_obstacle")
    assert found.position == pytest.approx((1.5, 0.0, 0.0))
    assert found.quaternion == (0.0, 0.0, 0.0, 1.0)
    assert rig.context.transforms.parent("detected_obstacle") == LASER


@pytest.mark.parametrize("reading", [math.inf, -math.inf, math.nan])
def test_without_an_echo_the_detector_publishes_nothing(rig: DetectorRig, reading: float) -> None:
    rig.create(ObstacleDetector)
    rig.see(1.0, reading, 1.0)
    assert "detected_obstacle" not in rig.context.transforms.frames()


def test_the_obstacles_transform_is_static_and_does_not_expire(rig: DetectorRig) -> None:
    rig.create(ObstacleDetector)
    rig.see(1.0, 1.5, 1.0)
    rig.robot.clock.sleep(60.0)
    assert rig.where(LASER)[0] == pytest.approx(1.5)


def test_only_the_improved_detectors_obstacle_stays_when_the_robot_moves(robot: RecordingRobot) -> None:
    places = {}
    for kind in (ObstacleDetector, ObstacleDetectorImproved):
        rig = DetectorRig(type(robot)())
        rig.know_frames()
        rig.create(kind)
        rig.see(1.0, 1.5, 1.0)
        rig.robot.pose = Pose2D(1.0, 0.0, math.pi / 2)
        rig.robot.clock.sleep(1.0)
        rig.see(1.0, math.inf, 1.0)
        try:
            places[kind] = rig.where("odom")
        finally:
            rig.executor.remove(rig.laser)
    assert places[ObstacleDetector] == pytest.approx((1.0, 1.7, 0.1), abs=1e-6)
    assert places[ObstacleDetectorImproved] == pytest.approx((1.7, 0.0, 0.1), abs=1e-6)


def test_the_improved_detector_uses_the_lasers_pose_at_the_scans_time(rig: DetectorRig) -> None:
    rig.know_frames()
    rig.create(ObstacleDetectorImproved)
    rig.robot.clock.sleep(0.5)
    stamp = rig.robot.clock.now()
    scan = LaserScan(np.array([1.5], dtype=np.float32), stamp, 0.0, 0.1, 0.05, 25.0, LASER)
    rig.robot.pose = Pose2D(5.0, 0.0, 0.0)
    rig.robot.clock.sleep(0.1)
    rig.scans.publish(scan)
    rig.robot.clock.sleep(0.0)
    assert rig.where("odom") == pytest.approx((1.7, 0.0, 0.1), abs=1e-6)


def test_without_the_robots_frames_the_improved_detector_warns(rig: DetectorRig) -> None:
    rig.create(ObstacleDetectorImproved)
    rig.see(1.0, 1.5, 1.0)
    assert [line.level for line in rig.lines] == ["WARN"]
    assert "detected_obstacle" not in rig.context.transforms.frames()


def test_the_monitor_logs_the_obstacle_twice_a_second_and_draws_an_arrow(rig: DetectorRig) -> None:
    rig.know_frames()
    rig.create(ObstacleDetector)
    rig.create(ObstacleMonitor)
    rig.see(1.0, 1.5, 1.0)
    rig.robot.clock.sleep(1.0)
    assert [line.stamp for line in rig.lines] == [500_000_000, 1_000_000_000]
    assert rig.lines[0].text == "Obstacle detected at (1.700 m, 0.000 m, 0.100 m) = 0.000 rad"
    arrow = rig.arrows[0]
    assert (arrow.frame, arrow.colour, arrow.lifetime) == ("base_footprint", RED, 1.0)
    assert (arrow.shaft, arrow.head) == (0.02, 0.1)
    assert (arrow.start, arrow.end) == ((0.0, 0.0, 0.0), pytest.approx((1.7, 0.0, 0.1)))


def test_the_monitor_warns_while_there_is_no_obstacle(rig: DetectorRig) -> None:
    rig.know_frames()
    rig.create(ObstacleMonitor)
    rig.robot.clock.sleep(1.0)
    assert [line.level for line in rig.lines] == ["WARN", "WARN"]
    assert rig.arrows == []


# --- exercises


def test_exercise_the_displacement_of_each_second(rig: DetectorRig) -> None:
    rig.know_frames()
    rig.create(Displacement)
    rig.robot.clock.sleep(1.0)
    rig.robot.pose = Pose2D(0.3, 0.4, math.pi / 2)
    rig.robot.clock.sleep(1.0)
    rig.robot.pose = Pose2D(0.3, 0.6, math.pi / 2)
    rig.robot.clock.sleep(1.0)
    assert [line.text for line in rig.lines] == [
        "moved 0.500 m (x 0.300, y 0.400), turned 1.571 rad",
        "moved 0.200 m (x 0.200, y 0.000), turned 0.000 rad",
    ]


@pytest.mark.parametrize(("distance", "colour"), [(9.0, GREEN), (3.0, GREEN), (0.5, RED), (0.1, RED)])
def test_exercise_arrow_is_green_far_away_and_red_near(distance: float, colour: tuple[float, ...]) -> None:
    assert distance_colour(distance) == colour


def test_exercise_the_arrows_colour_changes_gradually_with_the_distance(rig: DetectorRig) -> None:
    shares = [distance_colour(distance)[0] for distance in (0.6, 1.0, 2.0, 2.9)]
    assert shares == sorted(shares, reverse=True)
    rig.know_frames()
    rig.create(ObstacleDetector)
    rig.create(ObstacleMonitor, colour_by_distance=True)
    rig.see(1.0, 9.0, 1.0)
    rig.robot.clock.sleep(0.5)
    assert rig.arrows[0].colour == GREEN


def test_exercise_the_obstacle_in_three_frames(rig: DetectorRig) -> None:
    rig.robot.pose = Pose2D(1.0, 2.0, math.pi / 2)
    rig.know_frames()
    rig.create(ObstacleDetectorImproved)
    rig.create(ObstacleInFrames)
    rig.see(1.0, 1.5, 1.0)
    rig.robot.clock.sleep(0.5)
    assert [line.text for line in rig.lines] == [
        "Obstacle in odom: (1.000 m, 3.700 m, 0.100 m)",
        "Obstacle in base_footprint: (1.700 m, 0.000 m, 0.100 m)",
        "Obstacle in head_2_link: (1.575 m, 0.000 m, -0.900 m)",
    ]
