"""Watching the colour detection: what was found, in words and in a picture."""

from collections.abc import Mapping, Sequence

import click
import numpy as np
from numpy.typing import NDArray

import btcore_scene
from btcore_robot.perception.colour import ColourRange, Detection, debug_image, detect_each
from btcore_robot.perception.object_detector import Detections
from btcore_robot.process.process import Process, ProcessContext
from btcore_robot.robot import Robot
from btcore_scene import MovingScene, Picture, StaticScene

CAMERA = "head_front_camera"
"""What the picture is called for a viewer."""
PERIOD = 1.0
"""How often (s) it says what it sees."""


class ColourWatcher(Process):
    """Listens to ``detection``, and says each second what is there. *ranges*: what it looks for."""

    def __init__(self, context: ProcessContext, ranges: list[int], each: bool) -> None:
        super().__init__("colour_watcher", context)
        if context.robot is None or context.robot.camera_info is None:
            raise click.UsageError("there are no pictures to look at: the robot has no camera, or it is off")
        h, hh, s, ss, v, vv = ranges
        self.colours = ColourRange((h, hh), (s, ss), (v, vv))
        self.each = each
        self.found = 0
        self.last: Detections | None = None
        self.create_subscription("detection", Detections, self.heard)
        self.create_timer(PERIOD, self.tell)

    def heard(self, message: Detections) -> None:
        """Keep what was found."""
        self.found += 1
        self.last = message

    def tell(self) -> None:
        """Say what there is."""
        if self.last is None:
            self.info("Nothing of that colour is in sight")
            return
        for one in self.last.objects:
            centre = f"({one.x:.1f}, {one.y:.1f})"
            self.info(f"{one.width}x{one.height} pixels at ({one.left}, {one.top}), centre {centre}")
        self.last = None

    def scene_moving(self) -> MovingScene:
        """Return the camera's picture and the detections in it."""
        assert self.context.robot is not None
        return camera_scene(self.context.robot, self.last.objects if self.last is not None else ())

    def scene_static(self) -> StaticScene:
        """Return an empty scene: everything moves."""
        return StaticScene()

    def figures(self) -> Mapping[str, object]:
        """In how many pictures something was found."""
        return {"pictures_with_colour": self.found}

    def picture(self) -> NDArray[np.uint8]:
        """The camera's picture with the rest dimmed, and what was found boxed."""
        robot = self.context.robot
        picture = robot.camera() if robot is not None else None
        if picture is None:
            raise click.UsageError("there is no picture to draw on: the robot has no camera, or it is off")
        found = detect_each(picture, self.colours) if self.each else None
        return debug_image(picture, self.colours, found)


def camera_scene(robot: Robot, objects: Sequence[Detection]) -> MovingScene:
    """Return the newest picture of *robot*, and *objects* as the detections in it."""
    picture = robot.camera()
    if picture is None:
        return MovingScene()
    height, width = picture.rgb.shape[:2]
    data = picture.rgb.tobytes()
    return MovingScene(
        pictures=[Picture(name=CAMERA, stamp=picture.stamp, size=(width, height), format="rgb8", data=data)],
        detections=[
            btcore_scene.Detection(
                picture=CAMERA, name="object", box=(one.left, one.top, one.width, one.height)
            )
            for one in objects
        ],
    )


def ranges_of(text: str) -> list[int]:
    """The six numbers of ``h,H,s,S,v,V``. Raises click.BadParameter."""
    parts = text.split(",")
    try:
        numbers = [int(part) for part in parts]
    except ValueError:
        numbers = []
    most = (180, 180, 255, 255, 255, 255)
    if len(numbers) != 6 or any(not 0 <= one <= top for one, top in zip(numbers, most, strict=True)):
        raise click.BadParameter(
            f"'{text}' is no colour range: write six whole numbers, such as 15,20,50,200,20,200",
            param_hint="--hsv",
        )
    return numbers
