"""A robot's camera: a picture is drawn when somebody asks for it, and not otherwise."""

import math
import re
from dataclasses import dataclass

import numpy as np

from robot_nodes.robot import Picture
from sim.description import CameraMount
from sim.engine import pybullet
from sim.mistakes import SimError
from sim.model import Model

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
    """Draws with the engine's software renderer, without shadows: 320x240 takes some 40 ms."""

    def __init__(self, client: int, mount: CameraMount, size: PictureSize) -> None:
        self._client = client
        self._mount = mount
        self._size = size
        up_and_down = 2 * math.atan(math.tan(mount.fov / 2) * size.height / size.width)
        self._projection = pybullet.computeProjectionMatrixFOV(
            math.degrees(up_and_down), size.width / size.height, mount.near, mount.far
        )
        self._picture: Picture | None = None

    def picture(self, model: Model, link: int, now: int, dead: bool) -> Picture | None:
        """The newest picture; drawn now if the camera's rate allows a newer one, and it is not *dead*."""
        last = self._picture
        if not dead and (last is None or self._count(now) > self._count(last.stamp)):
            self._picture = self._draw(model, link, now)
        return self._picture

    def _count(self, now: int) -> int:
        return int(now * self._size.rate / 1e9)

    def _draw(self, model: Model, link: int, now: int) -> Picture:
        eye, turned = self.pose(model, link)
        axes = np.array(pybullet.getMatrixFromQuaternion(turned)).reshape(3, 3)
        ahead, up = axes[:, 0], axes[:, 2]
        view = pybullet.computeViewMatrix(list(eye), (np.array(eye) + ahead).tolist(), up.tolist())
        image = pybullet.getCameraImage(
            self._size.width,
            self._size.height,
            view,
            self._projection,
            shadow=0,
            flags=pybullet.ER_NO_SEGMENTATION_MASK,
            renderer=pybullet.ER_TINY_RENDERER,
            physicsClientId=self._client,
        )
        pixels = np.asarray(image[2], dtype=np.uint8).reshape(self._size.height, self._size.width, 4)
        return Picture(np.ascontiguousarray(pixels[:, :, :3]), now, self._mount.frame)

    def pose(self, model: Model, link: int) -> tuple[tuple[float, ...], tuple[float, ...]]:
        """Where the camera is in the world, and how it is turned (x forward, z up), as a quaternion."""
        place, turned = model.link_place(link)
        mounted = pybullet.getQuaternionFromEuler([self._mount.roll, 0.0, 0.0])
        eye, turned = pybullet.multiplyTransforms(place, turned, self._mount.position, mounted)
        return tuple(eye), tuple(turned)
