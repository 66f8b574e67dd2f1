"""People: where they walk, that they stop before a robot, and reproducibility by seed."""

import itertools
import math
import threading
from collections.abc import Callable

import pytest

from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.map_rasteriser import overhangs
from btcore_sim.people import FROM_WALLS, RADIUS, ROBOT_DISTANCE, SPEED, PeopleSimulation, with_people
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scenario import Scenario
from btcore_sim.world import World, random_generator
from btcore_sim.world_description import WorldDescription
from btcore_sim.worlds import load_world_description

SECOND = 1_000_000_000
ROBOT = 0.27
NOWHERE = Pose2D(100.0, 100.0, 0.0)

Stroll = Callable[..., tuple[World, PeopleSimulation]]


@pytest.fixture
def stroll():
    """People in a world, with a robot at the pose that a function returns."""
    worlds = []

    def make(
        name: str, count: int, seed: int = 1, robot: Callable[[], Pose2D] = lambda: NOWHERE
    ) -> tuple[World, PeopleSimulation]:
        description = Scenario(people=count).add_to(load_world_description(name), seed, ROBOT)
        worlds.append(World(description, seed=seed))
        return worlds[-1], PeopleSimulation(worlds[-1], ClearanceMap.of(description), robot, ROBOT)

    yield make
    for world in worlds:
        world.close()


def tracks(world: World, people: PeopleSimulation, seconds: int) -> list[list[tuple[float, float]]]:
    """Return the positions of all people, ten times a second."""
    seen = []
    for tick in range(1, 10 * seconds + 1):
        world.wait_until(tick * SECOND // 10, threading.Event())
        seen.append(people.places())
    return seen


def nearest(description: WorldDescription, x: float, y: float) -> float:
    return min(item.distance(x, y) for item in description.objects if not item.is_kinematic) - RADIUS


@pytest.mark.parametrize("name", ["house", "aws_house"])
def test_people_walk_at_their_speed_and_keep_from_walls_and_tables(stroll: Stroll, name: str) -> None:
    world, people = stroll(name, 3)
    places = [people.places(), *tracks(world, people, 60)]
    for index in range(3):
        steps = [math.dist(a[index], b[index]) for a, b in itertools.pairwise(places)]
        assert max(steps) <= SPEED / 10 + 1e-9
        assert sum(steps) > 0.6 * SPEED * 60
        for at in places:
            assert nearest(world.description, *at[index]) >= FROM_WALLS
            for x0, y0, x1, y1 in overhangs(world.description):
                assert not (x0 < at[index][0] < x1 and y0 < at[index][1] < y1)


def test_people_do_not_walk_through_each_other(stroll: Stroll) -> None:
    world, people = stroll("arena", 4)
    for places in tracks(world, people, 60):
        for number, (x, y) in enumerate(places):
            for other in places[:number]:
                assert math.dist((x, y), other) >= 2 * RADIUS


def test_the_engine_has_people_at_their_places(stroll: Stroll) -> None:
    world, people = stroll("house", 3)
    for tick in range(1, 100):
        world.wait_until(tick * 70_000_000, threading.Event())
        for person in people.people:
            (x, y, z), _ = pybullet.getBasePositionAndOrientation(person.body, physicsClientId=world.client)
            assert math.dist((x, y), (person.x, person.y)) <= SPEED / 20 + 0.005
            assert z == pytest.approx(0.85)


def test_people_stop_before_a_robot_that_stands(stroll: Stroll) -> None:
    pose = Pose2D(0.0, 0.0, 0.0)
    closest = math.inf
    for seed in range(6):
        world, people = stroll("arena", 3, seed, lambda: pose)
        for places in tracks(world, people, 40):
            closest = min(closest, *(math.dist(at, (pose.x, pose.y)) for at in places))
    assert ROBOT_DISTANCE <= closest - ROBOT - RADIUS < ROBOT_DISTANCE + 0.15


def test_blocked_people_go_elsewhere_after_a_while(stroll: Stroll) -> None:
    before = [NOWHERE]
    world, people = stroll("arena", 1, robot=lambda: before[0])
    person = people.people[0]
    tracks(world, people, 1)
    heading = person.heading
    ahead = ROBOT + RADIUS + 0.4
    before[0] = Pose2D(person.x + ahead * math.cos(heading), person.y + ahead * math.sin(heading), 0.0)
    stood = person.x, person.y
    world.wait_until(2 * SECOND, threading.Event())
    assert person.speed == 0.0
    assert math.dist((person.x, person.y), stood) <= SPEED / 20 + 1e-9
    world.wait_until(6 * SECOND, threading.Event())
    assert math.dist((person.x, person.y), stood) > 0.5


def test_the_same_seed_makes_the_same_walks(stroll: Stroll) -> None:
    assert tracks(*stroll("house", 3, 4), 20) == tracks(*stroll("house", 3, 4), 20)
    assert tracks(*stroll("house", 3, 4), 1) != tracks(*stroll("house", 3, 5), 1)


def test_no_person_starts_near_the_robot() -> None:
    for seed in range(20):
        description = with_people(load_world_description("house"), 4, random_generator(seed, "people"))
        people = [item for item in description.objects if item.is_kinematic]
        assert len(people) == 4
        assert all(person.distance(0.0, 0.0) >= 1.0 for person in people)


def test_more_people_than_fit_are_refused() -> None:
    with pytest.raises(SimError, match=r"world 'arena': there is no room for 90 people, only for \d+"):
        with_people(load_world_description("arena"), 90, random_generator(1, "people"))
