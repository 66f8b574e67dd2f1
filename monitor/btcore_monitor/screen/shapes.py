"""Drawings of boxes, cylinders, spheres and meshes, with walls cut at a low height, on a dark floor."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_scene import UPRIGHT, Box, Color, Cylinder, Grid, Mesh, Part, Sphere

CUT_AT: Final = 0.4
"""Height (m) at which walls, and other parts that are as high as a room, are cut.

They would hide the robot, and the laser does not detect anything above. Furniture is drawn as a whole.
"""
_ROOM_HEIGHT: Final = 2.1
"""Height (m) above which a part is as high as a room."""
_FLAT: Final = 0.05
"""Height (m) below which a part is the floor, or lies on the floor."""
_FLOOR_LIGHT: Final = 0.3
_OUTLINE_LIGHT: Final = 0.45
_WALL_HEIGHT: Final = 1.5
_WALL_WIDTHS: Final = (0.05, 0.35)
"""Smallest height, and smallest and greatest thickness of a wall (m). A board of furniture is thinner."""
_COLOR: Final[Color] = (160, 168, 180, 255)
_LINE: Final = -0.75
"""Radius of outlines; rerun interprets negative values as pixels."""


def archetypes(parts: Sequence[Part], around: bool) -> Iterator[tuple[str, Any]]:
    """Yield a name and a rerun archetype for each drawing of *parts*.

    Args:
        parts: Parts of one kind and frame.
        around: Whether the parts belong to the robot's world, and not to the robot.
    """
    kind = parts[0].kind
    if not around:
        yield kind, _create_shape(parts, "solid")
        return
    yield kind, _create_shape([_dim(_cut(part)) for part in parts], "solid")
    high = [
        _light(part, _OUTLINE_LIGHT) for part in parts if _height(part) > _ROOM_HEIGHT and not _is_wall(part)
    ]
    if high:
        yield f"{kind}_outlines", _create_shape(high, "majorwireframe")


def surface(meshes: Sequence[Mesh], around: bool) -> Any:
    """Return a rerun archetype with all *meshes*, which have the same frame.

    Args:
        around: Whether the meshes belong to the robot's world; the upper parts of walls are then flattened at
            `CUT_AT`, which cuts vertical walls.
    """
    vertices = [_rows(mesh.vertices, "<f4") for mesh in meshes]
    if around:
        vertices = [_flatten(points) for points in vertices]
    counts = [len(points) for points in vertices]
    before = np.cumsum([0, *counts[:-1]])
    triangles = [_rows(mesh.triangles, "<u4") + first for mesh, first in zip(meshes, before, strict=True)]
    colors = np.array([mesh.color or _COLOR for mesh in meshes], dtype=np.uint8)
    return rr.Mesh3D(
        vertex_positions=np.concatenate(vertices),
        vertex_normals=np.concatenate([_rows(mesh.normals, "<f4") for mesh in meshes]),
        triangle_indices=np.concatenate(triangles),
        vertex_colors=np.repeat(colors, counts, axis=0),
    )


def _flatten(points: NDArray[Any]) -> NDArray[Any]:
    """Return the vertices of a mesh, flattened if the mesh is as high as a wall."""
    high = len(points) > 0 and points[:, 2].max() > _WALL_HEIGHT
    return np.minimum(points, np.array((np.inf, np.inf, CUT_AT))) if high else points


def _rows(data: bytes, dtype: str) -> NDArray[Any]:
    return np.frombuffer(data, dtype=dtype).reshape(-1, 3)


def extent(
    parts: Sequence[Part], grids: Sequence[Grid] = ()
) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the lower and upper corner (x, y in m) of the bounding box of *parts*.

    Args:
        grids: Without parts, the box is that of these grids. Without both, it is ±3 m.
    """
    corners = [] if parts or grids else [(-3.0, -3.0), (3.0, 3.0)]
    for grid in () if parts else grids:
        (x, y), (columns, rows) = grid.origin, grid.size
        corners += [(x, y), (x + columns * grid.resolution, y + rows * grid.resolution)]
    for part in parts:
        x, y = part.position[:2]
        if isinstance(part, Box):
            # The rotation about the z axis, as for an upright box.
            qx, qy, qz, qw = part.quaternion or UPRIGHT
            sin, cos = 2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)
            along, across = part.size[0] / 2, part.size[1] / 2
            reach_x = abs(cos) * along + abs(sin) * across
            reach_y = abs(sin) * along + abs(cos) * across
        else:
            reach_x = reach_y = part.radius
        corners += [(x - reach_x, y - reach_y), (x + reach_x, y + reach_y)]
    xs, ys = zip(*corners, strict=True)
    return (min(xs), min(ys)), (max(xs), max(ys))


def _height(part: Part) -> float:
    """Return the height of an upright part, or 0 for a sphere or a tilted part, which are never cut."""
    qx, qy, *_ = part.quaternion or UPRIGHT
    if isinstance(part, Sphere) or abs(qx) + abs(qy) > 0.01:
        return 0.0
    return part.size[2] if isinstance(part, Box) else part.length


def _is_wall(part: Part) -> bool:
    """Return whether a part is a wall: high and thin.

    Walls get no outlines: these would be most of the lines in the picture, and do not help to understand it.
    """
    if not isinstance(part, Box) or _height(part) <= _WALL_HEIGHT:
        return False
    thinnest, thickest = _WALL_WIDTHS
    return thinnest < min(part.size[:2]) < thickest


def _cut(part: Part) -> Part:
    height = _height(part)
    if isinstance(part, Sphere) or not (height > _ROOM_HEIGHT or _is_wall(part)):
        return part
    x, y, z = part.position
    position = (x, y, z - height / 2 + CUT_AT / 2)
    if isinstance(part, Box):
        return replace(part, position=position, size=(*part.size[:2], CUT_AT))
    return replace(part, position=position, length=CUT_AT)


def _dim(part: Part) -> Part:
    """Return *part*, darker if it is the floor or lies on it, so that laser and trail are clearly visible."""
    height = _height(part)
    on_floor = part.position[2] + height / 2 < _FLAT
    return _light(part, _FLOOR_LIGHT) if 0.0 < height < _FLAT and on_floor else part


def _light(part: Part, light: float) -> Part:
    red, green, blue, alpha = part.color or _COLOR
    return replace(part, color=(int(red * light), int(green * light), int(blue * light), alpha))


def _create_shape(parts: Sequence[Part], fill: str) -> Any:
    shared: dict[str, Any] = {
        "centers": [part.position for part in parts],
        "quaternions": [rr.Quaternion(xyzw=part.quaternion or UPRIGHT) for part in parts],
        "colors": np.array([part.color or _COLOR for part in parts], dtype=np.uint8),
        "fill_mode": fill,
        "labels": [part.name or "" for part in parts],
        "show_labels": False,
    }
    # All parts are of one kind, so there are only boxes or none.
    boxes = [part for part in parts if isinstance(part, Box)]
    if boxes:
        return rr.Boxes3D(sizes=[box.size for box in boxes], radii=[_LINE], **shared)
    shared |= {"line_radii": [_LINE], "radii": [part.radius for part in parts if not isinstance(part, Box)]}
    cylinders = [part for part in parts if isinstance(part, Cylinder)]
    if cylinders:
        return rr.Cylinders3D(lengths=[cylinder.length for cylinder in cylinders], **shared)
    return rr.Ellipsoids3D(**shared)
