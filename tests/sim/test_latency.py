"""Latency: a reading arrives later than its stamp."""

import threading
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from btcore.clock import NS_PER_S
from btcore_navigation.stack import Navigation
from btcore_robot.perception.object_locator import ObjectLocator
from btcore_sim.camera import CameraSettings
from btcore_sim.latency import DelayedReadings
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.robot_description import load_robot_description
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.worlds import load_world_description

TREES = Path(__file__).parents[2] / "trees"
TIAGO = load_robot_description()


def test_a_reading_arrives_after_the_latency() -> None:
    readings = DelayedReadings[str](0.25)
    assert readings.newest(0) is None
    readings.add("first", 0)
    readings.add("second", NS_PER_S)
    readings.add("third", NS_PER_S + 100)
    assert readings.newest(NS_PER_S + NS_PER_S // 4 - 1) == "first"
    assert readings.newest(NS_PER_S + NS_PER_S // 4) == "second"
    assert readings.newest(NS_PER_S + NS_PER_S // 4 + 100) == "third"


@pytest.mark.parametrize(
    ("read", "period"),
    [
        (lambda robot: robot.scan(), 0.1),
        (lambda robot: robot.odometry(), 0.02),
        (lambda robot: robot.sonars()[0], 0.2),
        (lambda robot: robot.camera(), 0.1),
    ],
    ids=["laser", "odometry", "sonar", "camera"],
)
def test_a_robots_readings_are_as_old_as_the_latency_and_at_most_a_period_older(
    robot_at: Any, steer: Any, read: Callable[[Any], Any], period: float
) -> None:
    late = replace(
        TIAGO,
        laser=replace(TIAGO.laser, latency=0.15),
        odometry=replace(TIAGO.odometry, latency=0.15),
        camera=replace(TIAGO.camera, latency=0.15) if TIAGO.camera else None,
        sonar_latency=0.15,
    )
    robot = robot_at(description=late, camera=CameraSettings(8, 6, 10.0))
    assert read(robot).stamp == 0
    ages = []
    for _ in range(12):
        steer(robot, 0.1, None)
        ages.append((robot.world.now() - read(robot).stamp) / NS_PER_S)
    settled = ages[5:]
    assert 0.15 <= min(settled) <= max(settled) <= 0.15 + period + 1e-9


def test_localiser_and_locator_wait_for_an_odometry_that_is_later_than_scans_and_pictures() -> None:
    late = replace(
        TIAGO, laser=replace(TIAGO.laser, latency=0.0), odometry=replace(TIAGO.odometry, latency=0.1)
    )
    world = World(load_world_description("house"), seed=1)
    body = SimulatedRobot(world, late, camera=CameraSettings(160, 120, 10.0))
    navigation = Navigation(body, rasterise(world.description), np.random.default_rng(1), TREES)
    locator = ObjectLocator(body, navigation.transforms)
    assert locator.configure()
    assert locator.activate()
    body.move_head(-1.2, -0.15)
    world.wait_until(3 * NS_PER_S, threading.Event())
    assert navigation.localiser.stamp == pytest.approx(2.9 * NS_PER_S, abs=NS_PER_S / 10)
    assert {box.stamp for box in locator.boxes} == {round(2.5 * NS_PER_S)}
    world.close()
