"""Finding coloured objects in the camera's pictures, as a process (the book's chapter 5.2)."""

from dataclasses import dataclass

from btcore_robot.perception.colour import ColourRange, Detection, detect, detect_each
from btcore_robot.process.parameters import ParameterError
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import CameraImage


@dataclass(frozen=True, slots=True)
class Detections:
    """What was found in one picture, the largest first."""

    objects: tuple[Detection, ...]


class ObjectDetector(Process):
    """Looks for ``hsv_ranges`` in the pictures on ``input_image``, and tells what it found on ``detection``.

    ``hsv_ranges`` is hue from and to (0–180), saturation and value (0–255). It works only while somebody
    listens. With ``each`` every patch is an object of its own; without, all that has the colour is one.
    """

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
        super().__init__("object_detector", context, options)
        ranges = self.parameters.declare("hsv_ranges", [0, 180, 0, 255, 0, 255])
        if len(ranges) != 6:
            raise ParameterError(f"{self.name}: hsv_ranges has 6 numbers, h H s S v V, and not {len(ranges)}")
        h, hh, s, ss, v, vv = ranges
        self.colours = ColourRange((h, hh), (s, ss), (v, vv))
        self.each = self.parameters.declare("each", False)
        self.detections = self.publisher("detection", Detections)
        self.subscribe("input_image", CameraImage, self.seen)

    def seen(self, picture: CameraImage) -> None:
        """Look at a picture."""
        if not self.detections.has_subscribers:
            return
        if self.each:
            found = detect_each(picture, self.colours)
        else:
            whole = detect(picture, self.colours)
            found = [] if whole is None else [whole]
        if found:
            self.detections.publish(Detections(tuple(found)))
