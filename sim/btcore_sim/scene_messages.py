"""Conversion of a world and a robot to messages of `btcore_scene`, in the frame `map` of the world."""

import logging
import math
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from btcore_robot.rigid_transform import Transform, from_rpy
from btcore_robot.robot import MAP_FRAME, TransformStamped
from btcore_scene import UPRIGHT, Box, Color, Cylinder, Frame, Mesh, Part, Place, Sphere
from btcore_sim.errors import SimError
from btcore_sim.looks import LookPart, look_parts
from btcore_sim.map_walls import WALL_COLOR
from btcore_sim.mesh_files import read_triangles
from btcore_sim.physics_body import PhysicsBody
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.shells import CORNERS, Section, ball, loft, rgba, rounded_box
from btcore_sim.world import World, prism_mesh, world_extent
from btcore_sim.world_description import WorldObject

_log = logging.getLogger(__name__)

_COARSE = 16
"""The number of corners of a cross-section of furniture, which is far from the eye."""


def world_parts(world: World) -> list[Part]:
    """Return the floor and all objects except prisms. A movable object has a frame of its own."""
    x0, y0, x1, y1 = world_extent(world.description)
    floor = Box(
        name=f"{world.description.name}/floor",
        frame=MAP_FRAME,
        size=(x1 - x0, y1 - y0, 0.01),
        position=((x0 + x1) / 2, (y0 + y1) / 2, -0.005),
        quaternion=UPRIGHT,
        color=world.description.floor,
    )
    plain = [item for item in world.description.objects if item.kind != "prism" and not item.look]
    parts = [floor, *_wall_parts(world), *(_object_part(world.description.name, item) for item in plain)]
    for item in world.description.objects:
        parts += [_look_part(item, part) for part in _looks(item) if part.kind in ("box", "cylinder")]
    return parts


def world_meshes(world: World) -> list[Mesh]:
    """Return the prisms among the objects, and the rounded parts of the objects' looks."""
    prisms = [
        _prism(world.description.name, item) for item in world.description.objects if item.kind == "prism"
    ]
    rounded = [
        _look_mesh(item, part)
        for item in world.description.objects
        for part in _looks(item)
        if part.kind in ("cushion", "ball")
    ]
    return prisms + rounded


def robot_parts(world: World, physics_body: PhysicsBody) -> list[Part]:
    """Return the boxes, cylinders and spheres of the robot's URDF, each in the frame of its link.

    The shapes of links that have shells are left out.

    Args:
        world: The world that contains the robot.
        physics_body: The robot's body.
    """
    parts: list[Part] = []
    counts: Counter[str] = Counter()
    for link, shape in _link_shapes(world, physics_body):
        geometry, size, _, position, quaternion, color, *_ = shape
        where: dict[str, Any] = {
            "name": f"{physics_body.description.name}/{link}/{counts[link]}",
            "frame": link,
            "position": position,
            "quaternion": quaternion,
            "color": tuple(round(255 * part) for part in color),
        }
        if geometry == pybullet.GEOM_BOX:
            parts.append(Box(**where, size=size))
        elif geometry == pybullet.GEOM_CYLINDER:
            parts.append(Cylinder(**where, length=size[0], radius=size[1]))
        elif geometry == pybullet.GEOM_SPHERE:
            parts.append(Sphere(**where, radius=size[0]))
        else:
            continue
        counts[link] += 1
    return parts


def robot_meshes(world: World, physics_body: PhysicsBody) -> list[Mesh]:
    """Return the shells and the mesh files of a robot, as meshes in the frames of their links.

    A mesh file that cannot be drawn is reported as a warning and left out.

    Args:
        world: The world that contains the robot.
        physics_body: The robot's body.
    """
    meshes = []
    for number, shell in enumerate(physics_body.description.shells):
        place = Transform(shell.position, from_rpy(shell.rpy))
        name = f"{physics_body.description.name}/{shell.link}/shell_{number}"
        meshes.append(_mesh(name, shell.link, rgba(shell.color), place, shell.sections))
    for link, shape in _link_shapes(world, physics_body):
        geometry, scale, file, position, quaternion, color, *_ = shape
        if geometry != pybullet.GEOM_MESH:
            continue
        path = Path(file.decode())
        try:
            triangles = read_triangles(path)
        except SimError as error:
            _log.warning("%s", error)
            continue
        red, green, blue, alpha = (round(255 * part) for part in color)
        placed = Transform(position, quaternion).apply((triangles * scale).reshape(-1, 3)).reshape(-1, 3, 3)
        name = f"{physics_body.description.name}/{link}/{path.name}"
        meshes.append(_flat_mesh(name, link, (red, green, blue, alpha), placed))
    return meshes


def _link_shapes(world: World, physics_body: PhysicsBody) -> Iterator[tuple[str, Sequence[Any]]]:
    """Yield the shapes of links without shells: the link's name, and pybullet's data from the geometry on."""
    shelled = {shell.link for shell in physics_body.description.shells}
    names = {link: name for name, link in physics_body.links.items() if name not in shelled}
    for shape in pybullet.getVisualShapeData(physics_body.body_id, physicsClientId=world.client):
        if shape[1] in names:
            yield names[shape[1]], shape[2:]


