"""Following coloured objects with the head: the book's detector, tracker and controller (chapter 5.2)."""

from collections.abc import Callable
from dataclasses import dataclass

import btcore_scene
from btcore_robot.control.pid import PID
from btcore_robot.perception.colour import WOOD, ColourRange, Detection, detect
from btcore_robot.process.lifecycle import LifecycleComponent
from btcore_robot.robot import Phase, Robot
from btcore_scene import MovingScene, StaticScene

PATIENCE = 100_000_000
"""How old (ns) a command may be before the head goes back to the middle."""


@dataclass(frozen=True, slots=True)
class Tuning:
    """How the head is controlled: *rate* (Hz), and the three *gains* of both PIDs."""

    rate: float
    gains: tuple[float, float, float]


BOOK = Tuning(10.0, (0.4, 0.05, 0.55))
"""What the book's controller sets when it is configured."""
REACTIVE = Tuning(20.0, (0.8, 0.1, 0.55))
"""Twice as quick: the book's exercise."""


@dataclass(frozen=True, slots=True)
class PanTilt:
    """Where an object is in the picture: -1 … 1, *pan* + to the right, *tilt* + downwards."""

    pan: float
    tilt: float
    stamp: int


def command_of(detection: Detection) -> PanTilt:
    """Where the detection's centre of mass lies, relative to the picture's size."""
    width, height = detection.picture
    return PanTilt(detection.x / width * 2 - 1, detection.y / height * 2 - 1, detection.stamp)


class HeadTracker(LifecycleComponent):
    """While active, looks for *colours* in the robot's pictures and turns the head to what it finds.

    Without anything to see for 100 ms the head goes back to the middle, and so it does when deactivated. It
    asks for pictures only while it is active. A robot without a head or a camera refuses `configure`.
    """

    def __init__(self, robot: Robot, colours: ColourRange = WOOD, tuning: Tuning = BOOK) -> None:
        super().__init__()
        self.robot = robot
        self.colours = colours
        self.tuning = tuning
        self.detection: Detection | None = None
        """What was found last, for whoever draws it."""
        self.seen = 0
        """In how many pictures something was found."""
        self._command: PanTilt | None = None
        self._pan = PID(0.0, 1.0, 0.0, 0.3)
        self._tilt = PID(0.0, 1.0, 0.0, 0.3)
        self._end: Callable[[], None] | None = None
        self._looked = -1

    def on_configure(self) -> bool:
        """Set the gains."""
        if self.robot.head_info is None:
            return False
        for pid in (self._pan, self._tilt):
            pid.set_gains(*self.tuning.gains)
            pid.reset()
        return True

    def on_activate(self) -> bool:
        """Begin to look and to turn."""
        self._command = None
        self._end = self.robot.schedule.every(self.tuning.rate, Phase.HEAD, self.step)
        return True

    def on_deactivate(self) -> bool:
        """Stop looking; the head goes back to the middle."""
        if self._end is not None:
            self._end()
            self._end = None
            self.detection = None
            self.robot.move_head(0.0, 0.0)
        return True

    def step(self, now: int) -> None:
        """One period: look, then turn the head."""
        self._look()
        head = self.robot.head()
        if head is None:
            return
        command = self._command
        if command is None or now - command.stamp > PATIENCE:
            self.robot.move_head(0.0, 0.0)
            return
        # The joints' signs: + is left and up, whereas in a picture + is right and down.
        pan = head.pan - self._pan.output(command.pan)
        tilt = head.tilt - self._tilt.output(command.tilt)
        self.robot.move_head(pan, tilt)

    def scene_static(self) -> StaticScene:
        """Return an empty scene: everything moves."""
        return StaticScene()

    def scene_moving(self) -> MovingScene:
        """Return the newest detection in the camera's picture."""
        found = self.detection
        if found is None:
            return MovingScene(detections=())
        box = (found.left, found.top, found.width, found.height)
        shown = btcore_scene.Detection(picture="camera", name="object", stamp=found.stamp, box=box)
        return MovingScene(detections=[shown])

    def _look(self) -> None:
        picture = self.robot.camera()
        if picture is None or picture.stamp == self._looked:
            return
        self._looked = picture.stamp
        self.detection = detect(picture, self.colours)
        if self.detection is not None:
            self.seen += 1
            self._command = command_of(self.detection)
