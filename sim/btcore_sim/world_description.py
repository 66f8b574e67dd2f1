"""Descriptions of worlds: walls and objects on a floor, and the start pose of the robot.

A world is a JSON object. Lengths are in metres, angles in radians, colours `#rrggbb`:

    {"description": "an empty square of 6 m",
     "start": {"area": [-3, -3, 3, 3], "clearance": 1.0},
     "objects": [{"name": "crate", "kind": "box", "position": [1, 2], "size": [0.5, 0.5, 0.8], "yaw": 0.3}]}

`position` is the middle of the object's underside; z is optional and 0 by default. `kind` is one of:

- `box` with `size`, and `cylinder` with `radius` and `height`. A `mass` (kg) above 0 makes them movable.
- `table` with `size`, `top` and `leg`: a board of thickness *top* on four square legs of width *leg*.
- `wall` with `points`, `thickness` and `height`: a wall along a line, `closed` or not.
- `polygon` with `points` and `height`: a solid block with that outline.
- `hinged_door` and `sliding_door` with `width`, `height` and `thickness`: see `Door`.

The `points` of walls and polygons are relative to `position`, which is the origin by default. With
`"material": "glass"` an object is invisible to the laser. A `look` such as `bed`, `shelf` or `plant` (see
looks.py) changes the drawing of a box or a cylinder, but not what contacts and sensors detect. `start` is
either an `area` in which the pose is drawn at random, or a `pose` (x, y, yaw). `world.schema.json` describes
all keys for editors.

A world may also have `waypoints` (name → [x, y]), `keepout`, a list of rectangles that robots must not
enter although they may be empty, and `physics_rate` (Hz), the rate of the physics steps. An `area` and a
rectangle consist of smallest x, smallest y, greatest x and greatest y.
"""

import itertools
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from btcore_robot.field_reader import did_you_mean
from btcore_robot.robot import Pose2D, Waypoints
from btcore_sim.errors import SimError
from btcore_sim.json_records import JsonRecord, read_record
from btcore_sim.looks import LOOKS
from btcore_sim.map_walls import MapWalls
from btcore_sim.polygons import (
    Floats,
    OutlineError,
    Point,
    boundary,
    distance_to_parts,
    polygon_triangles,
    wall_quads,
)

__all__ = ["Door", "WorldDescription", "WorldObject", "world_names"]

WORLD_FILES = Path(__file__).parent / "world_files"
"""The folder with the files of the worlds that are part of the package."""

SCHEMA = Path(__file__).with_name("world.schema.json")
"""The JSON schema of a world's file."""

KINDS = ("box", "cylinder", "table", "wall", "polygon", "hinged_door", "sliding_door")
"""The kinds of objects in a world's file."""

GLASS_COLOR = "#9fd0e060"
"""The default colour of glass: a light blue that lets most of the light through."""

Color = tuple[int, int, int, int]

Rectangle = tuple[float, float, float, float]
"""Smallest x, smallest y, greatest x and greatest y (m)."""

PHYSICS_RATE = 240
"""Default number of physics steps per second of simulated time; 240 Hz is PyBullet's default too."""

WALL_THICKNESS = 0.1
"""Default thickness (m) of a wall."""

_DOOR_NAME = re.compile(r"[A-Za-z0-9_-]+")
_TRIES = 10_000
_ORDER = "x and y from, then x and y to, and 'to' has to be greater"


