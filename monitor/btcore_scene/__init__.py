"""The scene of a robot: typed messages that any robot can send and that the monitor draws.

Lengths are in metres, angles in radians, quaternions are (x, y, z, w), colours are red, green, blue and
opacity of 0–255, and stamps are ns of the tree's clock. An entry without a `frame` is in the scene's frame.
Arrays are little-endian bytes in C order: `array.astype("<f4").tobytes()` with numpy, `float32` without.

    class Rover:
        def static_scene(self) -> StaticScene:
            base = Cylinder(frame="base_link", radius=0.2, length=0.3, position=(0.0, 0.0, 0.15))
            return StaticScene(parts=[base])

        def moving_scene(self) -> MovingScene:
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
UInt32Rows = Annotated[bytes, 12, "rows of three uint32"]
"""uint32 values of shape (n, 3)."""

UPRIGHT: Quaternion = (0.0, 0.0, 0.0, 1.0)
"""The quaternion of no rotation."""


def float32(values: Iterable[float]) -> bytes:
    """Return *values* as little-endian float32, for `Scan.ranges` and `Poses.rows`."""
    items = tuple(values)
    return struct.pack(f"<{len(items)}f", *items)


class Frame(NamedTuple):
    """The pose of a frame in another frame.

    Attributes:
        child: The frame.
        parent: The frame in which the pose is given.
        position: The origin of *child* in *parent* (m).
        quaternion: The rotation (x, y, z, w).
    """

    child: str
    parent: str
    position: Vector
    quaternion: Quaternion


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A solid body.

    Attributes:
        name: A label, or None.
        frame: The frame of *position* and *quaternion*; None = the root frame.
        kind: The kind of the body: box, cylinder or sphere.
        position: The centre of the body (m).
        quaternion: The rotation (x, y, z, w).
        color: The colour (RGBA); None = grey.
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
    """A cylinder along its z axis.

    Attributes:
        kind: Always `cylinder`.
        radius: The radius (m).
        length: The length (m).
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
class Mesh:
    """A surface of triangles, for bodies that are neither boxes nor cylinders nor spheres.

    Attributes:
        name: A label, or None.
        frame: The frame of the vertices; None = the root frame.
        color: The colour (RGBA); None = grey.
        vertices: The corners of the triangles (m).
        normals: The outward unit normal of the surface at each vertex, for the shading.
        triangles: Three indices of vertices for each triangle, counter-clockwise seen from outside.
    """

    name: str | None = None
    frame: str | None = None
    color: Color | None = None
    vertices: Float32Rows
    normals: Float32Rows
    triangles: UInt32Rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Laser:
    """A planar laser. Ray i points in the direction `angle_min + i * angle_increment` in *frame*.

    Attributes:
        frame: The frame of the laser.
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
    """A rectangle on the floor to keep out of.

    Attributes:
        name: The label.
        frame: The frame of *corners*; None = the root frame.
        corners: xmin, ymin, xmax and ymax (m).
    """

    name: str
    frame: str | None = None
    corners: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A pinhole camera.

    Attributes:
        name: The name of the camera, which its pictures refer to.
        frame: The optical frame: z ahead, x right, y down.
        size: Width and height of the picture (pixels).
        focal: The focal lengths fx and fy (pixels).
        center: The optical centre cx, cy (pixels); None = the middle of the picture.
    """

    name: str
    frame: str
    size: Size
    focal: Pair
    center: Pair | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Grid:
    """Cells on the floor. A grid replaces the earlier grid of the same *name*.

    Attributes:
        name: The name of the grid.
        kind: `occupancy` or `costs`.
        frame: The frame of the grid; None = the root frame.
        resolution: The edge length of a cell (m).
        origin: The lower left corner (x, y; m).
        size: The number of columns and rows.
        cells: The cells with shape (rows, columns), the row with the lowest y first. The cells of an
            `occupancy` grid are int8: -1 is unknown, 0 free, 100 occupied. The cells of a `costs` grid are
            uint8: Nav2's costs of 0–255.
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
    """A sweep of the laser.

    Attributes:
        stamp: The time of the scan (ns); None = now.
        ranges: The range of each ray (m); +inf = no echo.
    """

    stamp: int | None = None
    ranges: Float32


@dataclass(frozen=True, slots=True, kw_only=True)
class Poses:
    """Poses on the floor. They replace the earlier poses of the same *name*.

    Attributes:
        name: The name of the poses.
        kind: The drawing: the points of a path, a cloud of particles, goals, the robot's estimated pose, or
            its pose by odometry alone.
        frame: The frame of the poses; None = the root frame.
        rows: x, y and yaw of each pose; empty = remove the poses.
    """

    name: str
    kind: Literal["path", "cloud", "goal", "estimate", "odometry"]
    frame: str | None = None
    rows: Float32Rows


@dataclass(frozen=True, slots=True, kw_only=True)
class Arrow:
    """An arrow.

    Attributes:
        name: The name of the arrow.
        frame: The frame of the points; None = the root frame.
        start: The tail (m).
        end: The tip (m).
        color: The colour (RGBA); None = the viewer's default.
    """

    name: str
    frame: str | None = None
    start: Vector
    end: Vector
    color: Color | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class BoundingBox:
    """The box around an object.

    Attributes:
        name: The label.
        frame: The frame of the box; None = the root frame.
        position: The centre (m).
        size: The full edge lengths (m).
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

    Attributes:
        name: The name of the camera.
        stamp: The time of the picture (ns); None = now.
        size: Width and height (pixels).
        format: The encoding of *data*.
        data: A JPEG file, or for `rgb8` uint8 of shape (height, width, 3).
    """

    name: str
    stamp: int | None = None
    size: Size
    format: Literal["jpeg", "rgb8"]
    data: bytes


@dataclass(frozen=True, slots=True, kw_only=True)
class Detection:
    """An object that was detected in a picture.

    Attributes:
        picture: The name of the picture.
        name: The label of the object.
        stamp: The time of the detection (ns); None = now.
        box: Left, top, width and height (pixels).
    """

    picture: str
    name: str
    stamp: int | None = None
    box: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class StaticScene:
    """The part of a scene that does not change.

    Attributes:
        frame: The root of all frames, by default `map`.
        parts: The bodies of the robot and of the world.
        meshes: Further bodies, as surfaces.
        laser: The laser, if the robot has one.
        places: Named points, such as waypoints.
        footprint_radius: The radius (m) of the robot's footprint.
        battery: The level of the battery (percent); if it is given, the viewer shows a plot of the level.
        cameras: The cameras.
        grids: Maps and costmaps.
        areas: Areas to keep out of.
        extra: Further data, which are sent unchanged.
    """

    frame: str | None = None
    parts: Sequence[Part] = ()
    meshes: Sequence[Mesh] = ()
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

    Attributes:
        stamp: The time (ns); None = now.
        frames: The frames that moved.
        velocity: The forward velocity (m/s) and the turning velocity (rad/s).
        battery: The level of the battery (percent).
        collisions: The number of collisions since the start of the run.
        grazes: The number of grazing contacts since the start of the run.
        scan: The newest scan.
        pictures: The newest pictures.
        grids: The grids that changed.
        poses: The poses that changed.
        notes: Markdown texts by label.
        arrows: All arrows: the viewer removes others. None = no change.
        boxes: All boxes: the viewer removes others. None = no change.
        detections: All detections: the viewer removes others. None = no change.
        extra: Further data, which are sent unchanged.
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
    results later, because these may be encoded on another thread. A new publisher first calls `static_scene`;
    a source that sends only changes must then send everything again.
    """

    def static_scene(self) -> StaticScene:
        """Return the part of the scene that does not change; by default, everything may change."""
        return StaticScene()

    def moving_scene(self) -> MovingScene:
        """Return the part of the scene that moved or changed."""
        ...
