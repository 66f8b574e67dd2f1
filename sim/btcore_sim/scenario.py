"""The additions of a run to its world: start pose, people, obstacles that are not on the map, events."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D
from btcore_sim.clearance_map import BESIDE_HULL, ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.events import Event, EventRunner, with_boxes
from btcore_sim.obstacles import with_obstacles
from btcore_sim.people import PeopleSimulation, with_people
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World, random_generator
from btcore_sim.world_description import WorldDescription

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

    def add_to(self, description: WorldDescription, seed: int, radius: float) -> WorldDescription:
        """Return *description* with people, obstacles and the boxes that events will drop.

        Args:
            description: The world without these additions.
            seed: The seed of the random places.
            radius: The radius (m) of the robot, which obstacles leave room to pass.

        Raises:
            SimError: There is not enough room.
        """
        if self.obstacles:
            description = with_obstacles(
                description, self.obstacles, random_generator(seed, "obstacles"), radius
            )
        if self.people:
            description = with_people(description, self.people, random_generator(seed, "people"))
        if self.events or self.spare_boxes:
            description = with_boxes(description, self.events, self.spare_boxes)
        return description

    def begin(self, world: World, robot: SimulatedRobot, radius: float) -> EventRunner | None:
        """Let the people walk, and schedule the events.

        Args:
            world: The world, made from the result of `add_to`.
            robot: The robot that the events affect.
            radius: The robot's radius (m).

        Returns:
            The runner of the events, or None without people, events and spare boxes.
        """
        if not (self.people or self.events or self.spare_boxes):
            return None
        floor = ClearanceMap.of(world.description)
        people = PeopleSimulation(world, floor, robot.true_pose, radius)
        return EventRunner(world, robot, radius, self.events, floor, people.places)


def with_start(
    description: WorldDescription, text: str, random: np.random.Generator, radius: float
) -> WorldDescription:
    """Return *description* with another start pose.

    With `random` or `unknown` the start is a free place from which the robot can drive to all waypoints, with
    a random heading. A world without a start pose has its own rule for random starts, and keeps that rule.

    Args:
        description: The world.
        text: `random`, `unknown`, `X,Y` (m) or `X,Y,YAW` (m, degrees).
        random: The source of the random pose.
        radius: The radius (m) of the robot.

    Raises:
        SimError: *text* has another form, or the world has no free place.
    """
    if text not in ("random", "unknown"):
        return replace(description, pose=_parsed(text))
    if description.pose is None:
        return description
    return replace(description, pose=_drawn(description, text, random, radius))


def _drawn(description: WorldDescription, text: str, random: np.random.Generator, radius: float) -> Pose2D:
    floor, clearance = ClearanceMap.of(description), radius + BESIDE_HULL
    points: list[Point] = list(description.waypoints.values())
    # The clearance map has no doors.
    leaves = [item for item in description.objects if item.name in description.doors]
    for _ in range(_TRIES):
        place = floor.random_point(random, clearance)
        if place is None:
            break
        yaw = random.uniform(-math.pi, math.pi)
        in_door = any(leaf.distance(*place) < clearance for leaf in leaves)
        if not in_door and floor.connected([*points, place], clearance):
            return Pose2D(*place, yaw)
    raise SimError(
        f"--start {text}: world '{description.name}' has no free place with a way to all its waypoints"
    )


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
