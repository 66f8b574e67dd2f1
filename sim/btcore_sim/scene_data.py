"""A world and a robot as plain data for whoever draws them: shapes once, poses again and again.

Sizes and positions are in m, quaternions (x, y, z, w), colours RGBA of 0–255; a part stays where it is in its
``frame``, and ``map`` is the world's own.
"""

import math
from collections import Counter
from collections.abc import Collection, Sequence
from typing import Any

from btcore_robot.robot import CameraImage, CameraInfo, LaserInfo, LaserScan, TransformStamped
from btcore_sim.physics_body import PhysicsBody
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.scene import SceneObject
from btcore_sim.world import World, scene_extent

UPRIGHT = [0.0, 0.0, 0.0, 1.0]

_KINDS = {pybullet.GEOM_BOX: "box", pybullet.GEOM_CYLINDER: "cylinder", pybullet.GEOM_SPHERE: "sphere"}


def world_parts(world: World) -> list[dict[str, Any]]:
    """The floor and every thing; what can be moved has a frame of its own."""
    x0, y0, x1, y1 = scene_extent(world.scene)
    floor = {
        "name": f"{world.scene.name}/floor",
        "frame": "map",
        "kind": "box",
        "size": [x1 - x0, y1 - y0, 0.01],
        "position": [(x0 + x1) / 2, (y0 + y1) / 2, -0.005],
        "quaternion": UPRIGHT,
        "color": list(world.scene.floor),
    }
    return [floor, *(_thing(world.scene.name, thing) for thing in world.scene.things)]


def robot_parts(world: World, model: PhysicsBody) -> list[dict[str, Any]]:
    """The shapes of the URDF, each in the frame of its link. Meshes are left out."""
    names = {link: name for name, link in model.links.items()}
    parts: list[dict[str, Any]] = []
    counts: Counter[int] = Counter()
    for shape in pybullet.getVisualShapeData(model.body_id, physicsClientId=world.client):
        _, link, geometry, size, _, place, turned, color, *_ = shape
        if geometry not in _KINDS:
            continue
        part: dict[str, Any] = {
            "name": f"{model.description.name}/{names[link]}/{counts[link]}",
            "frame": names[link],
            "kind": _KINDS[geometry],
            "position": list(place),
            "quaternion": list(turned),
            "color": [round(255 * one) for one in color],
        }
        if geometry == pybullet.GEOM_BOX:
            part["size"] = list(size)
        elif geometry == pybullet.GEOM_CYLINDER:
            part["length"], part["radius"] = size[0], size[1]
        else:
            part["radius"] = size[0]
        counts[link] += 1
        parts.append(part)
    return parts


def frames(world: World, model: PhysicsBody) -> list[list[Any]]:
    """Where every frame is now: ``[child, parent, position, quaternion]``."""
    found: list[list[Any]] = []
    for name, link in model.links.items():
        place, turned = model.link_place(link)
        found.append([name, "map", list(place), list(turned)])
    for number in world.movable:
        place, turned = pybullet.getBasePositionAndOrientation(number, physicsClientId=world.client)
        found.append([world.bodies[number].name, "map", list(place), list(turned)])
    mount = model.description.laser
    found.append([mount.facts.frame, mount.link, list(mount.position), UPRIGHT])
    return found


def laser_data(laser: LaserInfo) -> dict[str, Any]:
    """The laser, before its first scan."""
    return {
        "frame": laser.frame,
        "angle_min": laser.angle_min,
        "angle_increment": laser.angle_increment,
        "range_min": laser.range_min,
        "range_max": laser.range_max,
    }


def waypoint_data(world: World) -> list[dict[str, Any]]:
    """The world's waypoints, but for the one where the robot begins, which is seen anyway."""
    named = world.scene.waypoints.items()
    return [{"name": name, "position": [x, y, 0.0]} for name, (x, y) in named if name != "start"]


def camera_data(lens: CameraInfo) -> dict[str, Any]:
    """The camera, before its first picture."""
    return {
        "name": "camera",
        "frame": lens.frame,
        "size": [lens.width, lens.height],
        "focal": [lens.fx, lens.fy],
        "center": [lens.cx, lens.cy],
    }


def scan_data(scan: LaserScan) -> dict[str, Any]:
    """One sweep."""
    return {"stamp": scan.stamp, "ranges": scan.ranges.astype("<f4", copy=False).tobytes()}


def picture_data(picture: CameraImage) -> dict[str, Any]:
    """One picture, as the camera took it."""
    height, width, _ = picture.rgb.shape
    return {
        "name": "camera",
        "stamp": picture.stamp,
        "size": [width, height],
        "format": "rgb8",
        "data": picture.rgb.tobytes(),
    }


def frame_chain(name: str, known: Sequence[TransformStamped], placed: Collection[str]) -> list[list[Any]]:
    """The frames of *known* that lead from one of those that are *placed* to *name*."""
    parents = {one.child: one for one in known}
    found: list[list[Any]] = []
    while name in parents and name not in placed:
        one = parents[name]
        found.append([one.child, one.parent, list(one.position), list(one.quaternion)])
        name = one.parent
    return found


def _thing(scene: str, thing: SceneObject) -> dict[str, Any]:
    part: dict[str, Any] = {
        "name": f"{scene}/{thing.name}",
        "frame": "map",
        "kind": thing.kind,
        "position": [thing.position[0], thing.position[1], thing.position[2] + thing.size[2] / 2],
        "quaternion": [0.0, 0.0, math.sin(thing.yaw / 2), math.cos(thing.yaw / 2)],
        "color": list(thing.color),
    }
    if not thing.still:
        part |= {"frame": thing.name, "position": [0.0, 0.0, 0.0], "quaternion": UPRIGHT}
    if thing.kind == "box":
        part["size"] = list(thing.size)
    else:
        part["radius"], part["length"] = thing.size[0] / 2, thing.size[2]
    return part
