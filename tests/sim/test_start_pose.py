"""The options for the start pose and for the noise of the sensors."""

import math
import re

import pytest

from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.obstacles import PASSAGE
from btcore_sim.robot_description import load_description
from btcore_sim.scenario import with_start
from btcore_sim.scene import load_scene
from btcore_sim.world import random_generator

RADIUS = 0.27


@pytest.mark.parametrize("name", ["house", "aws_house"])
def test_random_starts_of_a_house_are_free_and_connected_to_all_waypoints(name: str):
    scene = load_scene(name)
    floor = ClearanceMap.of(scene)
    poses = []
    for seed in range(8):
        pose = with_start(scene, "random", random_generator(seed, "start"), RADIUS).pose
        assert pose is not None
        assert floor.connected([*scene.waypoints.values(), (pose.x, pose.y)], PASSAGE / 2)
        assert scene.clearance_at(pose.x, pose.y) >= RADIUS
        poses.append(pose)
    assert len(set(poses)) == 8
    assert max(math.dist((a.x, a.y), (b.x, b.y)) for a in poses for b in poses) > 4.0
    again = with_start(scene, "random", random_generator(3, "start"), RADIUS).pose
    assert again == poses[3]


def test_a_world_with_random_starts_of_its_own_keeps_them():
    arena = load_scene("arena")
    assert with_start(arena, "random", random_generator(1, "start"), RADIUS) is arena


def test_a_start_is_given_in_metres_and_degrees():
    pose = with_start(load_scene("house"), "0.5,-0.25,90", random_generator(0, "start"), RADIUS).pose
    assert pose is not None
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((0.5, -0.25, math.pi / 2))
    turned = with_start(load_scene("house"), "0,0,270", random_generator(0, "start"), RADIUS).pose
    assert turned is not None
    assert turned.yaw == pytest.approx(-math.pi / 2)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("somewhere", "use random, or X,Y or X,Y,YAW"),
        ("1", "use random"),
        ("1,2,3,4", "use random"),
        ("nan,0", "X, Y and YAW have to be finite numbers"),
        ("-9.7,-5", "m of room in world 'house'"),
    ],
)
def test_an_invalid_start_raises(text: str, said: str):
    with pytest.raises(SimError, match=re.escape(said)):
        with_start(load_scene("house"), text, random_generator(0, "start"), RADIUS)


def test_noise_is_a_factor_on_laser_and_odometry():
    tiago = load_description()
    assert tiago.with_noise(1.0) == tiago
    perfect, twice = tiago.with_noise(0.0), tiago.with_noise(2.0)
    assert (perfect.laser.facts.sigma, perfect.odometry.slip, perfect.odometry.scale_sigma) == (0.0, 0.0, 0.0)
    assert twice.laser.facts.sigma == 2 * tiago.laser.facts.sigma
    assert twice.odometry.slip_sigma == 2 * tiago.odometry.slip_sigma
