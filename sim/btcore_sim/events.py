"""Events during a run: a box drops, the robot is moved to another place, a door opens or closes.

An event happens exactly at its time: `box:30` drops a box of 0.5 m at 30 s, `kidnap:60` moves the robot at
60 s. An event that is not possible at its time ends the run with an error. Only an event with a window, such
as `box:30-60`, waits: from 30 s on for the first suitable moment, and until 60 s at the latest.

Kidnapping, a term of robotics, is a move to another place that the odometry does not measure: `kidnap` does
this at once, `carry` along a path that laser and camera see.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

from btcore.clock import NS_PER_S
from btcore.suggestions import did_you_mean
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Phase, Pose2D
from btcore_sim.clearance_map import BESIDE_HULL, ClearanceMap, Point
from btcore_sim.errors import SimError
from btcore_sim.obstacles import FROM_WAYPOINTS, passable
from btcore_sim.simulated_robot import SimulatedRobot
from btcore_sim.world import World
from btcore_sim.world_description import WorldDescription, WorldObject

__all__ = ["Event", "parse_event"]

FORMS = {
    "box": "box:TIME[@AHEAD[,LEFT]]",
    "kidnap": "kidnap:TIME",
    "carry": "carry:TIME",
    "door": "door:NAME:open@TIME or door:NAME:close@TIME",
}
"""The form of each kind of events; TIME is a time (s), or except for doors a window FROM-TO (s)."""

AHEAD = 1.5
"""Default distance (m) between the robot's hull and the near side of a dropped box."""

SIDE = 0.5
"""Side length (m) of a dropped box."""

PASSAGE = 0.9
"""Width (m) of the passage that stays free beside a dropped box, and distance (m) of the box from people."""

CLEAR = 0.5
"""Clearance (m) around the hull at the place to which the robot is moved."""

FAR = 2.0
"""Smallest distance (m) over which the robot is moved."""

CARRYING_SPEED = 1.0
"""Speed (m/s) at which the robot is carried: a person who walks."""

_TIME = r"\d+(?:\.\d+)?"
_TIMED = re.compile(
    rf"(?P<kind>[^:@]*):(?P<time>{_TIME})(?:-(?P<latest>{_TIME}))?"
    rf"(?:@(?P<distance>{_TIME})(?:,(?P<offset>-?{_TIME}))?)?"
)
_DOOR = re.compile(rf"door:(?P<name>.+):(?P<action>[^:@]*)@(?P<time>{_TIME})")
_DOOR_ACTIONS = ("open", "close")
_NAME = "dropped_box_"
_COLOR = (204, 120, 178, 255)
_RATE = 10.0  # Hz at which the conditions of events with a window are checked
_TRIES = 500
_STRAIGHT = 0.15  # rad/s: slower turns count as driving straight
_DRIVING = 0.1  # m/s: slower motion counts as standing
_PARKED = -2.0  # m: the height, below the floor, of a box that has not dropped yet
_CARRIED_ROOM = 0.03  # m: least clearance around the hull on the way along which the robot is carried


@dataclass(frozen=True, slots=True)
class Event:
    """An event of a run.

    Attributes:
        kind: The kind of the event, a key of `FORMS`.
        time: The time (ns); with *latest* the earliest time.
        latest: The end of the window (ns) in which the event waits for a suitable moment; None = the event
            happens exactly at *time*.
        distance: The distance (m) between the robot's hull and the near side of a dropped box.
        offset: The distance to the left (m) at which a box drops.
        door: The name of the door.
        opens: Whether the door opens; False = it closes.
    """

    kind: str
    time: int
    latest: int | None = None
    distance: float = AHEAD
    offset: float = 0.0
    door: str = ""
    opens: bool = False

    def __str__(self) -> str:
        """Return the event in the form of the option `--event`."""
        time = f"{self.time / NS_PER_S:g}"
        if self.kind == "door":
            return f"door:{self.door}:{'open' if self.opens else 'close'}@{time}"
        window = "" if self.latest is None else f"-{self.latest / NS_PER_S:g}"
        place = ""
        if self.kind == "box" and (self.distance, self.offset) != (AHEAD, 0.0):
            place = f"@{self.distance:g},{self.offset:g}"
        return f"{self.kind}:{time}{window}{place}"


