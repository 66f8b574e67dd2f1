"""Boxes, cylinders and spheres as flat faces with four corners, for the renderer.

A face's corners are counter-clockwise when seen from outside. Round shapes become prisms and polyhedra with
enough sides that the difference in a picture is at most a pixel.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]

_SIDES = 24
_RINGS = 8

_CUBE = (
    ((1, -1, -1), (1, 1, -1), (1, 1, 1), (1, -1, 1)),
    ((-1, 1, -1), (-1, -1, -1), (-1, -1, 1), (-1, 1, 1)),
    ((1, 1, -1), (-1, 1, -1), (-1, 1, 1), (1, 1, 1)),
    ((-1, -1, -1), (1, -1, -1), (1, -1, 1), (-1, -1, 1)),
    ((-1, -1, 1), (1, -1, 1), (1, 1, 1), (-1, 1, 1)),
    ((-1, 1, -1), (1, 1, -1), (1, -1, -1), (-1, -1, -1)),
)


def box(size: Sequence[float]) -> Floats:
    """Return the six faces of a box of full extent *size* (m) around the origin, shape ``(6, 4, 3)``."""
    faces: Floats = np.array(_CUBE, dtype=np.float64) * (np.asarray(size, dtype=np.float64) / 2)
    return faces


def cylinder(radius: float, length: float) -> Floats:
    """Return the faces of an upright cylinder (m) around the origin, shape ``(n, 4, 3)``."""
    around = np.linspace(0.0, 2 * math.pi, _SIDES + 1)
    x, y = radius * np.cos(around), radius * np.sin(around)
    half = length / 2
    faces = [
        [(x[k], y[k], -half), (x[k + 1], y[k + 1], -half), (x[k + 1], y[k + 1], half), (x[k], y[k], half)]
        for k in range(_SIDES)
    ]
    for k in range(1, _SIDES - 2, 2):  # a lid is a fan of quadrilaterals about its first corner
        lid = [(x[i], y[i]) for i in (0, k, k + 1, k + 2)]
        faces.append([(*corner, half) for corner in lid])
        faces.append([(*corner, -half) for corner in reversed(lid)])
    return np.array(faces, dtype=np.float64)


def sphere(radius: float) -> Floats:
    """Return the faces of a sphere (m) around the origin, shape ``(n, 4, 3)``."""
    around = np.linspace(0.0, 2 * math.pi, _SIDES // 2 + 1)
    up = np.linspace(-math.pi / 2, math.pi / 2, _RINGS + 1)

    def corner(ring: int, side: int) -> tuple[float, float, float]:
        wide = radius * math.cos(up[ring])
        return wide * math.cos(around[side]), wide * math.sin(around[side]), radius * math.sin(up[ring])

    faces = [
        [corner(ring, side), corner(ring, side + 1), corner(ring + 1, side + 1), corner(ring + 1, side)]
        for ring in range(_RINGS)
        for side in range(len(around) - 1)
    ]
    return np.array(faces, dtype=np.float64)


def shape(kind: str, size: Sequence[float]) -> Floats:
    """Return the faces of a shape around the origin, shape ``(n, 4, 3)``.

    Args:
        kind: ``box``, ``cylinder`` or ``sphere``.
        size: In m: three sides of a box; diameter, diameter, height of a cylinder; radius of a sphere.
    """
    if kind == "box":
        return box(size)
    if kind == "cylinder":
        return cylinder(size[0] / 2, size[2])
    return sphere(size[0])
