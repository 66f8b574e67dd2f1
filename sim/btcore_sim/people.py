"""Simulated people. They walk on straight lines between random places, and stop for the robot."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from btcore_robot.robot import Phase, Pose2D
from btcore_sim.clearance_map import ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.world import World
from btcore_sim.world_description import Color, WorldDescription, WorldObject

RADIUS = 0.25
"""Radius (m) of the cylinder that represents a person."""

HEIGHT = 1.7
"""Height (m) of a person."""

SPEED = 0.5
"""Walking speed (m/s)."""

ROBOT_DISTANCE = 0.5
"""Distance (m, edge to edge) that a person keeps from a robot ahead."""

FROM_WALLS = 0.35
"""Distance (m) that a person keeps from walls and objects."""

FROM_DOORS = 0.1
"""Distance (m) that a person keeps from the leaf of a door."""

_NAME = "person_"
_RATE = 20.0  # Hz of decisions; between two decisions the engine moves the bodies by their velocities
_ROOM = RADIUS + FROM_WALLS + 0.03  # m: the clearance of a path; the map is exact to half a cell (0.025 m)
_PERSONAL = 0.3  # m that people keep from each other
_RESTART_MARGIN = 0.1  # m: added to the stopping distance to obtain the distance at which a person walks on
_CHOICES = 4  # number of candidates for a goal; the farthest becomes the goal
_TRIES = 20  # attempts to find the candidates
_MAX_WAIT_S = 2.0  # s for which a person waits before it chooses another goal
_FAR = 1.5  # m between a person and the robot at the start; between two people it is 1 m
_SHIRTS: tuple[Color, ...] = ((58, 92, 160, 255), (160, 62, 84, 255), (70, 130, 92, 255), (110, 84, 150, 255))


def with_people(description: WorldDescription, count: int, random: np.random.Generator) -> WorldDescription:
    """Return *description* with additional people on the free floor.

    Args:
        count: The number of people.
        random: The source of the random places.

    Raises:
        SimError: There is not enough room for *count* people.
    """
    floor = ClearanceMap.of(description)
    robots = [(description.pose.x, description.pose.y)] if description.pose is not None else []
    objects: list[WorldObject] = []
    leaves = [item for item in description.objects if item.name in description.doors]
    for number in range(count):
        place = _place(floor, random, robots, [*leaves, *objects])
        if place is None:
            raise SimError(
                f"world '{description.name}': there is no room for {count} people, only for {number}"
            )
        shirt = _SHIRTS[number % len(_SHIRTS)]
        size = (2 * RADIUS, 2 * RADIUS, HEIGHT)
        objects.append(
            WorldObject(
                f"{_NAME}{number}", "cylinder", size, (*place, 0.0), 0.0, 0.0, shirt, is_kinematic=True
            )
        )
    return replace(description, objects=(*description.objects, *objects))


def _place(
    floor: ClearanceMap, random: np.random.Generator, robots: list[Point], obstacles: list[WorldObject]
) -> Point | None:
    for _ in range(200):
        place = floor.random_point(random, _ROOM)
        if place is None:
            return None
        near = min((math.dist(place, robot) for robot in robots), default=math.inf)
        if near >= _FAR and all(item.distance(*place) >= 1.0 for item in obstacles):
            return place
    return None


@dataclass(slots=True)
class Person:
    """A person: position and goal (m), present speed (m/s), and for how long (s) the person has waited.

    *body* is PyBullet's ID of the body.
    """

    body: int
    x: float
    y: float
    goal: Point
    random: np.random.Generator
    speed: float = 0.0
    waited: float = 0.0

    @property
    def heading(self) -> float:
        """The direction of the goal (rad)."""
        return math.atan2(self.goal[1] - self.y, self.goal[0] - self.x)


class PeopleSimulation:
    """The walking people of a world. They walk at `SPEED`.

    *robot* returns the robot's pose, and *radius* (m) is the robot's radius. A person stops when the robot is
    ahead and nearer than `ROBOT_DISTANCE`. After 2 s the person chooses a goal away from the robot.
    People do not walk into a standing robot, a closed door, nor into the obstacles of the *floor*.
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
            world.schedule.add_task(_RATE, Phase.PHYSICS, self._decide)

    def places(self) -> list[Point]:
        """Return the positions of all people (m)."""
        return [(person.x, person.y) for person in self.people]

    def _decide(self, now: int) -> None:
        robot = self._robot()
        # All people move before the first person decides, so that the order of the people has no effect.
        for person in self.people:
            step = min(person.speed / _RATE, math.dist((person.x, person.y), person.goal))
            heading = person.heading
            person.x += step * math.cos(heading)
            person.y += step * math.sin(heading)
        for person in self.people:
            if math.dist((person.x, person.y), person.goal) < 1e-6 or not self._open(person):
                self._choose(person, [])
            in_the_way = self._in_the_way_of(person, robot)
            if in_the_way:
                person.speed = 0.0
                person.waited += 1.0 / _RATE
                if person.waited >= _MAX_WAIT_S:
                    person.waited = 0.0
                    self._choose(person, in_the_way)
            else:
                person.waited = 0.0
                left = math.dist((person.x, person.y), person.goal)
                person.speed = min(SPEED, left * _RATE)
            self._world.move_kinematic_body(person.body, person.x, person.y, person.heading, v=person.speed)

    def _open(self, person: Person) -> bool:
        """Return whether the next 0.3 m of the path are free of new obstacles."""
        left = math.dist((person.x, person.y), person.goal)
        ahead = min(0.3, left)
        x = person.x + ahead * math.cos(person.heading)
        y = person.y + ahead * math.sin(person.heading)
        if self._leads_to_door(person, x, y):
            return False
        return self._floor.clearance_at(x, y) >= self._needed(person) - self._floor.map.resolution

    def _leads_to_door(self, person: Person, x: float, y: float) -> bool:
        """Return whether the way to the point (x, y; m) leads nearer to a door's leaf than `FROM_DOORS`."""
        after = self._world.door_distance(x, y)
        return after < RADIUS + FROM_DOORS and after < self._world.door_distance(person.x, person.y)

    def _needed(self, person: Person) -> float:
        """Return the clearance (m) that a path needs: less if the person's own place has less clearance."""
        return min(_ROOM, self._floor.clearance_at(person.x, person.y))

    def _choose(self, person: Person, away_from: Sequence[Point]) -> None:
        """Choose the farthest of up to four random goals.

        The direction to the goal must not lead nearer to any point of *away_from*. Without such a goal the
        person keeps the old goal if *away_from* is given, and otherwise stands.
        """
        here = before = (person.x, person.y)
        if away_from:
            before = person.goal
        goals: list[Point] = []
        for _ in range(_TRIES):
            goal = self._floor.random_visible_point(person.random, here, self._needed(person), 0.5, 8.0)
            if goal is None or len(goals) == _CHOICES:
                break
            # `_ahead` depends on the goal, so each candidate is set as the goal to test it.
            person.goal = goal
            if not any(_ahead(person, place) for place in away_from):
                goals.append(goal)
        person.goal = max(goals, key=lambda goal: math.dist(here, goal), default=before)

    def _in_the_way_of(self, person: Person, robot: Pose2D) -> list[Point]:
        """Return the positions (m) of the robot and the people for which *person* has to stop."""
        margin = _RESTART_MARGIN if person.speed == 0.0 else SPEED / _RATE
        bodies = [(robot.x, robot.y, self._reach + ROBOT_DISTANCE)]
        bodies += [
            (walker.x, walker.y, 2 * RADIUS + _PERSONAL) for walker in self.people if walker is not person
        ]
        return [
            (x, y)
            for x, y, apart in bodies
            if math.dist((person.x, person.y), (x, y)) < apart + margin and _ahead(person, (x, y))
        ]


def _ahead(person: Person, place: Point) -> bool:
    """Return whether walking on brings the person nearer to *place*."""
    heading = person.heading
    return math.cos(heading) * (place[0] - person.x) + math.sin(heading) * (place[1] - person.y) > 0.0
