"""Boxes that no map has: they block no way, and are where the seed says."""

import math

import pytest

from sim.floor import Floor
from sim.life import Life
from sim.mistakes import SimError
from sim.obstacles import FROM_WAYPOINTS, PASSAGE, passable, with_obstacles
from sim.rasterise import rasterise
from sim.scene import Thing, load_scene
from sim.world import generator


@pytest.mark.parametrize("name", ["house", "aws_house"])
@pytest.mark.parametrize("seed", range(5))
def test_boxes_leave_a_way_and_the_waypoints_alone(name: str, seed: int):
    bare = load_scene(name)
    scene = Life(obstacles=6).scene(bare, seed)
    boxes = [thing for thing in scene.things if thing not in bare.things]
    assert len(boxes) == 6
    points = list(scene.waypoints.values())
    for box in boxes:
        assert box.mass > 0.0
        assert 0.3 <= min(box.size[:2]) <= max(box.size[:2]) <= 0.5
        assert min(box.distance(*point) for point in points) >= FROM_WAYPOINTS
        assert bare.free(*box.position[:2]) >= math.hypot(*box.size[:2]) / 2
    assert Floor.of(scene).connected(points, PASSAGE / 2)
    assert (rasterise(scene).cells == rasterise(bare).cells).all()


def test_the_same_seed_puts_them_in_the_same_places():
    house = load_scene("house")
    assert Life(obstacles=4).scene(house, 3) == Life(obstacles=4).scene(house, 3)
    assert Life(obstacles=4).scene(house, 3) != Life(obstacles=4).scene(house, 4)


def test_more_than_fit_are_refused():
    with pytest.raises(SimError, match=r"no room for 60 obstacles that block no way, only for \d+"):
        with_obstacles(load_scene("arena"), 60, generator(1, "obstacles"))


def test_a_box_can_be_passed_where_there_is_room_on_one_side(box):
    floor = Floor.of(load_scene("arena"))  # free from -3 m to 3 m
    course = 0.0

    def at(y: float, width: float) -> Thing:
        return box(0.0, y, (0.5, width, 0.5))

    assert passable(floor, at(0.0, 0.5), course)
    assert passable(floor, at(0.0, 4.0), course)
    assert not passable(floor, at(0.0, 4.4), course)
    assert passable(floor, at(0.5, 4.4), course)
    assert passable(floor, at(0.0, 4.0), math.pi / 2)
