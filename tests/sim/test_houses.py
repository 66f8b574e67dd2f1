"""The two houses compared with their sources: rooms, doors, clearances, ways, colours."""

import itertools
import math
import threading
from dataclasses import replace

import cv2
import numpy as np
import pytest
from skimage.graph import MCP_Geometric

from btcore_robot.robot import Pose2D
from btcore_sim.camera import CameraSettings
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.laser import RayCaster
from btcore_sim.map_rasteriser import LASER_HEIGHT, rasterise
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description

HOUSES = ["house", "aws_house"]
NAVIGATION_RADIUS = 0.3

WAYPOINTS = {  # x, y and the distance to the nearest object in the laser's plane, all in m
    "house": {
        "start": (0.0, 0.0, 1.94),
        "recharge": (3.67, -0.24, 1.03),
        "wp1": (1.07, -12.38, 1.09),
        "wp2": (-5.32, -8.85, 0.83),
        "wp3": (-0.56, 0.24, 2.08),
    },
    "aws_house": {
        "start": (0.0, 0.0, 1.60),
        "recharge": (-1.0, 4.14, 1.28),
        "wp1": (6.70, -2.54, 2.03),
        "wp2": (0.45, -3.90, 1.53),
        "wp3": (-6.01, -0.30, 1.08),
    },
}
BOUNDS = {"house": (-9.93, -14.10, 5.47, 3.60), "aws_house": (-9.37, -5.60, 9.33, 5.55)}
FLOOR = {"house": 181.9, "aws_house": 126.7}  # m² that a robot of 0.3 m radius can reach
WIDEST = {"house": 0.75, "aws_house": 1.05}  # m: the largest radius for which all waypoints are connected
WAYS = {  # m, 8-connected, for a radius of 0.3 m
    "house": {
        ("start", "recharge"): 6.15,
        ("start", "wp1"): 13.53,
        ("start", "wp2"): 13.79,
        ("start", "wp3"): 0.65,
        ("recharge", "wp1"): 18.39,
        ("recharge", "wp2"): 19.85,
        ("recharge", "wp3"): 6.5,
        ("wp1", "wp2"): 7.8,
        ("wp2", "wp3"): 13.34,
        ("wp3", "wp1"): 14.01,
    },
    "aws_house": {
        ("start", "recharge"): 4.56,
        ("start", "wp1"): 7.74,
        ("start", "wp2"): 4.09,
        ("start", "wp3"): 6.12,
        ("recharge", "wp1"): 10.45,
        ("recharge", "wp2"): 8.65,
        ("recharge", "wp3"): 8.4,
        ("wp1", "wp2"): 6.83,
        ("wp2", "wp3"): 7.94,
        ("wp3", "wp1"): 13.61,
    },
}
DOORS = {  # from and to, in the middle of the wall (m)
    "house": [
        ((-7.5, -1.98), (-5.43, -1.98)),
        ((-0.6, -1.98), (2.0, -1.98)),
        ((-2.7, -11.45), (-2.7, -9.25)),
        ((1.0, -7.4), (2.65, -7.4)),
        ((2.12, 1.75), (2.12, 3.35)),
    ],
    "aws_house": [((-2.4, -2.75), (-2.4, 0.55)), ((4.68, -4.3), (4.68, 2.0)), ((-3.8, -1.5), (-2.7, -1.5))],
}


@pytest.fixture(params=HOUSES)
def house(request: pytest.FixtureRequest) -> WorldDescription:
    return load_world_description(request.param)


def test_waypoints_have_the_specified_positions(house: WorldDescription) -> None:
    assert house.waypoints == {name: (x, y) for name, (x, y, _) in WAYPOINTS[house.name].items()}


def test_the_robot_starts_at_the_books_pose(house: WorldDescription) -> None:
    for seed in range(1, 21):
        assert house.start(np.random.default_rng(seed), 0.27) == house.pose
    assert (house.pose.x, house.pose.y, house.pose.yaw) == (0.0, 0.0, 0.0)


def test_each_waypoint_has_the_specified_clearance(house: WorldDescription) -> None:
    for name, (x, y, clearance) in WAYPOINTS[house.name].items():
        seen = min(item.distance(x, y) for item in house.objects if item.meets(LASER_HEIGHT))
        assert seen == pytest.approx(clearance, abs=0.15), name
        assert house.clearance_at(x, y) >= 0.75, f"{name}, with what the laser does not see"


def test_paths_between_waypoints_have_the_specified_lengths(house: WorldDescription) -> None:
    floor = ClearanceMap.of(house)
    costs = np.where(floor.clearances >= NAVIGATION_RADIUS, 1.0, -1.0)
    found = {}
    for start, end in WAYS[house.name]:
        search = MCP_Geometric(costs, fully_connected=True)
        reached, _ = search.find_costs([floor.map.cell(*house.waypoints[start])])
        found[start, end] = reached[floor.map.cell(*house.waypoints[end])] * floor.map.resolution
    assert found == {pair: pytest.approx(length, rel=0.1) for pair, length in WAYS[house.name].items()}


