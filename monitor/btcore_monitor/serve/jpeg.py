"""Pictures of a scene as JPEG, where the robot's process can do that."""

import importlib
from typing import Any, Final

QUALITY: Final = 80


def with_jpeg(scene: dict[str, Any]) -> dict[str, Any]:
    """*scene* with its rgb8 pictures as JPEG; as it is where OpenCV isn't installed or can't."""
    pictures = scene.get("pictures")
    return scene if not pictures else {**scene, "pictures": [_jpeg(one) for one in pictures]}


def _jpeg(picture: dict[str, Any]) -> dict[str, Any]:
    if picture["format"] != "rgb8":
        return picture
    try:
        cv2, numpy = importlib.import_module("cv2"), importlib.import_module("numpy")
    except ImportError:
        return picture
    width, height = picture["size"]
    pixels = numpy.frombuffer(picture["data"], numpy.uint8).reshape(height, width, 3)
    done, data = cv2.imencode(".jpg", pixels[:, :, ::-1], (cv2.IMWRITE_JPEG_QUALITY, QUALITY))
    return {**picture, "format": "jpeg", "data": data.tobytes()} if done else picture
