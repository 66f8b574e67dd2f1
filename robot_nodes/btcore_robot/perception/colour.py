"""Finding what has a colour in a picture, by hue, saturation and value (the book's chapter 5.2)."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.robot import CameraImage

LEAST = 1e-6
"""The least area (pixels) that is an object."""


@dataclass(frozen=True, slots=True)
class ColourRange:
    """From and to, both included: hue 0–180 (OpenCV's half degrees), saturation and value 0–255."""

    hue: tuple[int, int] = (0, 180)
    saturation: tuple[int, int] = (0, 255)
    value: tuple[int, int] = (0, 255)


WOOD = ColourRange((15, 20), (50, 200), (20, 200))
"""The book's wooden furniture (its detector.yaml)."""


@dataclass(frozen=True, slots=True)
class Detection:
    """What was found: the box (*left*, *top*, *width*, *height*) and the centre of mass *x*, *y*, in pixels.

    The picture it was found in has the size *picture* (width, height).
    """

    left: int
    top: int
    width: int
    height: int
    x: float
    y: float
    picture: tuple[int, int]
    stamp: int


def mask(picture: CameraImage, colours: ColourRange) -> NDArray[np.uint8]:
    """Which pixels are within *colours*: 255 where they are, shape ``(height, width)``."""
    hsv = cv2.cvtColor(picture.rgb, cv2.COLOR_RGB2HSV)
    low = (colours.hue[0], colours.saturation[0], colours.value[0])
    high = (colours.hue[1], colours.saturation[1], colours.value[1])
    return np.asarray(cv2.inRange(hsv, low, high), dtype=np.uint8)


def detect(picture: CameraImage, colours: ColourRange) -> Detection | None:
    """The box around all pixels within *colours*, and their centre of mass; None where there are none."""
    return _detection(mask(picture, colours), picture)


def detect_each(picture: CameraImage, colours: ColourRange, least: int = 20) -> list[Detection]:
    """One detection for every separate patch of at least *least* pixels, the largest first."""
    found = mask(picture, colours)
    count, _, figures, centres = cv2.connectedComponentsWithStats(found)
    size = (picture.rgb.shape[1], picture.rgb.shape[0])
    patches = [
        (int(figures[label, cv2.CC_STAT_AREA]), label)
        for label in range(1, count)
        if figures[label, cv2.CC_STAT_AREA] >= least
    ]
    return [
        Detection(
            int(figures[label, cv2.CC_STAT_LEFT]),
            int(figures[label, cv2.CC_STAT_TOP]),
            int(figures[label, cv2.CC_STAT_WIDTH]),
            int(figures[label, cv2.CC_STAT_HEIGHT]),
            float(centres[label][0]),
            float(centres[label][1]),
            size,
            picture.stamp,
        )
        for _, label in sorted(patches, key=lambda patch: (-patch[0], patch[1]))
    ]


def debug_image(
    picture: CameraImage, colours: ColourRange, objects: Sequence[Detection] | None = None
) -> NDArray[np.uint8]:
    """The picture with what lies outside *colours* dimmed, and *objects* drawn in; RGB.

    Without *objects* it is the box around all that has the colour.
    """
    found = mask(picture, colours)
    shown = np.where(found[:, :, None] > 0, picture.rgb, picture.rgb // 3).astype(np.uint8)
    if objects is None:
        whole = _detection(found, picture)
        objects = [] if whole is None else [whole]
    for one in objects:
        corner = (one.left, one.top)
        opposite = (one.left + one.width - 1, one.top + one.height - 1)
        cv2.rectangle(shown, corner, opposite, (255, 255, 0), 1)
        cv2.circle(shown, (round(one.x), round(one.y)), 3, (255, 0, 0), -1)
    return shown


def _detection(found: NDArray[np.uint8], picture: CameraImage) -> Detection | None:
    moments = cv2.moments(found, binaryImage=True)
    if moments["m00"] < LEAST:
        return None
    left, top, width, height = cv2.boundingRect(found)
    x, y = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
    size = (picture.rgb.shape[1], picture.rgb.shape[0])
    return Detection(left, top, width, height, x, y, size, picture.stamp)
