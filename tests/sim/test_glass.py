"""Glass: laser and camera see through it, sonars and hull do not, and the map keeps robots out."""

import math
import threading
from dataclasses import replace

import numpy as np
import pytest

from btcore_robot.robot import Pose2D
from btcore_sim.camera import CameraSettings
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.robot_description import RobotDescription
from btcore_sim.world_description import WorldDescription, WorldObject
from tests.sim.conftest import MakeObject, RobotAt, Steer

RED, CLEAR = (220, 30, 30, 255), (160, 208, 224, 96)


@pytest.fixture
def pane(box: MakeObject) -> WorldObject:
    """A pane of glass 1.2 m ahead."""
    return replace(box(1.2, 0.0, (0.02, 3.0, 2.0), name="pane"), is_glass=True, color=CLEAR)


def test_the_laser_passes_and_sonars_do_not(
    robot_at: RobotAt,
    box: MakeObject,
    pane: WorldObject,
    noiseless_tiago: RobotDescription,
) -> None:
    wall = box(3.0, 0.0, (0.2, 4.0, 2.0), name="wall")
    ranges = {}
    for glass in (False, True):
        pane = replace(pane, is_glass=glass)
        scan = robot_at(pane, wall, description=noiseless_tiago).scan()
        # The sonars face backwards.
        turned = robot_at(pane, wall, pose=(0.6, 0.0, math.pi))
        echo = min(reading.range for reading in turned.sonars())
        ranges[glass] = (float(scan.ranges[len(scan.ranges) // 2]), echo)
    assert ranges[False][0] == pytest.approx(1.19 - 0.2, abs=0.05)
    assert ranges[True][0] == pytest.approx(2.9 - 0.2, abs=0.05)
    assert ranges[True][1] == ranges[False][1] < 0.6


def test_the_robot_collides_with_glass(robot_at: RobotAt, pane: WorldObject, steer: Steer) -> None:
    body = robot_at(pane)
    steer(body, 5.0, (0.4, 0.0))
    assert body.contacts.collisions == 1
    assert body.world.bodies[body.contacts.events[0].body].name == "pane"
    assert body.true_pose().x < 1.2 - 0.2


def test_camera_sees_red_box_through_glass(robot_at: RobotAt, box: MakeObject, pane: WorldObject) -> None:
    red = replace(box(2.5, 0.0, (0.5, 3.0, 2.5), name="red"), color=RED)
    pictures = {}
    for name, objects in {"bare": (red,), "glass": (pane, red)}.items():
        body = robot_at(*objects, camera=CameraSettings(32, 24, 10.0))
        body.world.wait_until(1_000_000, threading.Event())
        pictures[name] = body.camera()
    middle = (12, 16)
    bare, glass = (pictures[name].rgb[middle].astype(int) for name in ("bare", "glass"))
    assert glass[0] > glass[1], "still red"
    assert glass[2] > bare[2] + 40, "but bluer"
    assert pictures["glass"].depth[middle] == pytest.approx(pictures["bare"].depth[middle])
    opaque = robot_at(replace(pane, is_glass=False), red, camera=CameraSettings(32, 24, 10.0)).camera()
    assert opaque.depth[middle] < pictures["glass"].depth[middle] - 1.0


@pytest.mark.parametrize("yaw", [0.0, 0.6])
def test_the_map_keeps_robots_out_of_glass_but_does_not_show_it_to_the_laser(
    box: MakeObject, pane: WorldObject, yaw: float
) -> None:
    walls = [
        box(3.0, 0.0, (0.1, 6.1, 2.0), name="east"),
        box(-3.0, 0.0, (0.1, 6.1, 2.0), name="west"),
        box(0.0, 3.0, (6.1, 0.1, 2.0), name="north"),
        box(0.0, -3.0, (6.1, 0.1, 2.0), name="south"),
    ]
    pane = replace(pane, yaw=yaw)
    description = WorldDescription("room", "", (*walls, pane), (-2, 0, -2, 0), 0.0, Pose2D(-2, 0, 0), CLEAR)
    map = rasterise(description)
    assert not map.occupied[map.cell(1.2, 0.0)]
    floor = ClearanceMap.of(description)
    along = np.linspace(-1.45, 1.45, 30)
    for x, y in ((1.2 - math.sin(yaw) * part, math.cos(yaw) * part) for part in along):
        assert floor.clearance_at(x, y) == 0.0
    assert floor.clearance_at(0.6, 0.0) == pytest.approx(0.59 * math.cos(yaw), abs=0.08)
