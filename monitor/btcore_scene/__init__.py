"""The scene of a robot: typed messages that any robot can send and that the monitor draws.

Lengths are in metres, angles in radians, quaternions are (x, y, z, w), colours are red, green, blue and
opacity of 0–255, and stamps are ns of the tree's clock. An entry without a `frame` is in the scene's frame.
Arrays are little-endian bytes in C order: `array.astype("<f4").tobytes()` with numpy, `float32` without.

    class Rover:
        def scene_static(self) -> StaticScene:
            base = Cylinder(frame="base_link", radius=0.2, length=0.3, position=(0.0, 0.0, 0.15))
            return StaticScene(parts=[base])

        def scene_moving(self) -> MovingScene:
            return MovingScene(frames=[Frame("base_link", "map", (self.x, self.y, 0.0), UPRIGHT)])
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Literal, NamedTuple, Protocol, runtime_checkable

Pair = tuple[float, float]
"""Two numbers, x and y."""

Vector = tuple[float, float, float]
"""x, y and z."""

Quaternion = tuple[float, float, float, float]
"""A rotation: x, y, z and w."""

Color = tuple[int, int, int, int]
"""Red, green, blue and opacity, each 0–255."""

Size = tuple[int, int]
"""Columns and rows of a grid, or width and height of a picture in pixels."""

Float32 = Annotated[bytes, 4, "float32"]
"""float32 values of shape (n,). The annotation has the bytes per value, and a name for error messages."""
Float32Rows = Annotated[bytes, 12, "rows of three float32"]
"""float32 values of shape (n, 3)."""

UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
"""The quaternion of no rotation."""


def float32(values: Iterable[float]) -> bytes:
    """Return *values* as little-endian float32, for `Scan.ranges` and `Poses.rows`."""
    items = tuple(values)
    return struct.pack(f"<{len(items)}f", *items)


class Frame(NamedTuple):
    """The pose of the frame *child* in the frame *parent*.

    Attributes:
        position: The origin of *child* in *parent* (m).
        quaternion: The rotation (x, y, z, w).
    """

    child: str
    parent: str
    position: Vector
    quaternion: Quaternion


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A solid body. *position* (of its centre) and *quaternion* (its rotation) are in *frame*.

    Without *color* the body is grey.

    Attributes:
        name: A label, or None.
        kind: The kind of the body: box, cylinder or sphere.
    """

    name: str | None = None
    frame: str | None = None
    kind: str = field(init=False)
    position: Vector
    quaternion: Quaternion | None = None
    color: Color | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Box(Shape):
    """A box with the full edge lengths *size* along its axes."""

    kind: Literal["box"] = field(default="box", init=False)
    size: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Cylinder(Shape):
    """A cylinder of *length* along its z axis.

    Attributes:
        radius: The radius (m).
    """

    kind: Literal["cylinder"] = field(default="cylinder", init=False)
    radius: float
    length: float


@dataclass(frozen=True, slots=True, kw_only=True)
class Sphere(Shape):
    """A sphere with *radius*."""

    kind: Literal["sphere"] = field(default="sphere", init=False)
    radius: float


