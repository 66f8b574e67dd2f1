"""The visible surfaces of a world and its robot, as coloured faces at their present poses.

Boxes, cylinders, prisms and spheres consist of flat faces with four corners. A face's corners are
counter-clockwise when seen from outside. Round shapes become prisms and polyhedra with enough sides that the
difference in a picture is at most a pixel.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import Transform
from btcore_sim.map_walls import WALL_COLOR, MapWalls
from btcore_sim.physics_body import PhysicsBody
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.world import World, world_extent
from btcore_sim.world_description import WorldObject

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

_KINDS = {pybullet.GEOM_BOX: "box", pybullet.GEOM_CYLINDER: "cylinder", pybullet.GEOM_SPHERE: "sphere"}
_THICK = 0.01  # m: thickness of the floor


def box_faces(size: Sequence[float]) -> Floats:
    """Return the six faces of a box of full extent *size* (m) around the origin, shape `(6, 4, 3)`."""
    faces: Floats = np.array(_CUBE, dtype=np.float64) * (np.asarray(size, dtype=np.float64) / 2)
    return faces


def cylinder_faces(radius: float, length: float) -> Floats:
    """Return the faces of an upright cylinder whose centre is the origin.

    Args:
        radius: The radius (m).
        length: The length along the z axis (m).

    Returns:
        The corners of each face (x, y, z in m), shape `(n, 4, 3)`.
    """
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


def sphere_faces(radius: float) -> Floats:
    """Return the faces of a sphere of *radius* (m) around the origin, shape `(n, 4, 3)`."""
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


def shape_faces(kind: str, size: Sequence[float]) -> Floats:
    """Return the faces of a shape around the origin, shape `(n, 4, 3)`.

    Args:
        kind: `box`, `cylinder` or `sphere`.
        size: The sides of a box; diameter, diameter and height of a cylinder; or radius of a sphere (m).
    """
    if kind == "box":
        return box_faces(size)
    if kind == "cylinder":
        return cylinder_faces(size[0] / 2, size[2])
    return sphere_faces(size[0])


def prism_faces(item: WorldObject) -> Floats:
    """Return the faces of a prism around the middle of its extent, shape `(n, 4, 3)`."""
    half = item.size[2] / 2
    faces = [[(*a, -half), (*b, -half), (*b, half), (*a, half)] for a, b in item.sides()]
    for part in item.parts:
        corners = part if len(part) == 4 else (*part, part[-1])
        faces.append([(*corner, half) for corner in corners])
        faces.append([(*corner, -half) for corner in reversed(corners)])
    return np.array(faces, dtype=np.float64)


class VisibleFaces:
    """The faces of the floor, of all objects and of the robot. The meshes of its URDF are left out."""

    def __init__(self, world: World, physics_body: PhysicsBody) -> None:
        self._world = world
        self._physics_body = physics_body
        still = [_standing(item) for body, item in world.bodies.items() if body not in world.movable]
        if world.description.walls is not None:
            still += _walls(world.description.walls)
        still.append(_floor(world))
        self._still = np.concatenate([faces for faces, _ in still])
        self._moved = [(body, *_shaped(world.bodies[body])) for body in world.movable]
        self._robot = _robot(world, physics_body)
        # The order of the faces in `now`.
        painted = [*still, *(entry[1:] for entry in self._moved), *(entry[1:] for entry in self._robot)]
        self.colors = np.concatenate([np.tile(color, (len(shape), 1)) for shape, color in painted])
        """The colour (RGBA, 0–255) of every face, shape `(n, 4)`."""

    def now(self) -> Floats:
        """Return all faces in the world frame (m), shape `(n, 4, 3)`; the robot's own faces come last."""
        faces = [self._still]
        for body, shape, _ in self._moved:
            place, turned = pybullet.getBasePositionAndOrientation(body, physicsClientId=self._world.client)
            faces.append(Transform(place, turned).apply(shape))
        places: dict[int, Transform] = {}
        for link, shape, _ in self._robot:
            if link not in places:
                places[link] = Transform(*self._physics_body.link_pose(link))
            faces.append(places[link].apply(shape))
        return np.concatenate(faces)


def _shaped(item: WorldObject) -> tuple[Floats, Floats]:
    faces = prism_faces(item) if item.kind == "prism" else shape_faces(item.kind, item.size)
    # Only glass is transparent: alpha of other objects is for the monitor alone.
    color = item.color if item.is_glass else (*item.color[:3], 255)
    return faces, np.array(color, dtype=np.float64)


def _standing(item: WorldObject) -> tuple[Floats, Floats]:
    shape, color = _shaped(item)
    x, y, z = item.position
    turned = (0.0, 0.0, math.sin(item.yaw / 2), math.cos(item.yaw / 2))
    return Transform((x, y, z + item.size[2] / 2), turned).apply(shape), color


def _walls(walls: MapWalls) -> list[tuple[Floats, Floats]]:
    color = np.array(WALL_COLOR, dtype=np.float64)
    return [(box_faces(size) + np.array(middle), color) for size, middle in walls.boxes()]


def _floor(world: World) -> tuple[Floats, Floats]:
    x0, y0, x1, y1 = world_extent(world.description)
    shape = box_faces((x1 - x0, y1 - y0, _THICK))
    middle = ((x0 + x1) / 2, (y0 + y1) / 2, -_THICK / 2)
    return Transform(middle).apply(shape), np.array((*world.description.floor[:3], 255), dtype=np.float64)


def _robot(world: World, physics_body: PhysicsBody) -> list[tuple[int, Floats, Floats]]:
    """Return the URDF's shapes: the link, the faces in the link's frame, and the colour."""
    shapes: list[tuple[int, Floats, Floats]] = []
    for visual in pybullet.getVisualShapeData(physics_body.body_id, physicsClientId=world.client):
        _, link, geometry, size, _, place, turned, color, *_ = visual
        if geometry not in _KINDS:
            continue
        # The engine's size of a cylinder is its length, then its radius.
        sizes = (2 * size[1], 2 * size[1], size[0]) if geometry == pybullet.GEOM_CYLINDER else size
        shape = Transform(place, turned).apply(shape_faces(_KINDS[geometry], sizes))
        shapes.append((link, shape, 255.0 * np.array((*color[:3], 1.0), dtype=np.float64)))
    return shapes
