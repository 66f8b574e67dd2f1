"""Pictures of a scene as JPEG, where the robot's process can do that."""

import importlib
from dataclasses import replace
from typing import Final

from btcore_scene import MovingScene, Picture

QUALITY: Final = 80


def with_jpeg(scene: MovingScene) -> MovingScene:
    """Return *scene* with its rgb8 pictures as JPEG; unchanged where OpenCV isn't installed or can't."""
    return replace(scene, pictures=[_jpeg(one) for one in scene.pictures]) if scene.pictures else scene


def _jpeg(picture: Picture) -> Picture:
    if picture.format != "rgb8":
        return picture
    try:
        cv2, numpy = importlib.import_module("cv2"), importlib.import_module("numpy")
    except ImportError:
        return picture
    width, height = picture.size
    pixels = numpy.frombuffer(picture.data, numpy.uint8).reshape(height, width, 3)
    done, data = cv2.imencode(".jpg", pixels[:, :, ::-1], (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
    return replace(picture, format="jpeg", data=data.tobytes()) if done else picture
