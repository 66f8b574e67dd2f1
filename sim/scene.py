"""Worlds as data: walls and objects that stand on a floor, and where a robot may start.

A world is a JSON object. Lengths are metres, angles radians, colours ``#rrggbb``::

    {"description": "an empty square of 6 m",
     "start": {"area": [-3, -3, 3, 3], "clearance": 1.0},
     "objects": [{"name": "crate", "kind": "box", "position": [1, 2], "size": [0.5, 0.5, 0.8], "yaw": 0.3}]}

``position`` is the middle of the object's underside (z is 0 unless given), ``kind`` is ``box`` with ``size``
or ``cylinder`` with ``radius`` and ``height``; a ``mass`` (kg) above 0 makes it movable. ``start`` is either
an ``area`` (x and y from, x and y to) in which the pose is drawn, or one ``pose`` (x, y, yaw).
"""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robot_nodes.robot import Pose2D
from sim.mistakes import SimError, did_you_mean
from sim.records import Record, read_record

SCENES = Path(__file__).parent / "scenes"

Color = tuple[int, int, int, int]

_TRIES = 10_000


@dataclass(frozen=True, slots=True)
class Thing:
    """A box or a cylinder that stands upright.

    *size* is the full extent (m) along its own x, y and z; a cylinder's first two are its diameter.
    *position* is the middle of the underside, *mass* (kg) is 0 for what never moves, *color* is RGBA (0–255).
    """

    name: str
    kind: str
    size: tuple[float, float, float]
    position: tuple[float, float, float]
    yaw: float
    mass: float
    color: Color

    def distance(self, x: float, y: float) -> float:
        """How far (m) the point is from the thing's outline on the floor; 0 inside."""
        dx, dy = x - self.position[0], y - self.position[1]
        if self.kind == "cylinder":
            return max(0.0, math.hypot(dx, dy) - self.size[0] / 2)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        along = abs(cos * dx + sin * dy) - self.size[0] / 2
        across = abs(cos * dy - sin * dx) - self.size[1] / 2
        return math.hypot(max(0.0, along), max(0.0, across))


@dataclass(frozen=True, slots=True)
class Scene:
    """A world to be: its things, and the rule for the start pose.

    *area* (x and y from, x and y to) is where a start pose is drawn, at least *clearance* (m) between the
    robot's footprint and anything else; *pose* is a start that is given instead.
    """

    name: str
    description: str
    things: tuple[Thing, ...]
    area: tuple[float, float, float, float]
    clearance: float
    pose: Pose2D | None
    floor: Color

    def start(self, random: np.random.Generator, radius: float) -> Pose2D:
        """A pose for a robot of *radius* (m), uniform in place and heading among those clear enough."""
        if self.pose is not None:
            return self.pose
        for _ in range(_TRIES):
            x = random.uniform(self.area[0], self.area[2])
            y = random.uniform(self.area[1], self.area[3])
            yaw = random.uniform(-math.pi, math.pi)
            if self.free(x, y) >= self.clearance + radius:
                return Pose2D(x, y, yaw)
        raise SimError(
            f"world '{self.name}': no start pose with {self.clearance:g} m of room around a robot of "
            f"{radius:g} m radius was found in {_TRIES} draws: a smaller 'clearance' or another 'area' helps"
        )

    def free(self, x: float, y: float) -> float:
        """How far (m) the nearest thing's outline is from a point on the floor; inf in an empty world."""
        return min((thing.distance(x, y) for thing in self.things), default=math.inf)


def scene_names() -> list[str]:
    """The worlds that come along, sorted."""
    return sorted(path.stem for path in SCENES.glob("*.json"))


def load_scene(name: str) -> Scene:
    """The world called *name*, or the one in the JSON file at the path *name*; raises `SimError`."""
    if name.endswith(".json") or "/" in name:
        path = Path(name)
    elif name in scene_names():
        path = SCENES / f"{name}.json"
    else:
        known = scene_names()
        raise SimError(
            f"there is no world '{name}': {did_you_mean(name, known)}worlds are {', '.join(known)}, "
            "and the path of a JSON file works too"
        )
    return _scene(read_record(path, "a world"), path.stem)


def _scene(record: Record, name: str) -> Scene:
    things = tuple(_thing(one, index) for index, one in enumerate(record.records("objects")))
    seen: set[str] = set()
    for thing in things:
        if thing.name in seen:
            raise record.mistake(f"two objects are named '{thing.name}', and names tell them apart")
        seen.add(thing.name)
    area, clearance, pose = _start(record.record("start"))
    scene = Scene(
        name=name,
        description=record.text("description", ""),
        things=things,
        area=area,
        clearance=clearance,
        pose=pose,
        floor=record.color("floor", "#8d9297"),
    )
    record.finish()
    return scene


def _start(record: Record) -> tuple[tuple[float, float, float, float], float, Pose2D | None]:
    if record.has("pose"):
        x, y, yaw = record.numbers("pose", [3])
        record.finish()
        return (x, y, x, y), 0.0, Pose2D(x, y, yaw)
    x0, y0, x1, y1 = record.numbers("area", [4])
    if not (x0 < x1 and y0 < y1):
        raise record.mistake("'area' is x and y from, then x and y to, and 'to' has to be greater")
    clearance = record.number("clearance", 1.0)
    record.finish()
    return (x0, y0, x1, y1), clearance, None


def _thing(record: Record, index: int) -> Thing:
    name = record.text("name", f"object_{index}")
    kind = record.text("kind", among=("box", "cylinder"))
    if kind == "box":
        x, y, z = record.numbers("size", [3])
    else:
        x = y = 2 * record.number("radius", over=0.0)
        z = record.number("height", over=0.0)
    if min(x, y, z) <= 0.0:
        raise record.mistake("'size' has to be greater than 0 in all three directions")
    place = record.numbers("position", [2, 3])
    mass = record.number("mass", 0.0)
    if mass < 0.0:
        raise record.mistake(f"'mass' is {mass:g}, and it can't be below 0")
    thing = Thing(
        name=name,
        kind=kind,
        size=(x, y, z),
        position=(place[0], place[1], place[2] if len(place) == 3 else 0.0),
        yaw=record.number("yaw", 0.0),
        mass=mass,
        color=record.color("color", "#c9b79c"),
    )
    record.finish()
    return thing
