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
either an `area` in which the pose is drawn at random, or a `pose` (x, y, yaw). `json_schema(WorldFile)`
returns a schema of all keys for editors.

A world may also have `waypoints` (name → [x, y]), `keepout`, a list of rectangles that robots must not
enter although they may be empty, and `physics_rate` (Hz), the rate of the physics steps. An `area` and a
rectangle consist of smallest x, smallest y, greatest x and greatest y.
"""

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeAlias

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType

from btcore.suggestions import did_you_mean
from btcore.typed_data import DataError, FieldError, NotNegative, Positive, Record, convert
from btcore_robot.data_files import json_data
from btcore_robot.robot import Pose2D, Waypoints
from btcore_sim.errors import SimError
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
from btcore_sim.shells import HexColor, rgba

__all__ = ["Door", "WorldDescription", "WorldObject", "world_names"]

WORLD_FILES = Path(__file__).parent / "world_files"
"""The folder with the files of the worlds that are part of the package."""

GLASS_COLOR = "#9fd0e060"
"""The default colour of glass: a light blue that lets most of the light through."""

Color = tuple[int, int, int, int]

Point3 = tuple[float, float, float]

Rectangle = tuple[float, float, float, float]
"""Smallest x, smallest y, greatest x and greatest y (m)."""

PHYSICS_RATE = 240
"""Default number of physics steps per second of simulated time; 240 Hz is PyBullet's default too."""

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
    def is_parked(self) -> bool:
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
        # Numbers instead of arrays: numpy takes 40 times as long for a single point.
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
            raise SimError(f"world '{self.name}': there is no door '{name}': {known}{hint}")
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
        away = (item.distance(x, y) for item in self.objects if not item.is_parked)
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
    with json_data(path, "a world", SimError) as data:
        return _world_description(convert(data, WorldFile), path.stem)


def parse_world_description(data: dict[str, Any], name: str) -> WorldDescription:
    """Return the world that a JSON object describes.

    Args:
        data: The object, in the form of a world file.
        name: The name of the world.

    Raises:
        SimError: The object is invalid.
    """
    try:
        return _world_description(convert(data, WorldFile), name)
    except DataError as error:
        raise SimError(f"{name}: {error}") from None


def _key(description: str, **limits: Any) -> Any:
    return Meta(description=description, **limits)


_Position = Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)]
_Size = Annotated[
    tuple[Positive, Positive, Positive], _key("The extent along the object's own x, y and z (m).")
]
_Height = Annotated[Positive, _key("The height (m).")]
_Origin = Annotated[
    _Position,
    _key(
        "The point [x, y] or [x, y, z] (m) to which `points` are relative; `yaw` turns the points about it."
    ),
]
_Underside = Annotated[
    _Position,
    _key("The middle of the underside: [x, y], or [x, y, z] above the floor (m)."),
]
_Mass = Annotated[
    NotNegative,
    _key("The mass (kg). An object with a mass can be pushed; others stand still."),
]
_LOOK = _key("How the viewer draws the object. Contacts, sensors and the camera detect the simple shape.")
if TYPE_CHECKING:
    _BoxLook: TypeAlias = str
    _CylinderLook: TypeAlias = str
else:
    _BoxLook = Annotated[Literal[tuple(sorted(LOOKS["box"]))], _LOOK]
    _CylinderLook = Annotated[Literal[tuple(sorted(LOOKS["cylinder"]))], _LOOK]


class _ObjectEntry(Record, tag_field="kind"):
    """An entry of `objects`."""

    name: (
        Annotated[
            str,
            _key(
                "The name, for messages and reports. Names are unique. Without a name it is `object_` and a "
                "number."
            ),
        ]
        | UnsetType
    ) = UNSET
    yaw: Annotated[float, _key("The rotation about the vertical axis, counter-clockwise (rad).")] = 0.0
    color: (
        Annotated[
            HexColor,
            _key(
                "The colour, `#rrggbb` or with opacity `#rrggbbaa`. Glass is `#9fd0e060` by default.",
                extra_json_schema={"default": "#c9b79c"},
            ),
        ]
        | UnsetType
    ) = UNSET
    material: Annotated[
        Literal["solid", "glass"],
        _key("Glass is transparent for the laser and the camera, but not for sonars and bumpers."),
    ] = "solid"

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the objects of the entry, and add its door, if any, to *doors*."""
        raise NotImplementedError

    def _object(self, name: str, kind: str, size: Point3, position: tuple[float, ...]) -> WorldObject:
        is_glass = self.material == "glass"
        color = rgba((GLASS_COLOR if is_glass else "#c9b79c") if self.color is UNSET else self.color)
        place = (position[0], position[1], position[2] if len(position) == 3 else 0.0)
        return WorldObject(name, kind, size, place, self.yaw, 0.0, color, is_glass=is_glass)


class Box(_ObjectEntry, kw_only=True, tag="box"):
    """A box."""

    position: _Underside
    look: _BoxLook | UnsetType = UNSET
    size: _Size
    mass: _Mass = 0.0

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the box."""
        box = self._object(name, "box", self.size, self.position)
        return [replace(box, mass=self.mass, look=self.look or "")]


