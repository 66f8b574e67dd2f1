"""Boxes, cylinders and spheres, drawn like an architect's model: walls cut, on a dark floor."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr

Part = Mapping[str, Any]

CUT_AT: Final = 0.4
"""m; what stands around and is higher is solid up to here and an outline above:
walls of 2.4 m would hide the robot, and the laser sees nothing of what is above. Walls have no outline."""
_FLAT: Final = 0.05
"""m; what is thinner lies on the floor, or is it."""
_FLOOR_LIGHT: Final = 0.3
_OUTLINE_LIGHT: Final = 0.45
_WALL_HEIGHT, _WALL_WIDTH = 1.5, 0.35
_LINE: Final = -0.75
"""Outlines' radius; rerun takes a negative one as pixels."""


def archetypes(kind: str, parts: Sequence[Part], around: bool) -> Iterator[tuple[str, Any]]:
    """(name, what rerun draws) for *parts* of one *kind* and frame; *around*: they are the robot's world."""
    if not around:
        yield kind, _shape(kind, parts, "solid")
        return
    yield kind, _shape(kind, [_dimmed(_cut(part)) for part in parts], "solid")
    high = [_lit(part, _OUTLINE_LIGHT) for part in parts if _height(part) > CUT_AT and not _is_wall(part)]
    if high:
        yield f"{kind}_outlines", _shape(kind, high, "majorwireframe")


def extent(parts: Sequence[Part]) -> tuple[tuple[float, float], tuple[float, float]]:
    """Lower and upper corner (x, y in m) of what *parts* cover, turned as they are; ±3 m for none."""
    corners = [(-3.0, -3.0), (3.0, 3.0)] if not parts else []
    for part in parts:
        x, y = part["position"][:2]
        if "size" in part:
            qx, qy, qz, qw = part.get("quaternion", (0, 0, 0, 1))
            sin, cos = 2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz)
            along, across = part["size"][0] / 2, part["size"][1] / 2
            reach_x = abs(cos) * along + abs(sin) * across
            reach_y = abs(sin) * along + abs(cos) * across
        else:
            reach_x = reach_y = part["radius"]
        corners += [(x - reach_x, y - reach_y), (x + reach_x, y + reach_y)]
    xs, ys = zip(*corners, strict=True)
    return (min(xs), min(ys)), (max(xs), max(ys))


def _height(part: Part) -> float:
    """How high an upright part is; 0 for a sphere and for what is tilted, which are left whole."""
    qx, qy, *_ = part.get("quaternion", (0, 0, 0, 1))
    if abs(qx) + abs(qy) > 0.01:
        return 0.0
    return float(part["size"][2]) if "size" in part else float(part.get("length", 0.0))


def _is_wall(part: Part) -> bool:
    """Whether it is as high as a room, and thin: everybody knows how walls go on, and a room's edges in the
    air would be most of the lines of the picture.
    """
    return "size" in part and _height(part) > _WALL_HEIGHT and min(part["size"][:2]) < _WALL_WIDTH


def _cut(part: Part) -> Part:
    height = _height(part)
    if height <= CUT_AT:
        return part
    x, y, z = part["position"]
    place = {"position": [x, y, z - height / 2 + CUT_AT / 2]}
    if "size" in part:
        return {**part, **place, "size": [*part["size"][:2], CUT_AT]}
    return {**part, **place, "length": CUT_AT}


def _dimmed(part: Part) -> Part:
    """A floor is dark, so that laser and trail stand out on it."""
    return _lit(part, _FLOOR_LIGHT) if 0.0 < _height(part) < _FLAT else part


def _lit(part: Part, light: float) -> Part:
    red, green, blue, alpha = part.get("color", (160, 168, 180, 255))
    return {**part, "color": [int(red * light), int(green * light), int(blue * light), alpha]}


def _shape(kind: str, parts: Sequence[Part], fill: str) -> Any:
    shared: dict[str, Any] = {
        "centers": [part.get("position", (0, 0, 0)) for part in parts],
        "quaternions": [rr.Quaternion(xyzw=part.get("quaternion", (0, 0, 0, 1))) for part in parts],
        "colors": np.array([part.get("color", (160, 168, 180, 255)) for part in parts], dtype=np.uint8),
        "fill_mode": fill,
        "labels": [part.get("name", "") for part in parts],
        "show_labels": False,
    }
    if kind == "box":
        return rr.Boxes3D(sizes=[part["size"] for part in parts], radii=[_LINE], **shared)
    shared["line_radii"] = [_LINE]
    radii = [part["radius"] for part in parts]
    if kind == "cylinder":
        return rr.Cylinders3D(lengths=[part["length"] for part in parts], radii=radii, **shared)
    return rr.Ellipsoids3D(radii=radii, **shared)