def frames(world: World, physics_body: PhysicsBody) -> list[Frame]:
    """Return the present poses of the robot's links, the movable objects and the laser.

    Returns:
        The poses of links and objects in the frame `map`. The pose of the laser is in the frame of the link
        on which it is mounted.
    """
    links = [
        Frame(name, MAP_FRAME, *physics_body.link_pose(link)) for name, link in physics_body.links.items()
    ]
    for number in world.movable:
        place = pybullet.getBasePositionAndOrientation(number, physicsClientId=world.client)
        links.append(Frame(world.bodies[number].name, MAP_FRAME, *place))
    mount = physics_body.description.laser
    return [*links, Frame(mount.info.frame, mount.link, mount.position, UPRIGHT)]


def waypoint_data(world: World) -> list[Place]:
    """Return the world's waypoints, except `start`, because the robot is displayed there."""
    named = world.description.waypoints.items()
    return [Place(name=name, position=(x, y, 0.0)) for name, (x, y) in named if name != "start"]


def frame_chain(name: str, known: Iterable[TransformStamped], placed: Collection[str]) -> list[Frame]:
    """Return the chain of frames from *name* up to a frame that has a pose already.

    Args:
        name: The last frame of the chain.
        known: All frames of the robot.
        placed: The names of the frames that have a pose already.
    """
    parents = {frame.child: frame for frame in known}
    chain: list[Frame] = []
    while name in parents and name not in placed:
        frame = parents[name]
        chain.append(Frame(frame.child, frame.parent, frame.position, frame.quaternion))
        name = frame.parent
    return chain


def _prism(description: str, item: WorldObject) -> Mesh:
    corners, indices = prism_mesh(item)
    x, y, z = item.position
    turned = (0.0, 0.0, math.sin(item.yaw / 2), math.cos(item.yaw / 2))
    placed = Transform((x, y, z + item.size[2] / 2), turned).apply(np.array(corners))
    return _flat_mesh(f"{description}/{item.name}", MAP_FRAME, item.color, placed[indices].reshape(-1, 3, 3))


def _flat_mesh(name: str, frame: str, color: Color, triangles: NDArray[np.float64]) -> Mesh:
    """Return a mesh of *triangles*, shape `(n, 3, 3)`, with corners of their own, so that edges are sharp."""
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1)[:, None], 1e-12)
    return Mesh(
        name=name,
        frame=frame,
        color=color,
        vertices=triangles.astype("<f4").tobytes(),
        normals=np.repeat(normals, 3, axis=0).astype("<f4").tobytes(),
        triangles=np.arange(3 * len(triangles), dtype="<u4").tobytes(),
    )


def _mesh(
    name: str, frame: str, color: Color, place: Transform, sections: Sequence[Section], corners: int = CORNERS
) -> Mesh:
    points, normals, triangles = loft(sections, corners)
    return Mesh(
        name=name,
        frame=frame,
        color=color,
        vertices=place.apply(points).astype("<f4").tobytes(),
        normals=(normals @ place.rotation.T).astype("<f4").tobytes(),
        triangles=triangles.astype("<u4").tobytes(),
    )


def _looks(item: WorldObject) -> list[LookPart]:
    return look_parts(item.look, item.size, item.color) if item.look else []


def _look_place(item: WorldObject) -> tuple[str, Transform]:
    """Return the frame of an object's look, and the pose of the middle of the object's underside in it."""
    if item.is_static:
        return MAP_FRAME, Transform(item.position, from_rpy((0.0, 0.0, item.yaw)))
    return item.name, Transform((0.0, 0.0, -item.size[2] / 2))


def _look_part(item: WorldObject, part: LookPart) -> Part:
    frame, place = _look_place(item)
    x, y, z = part.position
    middle = place * Transform((x, y, z + part.size[2] / 2))
    where: dict[str, Any] = {
        "name": item.name,
        "frame": frame,
        "position": middle.position,
        "quaternion": middle.quaternion,
        "color": part.color,
    }
    if part.kind == "box":
        return Box(**where, size=part.size)
    return Cylinder(**where, radius=part.size[0] / 2, length=part.size[2])


def _look_mesh(item: WorldObject, part: LookPart) -> Mesh:
    frame, place = _look_place(item)
    sections = ball(part.size) if part.kind == "ball" else rounded_box(part.size)
    return _mesh(item.name, frame, part.color, place * Transform(part.position), sections, _COARSE)


def _wall_parts(world: World) -> list[Part]:
    """Return the walls of a world that was made from a map."""
    if world.description.walls is None:
        return []
    where: dict[str, Any] = {
        "name": f"{world.description.name}/wall",
        "frame": MAP_FRAME,
        "quaternion": UPRIGHT,
    }
    return [
        Box(**where, size=size, position=middle, color=WALL_COLOR)
        for size, middle in world.description.walls.boxes()
    ]


def _object_part(description: str, item: WorldObject) -> Part:
    x, y, z = item.position
    width, _, height = item.size
    still = item.is_static
    where: dict[str, Any] = {
        "name": f"{description}/{item.name}",
        "frame": MAP_FRAME if still else item.name,
        "position": (x, y, z + height / 2) if still else (0.0, 0.0, 0.0),
        "quaternion": (0.0, 0.0, math.sin(item.yaw / 2), math.cos(item.yaw / 2)) if still else UPRIGHT,
        "color": item.color,
    }
    if item.kind == "box":
        return Box(**where, size=item.size)
    return Cylinder(**where, radius=width / 2, length=height)
