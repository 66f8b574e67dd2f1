"""Boxes that are not on the map: they block no way, and the seed determines their places."""

import math

import pytest

from btcore_sim.clearance_map import BESIDE_HULL, ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.obstacles import FROM_WAYPOINTS, passable, with_obstacles
from btcore_sim.scenario import Scenario
from btcore_sim.world import random_generator
from btcore_sim.world_description import WorldObject
from btcore_sim.worlds import load_world_description
from tests.sim.conftest import MakeObject

RADIUS = 0.27
ROOM = RADIUS + BESIDE_HULL


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", ["house", "aws_house", "office:3", "home:3"])
def test_boxes_leave_a_passage_and_keep_away_from_waypoints(name: str, seed: int) -> None:
    bare = load_world_description(name)
    description = Scenario(obstacles=6).add_to(bare, seed, RADIUS)
    boxes = [item for item in description.objects if item not in bare.objects]
    assert len(boxes) == 6
    points = list(description.waypoints.values())
    for box in boxes:
        assert box.mass > 0.0
        assert 0.3 <= min(box.size[:2]) <= max(box.size[:2]) <= 0.5
        assert min(box.distance(*point) for point in points) >= FROM_WAYPOINTS
        assert bare.clearance_at(*box.position[:2]) >= math.hypot(*box.size[:2]) / 2
    assert ClearanceMap.of(description).connected(points, ROOM)
    assert (rasterise(description).cells == rasterise(bare).cells).all()


def test_the_same_seed_puts_boxes_in_the_same_places() -> None:
    house = load_world_description("house")
    assert Scenario(obstacles=4).add_to(house, 3, RADIUS) == Scenario(obstacles=4).add_to(house, 3, RADIUS)
    assert Scenario(obstacles=4).add_to(house, 3, RADIUS) != Scenario(obstacles=4).add_to(house, 4, RADIUS)


def test_more_boxes_than_fit_are_refused() -> None:
    with pytest.raises(SimError, match=r"no room for 60 obstacles that block no way, only for \d+"):
        with_obstacles(load_world_description("arena"), 60, random_generator(1, "obstacles"), RADIUS)


def test_a_box_can_be_passed_where_there_is_room_on_one_side(box: MakeObject) -> None:
    floor = ClearanceMap.of(load_world_description("arena"))  # free from -3 m to 3 m
    course = 0.0

    def at(y: float, width: float) -> WorldObject:
        return box(0.0, y, (0.5, width, 0.5))

    assert passable(floor, at(0.0, 0.5), 0.45, course)
    assert passable(floor, at(0.0, 4.0), 0.45, course)
    assert not passable(floor, at(0.0, 4.4), 0.45, course)
    assert passable(floor, at(0.0, 4.4), ROOM, course)
    assert passable(floor, at(0.5, 4.4), 0.45, course)
    assert passable(floor, at(0.0, 4.0), 0.45, math.pi / 2)
