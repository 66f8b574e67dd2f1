"""Detection of coloured objects in an image by hue, saturation and value.

The method is from chapter 5.2 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.components.component import Component, ComponentContext, ComponentOptions
from btcore_robot.components.parameters import ParameterError
from btcore_robot.robot import CameraImage

__all__ = [
    "WOOD",
    "ColourRange",
    "Detection",
    "Detections",
    "ObjectDetector",
    "colour_mask",
    "debug_image",
    "detect_colour",
    "detect_each",
]

MIN_PIXELS = 20
"""The minimum size (pixels) of a separate patch of a colour."""
MIN_AREA = 1e-6
"""The minimum area (pixels) of an object."""


@dataclass(frozen=True, slots=True)
class ColourRange:
    """A range of colours: the lower and upper limit, both included, of hue, saturation and value.

    The hue is 0–180 (OpenCV's unit of 2°), saturation and value are 0–255.

    Attributes:
        hue: The limits of the hue.
        saturation: The limits of the saturation.
        value: The limits of the value.
    """

    hue: tuple[int, int] = (0, 180)
    saturation: tuple[int, int] = (0, 255)
    value: tuple[int, int] = (0, 255)


WOOD = ColourRange((15, 20), (50, 200), (20, 200))
"""The colour of wooden furniture, from the book's parameter file detector.yaml."""


@dataclass(frozen=True, slots=True)
class Detection:
    """A detected object: box (*left*, *top*, *width*, *height*) and centre of mass (*x*, *y*) in pixels.

    *image_size* is the width and height (pixels) of the image, *stamp* its time (ns).
    """

    left: int
    top: int
    width: int
    height: int
    x: float
    y: float
    image_size: tuple[int, int]
    stamp: int


def colour_mask(image: CameraImage, colours: ColourRange) -> NDArray[np.uint8]:
    """Return the mask of the pixels within a range of colours.

    Args:
        image: The camera image.
        colours: The range of colours.

    Returns:
        The mask, shape `(height, width)`: 255 for pixels within the range, 0 for others.
    """
    hsv = cv2.cvtColor(image.rgb, cv2.COLOR_RGB2HSV)
    low = (colours.hue[0], colours.saturation[0], colours.value[0])
    high = (colours.hue[1], colours.saturation[1], colours.value[1])
    return np.asarray(cv2.inRange(hsv, low, high), dtype=np.uint8)


def detect_colour(image: CameraImage, colours: ColourRange) -> Detection | None:
    """Return a single detection of all pixels within a range of colours; None if there are none.

    Args:
        image: The camera image.
        colours: The range of colours.

    Returns:
        The box around the pixels and their centre of mass.
    """
    return _detection(colour_mask(image, colours), image)


def detect_each(image: CameraImage, colours: ColourRange) -> list[Detection]:
    """Return a detection for every separate patch of pixels within a range of colours, the largest first.

    Patches of less than `MIN_PIXELS` are ignored.

    Args:
        image: The camera image.
        colours: The range of colours.
    """
    mask = colour_mask(image, colours)
    count, _, stats, centres = cv2.connectedComponentsWithStats(mask)
    size = (image.rgb.shape[1], image.rgb.shape[0])
    patches = [
        (int(stats[label, cv2.CC_STAT_AREA]), label)
        for label in range(1, count)
        if stats[label, cv2.CC_STAT_AREA] >= MIN_PIXELS
    ]
    return [
        Detection(
            int(stats[label, cv2.CC_STAT_LEFT]),
            int(stats[label, cv2.CC_STAT_TOP]),
            int(stats[label, cv2.CC_STAT_WIDTH]),
            int(stats[label, cv2.CC_STAT_HEIGHT]),
            float(centres[label][0]),
            float(centres[label][1]),
            size,
            image.stamp,
        )
        for _, label in sorted(patches, key=lambda patch: (-patch[0], patch[1]))
    ]


def debug_image(
    image: CameraImage, colours: ColourRange, objects: Sequence[Detection] | None = None
) -> NDArray[np.uint8]:
    """Return the image (RGB) with pixels outside *colours* dimmed and *objects* marked.

    Args:
        image: The camera image.
        colours: The range of colours that stays bright.
        objects: The detections to mark; by default the box around all pixels of the colour.
    """
    mask = colour_mask(image, colours)
    shown = np.where(mask[:, :, None] > 0, image.rgb, image.rgb // 3).astype(np.uint8)
    if objects is None:
        detection = _detection(mask, image)
        objects = [] if detection is None else [detection]
    for detected in objects:
        corner = (detected.left, detected.top)
        opposite = (detected.left + detected.width - 1, detected.top + detected.height - 1)
        cv2.rectangle(shown, corner, opposite, (255, 255, 0), 1)
        cv2.circle(shown, (round(detected.x), round(detected.y)), 3, (255, 0, 0), -1)
    return shown


def _detection(mask: NDArray[np.uint8], image: CameraImage) -> Detection | None:
    moments = cv2.moments(mask, binaryImage=True)
    if moments["m00"] < MIN_AREA:
        return None
    left, top, width, height = cv2.boundingRect(mask)
    x, y = moments["m10"] / moments["m00"], moments["m01"] / moments["m00"]
    size = (image.rgb.shape[1], image.rgb.shape[0])
    return Detection(left, top, width, height, x, y, size, image.stamp)


@dataclass(frozen=True, slots=True)
class Detections:
    """The objects detected in an image, the largest first.

    Attributes:
        objects: The detected objects.
    """

    objects: tuple[Detection, ...]


class ObjectDetector(Component):
    """Detect objects by colour in the images on `input_image` and publish them on `detection`.

    The parameter `hsv_ranges` contains the lower and upper limits of hue (0–180), saturation and value
    (0–255). With the parameter `each` every patch is a separate object; without it all pixels of the colour
    are a single object. The component works only while `detection` has subscribers.
    """

    def __init__(self, context: ComponentContext, options: ComponentOptions | None = None) -> None:
        super().__init__("object_detector", context, options)
        ranges = self.parameters.declare("hsv_ranges", [0, 180, 0, 255, 0, 255])
        if len(ranges) != 6:
            raise ParameterError(f"{self.name}: hsv_ranges has 6 numbers, h H s S v V, not {len(ranges)}")
        h, hh, s, ss, v, vv = ranges
        self.colours = ColourRange((h, hh), (s, ss), (v, vv))
        self.each = self.parameters.declare("each", False)
        self.detections = self.create_publisher("detection", Detections)
        self.create_subscription("input_image", CameraImage, self.on_image)

    def on_image(self, image: CameraImage) -> None:
        """Detect the objects in *image* and publish them."""
        if not self.detections.has_subscribers:
            return
        if self.each:
            detections = detect_each(image, self.colours)
        else:
            detection = detect_colour(image, self.colours)
            detections = [] if detection is None else [detection]
        if detections:
            self.detections.publish(Detections(tuple(detections)))
