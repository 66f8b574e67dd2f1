"""Detection of coloured objects in camera images, as a process (the book's chapter 5.2)."""

from dataclasses import dataclass

from btcore_robot.perception.colour import ColourRange, Detection, detect_colour, detect_each
from btcore_robot.process.parameters import ParameterError
from btcore_robot.process.process import Process, ProcessContext, ProcessOptions
from btcore_robot.robot import CameraImage


@dataclass(frozen=True, slots=True)
class Detections:
    """The objects detected in an image, the largest first."""

    objects: tuple[Detection, ...]


class ObjectDetector(Process):
    """Detect objects by colour in the images on ``input_image`` and publish them on ``detection``.

    ``hsv_ranges`` contains the limits of hue (0–180), saturation and value (0–255), each from and to. The
    process works only while ``detection`` has subscribers. With the parameter ``each`` every patch is a
    separate object; without it all pixels of the colour are a single object.
    """

    def __init__(self, context: ProcessContext, options: ProcessOptions | None = None) -> None:
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
