"""People who walk through a world: along straight lines between random places, and they mind the robot."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from btcore_robot.robot import Phase, Pose2D
from btcore_sim.clearance_map import ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.scene import Color, Scene, SceneObject
from btcore_sim.world import World

RADIUS = 0.25
HEIGHT = 1.7
SPEED = 0.5
"""m/s."""

POLITE = 0.5
"""m, edge to edge, that a person leaves to a robot ahead."""

FROM_WALLS = 0.35
"""m that a person keeps from what stands in a world."""

_NAME = "person_"
_RATE = 20.0  # Hz of decisions; between two of them the engine moves everybody on
_ROOM = RADIUS + FROM_WALLS + 0.03  # m around a person on the way; what stands there is known to half a cell
_PERSONAL = 0.3  # m that people leave to each other
_AGAIN = 0.1  # m more than what stopped a person until it walks on
_CHOICES = 4  # goals that a person thinks of
_TRIES = 20  # and how often, to find these
_PATIENCE = 2.0  # s a person stands before it goes somewhere else
_FAR = 1.5  # m from the robot and 1 m from each other at the start
_SHIRTS: tuple[Color, ...] = ((58, 92, 160, 255), (160, 62, 84, 255), (70, 130, 92, 255), (110, 84, 150, 255))


def with_people(scene: Scene, count: int, random: np.random.Generator) -> Scene:
    """The scene with *count* people on its free floor; raises `SimError` when there is no room for them."""
    floor = ClearanceMap.of(scene)
    taken = [(scene.pose.x, scene.pose.y)] if scene.pose is not None else []
    things: list[SceneObject] = []
    for number in range(count):
        place = _place(floor, random, taken, things)
        if place is None:
            raise SimError(f"world '{scene.name}': there is no room for {count} people, only for {number}")
        shirt = _SHIRTS[number % len(_SHIRTS)]
        size = (2 * RADIUS, 2 * RADIUS, HEIGHT)
        things.append(
            SceneObject(
                f"{_NAME}{number}", "cylinder", size, (*place, 0.0), 0.0, 0.0, shirt, is_kinematic=True
            )
        )
    return replace(scene, things=(*scene.things, *things))


def _place(
    floor: ClearanceMap, random: np.random.Generator, robots: list[Point], people: list[SceneObject]
) -> Point | None:
    for _ in range(200):
        place = floor.random_point(random, _ROOM)
        if place is None:
            return None
        near = min((math.dist(place, robot) for robot in robots), default=math.inf)
        if near >= _FAR and all(other.distance(*place) >= 1.0 for other in people):
            return place
    return None


@dataclass(slots=True)
class Person:
    """One person: where it is, where it goes, how fast (m/s) now, and since when (s) it stands."""

    body: int
    x: float
    y: float
    goal: Point
    random: np.random.Generator
    speed: float = 0.0
    waited: float = 0.0

    @property
    def heading(self) -> float:
        """The direction (rad) of the goal."""
        return math.atan2(self.goal[1] - self.y, self.goal[0] - self.x)


class PeopleSimulation:
    """The people of a world, walking at `SPEED`. *robot* tells where the robot is, *radius* (m) its size.

    A person stops when the robot is ahead and within `POLITE`; who has stood for a while goes where the robot
    is not ahead. Nobody walks into a robot that stands, or into anything that *floor* knows of.
    """

    def __init__(self, world: World, floor: ClearanceMap, robot: Callable[[], Pose2D], radius: float) -> None:
        self._world = world
        self._floor = floor
        self._robot = robot
        self._reach = radius + RADIUS
        self.people: list[Person] = []
        for body in world.kinematic_bodies(_NAME):
            x, y, _ = world.bodies[body].position
            self.people.append(Person(body, x, y, (x, y), world.random(world.bodies[body].name)))
        if self.people:
            self._decide(0)
            world.schedule.every(_RATE, Phase.PHYSICS, self._decide)

    def places(self) -> list[Point]:
        """Where everybody is."""
        return [(one.x, one.y) for one in self.people]

    def _decide(self, now: int) -> None:
        robot = self._robot()
        for person in self.people:
            step = min(person.speed / _RATE, math.dist((person.x, person.y), person.goal))
            heading = person.heading
            person.x += step * math.cos(heading)
            person.y += step * math.sin(heading)
        for person in self.people:
            if math.dist((person.x, person.y), person.goal) < 1e-6 or not self._open(person):
                self._choose(person, [])
            hindering = self._hindering(person, robot)
            if hindering:
                person.speed = 0.0
                person.waited += 1.0 / _RATE
                if person.waited >= _PATIENCE:
                    person.waited = 0.0
                    self._choose(person, hindering)
            else:
                person.waited = 0.0
                left = math.dist((person.x, person.y), person.goal)
                person.speed = min(SPEED, left * _RATE)
            self._world.move_kinematic_body(person.body, person.x, person.y, person.heading, v=person.speed)

    def _open(self, person: Person) -> bool:
        """Whether nothing has come to stand on the next bit of the way."""
        left = math.dist((person.x, person.y), person.goal)
        ahead = min(0.3, left)
        x = person.x + ahead * math.cos(person.heading)
        y = person.y + ahead * math.sin(person.heading)
        return self._floor.clearance_at(x, y) >= self._needed(person) - self._floor.map.resolution

    def _needed(self, person: Person) -> float:
        """Room (m) on the way: less for who stands where less has become of it."""
        return min(_ROOM, self._floor.clearance_at(person.x, person.y))

    def _choose(self, person: Person, away_from: Sequence[Point]) -> None:
        """A new goal, rather a far one, that leads nearer to none of *away_from*; none is standing still."""
        here = before = (person.x, person.y)
        if away_from:
            before = person.goal
        goals: list[Point] = []
        for _ in range(_TRIES):
            goal = self._floor.random_visible_point(person.random, here, self._needed(person), 0.5, 8.0)
            if goal is None or len(goals) == _CHOICES:
                break
            person.goal = goal
            if not any(_ahead(person, place) for place in away_from):
                goals.append(goal)
        person.goal = max(goals, key=lambda goal: math.dist(here, goal), default=before)

    def _hindering(self, person: Person, robot: Pose2D) -> list[Point]:
        """Where those are for whom *person* has to stand."""
        more = _AGAIN if person.speed == 0.0 else SPEED / _RATE
        others = [(robot.x, robot.y, self._reach + POLITE)]
        others += [(one.x, one.y, 2 * RADIUS + _PERSONAL) for one in self.people if one is not person]
        return [
            (x, y)
            for x, y, apart in others
            if math.dist((person.x, person.y), (x, y)) < apart + more and _ahead(person, (x, y))
        ]


def _ahead(person: Person, place: Point) -> bool:
    """Whether walking on brings the person nearer to *place*."""
    heading = person.heading
    return math.cos(heading) * (place[0] - person.x) + math.sin(heading) * (place[1] - person.y) > 0.0