def test_the_narrowest_place_has_the_specified_width(house: WorldDescription) -> None:
    floor, points = ClearanceMap.of(house), list(house.waypoints.values())
    assert floor.connected(points, NAVIGATION_RADIUS)
    assert floor.connected(points, WIDEST[house.name] - 0.1)
    assert not floor.connected(points, WIDEST[house.name] + 0.2)


def test_the_floor_and_the_house_have_the_specified_sizes(house: WorldDescription) -> None:
    map = rasterise(house)
    area = np.count_nonzero(ClearanceMap(map).clearances >= NAVIGATION_RADIUS) * map.resolution**2
    assert area == pytest.approx(FLOOR[house.name], rel=0.03)
    assert map.bounds == pytest.approx(BOUNDS[house.name], abs=0.25)


def test_every_door_is_open_over_its_specified_width(house: WorldDescription) -> None:
    for start, end in DOORS[house.name]:
        for part in np.linspace(0.02, 0.98, 60):
            x, y = (a + part * (b - a) for a, b in zip(start, end, strict=True))
            assert all(item.distance(x, y) > 0.0 for item in house.objects), (start, end, part)


def test_no_ray_leaves_the_house(house: WorldDescription) -> None:
    outlines = RayCaster.of(house.objects)
    around = np.linspace(-math.pi, math.pi, 3600, endpoint=False)
    map = rasterise(house)
    random = np.random.default_rng(5)
    places = [*house.waypoints.values(), *(ClearanceMap(map).random_point(random, 0.27) for _ in range(60))]
    for (x, y), height in itertools.product(places, (LASER_HEIGHT, 1.07, 2.4)):
        assert np.isfinite(outlines.distances(x, y, height, around)).all(), (x, y, height)


def test_walls_are_straight_high_and_15_to_20_cm_thick(house: WorldDescription) -> None:
    walls = [item for item in house.objects if item.name.startswith("wall_")]
    assert len(walls) >= 12
    for wall in walls:
        assert (wall.yaw, wall.position[2], wall.size[2]) == (0.0, 0.0, 2.5)
        assert 0.15 - 1e-9 <= min(wall.size[:2]) <= 0.2 + 1e-9


def test_a_house_is_a_few_dozen_bodies(house: WorldDescription) -> None:
    assert 40 <= len(house.objects) <= 70


def test_the_floor_below_table_tops_is_a_keep_out_area(house: WorldDescription) -> None:
    map = rasterise(house)
    tops = [item for item in house.objects if item.name.endswith("_top")]
    assert len(tops) >= 2
    kept = map.keepout_mask()
    for top in tops:
        assert not top.meets(LASER_HEIGHT)
        assert kept[map.cell(*top.position[:2])]
        assert map.cells[map.cell(*top.position[:2])] == 0


def test_furniture_has_the_books_wooden_colour_and_other_colours(house: WorldDescription) -> None:
    wooden = [item for item in house.objects if is_wooden(item.color)]
    others = [item for item in house.objects if item not in wooden and not item.name.startswith("wall_")]
    assert len({item.name.split("_")[0] for item in wooden}) >= 4
    assert len({item.color for item in others}) >= 5
    assert not any(item.name.startswith("wall_") for item in wooden)
    assert not is_wooden(house.floor)


def is_wooden(color: tuple[int, int, int, int]) -> bool:
    """Check the book's range for furniture in OpenCV's HSV, at any brightness."""
    pixel = np.array([[color[:3]]], dtype=np.uint8)
    return bool(cv2.inRange(cv2.cvtColor(pixel, cv2.COLOR_RGB2HSV), (15, 50, 20), (20, 200, 255)).any())


@pytest.mark.parametrize("name", HOUSES)
def test_the_camera_sees_wood_at_every_waypoint_but_not_on_walls_and_floor(name: str) -> None:
    description = load_world_description(name)
    bare = replace(
        description, objects=tuple(item for item in description.objects if not is_wooden(item.color))
    )
    shares = seen_wood(description)
    assert (shares.max(axis=1) > 0.01).all(), shares
    assert (shares > 0.01).sum() >= 8
    assert (seen_wood(bare) == 0.0).all()


def seen_wood(description: WorldDescription) -> np.ndarray:
    """Return the share of pixels in the book's range, for each waypoint and each eighth of a turn."""
    world = World(description)
    robot = SimulatedRobot(world, camera=CameraSettings(80, 60, 10.0))
    shares = np.zeros((3, 8))
    for (row, turn), _ in np.ndenumerate(shares):
        robot.kidnap(Pose2D(*description.waypoints[f"wp{row + 1}"], turn * math.pi / 4))
        world.wait_until(world.now() + 200_000_000, threading.Event())
        pixels = cv2.cvtColor(robot.camera().rgb, cv2.COLOR_RGB2HSV)
        shares[row, turn] = cv2.inRange(pixels, (15, 50, 20), (20, 200, 200)).mean() / 255
    world.close()
    return shares
