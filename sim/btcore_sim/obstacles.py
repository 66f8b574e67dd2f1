"""Movable boxes at random places that are not on the world's map."""

import math
from dataclasses import replace

import numpy as np

from btcore_sim.clearance_map import BESIDE_HULL, ClearanceMap
from btcore_sim.errors import SimError
from btcore_sim.world_description import WorldDescription, WorldObject

FROM_WAYPOINTS = 1.0
"""Smallest distance (m) between a box and any waypoint or the robot's fixed start."""

_MASS = 6.0  # kg
_COLOR = (122, 132, 70, 255)
_TRIES = 300  # attempts to place a box


def with_obstacles(
    description: WorldDescription, count: int, random: np.random.Generator, radius: float
) -> WorldDescription:
    """Return *description* with additional boxes at random places on the free floor.

    The boxes are 0.3–0.5 m long and wide, and block no way: the robot can still drive between all waypoints
    and past each box.

    Args:
        description: The world without the boxes.
        count: The number of boxes.
        random: The source of the random sizes and poses.
        radius: The radius (m) of the robot.

    Raises:
        SimError: There is not enough room for *count* boxes.
    """
    for number in range(count):
        floor = ClearanceMap.of(description)
        box = _draw(description, floor, f"obstacle_{number}", random, radius + BESIDE_HULL)
        if box is None:
            raise SimError(
                f"world '{description.name}': there is no room for {count} obstacles that block no way, "
                f"only for {number}"
            )
        description = replace(description, objects=(*description.objects, box))
    return description


def _draw(
    description: WorldDescription,
    floor: ClearanceMap,
    name: str,
    random: np.random.Generator,
    clearance: float,
) -> WorldObject | None:
    """Draw a box that leaves ways with *clearance* (m); None if there is no place for it."""
    points = list(description.waypoints.values())
    if description.pose is not None:
        points.append((description.pose.x, description.pose.y))
    for _ in range(_TRIES):
        length, width = random.uniform(0.3, 0.5, 2)
        height, yaw = random.uniform(0.3, 0.6), random.uniform(-math.pi, math.pi)
        place = floor.random_point(random, math.hypot(length, width) / 2 + 0.05)
        if place is None:
            return None
        box = WorldObject(name, "box", (length, width, height), (*place, 0.0), yaw, _MASS, _COLOR)
        if any(box.distance(*point) < FROM_WAYPOINTS for point in points):
            continue
        if any(item.is_kinematic and item.distance(*place) < 1.0 for item in description.objects):
            continue
        if passable(floor, box, clearance) and floor.with_obstacle(box).connected(points, clearance):
            return box
    return None


def passable(floor: ClearanceMap, box: WorldObject, clearance: float, course: float | None = None) -> bool:
    """Return whether a straight passage is free on at least one side of a box.

    Args:
        floor: The clearance map without the box.
        box: The box at its planned pose.
        clearance: The clearance (m) on the middle line of the passage: half its width.
        course: The direction (rad) in which a robot drives past the box. With None, a passage along either of
            the box's own axes is enough.
    """
    for along in (course,) if course is not None else (box.yaw, box.yaw + math.pi / 2):
        cos, sin = math.cos(along), math.sin(along)
        length, width, _ = box.size
        turn = along - box.yaw
        half_along = (abs(math.cos(turn)) * length + abs(math.sin(turn)) * width) / 2
        half_across = (abs(math.sin(turn)) * length + abs(math.cos(turn)) * width) / 2
        x, y, _ = box.position
        reach = half_along + clearance
        for side in (1.0, -1.0):
            aside = side * (half_across + clearance)
            start = (x - sin * aside - cos * reach, y + cos * aside - sin * reach)
            end = (x - sin * aside + cos * reach, y + cos * aside + sin * reach)
            if floor.clearance_along(start, end) >= clearance:
                return True
    return False
