"""Compress the pictures of a scene as JPEG, if OpenCV is installed in the robot's process."""

import importlib
from dataclasses import replace
from typing import Final

from btcore_scene import MovingScene, Picture

QUALITY: Final = 80
"""OpenCV's JPEG quality, 0–100."""


def with_jpeg(scene: MovingScene) -> MovingScene:
    """Return *scene* with its rgb8 pictures as JPEG, or unchanged if OpenCV is missing or fails."""
    pictures = [_jpeg(picture) for picture in scene.pictures]
    return replace(scene, pictures=pictures) if pictures else scene


def _jpeg(picture: Picture) -> Picture:
    if picture.format != "rgb8":
        return picture
    try:
        cv2, numpy = importlib.import_module("cv2"), importlib.import_module("numpy")
    except ImportError:
        return picture
    width, height = picture.size
    pixels = numpy.frombuffer(picture.data, numpy.uint8).reshape(height, width, 3)
    # OpenCV expects the channels in the order blue, green, red.
    done, data = cv2.imencode(".jpg", pixels[:, :, ::-1], (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
    return replace(picture, format="jpeg", data=data.tobytes()) if done else picture
