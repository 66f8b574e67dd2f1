"""A robot's camera: a picture is drawn when somebody asks for it, and not otherwise."""

import math
import re
from dataclasses import dataclass

import numpy as np

from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import CameraImage, CameraInfo
from btcore_sim.errors import SimError
from btcore_sim.physics_body import PhysicsBody, Pose3D
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.render_scene import RenderScene
from btcore_sim.renderer import Renderer
from btcore_sim.robot_description import CameraMount

_FORM = re.compile(r"(\d+)x(\d+)(?:@(\d+(?:\.\d+)?))?")


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """How large (pixels) and how often (Hz) pictures are."""

    width: int
    height: int
    rate: float


def parse_camera(text: str) -> CameraSettings | None:
    """``off``, or ``WxH@HZ`` (10 Hz unless said); raises `SimError`."""
    if text == "off":
        return None
    found = _FORM.fullmatch(text)
    size = CameraSettings(int(found[1]), int(found[2]), float(found[3] or 10.0)) if found else None
    if size is None or not (0 < size.width <= 4096 and 0 < size.height <= 4096 and size.rate > 0.0):
        raise SimError(f"camera '{text}': it is off, or WxH@HZ like 320x240@10 (at most 4096x4096)")
    return size


class Camera:
    """Draws a picture, with depth, when it is asked for one and it is time for a new one."""

    def __init__(self, visible: RenderScene, mount: CameraMount, size: CameraSettings) -> None:
        self._visible = visible
        self._mount = mount
        focal = size.width / 2 / math.tan(mount.fov / 2)
        self.facts = CameraInfo(
            width=size.width,
            height=size.height,
            fx=focal,
            fy=focal,
            cx=(size.width - 1) / 2,
            cy=(size.height - 1) / 2,
            near=mount.near,
            far=mount.far,
            rate=size.rate,
            frame=mount.frame,
        )
        """The pinhole. Columns and rows count from 0, and a whole number is the middle of a pixel."""
        self._painter = Renderer(self.facts)
        self.newest: CameraImage | None = None
        """The last picture that was drawn."""

    def picture(self, model: PhysicsBody, link: int, now: int, dead: bool) -> CameraImage | None:
        """The newest picture; drawn now if the camera's rate allows a newer one, and it is not *dead*."""
        last = self.newest
        if not dead and (last is None or self._count(now) > self._count(last.stamp)):
            self.newest = self._draw(model, link, now)
        return self.newest

    def _count(self, now: int) -> int:
        return int(now * self.facts.rate / 1e9)

    def _draw(self, model: PhysicsBody, link: int, now: int) -> CameraImage:
        eye, turned = self.pose(model, link)
        ahead, left, up = Transform(quaternion=turned).rotation.T
        rgb, depth = self._painter.draw(
            self._visible.now(), self._visible.colors, np.array(eye), np.stack((-left, -up, ahead), axis=1)
        )
        rgb.flags.writeable = depth.flags.writeable = False
        return CameraImage(rgb, now, self._mount.frame, depth)

    def pose(self, model: PhysicsBody, link: int) -> Pose3D:
        """Where the camera is in the world, and how it is turned (x forward, z up), as a quaternion."""
        place, turned = model.link_place(link)
        mounted = pybullet.getQuaternionFromEuler([self._mount.roll, 0.0, 0.0])
        eye, turned = pybullet.multiplyTransforms(place, turned, self._mount.position, mounted)
        return eye, turned
