"""Reports of the detected coloured objects, in the log and as a picture."""

from collections.abc import Mapping, Sequence

import click
import numpy as np
from numpy.typing import NDArray

import btcore_scene
from btcore_robot.components.component import Component, ComponentContext
from btcore_robot.errors import RobotError
from btcore_robot.perception.colour import ColourRange, Detection, Detections, debug_image, detect_each
from btcore_robot.robot import Robot
from btcore_scene import MovingScene, Picture, SceneSource

CAMERA = "head_front_camera"
"""The name of the camera image in the scene."""
PERIOD_S = 1.0
"""The period (s) of the reports."""


class ColourWatcher(Component, SceneSource):
    """A component that logs, once a second, the last objects published on the topic `detection`.

    Args:
        context: The resources that components share.
        ranges: The lower and upper limits of hue, saturation and value, as `parse_hsv_ranges` returns them.
        each: Whether every object is marked separately in the picture.

    Raises:
        RobotError: The robot has no camera, or the camera is off.
    """

    def __init__(self, context: ComponentContext, ranges: list[int], each: bool) -> None:
        super().__init__("colour_watcher", context)
        if context.robot is None or context.robot.camera_info is None:
            raise RobotError("there are no camera images: the robot has no camera, or it is off")
        h, hh, s, ss, v, vv = ranges
        self.colours = ColourRange((h, hh), (s, ss), (v, vv))
        self.each = each
        self.detection_count = 0
        self.last: Detections | None = None
        self.create_subscription("detection", Detections, self.on_detection)
        self.create_timer(PERIOD_S, self.report)

    def on_detection(self, message: Detections) -> None:
        """Store the detections for the next report."""
        self.detection_count += 1
        self.last = message

    def report(self) -> None:
        """Log the position and size of each object."""
        if self.last is None:
            self.info("Nothing of that colour is in sight")
            return
        for detected in self.last.objects:
            centre = f"({detected.x:.1f}, {detected.y:.1f})"
            corner = f"({detected.left}, {detected.top})"
            self.info(f"{detected.width}x{detected.height} pixels at {corner}, centre {centre}")
        self.last = None

    def moving_scene(self) -> MovingScene:
        """Return the camera image and the detections in it."""
        assert self.context.robot is not None
        return camera_scene(self.context.robot, self.last.objects if self.last is not None else ())

    def results(self) -> Mapping[str, object]:
        """Return the number of images with a detection."""
        return {"pictures_with_colour": self.detection_count}

    def draw(self) -> NDArray[np.uint8]:
        """Return the camera image (RGB) with other colours dimmed and detections marked.

        Raises:
            RobotError: There is no camera image.
        """
        robot = self.context.robot
        image = robot.camera() if robot is not None else None
        if image is None:
            raise RobotError("there is no camera image: the robot has no camera, or it is off")
        objects = detect_each(image, self.colours) if self.each else None
        return debug_image(image, self.colours, objects)


def camera_scene(robot: Robot, objects: Sequence[Detection]) -> MovingScene:
    """Return the newest camera image of *robot*, and *objects* as the detections in it."""
    image = robot.camera()
    if image is None:
        return MovingScene()
    height, width = image.rgb.shape[:2]
    data = image.rgb.tobytes()
    return MovingScene(
        pictures=[Picture(name=CAMERA, stamp=image.stamp, size=(width, height), format="rgb8", data=data)],
        detections=[
            btcore_scene.Detection(
                picture=CAMERA, name="object", box=(item.left, item.top, item.width, item.height)
            )
            for item in objects
        ],
    )


def parse_hsv_ranges(text: str) -> list[int]:
    """Return the six numbers of `h,H,s,S,v,V`: the limits of hue, saturation and value.

    Raises:
        click.BadParameter: *text* does not consist of six whole numbers in the valid ranges.
    """
    parts = text.split(",")
    try:
        numbers = [int(part) for part in parts]
    except ValueError:
        numbers = []
    limits = (180, 180, 255, 255, 255, 255)
    if len(numbers) != 6 or any(not 0 <= n <= limit for n, limit in zip(numbers, limits, strict=True)):
        raise click.BadParameter(
            f"'{text}' is not a colour range: write six whole numbers, such as 15,20,50,200,20,200",
            param_hint="--hsv",
        )
    return numbers