def parse_event(text: str) -> Event:
    """Parse an event of the option `--event`.

    Args:
        text: `box:TIME[@AHEAD[,LEFT]]`, `kidnap:TIME`, `carry:TIME`, `door:NAME:open@TIME` or
            `door:NAME:close@TIME`; TIME in s or, except for doors, a window `FROM-TO`; distances in m.

    Returns:
        The event.

    Raises:
        SimError: *text* has another form or an unknown kind.

    Examples:
        >>> from btcore_sim.events import parse_event
        >>> parse_event("box:10@2,0.3").distance
        2.0
        >>> str(parse_event("kidnap:30-60"))
        'kidnap:30-60'
    """
    text = text.strip()
    kind = text.partition(":")[0]
    if kind not in FORMS:
        raise SimError(
            f"event '{text}': unknown kind '{kind}': kinds are {', '.join(FORMS)}{did_you_mean(kind, FORMS)}"
        )
    if kind == "door":
        return _parse_door(text)
    match = _TIMED.fullmatch(text)
    if match is None:
        raise SimError(f"invalid event '{text}': use {FORMS[kind]}, with TIME in s, {_example(kind)}")
    time = _nanoseconds(match["time"])
    latest = None if match["latest"] is None else _nanoseconds(match["latest"])
    if latest is not None and latest <= time:
        raise SimError(f"event '{text}': the window ends before it begins; use {kind}:FROM-TO in s")
    if match["distance"] is None:
        return Event(kind, time, latest)
    if kind != "box":
        raise SimError(f"event '{text}': only a box has a place; use {text.partition('@')[0]}")
    return Event(kind, time, latest, float(match["distance"]), float(match["offset"] or 0.0))


def _parse_door(text: str) -> Event:
    match = _DOOR.fullmatch(text)
    if match is None:
        raise SimError(f"invalid event '{text}': use {FORMS['door']}, with TIME in s, {_example('door')}")
    action = match["action"]
    if action not in _DOOR_ACTIONS:
        raise SimError(
            f"event '{text}': unknown action '{action}': a door can {' or '.join(_DOOR_ACTIONS)}"
            f"{did_you_mean(action, _DOOR_ACTIONS)}"
        )
    return Event("door", _nanoseconds(match["time"]), door=match["name"], opens=action == "open")


def _example(kind: str) -> str:
    if kind == "door":
        return "like door:kitchen:open@20"
    place = ", or box:30@2,0.3 with a place in m" if kind == "box" else ""
    return f"like {kind}:30{place}, or a window, like {kind}:30-60"


def _nanoseconds(seconds: str) -> int:
    return round(float(seconds) * NS_PER_S)


def check_events(events: Sequence[Event], description: WorldDescription, duration: float | None) -> None:
    """Raise an error for events that cannot happen in a run.

    Args:
        events: The events of the run.
        description: The world of the run.
        duration: The longest duration of the run (s), or None.

    Raises:
        SimError: An event is after the end of the run, or its door does not exist.
    """
    for event in events:
        if duration is not None and event.time > duration * NS_PER_S:
            raise SimError(f"event '{event}' is after the end of the run (--duration {duration:g})")
        if event.kind == "door":
            try:
                description.door(event.door)
            except SimError as error:
                raise SimError(f"event '{event}': {error}") from error


def with_boxes(description: WorldDescription, events: Sequence[Event], spare: int = 0) -> WorldDescription:
    """Return a copy of *description* with a box for every `box` event, parked below the floor.

    Args:
        description: The world; it is not modified.
        events: The events of the run; events of other kinds are ignored.
        spare: The number of further boxes, for events that are triggered during the run.
    """
    x, y = ((description.area[0] + description.area[2]) / 2, (description.area[1] + description.area[3]) / 2)
    size, place = (SIDE, SIDE, SIDE), (x, y, _PARKED)
    boxes = [
        WorldObject(f"{_NAME}{number}", "box", size, place, 0.0, 0.0, _COLOR, is_kinematic=True)
        for number in range(sum(event.kind == "box" for event in events) + spare)
    ]
    return replace(description, objects=(*description.objects, *boxes))


