"""Tracking of coloured objects with the head: object detector, tracker and head controller.

They are from chapter 5.2 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import btcore_scene
from btcore_robot.components.lifecycle import Lifecycle
from btcore_robot.perception.colour import WOOD, ColourRange, Detection, detect_colour
from btcore_robot.robot import Phase, Robot
from btcore_scene import MovingScene, SceneSource

__all__ = [
    "BOOK_TUNING",
    "PID",
    "REACTIVE",
    "HeadTracker",
    "PanTiltCommand",
    "TrackerTuning",
    "command_from_detection",
]

COMMAND_TIMEOUT_NS = 100_000_000
"""The maximum age (ns) of a command. After an older command the head returns to its centre position."""


class PID:
    """A PID controller that computes a command from an error.

    The size of the error is first scaled. Below *min_error* the scaled size is 0, and above *max_error* it is
    *max_output*. In between it is `min_output + size * (max_output - min_output)`. The gains apply to the
    scaled error, which keeps its sign. Each call multiplies the integral by 2/3. The default gains are from
    the book's class.

    Args:
        min_error: The size of an error below which it counts as 0.
        max_error: The size of an error above which it counts as *max_output*.
        min_output: The scaled size of the smallest error that counts, if *min_error* is 0.
        max_output: The maximum size of the scaled error and of the command.
    """

    def __init__(self, min_error: float, max_error: float, min_output: float, max_output: float) -> None:
        self.min_error = min_error
        self.max_error = max_error
        self.min_output = min_output
        self.max_output = max_output
        self.set_gains(0.41, 0.06, 0.53)
        self.reset()

    def set_gains(self, proportional: float, integral: float, derivative: float) -> None:
        """Set the gains of the controller.

        Args:
            proportional: The gain of the scaled error.
            integral: The gain of the decaying sum of the scaled errors.
            derivative: The gain of the change of the scaled error since the last call of `output`.
        """
        self._kp, self._ki, self._kd = proportional, integral, derivative

    def reset(self) -> None:
        """Forget previous errors."""
        self._integral = 0.0
        self._previous = 0.0

    def output(self, error: float) -> float:
        """Return the command for *error*, taking previous errors into account."""
        size = abs(error)
        if size < self.min_error:
            scaled = 0.0
        elif size > self.max_error:
            scaled = math.copysign(self.max_output, error)
        else:
            scaled = math.copysign(self.min_output, error) + error * (self.max_output - self.min_output)
        # The integral decays, so that old errors lose their effect.
        self._integral = (self._integral + scaled) * 2.0 / 3.0
        derivative = scaled - self._previous
        self._previous = scaled
        command = self._kp * scaled + self._ki * self._integral + self._kd * derivative
        return min(max(command, -self.max_output), self.max_output)


@dataclass(frozen=True, slots=True)
class TrackerTuning:
    """Parameters of the head control: *rate* (Hz) and *gains* (proportional, integral, derivative)."""

    rate: float
    gains: tuple[float, float, float]


BOOK_TUNING = TrackerTuning(10.0, (0.4, 0.05, 0.55))
"""The values of the book's controller."""
REACTIVE = TrackerTuning(20.0, (0.8, 0.1, 0.55))
"""The values for an exercise of the book: twice the rate, twice the proportional and integral gains."""


@dataclass(frozen=True, slots=True)
class PanTiltCommand:
    """An object's position in the image, from -1 to 1: *pan* positive to the right, *tilt* downwards.

    *stamp* is the time (ns) of the image.
    """

    pan: float
    tilt: float
    stamp: int


def command_from_detection(detection: Detection) -> PanTiltCommand:
    """Return the position of the detection's centre of mass relative to the image: -1 and 1 are its edges."""
    width, height = detection.image_size
    return PanTiltCommand(detection.x / width * 2 - 1, detection.y / height * 2 - 1, detection.stamp)


class HeadTracker(Lifecycle, SceneSource):
    """While active, detect objects within *colours* in the camera's images and turn the head towards them.

    The head returns to its centre position when the last detection is older than 100 ms, and when the tracker
    is deactivated. Images are requested only while the tracker is active. `configure` returns False for a
    robot without a head.

    Attributes:
        robot: The robot.
        colours: The colours of the objects.
        tuning: The tuning of the tracker.
    """

    def __init__(
        self, robot: Robot, colours: ColourRange = WOOD, tuning: TrackerTuning = BOOK_TUNING
    ) -> None:
        super().__init__()
        self.robot = robot
        self.colours = colours
        self.tuning = tuning
        self.detection: Detection | None = None
        """The last detection, for visualisation; None if the last image shows no object."""
        self.detection_count = 0
        """The number of images with a detection."""
        self._command: PanTiltCommand | None = None
        self._pan = PID(0.0, 1.0, 0.0, 0.3)
        self._tilt = PID(0.0, 1.0, 0.0, 0.3)
        self._stop_steps: Callable[[], None] | None = None
        self._last_stamp = -1

    def on_configure(self) -> bool:
        """Set the gains; return False if the robot has no head."""
        if self.robot.head_info is None:
            return False
        for pid in (self._pan, self._tilt):
            pid.set_gains(*self.tuning.gains)
            pid.reset()
        return True

    def on_activate(self) -> bool:
        """Start to call `step` at the rate of the tuning."""
        self._command = None
        self._stop_steps = self.robot.schedule.add_task(self.tuning.rate, Phase.HEAD, self.step)
        return True

    def on_deactivate(self) -> bool:
        """Stop the periodic steps and return the head to its centre position."""
        if self._stop_steps is not None:
            self._stop_steps()
            self._stop_steps = None
            self.detection = None
            self.robot.move_head(0.0, 0.0)
        return True

    def step(self, now: int) -> None:
        """Detect objects in a new image, then command the head. *now* is the time (ns)."""
        self._detect()
        head = self.robot.head()
        if head is None:
            return
        command = self._command
        if command is None or now - command.stamp > COMMAND_TIMEOUT_NS:
            self.robot.move_head(0.0, 0.0)
            return
        # Joint angles are positive to the left and upwards; image coordinates to the right and downwards.
        pan = head.pan - self._pan.output(command.pan)
        tilt = head.tilt - self._tilt.output(command.tilt)
        self.robot.move_head(pan, tilt)

    def moving_scene(self) -> MovingScene:
        """Return the newest detection in the camera image."""
        detection = self.detection
        if detection is None:
            return MovingScene(detections=())
        box = (detection.left, detection.top, detection.width, detection.height)
        shown = btcore_scene.Detection(picture="camera", name="object", stamp=detection.stamp, box=box)
        return MovingScene(detections=[shown])

    def _detect(self) -> None:
        image = self.robot.camera()
        # The camera is slower than the control: the same image may be returned several times.
        if image is None or image.stamp == self._last_stamp:
            return
        self._last_stamp = image.stamp
        self.detection = detect_colour(image, self.colours)
        if self.detection is not None:
            self.detection_count += 1
            self._command = command_from_detection(self.detection)
