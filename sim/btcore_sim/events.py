"""Events during a run: a box drops in front of the robot, or the robot is carried to another place.

`box:30` drops a box of 0.5 m at 30 s, or later, as soon as the robot drives straight and there is a
suitable place; `box:30@2,0.3` drops it 2 m ahead and 0.3 m to the left. `kidnap:60` carries the robot to
another place at 60 s, or later, as soon as the robot moves.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from btcore_robot.field_reader import did_you_mean
from btcore_robot.robot import Phase, Pose2D
from btcore_sim.clearance_map import ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.obstacles import FROM_WAYPOINTS, PASSAGE, passable
from btcore_sim.scene import Scene, SceneObject
from btcore_sim.world import World

__all__ = ["Event", "parse_event"]

KINDS = {
    "box": "a box drops in front of the robot, where the robot can pass it",
    "kidnap": "the robot is carried to another place",
}
"""The kinds of events, with their descriptions."""

AHEAD = 1.5
"""Smallest and default distance (m) between the robot's hull and the near side of a dropped box."""

SIDE = 0.5
"""Side length (m) of a dropped box."""

CLEAR = 0.5
"""Clearance (m) around the hull at the place to which the robot is carried."""

FAR = 2.0
"""Smallest distance (m) over which the robot is carried."""

