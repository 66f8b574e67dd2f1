"""Doors: motion, obstacles in the way, mistakes, and what laser, map and people make of them."""

import json
import math
import threading
from pathlib import Path

import pytest

from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.doors import OPENING_TIME
from btcore_sim.errors import SimError
from btcore_sim.events import EventRunner, parse_event
from btcore_sim.map_rasteriser import rasterise
from btcore_sim.people import RADIUS, PeopleSimulation, with_people
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scenario import with_start
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World, random_generator
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description

HINGED = {"name": "office", "kind": "hinged_door", "position": [1.0, 0.0], "width": 1.0, "yaw": math.pi / 2}
SLIDING = {**HINGED, "kind": "sliding_door"}


def load(
    folder: Path, *objects: dict[str, object], start: tuple[float, float, float] = (0, 0, 0)
) -> WorldDescription:
    path = folder / "mine.json"
    path.write_text(json.dumps({"start": {"pose": start}, "objects": objects}))
    return load_world_description(str(path))


def run(world: World, seconds: float) -> None:
    world.wait_until(world.now() + round(seconds * 1e9), threading.Event())


@pytest.mark.parametrize(
    ("door", "opened"),
    [
        (HINGED, Pose2D(0.5, -0.5, math.pi)),
        ({**HINGED, "swing": "right"}, Pose2D(1.5, -0.5, 0.0)),
        (SLIDING, Pose2D(1.0, 1.0, math.pi / 2)),
    ],
)
def test_a_door_opens_and_closes_in_a_few_seconds(tmp_path: Path, door: dict, opened: Pose2D) -> None:
    description = load(tmp_path, door)
    world = World(description)
    assert list(description.doors) == ["office"]
    (leaf,) = world.kinematic_bodies("") or world.movable
    closed = (1.0, 0.0, 1.05)
    world.set_door("office", True)
    run(world, OPENING_TIME / 2)
    assert world.door_opening("office") == pytest.approx(0.5, abs=0.01)
    run(world, OPENING_TIME / 2 + 0.1)
    assert world.door_opening("office") == 1.0
    place, turned = pybullet.getBasePositionAndOrientation(leaf, physicsClientId=world.client)
    assert place == pytest.approx((opened.x, opened.y, 1.05))
    assert math.sin(2 * math.atan2(turned[2], turned[3]) - opened.yaw) == pytest.approx(0.0, abs=1e-6)
    world.set_door("office", False)
    run(world, OPENING_TIME + 0.1)
    place, _ = pybullet.getBasePositionAndOrientation(leaf, physicsClientId=world.client)
    assert place == pytest.approx(closed)
    assert world.door_distance(0.0, 0.0) == pytest.approx(0.98)
    world.close()


@pytest.mark.parametrize("door", [{**HINGED, "swing": "left"}, SLIDING])
def test_a_door_waits_for_the_robot(tmp_path: Path, door: dict) -> None:
    stand = (0.4, -0.1, 0.0) if door is not SLIDING else (1.0, 1.3, 0.0)
    world = World(load(tmp_path, door, start=stand))
    robot = SimulatedRobot(world, camera=None)
    world.set_door("office", True)
    run(world, OPENING_TIME + 1.0)
    waiting = world.door_opening("office")
    assert 0.0 < waiting < 0.9
    assert (robot.contacts.collisions, robot.contacts.grazes) == (0, 0)
    robot.kidnap(Pose2D(-3.0, -3.0, 0.0))
    run(world, OPENING_TIME + 0.1)
    assert world.door_opening("office") == 1.0
    world.close()


def test_a_door_closes_beside_a_robot_that_is_not_in_the_way(tmp_path: Path) -> None:
    """The robot stands closer to the sliding leaf than the distance at which a leaf stops."""
    world = World(load(tmp_path, {**SLIDING, "open": True}, start=(0.64, 0.5, 0.0)))
    robot = SimulatedRobot(world, camera=None)
    world.set_door("office", False)
    run(world, OPENING_TIME + 0.1)
    assert world.door_opening("office") == 0.0
    assert (robot.contacts.collisions, robot.contacts.grazes) == (0, 0)
    world.close()


