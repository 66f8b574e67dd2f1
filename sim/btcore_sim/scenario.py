"""The additions of a run to its world: start pose, people, obstacles that are not on the map, events."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import BESIDE_HULL, ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.events import Event, EventRunner, EventTarget, with_boxes
from btcore_sim.obstacles import with_obstacles
from btcore_sim.people import PeopleSimulation, with_people
from btcore_sim.scene import Scene
from btcore_sim.world import World, random_generator

_TRIES = 300  # attempts to draw a place


@dataclass(frozen=True, slots=True)
class Scenario:
    """The numbers of *people* and *obstacles* that a run adds to its world, and the *events* of the run.

    *spare_boxes* is the number of boxes for events that are triggered during the run.
    """

    people: int = 0
    obstacles: int = 0
    events: Sequence[Event] = ()
    spare_boxes: int = 0

    def scene(self, scene: Scene, seed: int, radius: float) -> Scene:
        """Return the scene with people, obstacles and the boxes that events will drop.

        Args:
            scene: The world without these additions.
            seed: The seed of the random places.
            radius: The radius (m) of the robot, which obstacles leave room to pass.

        Raises:
            SimError: There is not enough room.
        """
        if self.obstacles:
            scene = with_obstacles(scene, self.obstacles, random_generator(seed, "obstacles"), radius)
        if self.people:
            scene = with_people(scene, self.people, random_generator(seed, "people"))
        return with_boxes(scene, self.events, self.spare_boxes) if self.events or self.spare_boxes else scene

    def begin(self, world: World, robot: EventTarget, radius: float) -> EventRunner | None:
        """Let the people walk, and schedule the events.

        Args:
            world: The world, made from the result of `scene`.
            robot: The robot that the events affect.
            radius: The robot's radius (m).

        Returns:
            The runner of the events, or None without people, events and spare boxes.
        """
        if not (self.people or self.events or self.spare_boxes):
            return None
        floor = ClearanceMap.of(world.scene)
        people = PeopleSimulation(world, floor, robot.true_pose, radius)
        return EventRunner(world, robot, radius, self.events, floor, people.places)


def with_start(scene: Scene, text: str, random: np.random.Generator, radius: float) -> Scene:
    """Return the scene with another start pose.

    With `random` or `unknown` the start is a free place from which the robot can drive to all waypoints, with
    a random heading; a world with its own rule for random starts keeps that rule.

    Args:
        scene: The world with its own rule for the start.
        text: `random`, `unknown`, `X,Y` (m) or `X,Y,YAW` (m, degrees).
        random: The source of the random pose.
        radius: The radius (m) of the robot.

    Raises:
        SimError: *text* has another form, or the world has no free place.
    """
    if text in ("random", "unknown"):
        return scene if scene.pose is None else replace(scene, pose=_drawn(scene, text, random, radius))
    return replace(scene, pose=_parsed(text))


def _drawn(scene: Scene, text: str, random: np.random.Generator, radius: float) -> Pose2D:
    floor, room = ClearanceMap.of(scene), radius + BESIDE_HULL
    points: list[Point] = list(scene.waypoints.values())
    # The clearance map has no doors.
    leaves = [thing for thing in scene.things if thing.name in scene.doors]
    for _ in range(_TRIES):
        place = floor.random_point(random, room)
        if place is None:
            break
        yaw = random.uniform(-math.pi, math.pi)
        in_door = any(leaf.distance(*place) < room for leaf in leaves)
        if not in_door and floor.connected([*points, place], room):
            return Pose2D(*place, yaw)
    raise SimError(f"--start {text}: world '{scene.name}' has no free place with a way to all its waypoints")


def _parsed(text: str) -> Pose2D:
    try:
        x, y, *turn = (float(part) for part in text.split(","))
        (degrees,) = turn or [0.0]
    except ValueError:
        raise SimError(
            f"--start {text}: use random, unknown, X,Y or X,Y,YAW in metres and degrees, like 1.5,-2,90"
        ) from None
    if not all(map(math.isfinite, (x, y, degrees))):
        raise SimError(f"--start {text}: X, Y and YAW have to be finite numbers")
    return Pose2D(x, y, wrap_angle(math.radians(degrees)))