_FORM = re.compile(
    r"(?P<kind>[^:@]*):(?P<time>\d+(?:\.\d+)?)"
    r"(?:@(?P<distance>\d+(?:\.\d+)?)(?:,(?P<offset>-?\d+(?:\.\d+)?))?)?"
)
_NAME = "dropped_box_"
_COLOR = (204, 120, 178, 255)
_RATE = 10.0  # Hz at which the conditions of pending events are checked
_TRIES = 500
_STRAIGHT = 0.15  # rad/s: slower turns count as driving straight
_DRIVING = 0.1  # m/s: slower motion counts as standing
_PARKED = -2.0  # m: the height, below the floor, of a box that has not dropped yet


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a run.

    Attributes:
        kind: The kind of the event.
        time: The earliest time (ns).
        distance: The distance ahead (m) at which a box drops.
        offset: The distance to the left (m) at which a box drops.
    """

    kind: str
    time: float
    distance: float = AHEAD
    offset: float = 0.0


def parse_event(text: str) -> Event:
    """Parse an event of the option `--event`.

    Args:
        text: `box:TIME[@DISTANCE[,OFFSET]]` or `kidnap:TIME`; the time in s, distance and offset in m.

    Returns:
        The event.

    Raises:
        SimError: *text* has another form, an unknown kind, or a distance that is too small.

    Examples:
        >>> from btcore_sim.events import parse_event
        >>> parse_event("box:10@1.5").distance
        1.5
    """
    match = _FORM.fullmatch(text.strip())
    if match is None:
        raise SimError(
            f"invalid event '{text}': use KIND:TIME in seconds, like kidnap:60; a box may have a place "
            "in metres, box:TIME@DISTANCE,OFFSET, like box:30@2,0.3"
        )
    kind = match["kind"]
    if kind not in KINDS:
        raise SimError(
            f"event '{text}': unknown kind '{kind}': {did_you_mean(kind, KINDS)}kinds are {', '.join(KINDS)}"
        )
    if match["distance"] is None:
        return Event(kind, float(match["time"]) * 1e9)
    if kind != "box":
        raise SimError(f"event '{text}': only a box has a distance; use {kind}:{match['time']}")
    distance = float(match["distance"])
    if distance < AHEAD:
        raise SimError(
            f"event '{text}': the robot cannot avoid a box that drops {distance:g} m ahead: "
            f"use {AHEAD:g} m or more"
        )
    return Event(kind, float(match["time"]) * 1e9, distance, float(match["offset"] or 0.0))


def with_boxes(scene: Scene, events: Sequence[Event], spare: int = 0) -> Scene:
    """Return a copy of the scene with a box for every `box` event, parked below the floor.

    Args:
        scene: The scene; it is not modified.
        events: The events of the run; events of other kinds are ignored.
        spare: The number of further boxes, for events that are triggered during the run.
    """
    x, y = ((scene.area[0] + scene.area[2]) / 2, (scene.area[1] + scene.area[3]) / 2)
    size, place = (SIDE, SIDE, SIDE), (x, y, _PARKED)
    boxes = [
        SceneObject(f"{_NAME}{number}", "box", size, place, 0.0, 0.0, _COLOR, is_kinematic=True)
        for number in range(sum(event.kind == "box" for event in events) + spare)
    ]
    return replace(scene, things=(*scene.things, *boxes))


class EventTarget(Protocol):
    """The robot that is affected by events."""

    def true_pose(self) -> Pose2D:
        """Return the true pose (m, rad)."""

    def ramped_twist(self) -> tuple[float, float]:
        """Return the velocity (m/s, rad/s) that is commanded to the wheels."""

    def teleport(self, pose: Pose2D) -> None:
        """Move the robot to *pose*, without a change of its odometry."""


class EventRunner:
    """Triggers *events* for *robot*, which has the radius *radius* (m).

    *floor* is the clearance map of the world. *people* returns the positions (m) of all people.
    """

    def __init__(
        self,
        world: World,
        robot: EventTarget,
        radius: float,
        events: Sequence[Event],
        floor: ClearanceMap,
        people: Callable[[], Sequence[Point]],
    ) -> None:
        self.event_log: list[dict[str, object]] = []
        """The events so far: kind, time (s) and place (m); for `kidnap` also the robot's pose before."""
        self._world = world
        self._robot = robot
        self._radius = radius
        self._floor = floor
        self._people = people
        self._random = world.random("events")
        self._boxes = world.kinematic_bodies(_NAME)
        self._pending = sorted(events, key=lambda event: event.time)
        world.schedule.every(_RATE, Phase.PHYSICS, self._trigger_due)

    def trigger(self, kind: str) -> None:
        """Trigger an event of *kind* as soon as its condition is met: the robot drives, and there is a place.

        Raises:
            SimError: All boxes of the run are used, or *kind* is unknown.
        """
        if kind not in KINDS:
            raise SimError(f"unknown kind of event '{kind}': kinds are {', '.join(KINDS)}")
        if kind == "box" and len(self._boxes) <= sum(event.kind == "box" for event in self._pending):
            raise SimError("there is no further box: all boxes of this run have dropped or are about to drop")
        self._pending.append(Event(kind, self._world.now()))

    def _trigger_due(self, now: int) -> None:
        for event in list(self._pending):
            if event.time <= now and (self._drop(event) if event.kind == "box" else self._kidnap()):
                self._pending.remove(event)
                # `_drop` and `_kidnap` log the place; kind and time are put before it.
                self.event_log[-1] = {"event": event.kind, "t": now / 1e9, **self.event_log[-1]}

    def _drop(self, event: Event) -> bool:
        v, w = self._robot.ramped_twist()
        if v < _DRIVING or abs(w) > _STRAIGHT:
            return False
        pose = self._robot.true_pose()
        box = ahead_of(pose, self._radius, event, self._world.bodies[self._boxes[0]])
        if not self.fits(box, pose):
            return False
        x, y, _ = box.position
        self._world.move_kinematic_body(self._boxes.pop(0), x, y, box.yaw)
        self._floor.add_obstacle(box)
        self.event_log.append({"x": round(x, 3), "y": round(y, 3)})
        return True

    def fits(self, box: SceneObject, pose: Pose2D) -> bool:
        """Return whether *box* may drop in front of a robot at *pose*.

        The box needs free floor that is visible from the robot. It must keep a distance from waypoints and
        people. The robot must still be able to drive past the box and to all waypoints.

        Args:
            box: The box at the place where it would drop.
            pose: The robot's true pose (m, rad).
        """
        x, y, _ = box.position
        floor = self._floor
        corners = math.hypot(*box.size[:2]) / 2
        points = list(self._world.scene.waypoints.values())
        return (
            floor.clearance_at(x, y) > corners
            and floor.clearance_along((pose.x, pose.y), (x, y)) > 0.0
            and all(box.distance(*point) >= FROM_WAYPOINTS for point in points)
            and all(box.distance(*place) >= PASSAGE for place in self._people())
            and passable(floor, box, pose.yaw)
            and floor.with_obstacle(box).connected([*points, (pose.x, pose.y)], self._radius + 0.05)
        )

    def _kidnap(self) -> bool:
        v, w = self._robot.ramped_twist()
        if abs(v) < _DRIVING / 2 and abs(w) < _STRAIGHT:
            return False
        before = self._robot.true_pose()
        for _ in range(_TRIES):
            place = self._floor.random_point(self._random, self._radius + CLEAR + self._floor.map.resolution)
            if place is None:
                return False
            people = min((math.dist(place, person) for person in self._people()), default=math.inf)
            if math.dist(place, (before.x, before.y)) > FAR and people > 1.0 + self._radius:
                pose = Pose2D(*place, float(self._random.uniform(-math.pi, math.pi)))
                self._robot.teleport(pose)
                self.event_log.append(
                    {"from": _rounded(before), "x": _rounded(pose)[0], "y": _rounded(pose)[1]}
                )
                return True
        return False


def ahead_of(pose: Pose2D, radius: float, event: Event, box: SceneObject) -> SceneObject:
    """Return *box* at the distance and offset of *event* from the robot, turned to the robot's heading.

    Args:
        pose: The robot's pose (m, rad).
        radius: The robot's radius (m).
        event: The event that drops the box.
        box: The box to place.
    """
    cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
    along = radius + event.distance + box.size[0] / 2
    x, y = pose.x + cos * along - sin * event.offset, pose.y + sin * along + cos * event.offset
    return replace(box, position=(x, y, 0.0), yaw=pose.yaw)


def _rounded(pose: Pose2D) -> list[float]:
    return [round(pose.x, 3), round(pose.y, 3), round(pose.yaw, 3)]
