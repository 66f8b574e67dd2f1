"""Watching the head tracker: it is configured and activated, and seen at work through its own camera."""

from collections.abc import Mapping

import click
import numpy as np
from numpy.typing import NDArray

from btcore_robot.book.colour_watcher import camera_scene
from btcore_robot.control.head_tracker import BOOK_TUNING, REACTIVE, HeadTracker, command_from_detection
from btcore_robot.perception.colour import debug_image
from btcore_robot.process.process import Process, ProcessContext
from btcore_scene import MovingScene, StaticScene

PERIOD = 1.0
"""How often (s) it says where the head looks."""


class HeadWatcher(Process):
    """Keeps a head tracker active, turns the base at *turn* (rad/s), and says where the head looks."""

    def __init__(self, context: ProcessContext, turn: float, reactive: bool) -> None:
        super().__init__("head_watcher", context)
        assert context.robot is not None
        self.robot = context.robot
        self.turn = turn
        self.tracker = HeadTracker(self.robot, tuning=REACTIVE if reactive else BOOK_TUNING)
        if self.robot.camera_info is None or not (self.tracker.configure() and self.tracker.activate()):
            raise click.UsageError("this robot has no head with a camera to track with, or the camera is off")
        if turn:
            self.create_timer(0.1, self.drive)
        self.create_timer(PERIOD, self.tell)

    def drive(self) -> None:
        """Turn the base."""
        self.robot.drive(0.0, self.turn)

    def tell(self) -> None:
        """Say where the head looks, and where the object is in its picture."""
        head, seen = self.robot.head(), self.tracker.detection
        if head is None:
            return
        where = f"pan {head.pan:+.3f} rad, tilt {head.tilt:+.3f} rad"
        if seen is None:
            self.info(f"{where}; nothing is in sight")
        else:
            command = command_from_detection(seen)
            self.info(f"{where}; the object is off by {command.pan:+.2f}, {command.tilt:+.2f}")

    def scene_moving(self) -> MovingScene:
        """Return the picture of the head's camera, and the detected object in it."""
        found = self.tracker.detection
        return camera_scene(self.robot, [] if found is None else [found])

    def scene_static(self) -> StaticScene:
        """Return an empty scene: everything moves."""
        return StaticScene()

    def figures(self) -> Mapping[str, object]:
        """In how many pictures an object was, and where the head looks (rad)."""
        head = self.robot.head()
        assert head is not None
        return {
            "pictures_with_object": self.tracker.detection_count,
            "head": {"pan": round(head.pan, 4), "tilt": round(head.tilt, 4)},
        }

    def picture(self) -> NDArray[np.uint8]:
        """What the head's camera sees, with the object boxed."""
        picture = self.robot.camera()
        if picture is None:
            raise click.UsageError("there is no picture to draw on")
        return debug_image(picture, self.tracker.colours)