class EventRunner:
    """Triggers *events* for *robot*, which has the radius *radius* (m).

    *floor* is the clearance map of the world. *people* returns the positions (m) of all people.

    The world raises `SimError` at the time of an event that is not possible.
    """

    def __init__(
        self,
        world: World,
        robot: SimulatedRobot,
        radius: float,
        events: Sequence[Event],
        floor: ClearanceMap,
        people: Callable[[], Sequence[Point]],
    ) -> None:
        self.event_log: list[dict[str, object]] = []
        """The events so far: kind, time (s) and place (m), for a door its name and whether it opens.

        An event that moves the robot has the robot's pose before it as `from`.
        """
        self._world = world
        self._robot = robot
        self._radius = radius
        self._floor = floor
        self._people = people
        self._random = world.random("events")
        self._boxes = world.kinematic_bodies(_NAME)
        self._pending = list(events)
        for event in sorted(events, key=lambda event: event.time):
            if event.latest is None:
                self._schedule(event)
        if any(event.latest is not None for event in events):
            world.schedule.add_task(_RATE, Phase.PHYSICS, self._trigger_suitable)

    @property
    def pending(self) -> Sequence[Event]:
        """The events that have not happened yet."""
        return self._pending

    def trigger(self, kind: str) -> None:
        """Trigger an event of *kind* (`box`, `kidnap` or `carry`) now.

        Raises:
            SimError: The event is not possible now, all boxes of the run are used, or *kind* is unknown.
        """
        if kind not in FORMS or kind == "door":
            raise SimError(f"unknown kind of event '{kind}': kinds are box, kidnap, carry")
        if kind == "box" and len(self._boxes) <= sum(event.kind == "box" for event in self._pending):
            raise SimError("there is no further box: all boxes of this run have dropped or are about to drop")
        self._happen(Event(kind, self._world.now()), self._world.now())

    def set_door(self, name: str, opens: bool) -> None:
        """Open or close a door now.

        Args:
            name: The name of the door.
            opens: Whether to open the door.

        Raises:
            SimError: There is no such door.
        """
        now = self._world.now()
        self._happen(Event("door", now, door=name, opens=opens), now)

    def _schedule(self, event: Event) -> None:
        def happen(now: int) -> None:
            end()
            try:
                self._happen(event, now)
            except SimError as error:
                if event.kind == "door":
                    raise
                hint = f"a window, like {event.kind}:30-60, waits for a suitable moment"
                raise SimError(f"{error}; {hint}") from error
            self._pending.remove(event)

        end = self._world.schedule.add_task(_RATE, Phase.PHYSICS, happen, first=event.time)

    def _trigger_suitable(self, now: int) -> None:
        """Trigger the events with a window for which the moment is suitable."""
        for event in list(self._pending):
            if event.latest is None or event.time > now:
                continue
            condition = "in motion" if event.kind != "box" else "driving straight towards a suitable place"
            problem = _impossible(event, f"in this time the robot was at no moment {condition}")
            if self._is_suitable(event):
                try:
                    self._happen(event, now)
                    self._pending.remove(event)
                    continue
                except SimError as error:
                    problem = error
            if now >= event.latest:
                raise problem

    def _is_suitable(self, event: Event) -> bool:
        v, w = self._robot.ramped_twist()
        if event.kind != "box":
            return abs(v) >= _DRIVING / 2 or abs(w) >= _STRAIGHT
        if v < _DRIVING or abs(w) > _STRAIGHT:
            return False
        pose = self._robot.true_pose()
        return self.fits(ahead_of(pose, self._radius, event, self._world.bodies[self._boxes[0]]), pose)

    def _happen(self, event: Event, now: int) -> None:
        """Carry out *event* and log it."""
        match event.kind:
            case "box":
                place = self._drop(event)
            case "door":
                place = self._move_door(event)
            case _:
                place = self._move_robot(event)
        self.event_log.append({"event": event.kind, "t": now / NS_PER_S, **place})

    def _drop(self, event: Event) -> dict[str, object]:
        body = self._boxes[0]
        box = ahead_of(self._robot.true_pose(), self._radius, event, self._world.bodies[body])
        x, y, _ = box.position
        self._world.move_kinematic_body(body, x, y, box.yaw)
        occupant = self._world.overlapping(body)
        if occupant is not None:
            self._world.move_kinematic_body(body, x, y, box.yaw, z=_PARKED)
            raise _impossible(event, f"{occupant} is where the box would drop, at ({x:.2f}, {y:.2f})")
        self._boxes.pop(0)
        self._floor.add_obstacle(box)
        return {"x": round(x, 3), "y": round(y, 3)}

    def fits(self, box: WorldObject, pose: Pose2D) -> bool:
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
        points = list(self._world.description.waypoints.values())
        return (
            floor.clearance_at(x, y) > corners
            and floor.clearance_along((pose.x, pose.y), (x, y)) > 0.0
            and all(box.distance(*point) >= FROM_WAYPOINTS for point in points)
            and all(box.distance(*place) >= PASSAGE for place in self._people())
            and passable(floor, box, PASSAGE / 2, pose.yaw)
            and floor.with_obstacle(box).connected([*points, (pose.x, pose.y)], self._radius + BESIDE_HULL)
        )

    def _move_door(self, event: Event) -> dict[str, object]:
        leaves = self._world.door_leaves_of(event.door, event.opens)
        way = self._robot.carried_along()
        if any(leaf.distance(pose.x, pose.y) < self._radius for leaf in leaves for pose in way):
            raise _impossible(event, "the robot is being carried past this door")
        self._world.set_door(event.door, event.opens)
        return {"door": event.door, "open": event.opens}

    def _move_robot(self, event: Event) -> dict[str, object]:
        before = self._robot.true_pose()
        start = (before.x, before.y)
        # The map has no doors: their leaves are obstacles where they are at this time.
        leaves = self._world.door_leaves()
        floor = self._floor.with_obstacle(*leaves) if leaves else self._floor
        clearance = self._radius + _CARRIED_ROOM
        reachable = floor.reachable(start, clearance) if event.kind == "carry" else None
        for _ in range(_TRIES):
            clear = self._radius + CLEAR + floor.map.resolution
            place = floor.random_point(self._random, clear, reachable)
            if place is None:
                break
            yaw = float(self._random.uniform(-math.pi, math.pi))
            people = min((math.dist(place, person) for person in self._people()), default=math.inf)
            if math.dist(place, start) <= FAR or people <= 1.0 + self._radius:
                continue
            pose = Pose2D(*place, yaw)
            if event.kind == "kidnap":
                self._robot.kidnap(pose)
            else:
                way = floor.way(start, place, clearance)
                if way is None:
                    continue
                self._robot.carry(_with_headings([start, *way, place], before.yaw, yaw), CARRYING_SPEED)
            return {"from": _rounded(before), "x": _rounded(pose)[0], "y": _rounded(pose)[1]}
        raise _impossible(event, self._no_place(start, carried=event.kind == "carry"))

    def _no_place(self, start: Point, *, carried: bool) -> str:
        """Return the reason why there is no place to which the robot can be moved from *start*."""
        if carried and self._floor.clearance_at(*start) <= 0.0:
            return f"the robot is not on free floor of the map, at ({start[0]:.2f}, {start[1]:.2f})"
        shut = [name for name in self._world.description.doors if self._world.door_opening(name) < 1.0]
        doors = f" (doors that are not open: {', '.join(shut)})" if shut else ""
        return (
            f"there is no free place{f' with a way to it{doors}' if carried else ''} that is more than "
            f"{FAR:g} m away from the robot and has {CLEAR:g} m of room around it"
        )


def _with_headings(points: Sequence[Point], start: float, end: float) -> list[Pose2D]:
    """Return the poses at *points*, whose headings turn steadily from *start* to *end* (rad)."""
    turn = wrap_angle(end - start)
    last = len(points) - 1
    return [Pose2D(x, y, wrap_angle(start + turn * number / last)) for number, (x, y) in enumerate(points)]


def _impossible(event: Event, reason: str) -> SimError:
    return SimError(f"event '{event}' is not possible: {reason}")


def ahead_of(pose: Pose2D, radius: float, event: Event, box: WorldObject) -> WorldObject:
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