Part = Box | Cylinder | Sphere
"""A body of the scene."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """A planar laser. Ray i points in the direction `angle_min + i * angle_increment` in *frame*.

    Attributes:
        angle_min: The angle of the first ray (rad).
        angle_increment: The angle between two rays (rad).
        range_min: The smallest range (m), if known.
        range_max: The greatest range (m), if known.
    """

    frame: str
    angle_min: float
    angle_increment: float
    range_min: float | None = None
    range_max: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Place:
    """A named point.

    Attributes:
        name: The label.
        frame: The frame of *position*; None = the root frame.
        position: The point (m).
    """

    name: str
    frame: str | None = None
    position: Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Area:
    """A rectangle on the floor to keep out of; *corners* are xmin, ymin, xmax, ymax.

    Attributes:
        name: The label.
        frame: The frame of *corners*; None = the root frame.
    """

    name: str
    frame: str | None = None
    corners: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A pinhole camera; *frame* has z ahead, x right, y down.

    *focal* (fx, fy) and *center* (cx, cy) are in pixels; the default center is the middle of the picture.

    Attributes:
        name: The name of the camera, which its pictures refer to.
        size: Width and height of the picture (pixels).
    """

    name: str
    frame: str
    size: Size
    focal: Pair
    center: Pair | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Cells on the floor. A grid replaces the earlier grid of the same *name*.

    *cells* has shape (rows, columns), the row with the lowest y first. The cells of an `occupancy` grid are
    int8: -1 is unknown, 0 free, 100 occupied. The cells of a `costs` grid are uint8: Nav2's costs of 0–255.
    *origin* is the lower left corner (x, y), *resolution* the edge length of a cell.

    Attributes:
        kind: The meaning of the cells.
        frame: The frame of the grid; None = the root frame.
        size: The number of columns and rows.
    """

    name: str
    kind: Literal["occupancy", "costs"]
    frame: str | None = None
    resolution: float
    origin: Pair
    size: Size
    cells: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Scan:
    """A sweep of the laser: a range (m) for each ray, +inf without an echo. The default *stamp* is now.

    Attributes:
        ranges: The ranges of the rays (m).
    """

    stamp: int | None = None
    ranges: Float32


@dataclass(frozen=True, slots=True, kw_only=True)
class Poses:
    """Poses on the floor. They replace the earlier poses of the same *name*; empty *rows* remove them.

    *rows* are x, y and yaw of each pose. *kind* selects the drawing: the points of a path, a cloud of
    particles, goals, the robot's estimated pose, or its pose by odometry alone.

    Attributes:
        frame: The frame of the poses; None = the root frame.
    """

    name: str
    kind: Literal["path", "cloud", "goal", "estimate", "odometry"]
    frame: str | None = None
    rows: Float32Rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrow:
    """An arrow from *start* to *end*.

    Attributes:
        name: The name of the arrow.
        frame: The frame of the points; None = the root frame.
        color: The colour (RGBA); None = the viewer's default.
    """

    name: str
    frame: str | None = None
    start: Vector
    end: Vector
    color: Color | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundingBox:
    """The box around an object: *position* of the box's centre, and its full edge lengths *size*.

    Attributes:
        name: The label.
        frame: The frame of the box; None = the root frame.
        quaternion: The rotation (x, y, z, w); None = not rotated.
        color: The colour (RGBA); None = the viewer's default.
    """

    name: str
    frame: str | None = None
    position: Vector
    size: Vector
    quaternion: Quaternion | None = None
    color: Color | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """A camera's picture. It replaces the earlier picture of the same *name*.

    *data* is a JPEG file, or for `rgb8` uint8 of shape (height, width, 3).

    Attributes:
        stamp: The time of the picture (ns); None = now.
        size: Width and height (pixels).
        format: The encoding of *data*.
    """

    name: str
    stamp: int | None = None
    size: Size
    format: Literal["jpeg", "rgb8"]
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """An object that was detected in the picture named *picture*.

    *name* is the label of the object; *box* is left, top, width and height in pixels.

    Attributes:
        stamp: The time of the detection (ns); None = now.
    """

    picture: str
    name: str
    stamp: int | None = None
    box: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticScene:
    """The part of a scene that does not change. *frame* is the root of all frames (by default `map`).

    If *battery* (percent) is given, the viewer shows a plot of the battery level. *extra* has further data,
    which are sent unchanged.

    Attributes:
        parts: The bodies of the robot and of the world.
        laser: The laser, if the robot has one.
        places: Named points, such as waypoints.
        footprint_radius: The radius (m) of the robot's footprint.
        cameras: The cameras.
        grids: Maps and costmaps.
        areas: Areas to keep out of.
    """

    frame: str | None = None
    parts: Sequence[Part] = ()
    laser: Laser | None = None
    places: Sequence[Place] = ()
    footprint_radius: float | None = None
    battery: float | None = None
    cameras: Sequence[Camera] = ()
    grids: Sequence[Grid] = ()
    areas: Sequence[Area] = ()
    extra: Mapping[str, object] = field(default_factory=dict)


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingScene:
    """The part of a scene that moved or changed. Missing fields stay unchanged.

    *arrows*, *boxes* and *detections* are complete: the viewer removes objects that they do not contain, and
    None changes nothing. *velocity* is in m/s and rad/s, *battery* in percent. *collisions* and *grazes*
    count the robot's contacts since the start of the run. *notes* are Markdown texts by label. *extra* has
    further data, which are sent unchanged.

    Attributes:
        stamp: The time (ns); None = now.
        frames: The frames that moved.
        scan: The newest scan.
        pictures: The newest pictures.
        grids: The grids that changed.
        poses: The poses that changed.
    """

    stamp: int | None = None
    frames: Sequence[Frame] = ()
    velocity: Pair | None = None
    battery: float | None = None
    collisions: int | None = None
    grazes: int | None = None
    scan: Scan | None = None
    pictures: Sequence[Picture] = ()
    grids: Sequence[Grid] = ()
    poses: Sequence[Poses] = ()
    notes: Mapping[str, str] = field(default_factory=dict)
    arrows: Sequence[Arrow] | None = None
    boxes: Sequence[BoundingBox] | None = None
    detections: Sequence[Detection] | None = None
    extra: Mapping[str, object] = field(default_factory=dict)


@runtime_checkable
class SceneSource(Protocol):
    """A resource that the monitor can draw.

    Both methods are called on the thread that ticks the tree, and must be fast. Do not modify their
    results later, because these may be encoded on another thread. A new publisher first calls `scene_static`;
    a source that sends only changes must then send everything again.
    """

    def scene_static(self) -> StaticScene:
        """Return the part of the scene that does not change."""
        ...

    def scene_moving(self) -> MovingScene:
        """Return the part of the scene that moved or changed."""
        ...