@dataclass(frozen=True, slots=True)
class WorldObject:
    """An upright box, cylinder or prism.

    Attributes:
        name: The name of the object.
        kind: `box`, `cylinder` or `prism`.
        size: The full extent (m) along the object's own x, y and z; a cylinder's first two values are its
            diameter.
        position: The middle of the underside (m).
        yaw: The heading (rad).
        mass: The mass (kg); 0 = the object cannot be pushed.
        color: The colour (RGBA, 0–255).
        look: The name of the parts that are drawn instead of the box or the cylinder (see looks.py), or "".
        is_kinematic: Whether `World.move_kinematic_body` moves the object, for example a person; *position*
            and *yaw* are then its initial pose.
        is_glass: Whether the object is of glass: the laser does not detect it, sonars do.
        parts: The convex polygons of a prism's outline, each with counter-clockwise corners (m) relative to
            *position* and *yaw*; neighbouring polygons share whole sides. A prism never moves.
    """

    name: str
    kind: str
    size: tuple[float, float, float]
    position: tuple[float, float, float]
    yaw: float
    mass: float
    color: Color
    is_kinematic: bool = False
    is_glass: bool = False
    parts: tuple[tuple[Point, ...], ...] = ()
    look: str = ""

    @property
    def is_static(self) -> bool:
        """Whether the object never moves."""
        return self.mass == 0.0 and not self.is_kinematic

    @property
    def parked(self) -> bool:
        """Whether the object is below the floor, where it waits to be moved into the world."""
        return self.position[2] + self.size[2] <= 0.0

    def meets(self, z: float) -> bool:
        """Return whether the horizontal plane at the height *z* (m) cuts the object."""
        return self.position[2] <= z <= self.position[2] + self.size[2]

    def outline(self) -> Rectangle:
        """Return the axis-aligned bounding rectangle (m) of the object on the floor."""
        half_x, half_y = self.size[0] / 2, self.size[1] / 2
        if self.kind != "cylinder":
            cos, sin = abs(math.cos(self.yaw)), abs(math.sin(self.yaw))
            half_x, half_y = cos * half_x + sin * half_y, sin * half_x + cos * half_y
        x, y, _ = self.position
        return x - half_x, y - half_y, x + half_x, y + half_y

    def distance(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the object's outline on the floor; 0 inside.

        Args:
            x: The x coordinate of the point in the world frame (m).
            y: The y coordinate of the point in the world frame (m).
        """
        if self.kind == "prism":
            return float(self.distances(np.array(x), np.array(y)))
        dx, dy = x - self.position[0], y - self.position[1]
        if self.kind == "cylinder":
            return max(0.0, math.hypot(dx, dy) - self.size[0] / 2)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        along = abs(cos * dx + sin * dy) - self.size[0] / 2
        across = abs(cos * dy - sin * dx) - self.size[1] / 2
        return math.hypot(max(0.0, along), max(0.0, across))

    def distances(self, x: Floats, y: Floats) -> Floats:
        """Return the distances (m) from points to the object's outline on the floor; 0 inside.

        Args:
            x: The x coordinates of the points in the world frame (m), of any shape.
            y: The y coordinates of the points (m), of a shape that broadcasts with *x*.
        """
        dx, dy = x - self.position[0], y - self.position[1]
        if self.kind == "cylinder":
            return np.maximum(0.0, np.hypot(dx, dy) - self.size[0] / 2)
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        along, across = cos * dx + sin * dy, cos * dy - sin * dx
        if self.kind == "prism":
            return distance_to_parts(self.parts, along, across)
        along, across = np.abs(along) - self.size[0] / 2, np.abs(across) - self.size[1] / 2
        return np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))

    def pieces(self) -> list["WorldObject"]:
        """Return the convex pieces of a prism, each as an object, or the object itself if it is no prism."""
        return (
            [_centred(replace(self, parts=(part,))) for part in self.parts]
            if self.kind == "prism"
            else [self]
        )

    def sides(self) -> list[tuple[Point, Point]]:
        """Return the sides of a prism's outline (m), relative to *position* and *yaw*.

        The prism is on the left of each side, seen from the side's first point to its second point.
        """
        return boundary(self.parts)


@dataclass(frozen=True, slots=True)
class Door:
    """A door in an opening. Its leaf is an object of the world with the same name.

    A hinged door has its hinge at the end of the opening from which the *yaw* points to the other end. A
    sliding door moves in the direction of its *yaw*.

    Attributes:
        name: The name of the door and of its leaf.
        position: The middle of the opening (x, y; m).
        width: The width of the opening and of the leaf (m).
        yaw: The direction of the closed leaf (rad).
        swing: The angle (rad) by which the leaf of a hinged door turns to open, positive if
            counter-clockwise; 0 for a sliding door.
        open: Whether the door is open at the start.
    """

    name: str
    position: Point
    width: float
    yaw: float
    swing: float
    open: bool

    @property
    def hinge(self) -> Point:
        """The axis (x, y; m) about which the leaf of a hinged door turns."""
        x, y = self.position
        return x - self.width / 2 * math.cos(self.yaw), y - self.width / 2 * math.sin(self.yaw)

    def leaf_pose(self, opening: float) -> Pose2D:
        """Return the pose of the middle of the leaf.

        Args:
            opening: How far the door is open, from 0 (closed) to 1 (open).
        """
        if self.swing:
            x, y = self.hinge
            yaw, away = self.yaw + opening * self.swing, self.width / 2
        else:
            x, y = self.position
            yaw, away = self.yaw, opening * self.width
        return Pose2D(x + away * math.cos(yaw), y + away * math.sin(yaw), yaw)

    def placed(self, leaf: WorldObject, opening: float) -> WorldObject:
        """Return the leaf of the door at the pose for an opening.

        Args:
            leaf: The object of the leaf.
            opening: How far the door is open, from 0 (closed) to 1 (open).
        """
        pose = self.leaf_pose(opening)
        return replace(leaf, position=(pose.x, pose.y, leaf.position[2]), yaw=pose.yaw)


@dataclass(frozen=True, slots=True)
class WorldDescription:
    """The description of a world: its objects, and the rule for the start pose.

    Attributes:
        name: The name of the world.
        description: A short description for listings.
        objects: The objects.
        area: The area in which the start pose is drawn if *pose* is None.
        clearance: The least distance (m) between the robot's footprint and any object at a drawn start pose.
        pose: The start pose, or None.
        floor: The colour of the floor (RGBA).
        waypoints: The positions x, y (m) of the waypoints by name.
        keepout: The areas that robots must not enter.
        physics_rate: The rate of the physics steps (Hz).
        doors: The doors by name.
        headings: The headings (rad) of those waypoints whose heading is not 0, by name.
        walls: The walls of the map from which the world was made, in addition to *objects*; or None.
    """

    name: str
    description: str
    objects: tuple[WorldObject, ...]
    area: Rectangle
    clearance: float
    pose: Pose2D | None
    floor: Color
    waypoints: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    keepout: tuple[Rectangle, ...] = ()
    physics_rate: int = PHYSICS_RATE
    doors: Mapping[str, Door] = field(default_factory=dict)
    headings: Mapping[str, float] = field(default_factory=dict)
    walls: MapWalls | None = None

    def door(self, name: str) -> Door:
        """Return the door *name*.

        Raises:
            SimError: The world has no door of this name.
        """
        if name not in self.doors:
            known = f"doors are {', '.join(self.doors)}" if self.doors else "it has no doors"
            hint = did_you_mean(name, self.doors)
            raise SimError(f"world '{self.name}': there is no door '{name}': {hint}{known}")
        return self.doors[name]

    def waypoint_poses(self) -> Waypoints:
        """Return the waypoints, whose heading is 0 by default."""
        return Waypoints(
            {name: Pose2D(x, y, self.headings.get(name, 0.0)) for name, (x, y) in self.waypoints.items()}
        )

    def start(self, random: np.random.Generator, radius: float) -> Pose2D:
        """Return the fixed start pose, or draw a pose uniformly among those with enough clearance.

        Args:
            random: The source of the random pose.
            radius: The robot's radius (m).

        Raises:
            SimError: 10,000 draws found no pose with enough clearance.
        """
        if self.pose is not None:
            return self.pose
        for _ in range(_TRIES):
            x = random.uniform(self.area[0], self.area[2])
            y = random.uniform(self.area[1], self.area[3])
            yaw = random.uniform(-math.pi, math.pi)
            if self.clearance_at(x, y) >= self.clearance + radius:
                return Pose2D(x, y, yaw)
        raise SimError(
            f"world '{self.name}': no start pose with {self.clearance:g} m of room around a robot of "
            f"{radius:g} m radius was found in {_TRIES} draws: use a smaller 'clearance' or another 'area'"
        )

    def clearance_at(self, x: float, y: float) -> float:
        """Return the distance (m) from a point on the floor to the nearest object; inf in an empty world.

        Objects that are parked below the floor are ignored.

        Args:
            x: The x coordinate of the point in the world frame (m).
            y: The y coordinate of the point in the world frame (m).
        """
        away = (item.distance(x, y) for item in self.objects if not item.parked)
        walls = math.inf if self.walls is None else self.walls.distance(x, y)
        return min((walls, *away))


def world_names() -> list[str]:
    """Return the names of the worlds that are part of the package, sorted.

    Examples:
        >>> from btcore_sim.world_description import world_names
        >>> "house" in world_names()
        True
    """
    return sorted(path.stem for path in WORLD_FILES.glob("*.json"))


def read_world_description(name: str) -> WorldDescription:
    """Read the file of a world.

    Args:
        name: One of `world_names()`, or the path of a JSON file.

    Returns:
        The world's description.

    Raises:
        SimError: The file is missing or invalid.
    """
    path = WORLD_FILES / f"{name}.json" if name in world_names() else Path(name)
    return read_record(path, "a world").read_whole(lambda record: _world_description(record, path.stem))


def parse_world_description(data: dict[str, Any], name: str) -> WorldDescription:
    """Return the world that a JSON object describes.

    Args:
        data: The object, in the form of a world file.
        name: The name of the world.

    Raises:
        SimError: The object is invalid.
    """
    return JsonRecord(data, name).read_whole(lambda record: _world_description(record, name))


def _world_description(record: JsonRecord, name: str) -> WorldDescription:
    numbers = itertools.count()
    doors: dict[str, Door] = {}
    nested = record.nested_list("objects", lambda item: _parse_objects(item, next(numbers), doors))
    objects = tuple(itertools.chain.from_iterable(nested))
    record.has("$schema")  # for editors
    seen: set[str] = set()
    for item in objects:
        if item.name in seen:
            raise record.error(f"two objects are named '{item.name}', but names have to be unique")
        seen.add(item.name)
    area, clearance, pose = record.nested("start", _start)
    description = WorldDescription(
        name=name,
        description=record.text("description", ""),
        objects=objects,
        area=area,
        clearance=clearance,
        pose=pose,
        floor=record.color("floor", "#8d9297"),
        waypoints=record.points("waypoints"),
        keepout=tuple(map(_rectangle, record.rows("keepout", 4, []))),
        physics_rate=record.whole("physics_rate", PHYSICS_RATE),
        doors=doors,
    )
    for x0, y0, x1, y1 in description.keepout:
        if not (x0 < x1 and y0 < y1):
            raise record.error(f"'keepout' has [{x0:g}, {y0:g}, {x1:g}, {y1:g}], but the form is {_ORDER}")
    return description


def _rectangle(row: list[float]) -> Rectangle:
    return row[0], row[1], row[2], row[3]


def _start(record: JsonRecord) -> tuple[tuple[float, float, float, float], float, Pose2D | None]:
    if record.has("pose"):
        x, y, yaw = record.numbers("pose", [3])
        return (x, y, x, y), 0.0, Pose2D(x, y, yaw)
    x0, y0, x1, y1 = record.numbers("area", [4])
    if not (x0 < x1 and y0 < y1):
        raise record.error(f"the form of 'area' is {_ORDER}")
    return (x0, y0, x1, y1), record.number("clearance", 1.0), None


def _parse_objects(record: JsonRecord, index: int, doors: dict[str, Door]) -> list[WorldObject]:
    """Return the objects of an entry of `objects`, and add the door of the entry, if any, to *doors*."""
    kind = record.text("kind", among=KINDS)
    is_door = kind in ("hinged_door", "sliding_door")
    name = record.text("name", None if is_door else f"object_{index}")
    is_glass = record.text("material", "solid", among=("solid", "glass")) == "glass"
    color = record.color("color", GLASS_COLOR if is_glass else "#c9b79c")
    yaw = record.number("yaw", 0.0)
    if kind in ("wall", "polygon"):
        return [_prism(record, kind, name, yaw, color, is_glass)]
    if is_door:
        return [_door(record, kind, name, yaw, color, is_glass, doors)]
    if kind == "cylinder":
        x = y = 2 * record.number("radius", over=0.0)
        z = record.number("height", over=0.0)
    else:
        x, y, z = record.numbers("size", [3])
    if min(x, y, z) <= 0.0:
        raise record.error("'size' has to be greater than 0 in all three directions")
    place = record.numbers("position", [2, 3])
    mass = record.number("mass", 0.0) if kind != "table" else 0.0
    if mass < 0.0:
        raise record.error(f"'mass' is {mass:g}, but it has to be at least 0")
    position = (place[0], place[1], place[2] if len(place) == 3 else 0.0)
    look = record.text("look", among=LOOKS[kind]) if kind != "table" and record.has("look") else ""
    item = WorldObject(name, kind, (x, y, z), position, yaw, mass, color, is_glass=is_glass, look=look)
    return [item] if kind != "table" else _table(record, item)


def _prism(record: JsonRecord, kind: str, name: str, yaw: float, color: Color, is_glass: bool) -> WorldObject:
    points = [(x, y) for x, y in record.rows("points", 2)]
    height = record.number("height", over=0.0)
    place = record.numbers("position", [2, 3], [0.0, 0.0])
    try:
        if kind == "polygon":
            parts = polygon_triangles(points)
        else:
            thickness = record.number("thickness", WALL_THICKNESS, over=0.0)
            parts = wall_quads(points, thickness, record.truth("closed", False))
    except OutlineError as error:
        raise record.error(str(error)) from None
    position = (place[0], place[1], place[2] if len(place) == 3 else 0.0)
    size = (0.0, 0.0, height)
    return _centred(
        WorldObject(name, "prism", size, position, yaw, 0.0, color, is_glass=is_glass, parts=tuple(parts))
    )


def _centred(prism: WorldObject) -> WorldObject:
    """Return *prism* with its extent as *size*, and with the middle of its extent as *position*."""
    xs, ys = zip(*itertools.chain.from_iterable(prism.parts), strict=True)
    x, y = (min(xs) + max(xs)) / 2, (min(ys) + max(ys)) / 2
    cos, sin = math.cos(prism.yaw), math.sin(prism.yaw)
    x0, y0, z0 = prism.position
    return replace(
        prism,
        size=(max(xs) - min(xs), max(ys) - min(ys), prism.size[2]),
        position=(x0 + cos * x - sin * y, y0 + sin * x + cos * y, z0),
        parts=tuple(tuple((px - x, py - y) for px, py in part) for part in prism.parts),
    )


def _door(
    record: JsonRecord, kind: str, name: str, yaw: float, color: Color, is_glass: bool, doors: dict[str, Door]
) -> WorldObject:
    if not _DOOR_NAME.fullmatch(name):
        raise record.error(
            f"a door is named '{name}', but names of doors consist of letters, digits, '_' and '-'"
        )
    x, y = record.numbers("position", [2])
    swing = 0.0
    if kind == "hinged_door":
        swing = (
            math.pi / 2 if record.text("swing", "left", among=("left", "right")) == "left" else -math.pi / 2
        )
    width = record.number("width", 0.9, over=0.0)
    size = (width, record.number("thickness", 0.04, over=0.0), record.number("height", 2.1, over=0.0))
    door = doors[name] = Door(name, (x, y), width, yaw, swing, record.truth("open", False))
    leaf = WorldObject(name, "box", size, (x, y, 0.0), yaw, 0.0, color, is_kinematic=True, is_glass=is_glass)
    return door.placed(leaf, float(door.open))


def _table(record: JsonRecord, whole: WorldObject) -> list[WorldObject]:
    """Return the parts of a table with the bounds of *whole*: its top, and legs flush with the corners."""
    thick, wide = record.number("top", 0.04, over=0.0), record.number("leg", 0.06, over=0.0)
    length, width, height = whole.size
    if thick >= height or 2 * wide > min(length, width):
        raise record.error(
            f"a 'top' of {thick:g} m and legs of {wide:g} m don't fit into 'size': use smaller values"
        )
    x, y, z = whole.position
    under = height - thick
    board = replace(
        whole, name=f"{whole.name}_top", kind="box", size=(length, width, thick), position=(x, y, z + under)
    )
    parts = [board]
    cos, sin = math.cos(whole.yaw), math.sin(whole.yaw)
    for number, (along, across) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1)), 1):
        dx, dy = along * (length - wide) / 2, across * (width - wide) / 2
        foot = (x + cos * dx - sin * dy, y + sin * dx + cos * dy, z)
        name = f"{whole.name}_leg_{number}"
        parts.append(replace(board, name=name, size=(wide, wide, under), position=foot))
    return parts