class Cylinder(_ObjectEntry, kw_only=True, tag="cylinder"):
    """An upright cylinder."""

    position: _Underside
    look: _CylinderLook | UnsetType = UNSET
    radius: Annotated[Positive, _key("The radius (m).")]
    height: _Height
    mass: _Mass = 0.0

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the cylinder."""
        size = (2 * self.radius, 2 * self.radius, self.height)
        return [
            replace(self._object(name, "cylinder", size, self.position), mass=self.mass, look=self.look or "")
        ]


class Table(_ObjectEntry, kw_only=True, tag="table"):
    """A board on four legs. The laser detects the legs only, so the map has a keep-out area for the board."""

    position: _Underside
    size: _Size
    top: Annotated[Positive, _key("The thickness of the board (m).")] = 0.04
    leg: Annotated[Positive, _key("The width of the square legs (m).")] = 0.06

    def __post_init__(self) -> None:
        length, width, height = self.size
        if self.top >= height or 2 * self.leg > min(length, width):
            parts = f"a 'top' of {self.top:g} m and legs of {self.leg:g} m"
            raise ValueError(f"has {parts}, which don't fit into 'size': use smaller values")

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the parts of the table: its top, and legs flush with the corners."""
        extent = self._object(name, "box", self.size, self.position)
        thick, wide = self.top, self.leg
        length, width, height = self.size
        x, y, z = extent.position
        under = height - thick
        board = replace(extent, name=f"{name}_top", size=(length, width, thick), position=(x, y, z + under))
        parts = [board]
        cos, sin = math.cos(self.yaw), math.sin(self.yaw)
        for number, (along, across) in enumerate(((1, 1), (-1, 1), (-1, -1), (1, -1)), 1):
            dx, dy = along * (length - wide) / 2, across * (width - wide) / 2
            foot = (x + cos * dx - sin * dy, y + sin * dx + cos * dy, z)
            parts.append(replace(board, name=f"{name}_leg_{number}", size=(wide, wide, under), position=foot))
        return parts


class Wall(_ObjectEntry, kw_only=True, tag="wall"):
    """A wall along a line with corners."""

    position: _Origin = (0.0, 0.0)
    points: Annotated[tuple[Point, ...], _key("The corners [x, y] of the wall's middle line (m).")]
    height: _Height
    thickness: Annotated[Positive, _key("The thickness (m).")] = 0.1
    closed: Annotated[bool, _key("Whether the wall continues from the last point to the first.")] = False

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the wall as a prism."""
        parts = wall_quads(self.points, self.thickness, self.closed)
        return [_prism(self._object(name, "prism", (0.0, 0.0, self.height), self.position), parts)]


class Polygon(_ObjectEntry, kw_only=True, tag="polygon"):
    """A solid block with an outline, which may be concave."""

    position: _Origin = (0.0, 0.0)
    points: Annotated[
        tuple[Point, ...],
        _key(
            "The corners [x, y] of the outline (m), in either direction. The outline must not touch itself."
        ),
    ]
    height: _Height

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the block as a prism."""
        prism = self._object(name, "prism", (0.0, 0.0, self.height), self.position)
        return [_prism(prism, polygon_triangles(self.points))]


class _DoorEntry(_ObjectEntry, kw_only=True):
    """A door."""

    name: Annotated[
        str,
        _key(
            "The name of the door, for events: letters, digits, `_` and `-`.",
            pattern="^[A-Za-z0-9_-]+$",
            examples=["kitchen_door"],
        ),
    ]
    position: Annotated[Point, _key("The middle of the opening [x, y] (m).")]
    width: Annotated[Positive, _key("The width of the opening and of the leaf (m).")] = 0.9
    height: Annotated[Positive, _key("The height of the leaf (m).")] = 2.1
    thickness: Annotated[Positive, _key("The thickness of the leaf (m).")] = 0.04
    open: Annotated[bool, _key("Whether the door is open at the start.")] = False

    def _turn(self) -> float:
        return 0.0

    def create_objects(self, name: str, doors: dict[str, Door]) -> list[WorldObject]:
        """Return the leaf of the door, and add the door to *doors*."""
        door = doors[name] = Door(name, self.position, self.width, self.yaw, self._turn(), self.open)
        size = (self.width, self.thickness, self.height)
        leaf = replace(self._object(name, "box", size, self.position), is_kinematic=True)
        return [door.placed(leaf, float(door.open))]


