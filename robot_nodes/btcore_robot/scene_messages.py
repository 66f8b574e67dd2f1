"""Conversion of a robot's readings to messages of `btcore_scene`."""

from btcore_robot.robot import CameraImage, CameraInfo, LaserInfo, LaserScan
from btcore_scene import Camera, Laser, Picture, Scan

_CAMERA = "camera"
"""Name of the robot's camera, and of its pictures."""


def laser_message(laser: LaserInfo) -> Laser:
    """Return the frame, angles and range limits of *laser* as a message."""
    return Laser(
        frame=laser.frame,
        angle_min=laser.angle_min,
        angle_increment=laser.angle_increment,
        range_min=laser.range_min,
        range_max=laser.range_max,
    )


def camera_message(lens: CameraInfo) -> Camera:
    """Return the frame, picture size and focal lengths of a camera as a message."""
    return Camera(
        name=_CAMERA,
        frame=lens.frame,
        size=(lens.width, lens.height),
        focal=(lens.fx, lens.fy),
        center=(lens.cx, lens.cy),
    )


def scan_message(scan: LaserScan) -> Scan:
    """Return *scan* as a message."""
    return Scan(stamp=scan.stamp, ranges=scan.ranges.astype("<f4", copy=False).tobytes())


def picture_message(picture: CameraImage) -> Picture:
    """Return *picture* as a message."""
    height, width, _ = picture.rgb.shape
    data = picture.rgb.tobytes()
    return Picture(name=_CAMERA, stamp=picture.stamp, size=(width, height), format="rgb8", data=data)