def test_the_laser_detects_a_door_and_the_map_does_not_have_it(tmp_path: Path) -> None:
    wall = {"kind": "wall", "height": 2, "points": [[1, -3], [1, -0.5]]}
    other = {"kind": "wall", "height": 2, "points": [[1, 0.5], [1, 3]]}
    description = load(tmp_path, wall, other, {**HINGED, "swing": "right"})
    map = rasterise(description)
    assert map.free[map.cell(1.0, 0.0)]
    assert map.occupied[map.cell(1.0, 1.0)]
    assert description.clearance_at(1.0, 0.0) == 0.0, "a start in the closed door is refused"
    world = World(description)
    robot = SimulatedRobot(world, camera=None)
    ahead = len(robot.scan().ranges) // 2
    assert robot.scan().ranges[ahead] == pytest.approx(0.8, abs=0.15)
    world.set_door("office", True)
    run(world, OPENING_TIME + 0.2)
    assert math.isinf(robot.scan().ranges[ahead])
    world.close()


def test_runs_with_doors_are_identical(tmp_path: Path) -> None:
    def trace() -> list[object]:
        world = World(load(tmp_path, HINGED, start=(0.2, 0.0, 0.0)), seed=4)
        robot = SimulatedRobot(world, camera=None)
        world.set_door("office", True)
        robot.drive(0.1, 0.0)
        run(world, 2.0)
        found = [world.door_opening("office"), robot.true_pose(), robot.scan().ranges.tobytes()]
        world.close()
        return found

    assert trace() == trace()


def test_people_keep_away_from_closed_doors() -> None:
    description = load_world_description("lobby")
    for seed in range(3):
        people = with_people(description, 3, random_generator(seed, "people")).objects[
            len(description.objects) :
        ]
        leaves = [item for item in description.objects if item.name in description.doors]
        assert len(leaves) == 2
        assert all(leaf.distance(*person.position[:2]) > RADIUS for leaf in leaves for person in people)


def test_people_do_not_walk_through_doors_and_doors_do_not_hit_people() -> None:
    lobby = load_world_description("lobby")
    world = World(with_people(lobby, 4, random_generator(2, "people")), seed=2)
    people = PeopleSimulation(world, ClearanceMap.of(world.description), lambda: Pose2D(0.0, 0.0, 0.0), 0.27)
    walked, nearest = 0.0, math.inf
    for second in range(60):
        if second % 5 == 0:
            for name in lobby.doors:
                world.set_door(name, second % 10 == 0)
        before = people.places()
        run(world, 1.0)
        walked += sum(map(math.dist, before, people.places()))
        nearest = min(nearest, *(world.door_distance(*place) for place in people.places()))
    world.close()
    assert walked > 10.0
    assert nearest > RADIUS


class EventTargetMock:
    """A robot that records the poses to which events move it."""

    def __init__(self) -> None:
        self.poses = [Pose2D(0.0, 0.0, 0.0)]

    def true_pose(self) -> Pose2D:
        return self.poses[-1]

    def kidnap(self, pose: Pose2D) -> None:
        self.poses.append(pose)


def test_robots_are_not_put_into_doors(tmp_path: Path) -> None:
    """A door in the middle of a room of 6 m by 6 m; on the map of the room this is free floor."""
    corners = [[-2, -3], [4, -3], [4, 3], [-2, 3]]
    room = load(tmp_path, {"kind": "wall", "closed": True, "points": corners, "height": 2}, HINGED)
    starts = [with_start(room, "random", random_generator(seed, "start"), 0.27).pose for seed in range(60)]
    world, robot = World(room, seed=1), EventTargetMock()
    assert all(world.door_distance(pose.x, pose.y) > 0.3 for pose in starts)
    events = [parse_event(f"kidnap:{second}") for second in range(1, 31)]
    EventRunner(world, robot, 0.27, events, ClearanceMap.of(room), list)
    run(world, 31.0)
    assert len(robot.poses) == 31
    assert all(world.door_distance(pose.x, pose.y) > 0.7 for pose in robot.poses)
    world.close()


@pytest.mark.parametrize(
    ("door", "message"),
    [
        ({**HINGED, "name": "a:b"}, 'name\' is "a:b", and a text like "kitchen_door" is expected'),
        ({"kind": "hinged_door", "position": [0, 0]}, "name' is missing"),
        ({**SLIDING, "swing": "left"}, "swing' is unknown"),
    ],
)
def test_a_mistake_in_a_door_is_reported(tmp_path: Path, door: dict, message: str) -> None:
    with pytest.raises(SimError, match=message):
        load(tmp_path, door)


def test_an_unknown_door_is_reported_with_the_known_doors(tmp_path: Path) -> None:
    world = World(load(tmp_path, HINGED, {**SLIDING, "name": "entrance", "position": [0, 3]}))
    with pytest.raises(
        SimError, match=r"no door 'ofice': doors are office, entrance; did you mean 'office'\?"
    ):
        world.set_door("ofice", True)
    world.close()
    with pytest.raises(SimError, match="world 'arena': there is no door 'office': it has no doors"):
        load_world_description("arena").door("office")
