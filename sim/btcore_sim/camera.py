"""A robot's camera. Pictures are rendered on request only, because rendering is slow."""

import math
import re
from dataclasses import dataclass

import numpy as np

from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import CameraImage, CameraInfo
from btcore_sim.errors import SimError
from btcore_sim.latency import DelayedReadings
from btcore_sim.physics_body import PhysicsBody, Pose3D
from btcore_sim.quiet_pybullet import pybullet
from btcore_sim.renderer import Renderer
from btcore_sim.robot_description import CameraMount
from btcore_sim.visible_faces import VisibleFaces

__all__ = ["CameraSettings", "parse_camera"]

_FORM = re.compile(r"(\d+)x(\d+)(?:@(\d+(?:\.\d+)?))?")


@dataclass(frozen=True, slots=True)
class CameraSettings:
    """The size (pixels) and the rate (Hz) of a camera's pictures.

    Attributes:
        width: The width of a picture.
        height: The height of a picture.
        rate: The number of pictures per second.
    """

    width: int
    height: int
    rate: float


def parse_camera(text: str) -> CameraSettings | None:
    """Parse the option `--camera`.

    Args:
        text: `off`, `WxH` (10 Hz) or `WxH@HZ`.

    Returns:
        The settings, or None for `off`.

    Raises:
        SimError: *text* has another form, or a size above 4096 pixels.
    """
    if text == "off":
        return None
    match = _FORM.fullmatch(text)
    size = CameraSettings(int(match[1]), int(match[2]), float(match[3] or 10.0)) if match else None
    if size is None or not (0 < size.width <= 4096 and 0 < size.height <= 4096 and size.rate > 0.0):
        raise SimError(f"invalid camera '{text}': use off, or WxH@HZ like 320x240@10 (at most 4096x4096)")
    return size


class Camera:
    """A pinhole camera with depth. It renders pictures on request, at most as often as its rate allows."""

    def __init__(self, visible: VisibleFaces, mount: CameraMount, size: CameraSettings) -> None:
        self._visible = visible
        self._mount = mount
        focal = size.width / 2 / math.tan(mount.fov / 2)
        self.info = CameraInfo(
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
        """The pinhole model. Columns and rows count from 0; integer coordinates are the middles of pixels."""
        self._renderer = Renderer(self.info)
        self.newest: CameraImage | None = None
        """The picture that was rendered last."""
        self._arrived = DelayedReadings[CameraImage](mount.latency)

    def picture(self, physics_body: PhysicsBody, link: int, now: int, has_failed: bool) -> CameraImage | None:
        """Return the newest picture that has arrived; render a picture first if the camera's rate allows it.

        Args:
            physics_body: The robot's body in the physics engine.
            link: PyBullet's index of the link that carries the camera.
            now: The simulated time (ns).
            has_failed: Whether the camera has failed; then no new picture is rendered.

        Returns:
            The picture, or None if no picture has arrived yet.
        """
        last = self.newest
        if not has_failed and (last is None or self._count(now) > self._count(last.stamp)):
            self.newest = self._draw(physics_body, link, now)
            self._arrived.add(self.newest, now)
        return self._arrived.newest(now)

    def _count(self, now: int) -> int:
        # The index of the frame period that contains *now* (ns). Each period has at most one picture.
        return int(now * self.info.rate / 1e9)

    def _draw(self, physics_body: PhysicsBody, link: int, now: int) -> CameraImage:
        eye, turned = self.pose(physics_body, link)
        ahead, left, up = Transform(quaternion=turned).rotation.T
        rgb, depth = self._renderer.draw(
            self._visible.now(), self._visible.colors, np.array(eye), np.stack((-left, -up, ahead), axis=1)
        )
        rgb.flags.writeable = depth.flags.writeable = False
        return CameraImage(rgb, now, self._mount.frame, depth)

    def pose(self, physics_body: PhysicsBody, link: int) -> Pose3D:
        """Return the camera's pose in the world frame.

        Args:
            physics_body: The robot's body in the physics engine.
            link: PyBullet's index of the link that carries the camera.

        Returns:
            The position (m) and the orientation (quaternion; x forward, z up).
        """
        place, turned = physics_body.link_pose(link)
        mounted = pybullet.getQuaternionFromEuler([self._mount.roll, 0.0, 0.0])
        eye, turned = pybullet.multiplyTransforms(place, turned, self._mount.position, mounted)
        return eye, turned
