"""The scene of a robot from above, as JSON data in the root frame: outlines, paths and the laser."""

import math
import struct
from collections.abc import Iterable, Sequence
from typing import Any, Final

from btcore_scene import (
    UPRIGHT,
    Box,
    Color,
    Cylinder,
    Frame,
    Mesh,
    MovingScene,
    Part,
    Poses,
    Quaternion,
    StaticScene,
    Vector,
)
from btcore_scene.rotations import product, rotated, yaw_of

_Point = tuple[float, float]
_Place = tuple[Vector, Quaternion]
_Outline = tuple[float, Color, list[float]]
"""The height of the upper end, the colour, and the x and y of each corner."""
_ORIGIN: Final[_Place] = (0.0, 0.0, 0.0), UPRIGHT
_GREY: Final = (150, 150, 150, 255)
_CORNERS: Final = 16
"""Number of corners of the outline of a cylinder or a sphere."""
_MAX_BODIES: Final = 3_000
_MAX_VERTICES: Final = 20_000
"""Maximum number of vertices of a mesh; larger meshes are left out."""
_MAX_POINTS: Final = 400
"""Maximum number of points of a path, of poses or of a scan. Of more, some are left out."""
_MAX_DEPTH: Final = 20
"""Maximum number of frames between a body and the root."""


class PlanView:
    """Collects the messages of a scene, and returns the scene from above.

    Args:
        scene: The part that does not change.
    """

    def __init__(self, scene: StaticScene) -> None:
        self._root = scene.frame or "map"
        meshes = [mesh for mesh in scene.meshes if 0 < len(mesh.vertices) <= 12 * _MAX_VERTICES]
        bodies = [*map(_body_of, scene.parts[:_MAX_BODIES]), *map(_mesh_body, meshes[:_MAX_BODIES])]
        fixed = (None, self._root)
        self._fixed = [_outline(body, _ORIGIN) for body in bodies if body.frame in fixed]
        self._bodies = [body for body in bodies if body.frame not in fixed]
        self._laser = scene.laser
        self._places = scene.places[:_MAX_POINTS]
        self._frames: dict[str, Frame] = {}
        self._poses: dict[str, Poses] = {}
        self._ranges: Sequence[float] = ()

    def take_moving(self, scene: MovingScene) -> None:
        """Take what has moved or changed."""
        for frame in scene.frames:
            self._frames[frame.child] = frame
        for poses in scene.poses:
            self._poses[poses.name] = poses
        if scene.scan is not None:
            self._ranges = struct.unpack(f"<{len(scene.scan.ranges) // 4}f", scene.scan.ranges)

    def data(self) -> dict[str, Any] | None:
        """Return the scene, or None if nothing can be drawn.

        `LiveState.scene` describes the data. The bodies are sorted by the height of their upper ends.
        """
        drawn = self._fixed + [_outline(body, self._place(body.frame)) for body in self._bodies]
        if not drawn:
            return None
        drawn.sort(key=lambda item: item[0])
        return {
            "bodies": [(color, corners) for _, color, corners in drawn],
            "places": [
                (item.name, *_flat(self._place(item.frame), [item.position])) for item in self._places
            ],
            "poses": [(poses.kind, self._poses_data(poses)) for poses in self._poses.values() if poses.rows],
            "scan": self._scan_data(),
        }

    def _place(self, name: str | None) -> _Place:
        """Return the place of a frame in the root frame."""
        position, turn = (0.0, 0.0, 0.0), UPRIGHT
        for _ in range(_MAX_DEPTH):
            frame = self._frames.get(name or self._root)
            if frame is None or name == self._root:
                break
            own = (frame.position, frame.quaternion)
            position, turn = _apply(own, position), product(frame.quaternion, turn)
            name = frame.parent
        return position, turn

    def _poses_data(self, poses: Poses) -> list[float]:
        """Return x, y and yaw of poses."""
        place = self._place(poses.frame)
        rows = _thinned(list(struct.iter_unpack("<3f", poses.rows)))
        turned = yaw_of(place[1])
        return [
            round(value, 3) for x, y, yaw in rows for value in (*_apply(place, (x, y, 0.0))[:2], yaw + turned)
        ]

    def _scan_data(self) -> list[float]:
        """Return the x and y of the echoes of the laser."""
        laser = self._laser
        if laser is None:
            return []
        angles = (
            (laser.angle_min + index * laser.angle_increment, reach)
            for index, reach in enumerate(self._ranges)
        )
        limit = laser.range_max or math.inf
        echoes = [
            (reach * math.cos(angle), reach * math.sin(angle), 0.0)
            for angle, reach in angles
            if math.isfinite(reach) and 0.0 < reach < limit
        ]
        return _flat(self._place(laser.frame), _thinned(echoes))


class _Body:
    """A body by points on its surface, in its frame."""

    def __init__(self, frame: str | None, color: Color | None, corners: Sequence[Vector]) -> None:
        self.frame = frame
        self.color = color or _GREY
        self.corners = corners


def _body_of(part: Part) -> _Body:
    place = (part.position, part.quaternion or UPRIGHT)
    if isinstance(part, Box):
        x, y, z = (size / 2 for size in part.size)
        corners = [(a * x, b * y, c * z) for a in (-1, 1) for b in (-1, 1) for c in (-1, 1)]
    else:
        half = part.length / 2 if isinstance(part, Cylinder) else part.radius
        levels = (-half, half) if isinstance(part, Cylinder) else (0.0, half)
        angles = [math.tau * index / _CORNERS for index in range(_CORNERS)]
        corners = [
            (part.radius * math.cos(angle), part.radius * math.sin(angle), level)
            for level in levels
            for angle in angles
        ]
    return _Body(part.frame, part.color, [_apply(place, corner) for corner in corners])


def _mesh_body(mesh: Mesh) -> _Body:
    """Return a mesh by the corners of its outline, at its lowest and its highest level."""
    points: list[Vector] = list(struct.iter_unpack("<3f", mesh.vertices))
    outline = _convex_hull([(x, y) for x, y, _ in points])
    levels = min(z for _, _, z in points), max(z for _, _, z in points)
    return _Body(mesh.frame, mesh.color, [(x, y, level) for level in levels for x, y in outline])


def _outline(body: _Body, place: _Place) -> _Outline:
    corners = [_apply(place, corner) for corner in body.corners]
    outline = _convex_hull((x, y) for x, y, _ in corners)
    return (
        max(z for _, _, z in corners),
        body.color,
        [round(value, 3) for point in outline for value in point],
    )


def _thinned(items: list[Any]) -> list[Any]:
    return items[:: -(-len(items) // _MAX_POINTS) or 1]


def _flat(place: _Place, points: Iterable[Vector]) -> list[float]:
    return [round(value, 3) for point in points for value in _apply(place, point)[:2]]


def _apply(place: _Place, point: Vector) -> Vector:
    """Return *point* of the frame at *place* in the frame around it."""
    (px, py, pz), turn = place
    x, y, z = rotated(turn, point)
    return px + x, py + y, pz + z


def _convex_hull(points: Iterable[_Point]) -> list[_Point]:
    """Return the corners of the convex hull, by Andrew's monotone chain."""
    ordered = sorted(set(points))
    if len(ordered) < 3:
        return ordered
    halves = []
    for half in (ordered, ordered[::-1]):
        chain: list[_Point] = []
        for point in half:
            while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0:
                chain.pop()
            chain.append(point)
        halves += chain[:-1]
    return halves


def _turn(a: _Point, b: _Point, c: _Point) -> float:
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
