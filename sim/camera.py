"""A robot's camera: a picture is drawn when somebody asks for it, and not otherwise."""

import math
import re
from dataclasses import dataclass

import numpy as np

from robot_nodes.robot import CameraFacts, Picture
from sim.description import CameraMount
from sim.engine import pybullet
from sim.faces import matrix
from sim.mistakes import SimError
from sim.model import Model
from sim.render import Painter
from sim.visible import Visible

_FORM = re.compile(r"(\d+)x(\d+)(?:@(\d+(?:\.\d+)?))?")


@dataclass(frozen=True, slots=True)
class PictureSize:
    """How large (pixels) and how often (Hz) pictures are."""

    width: int
    height: int
    rate: float


def parse_camera(text: str) -> PictureSize | None:
    """``off``, or ``WxH@HZ`` (10 Hz unless said); raises `SimError`."""
    if text == "off":
        return None
    found = _FORM.fullmatch(text)
    size = PictureSize(int(found[1]), int(found[2]), float(found[3] or 10.0)) if found else None
    if size is None or not (0 < size.width <= 4096 and 0 < size.height <= 4096 and size.rate > 0.0):
        raise SimError(f"camera '{text}': it is off, or WxH@HZ like 320x240@10 (at most 4096x4096)")
    return size


class Camera:
    """Draws a picture, with depth, when it is asked for one and it is time for a new one."""

    def __init__(self, visible: Visible, mount: CameraMount, size: PictureSize) -> None:
        self._visible = visible
        self._mount = mount
        focal = size.width / 2 / math.tan(mount.fov / 2)
        self.facts = CameraFacts(
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
        self._painter = Painter(self.facts)
        self.newest: Picture | None = None
        """The last picture that was drawn."""

    def picture(self, model: Model, link: int, now: int, dead: bool) -> Picture | None:
        """The newest picture; drawn now if the camera's rate allows a newer one, and it is not *dead*."""
        last = self.newest
        if not dead and (last is None or self._count(now) > self._count(last.stamp)):
            self.newest = self._draw(model, link, now)
        return self.newest

    def _count(self, now: int) -> int:
        return int(now * self.facts.rate / 1e9)

    def _draw(self, model: Model, link: int, now: int) -> Picture:
        eye, turned = self.pose(model, link)
        ahead, left, up = matrix(turned).T
        rgb, depth = self._painter.draw(
            self._visible.now(), self._visible.colors, np.array(eye), np.stack((-left, -up, ahead), axis=1)
        )
        rgb.flags.writeable = depth.flags.writeable = False
        return Picture(rgb, now, self._mount.frame, depth)

    def pose(self, model: Model, link: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Where the camera is in the world, and how it is turned (x forward, z up), as a quaternion."""
        place, turned = model.link_place(link)
        mounted = pybullet.getQuaternionFromEuler([self._mount.roll, 0.0, 0.0])
        eye, turned = pybullet.multiplyTransforms(place, turned, self._mount.position, mounted)
        return tuple(eye), tuple(turned)
