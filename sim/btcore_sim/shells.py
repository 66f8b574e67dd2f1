"""Rounded shells: surfaces through a row of cross-sections, as triangles with normals.

A robot's description may have shells for its links (tiago.json is an example). Each shell is a list of
cross-sections from its bottom to its top. A cross-section is a superellipse, a shape between an ellipse
(exponent 2) and a rectangle (great exponents). Shells are only drawn: collisions, sensors and masses are
those of the URDF.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from btcore.typed_data import Positive
from btcore_scene import Color

Floats = NDArray[np.float64]

HexColor = Annotated[
    str, Meta(pattern="^#([0-9a-fA-F]{6}|[0-9a-fA-F]{8})$", examples=["#c8b090", "#c8b090ff"])
]
"""A colour in a file."""


def rgba(color: HexColor) -> Color:
    """Return *color* as red, green, blue and alpha (0–255)."""
    red, green, blue, alpha = bytes.fromhex(color[1:].ljust(8, "f"))
    return red, green, blue, alpha


CORNERS = 40
"""Default number of corners of a cross-section."""
_STEPS = 2  # steps of a rounded edge of a box
_ROUNDING = 0.05  # m: radius of the edges of a rounded box
_TINY = 1e-3  # m: smallest extent of a cross-section


class Section(NamedTuple):
    """A cross-section: the superellipse |x/a|ⁿ + |y/b|ⁿ = 1 about (*x*, 0) at the height *z*.

    Attributes:
        z: The height along the shell's axis (m).
        x: The x coordinate of the centre (m).
        half_x: Half the extent along x, a (m).
        half_y: Half the extent along y, b (m).
        exponent: The exponent n: 2 = an ellipse; the greater, the more like a rectangle.
    """

    z: float
    x: float
    half_x: Positive
    half_y: Positive
    exponent: Positive


@dataclass(frozen=True, slots=True, kw_only=True)
class Shell:
    """A closed surface through *sections*, from the bottom to the top, on a link of a robot.

    Two equal sections in a row make a sharp edge; elsewhere the surface is smooth.

    Attributes:
        link: The link.
        color: The colour, `#rrggbb` or `#rrggbbaa`.
        position: The origin of the sections on the link (m).
        rpy: Roll, pitch and yaw of the sections' axes on the link (rad).
        sections: The cross-sections.
    """

    link: str
    color: HexColor = "#a0a8b4"
    position: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy: tuple[float, float, float] = (0.0, 0.0, 0.0)
    sections: Annotated[tuple[Section, ...], Meta(min_length=2)]


def loft(sections: Sequence[Section], corners: int = CORNERS) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return a closed surface through *sections*, whose ends are flat.

    Args:
        sections: The cross-sections, from the bottom to the top.
        corners: The number of corners of each cross-section.

    Returns:
        The points (m, shape `(n, 3)`), the outward normals (shape `(n, 3)`), and the triangles as indices of
        points (shape `(m, 3)`).
    """
    rings = np.array([_ring(section, corners) for section in sections])
    sharp = [0, *(k for k in range(1, len(sections)) if sections[k] == sections[k - 1]), len(sections)]
    strips = [_strip(rings[begin:end]) for begin, end in itertools.pairwise(sharp) if end - begin > 1]
    strips += [_lid(rings[0], -1.0), _lid(rings[-1], 1.0)]
    first = np.cumsum([0, *(len(points) for points, _, _ in strips[:-1])])
    return (
        np.concatenate([points for points, _, _ in strips]),
        np.concatenate([normals for _, normals, _ in strips]),
        np.concatenate([triangles + k for (_, _, triangles), k in zip(strips, first, strict=True)]),
    )


def rounded_box(size: Sequence[float]) -> tuple[Section, ...]:
    """Return the cross-sections of a box with rounded edges and the full extent *size* (m), on z = 0."""
    half_x, half_y, height = size[0] / 2, size[1] / 2, size[2]
    radius = min(_ROUNDING, half_x, half_y, height / 2)
    exponent = max(2.0, 2.0 * min(half_x, half_y) / radius)
    angles = [math.pi / 2 * step / _STEPS for step in range(_STEPS + 1)]
    low = [(radius * (1.0 - math.cos(angle)), radius * (1.0 - math.sin(angle))) for angle in angles]
    profile = [*low, *((height - z, inset) for z, inset in reversed(low))]
    return tuple(
        Section(z, 0.0, max(half_x - inset, _TINY), max(half_y - inset, _TINY), exponent)
        for z, inset in profile
    )


def ball(size: Sequence[float]) -> tuple[Section, ...]:
    """Return the cross-sections of an ellipsoid with the full extent *size* (m), on z = 0."""
    steps = 6
    sections = []
    for step in range(steps + 1):
        angle = math.pi * step / steps
        wide = math.sin(angle) / 2
        z = size[2] * (1.0 - math.cos(angle)) / 2
        sections.append(Section(z, 0.0, max(size[0] * wide, _TINY), max(size[1] * wide, _TINY), 2.0))
    return tuple(sections)


def _ring(section: Section, corners: int) -> Floats:
    around = 2.0 * math.pi * np.arange(corners) / corners
    cos, sin = np.cos(around), np.sin(around)
    power = 2.0 / section.exponent
    x = section.x + section.half_x * np.sign(cos) * np.abs(cos) ** power
    y = section.half_y * np.sign(sin) * np.abs(sin) ** power
    return np.stack((x, y, np.full(corners, section.z)), axis=1)


def _strip(rings: Floats) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the smooth surface between *rings*, shape `(rings, corners, 3)`."""
    count, corners, _ = rings.shape
    along = np.gradient(rings, axis=0)
    across = np.roll(rings, -1, axis=1) - np.roll(rings, 1, axis=1)
    normals = np.cross(across, along)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-12)
    first = np.arange(count - 1)[:, None] * corners
    here, beside = first + np.arange(corners), first + np.roll(np.arange(corners), -1)
    lower = np.stack((here, beside, beside + corners), axis=-1).reshape(-1, 3)
    upper = np.stack((here, beside + corners, here + corners), axis=-1).reshape(-1, 3)
    return rings.reshape(-1, 3), normals.reshape(-1, 3), np.concatenate((lower, upper))


def _lid(ring: Floats, up: float) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Return the flat end of a shell. *up* is 1 for the top and -1 for the bottom."""
    points = np.concatenate((ring.mean(axis=0, keepdims=True), ring))
    around = np.arange(len(ring))
    sides = [1 + around, 1 + np.roll(around, -1)]
    triangles = np.stack((0 * around, *(sides if up > 0.0 else reversed(sides))), axis=1)
    return points, np.tile((0.0, 0.0, up), (len(points), 1)), triangles