class HingedDoor(_DoorEntry, kw_only=True, tag="hinged_door"):
    """A door that turns by 90° about its hinge, which is at the near end of the opening, seen along `yaw`."""

    swing: Annotated[
        Literal["left", "right"], _key("The side to which the leaf turns, seen along `yaw`.")
    ] = "left"

    def _turn(self) -> float:
        return math.pi / 2 if self.swing == "left" else -math.pi / 2


class SlidingDoor(_DoorEntry, kw_only=True, tag="sliding_door"):
    """A door that slides by its width in the direction of `yaw`, for example into a wall."""


class Start(Record):
    """The start of the robot: a `pose`, or an `area` in which the pose is drawn at random."""

    pose: Annotated[Point3, _key("x and y (m) and the heading (rad).")] | UnsetType = UNSET
    area: Annotated[Rectangle, _key("Smallest x, smallest y, greatest x and greatest y (m).")] | UnsetType = (
        UNSET
    )
    clearance: Annotated[float, _key("The least distance (m) between the robot and any object.")] = 1.0

    def __post_init__(self) -> None:
        if (self.pose is UNSET) is (self.area is UNSET):
            raise ValueError("needs either 'area' or 'pose'")
        if self.area is not UNSET:
            _check_rectangle("area", self.area)


class WorldFile(Record, kw_only=True, rename={"schema": "$schema"}):
    """A world for the simulated robot of btcore."""

    schema: Annotated[str, _key("This schema, for editors.")] | UnsetType = UNSET
    description: Annotated[str, _key("A short description.")] = ""
    floor: Annotated[HexColor, _key("The colour of the floor.")] = "#8d9297"
    start: Start
    waypoints: Annotated[
        dict[str, Point],
        _key(
            "Named places [x, y] (m). The patrol drives to `wp1`, `wp2` and `wp3`, and recharges at "
            "`recharge`."
        ),
    ] = msgspec.field(default_factory=dict)
    keepout: Annotated[
        tuple[Rectangle, ...],
        _key("Rectangles that robots must not enter: smallest x, smallest y, greatest x and greatest y (m)."),
    ] = ()
    physics_rate: Annotated[int, _key("The number of physics steps per second.", ge=1)] = PHYSICS_RATE
    objects: Annotated[
        tuple[Box | Cylinder | Table | Wall | Polygon | HingedDoor | SlidingDoor, ...],
        _key("The walls and all other objects in the world."),
    ]

    def __post_init__(self) -> None:
        for rectangle in self.keepout:
            _check_rectangle("keepout", rectangle)


def _check_rectangle(key: str, rectangle: Rectangle) -> None:
    x0, y0, x1, y1 = rectangle
    if not (x0 < x1 and y0 < y1):
        raise FieldError(key, f"has [{x0:g}, {y0:g}, {x1:g}, {y1:g}], but the form is {_ORDER}")


def _world_description(file: WorldFile, name: str) -> WorldDescription:
    doors: dict[str, Door] = {}
    objects: dict[str, WorldObject] = {}
    for index, entry in enumerate(file.objects):
        try:
            entry_objects = entry.create_objects(entry.name or f"object_{index}", doors)
        except OutlineError as error:
            raise DataError(("objects", index, "points"), f"are no outline: {error}") from None
        for item in entry_objects:
            if item.name in objects:
                raise DataError(
                    ("objects", index), f"is named '{item.name}' like another object; names have to be unique"
                )
            objects[item.name] = item
    start = file.start
    pose = None if start.pose is UNSET else Pose2D(*start.pose)
    area = (pose.x, pose.y, pose.x, pose.y) if pose is not None else start.area
    assert area is not UNSET
    return WorldDescription(
        name=name,
        description=file.description,
        objects=tuple(objects.values()),
        area=area,
        clearance=start.clearance if pose is None else 0.0,
        pose=pose,
        floor=rgba(file.floor),
        waypoints=file.waypoints,
        keepout=file.keepout,
        physics_rate=file.physics_rate,
        doors=doors,
    )


def _prism(item: WorldObject, parts: list[tuple[Point, ...]]) -> WorldObject:
    return _centred(replace(item, parts=tuple(parts)))


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
