"""Reports of the head tracker: the position of the head, and the image of its camera."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from btcore_robot.book.colour_watcher import camera_scene
from btcore_robot.components.component import Component, ComponentContext
from btcore_robot.control.head_tracker import BOOK_TUNING, REACTIVE, HeadTracker, command_from_detection
from btcore_robot.errors import RobotError
from btcore_robot.perception.colour import debug_image
from btcore_scene import MovingScene, SceneSource

PERIOD_S = 1.0
"""The period (s) of the reports."""


class HeadWatcher(Component, SceneSource):
    """A component that runs a head tracker, turns the base at *turn* (rad/s), and logs the head's position.

    *reactive* selects the tuning `REACTIVE` of the tracker.

    Raises:
        RobotError: The robot has no head with a camera, or the camera is off.
    """

    def __init__(self, context: ComponentContext, turn: float, reactive: bool) -> None:
        super().__init__("head_watcher", context)
        assert context.robot is not None
        self.robot = context.robot
        self.turn = turn
        self.tracker = HeadTracker(self.robot, tuning=REACTIVE if reactive else BOOK_TUNING)
        if self.robot.camera_info is None or not (self.tracker.configure() and self.tracker.activate()):
            raise RobotError("this robot has no head with a camera to track with, or the camera is off")
        if turn:
            self.create_timer(0.1, self.drive)
        self.create_timer(PERIOD_S, self.report)

    def drive(self) -> None:
        """Command the base to turn."""
        self.robot.drive(0.0, self.turn)

    def report(self) -> None:
        """Log the position of the head and of the object in the image."""
        head, detection = self.robot.head(), self.tracker.detection
        if head is None:
            return
        position = f"pan {head.pan:+.3f} rad, tilt {head.tilt:+.3f} rad"
        if detection is None:
            self.info(f"{position}; nothing is in sight")
        else:
            command = command_from_detection(detection)
            self.info(f"{position}; the object is off by {command.pan:+.2f}, {command.tilt:+.2f}")

    def moving_scene(self) -> MovingScene:
        """Return the image of the head's camera, and the detected object in it."""
        detection = self.tracker.detection
        return camera_scene(self.robot, [] if detection is None else [detection])

    def results(self) -> Mapping[str, object]:
        """Return the number of images with a detection, and the position of the head (rad)."""
        head = self.robot.head()
        assert head is not None
        return {
            "pictures_with_object": self.tracker.detection_count,
            "head": {"pan": round(head.pan, 4), "tilt": round(head.tilt, 4)},
        }

    def draw(self) -> NDArray[np.uint8]:
        """Return the image (RGB) of the head's camera with the object marked.

        Raises:
            RobotError: There is no camera image.
        """
        image = self.robot.camera()
        if image is None:
            raise RobotError("there is no camera image to draw on")
        return debug_image(image, self.tracker.colours)
