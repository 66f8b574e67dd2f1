"""Location of coloured objects in space, as boxes, from images with depth.

This is an exercise of chapter 6 of the book *A Concise Introduction to Robot Programming with ROS2*.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.components.lifecycle import Lifecycle
from btcore_robot.perception.colour import WOOD, ColourRange, colour_mask
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import MAP_FRAME, CameraImage, CameraInfo, Phase, Robot
from btcore_robot.transform_filter import TransformFilter
from btcore_robot.transforms import TransformTree
from btcore_scene import BoundingBox, MovingScene, SceneSource

__all__ = ["BoundingBox3D", "ObjectLocator", "depth_to_points", "detect_boxes"]

MIN_PIXELS = 20
"""The minimum number of pixels of an object; smaller patches are ignored."""
MAX_DEPTH_STEP = 0.1
"""The relative depth step between neighbouring pixels above which they belong to different objects."""
NO_DEPTH = 1e9
"""The depth (m) assumed for a pixel without depth.

It is greater than any real depth, so that objects beside the pixel do not lose their edges.
"""
OUTLIER_PERCENT = 1.0
"""The percentage of points at each end of each axis that is ignored, because depth errors are large there."""

RATE = 2.0
"""The rate (Hz) at which images are processed."""


@dataclass(frozen=True, slots=True)
class BoundingBox3D:
    """The visible part of an object: a box along the axes of *frame* with its *centre* and full *size* (m).

    A camera sees the near sides only, so the box is at most as large as the object. *stamp* is the time (ns)
    of the image.
    """

    frame: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    stamp: int


def detect_boxes(
    image: CameraImage, camera_info: CameraInfo, colours: ColourRange, frame: str, camera: Transform
) -> list[BoundingBox3D]:
    """Return a box for every patch of *colours* in *image*, the largest patch first.

    A patch ends where the colour ends or the depth jumps. Two objects, one behind the other, are therefore
    two patches.

    Args:
        image: The image; without depth the result is empty.
        camera_info: The camera's intrinsic parameters.
        colours: The range of colours of the objects.
        frame: The frame of the boxes.
        camera: The pose of the image's frame in *frame*.
    """
    if image.depth is None:
        return []
    mask = _patches(image, image.depth, colours)
    count, labels, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    areas = stats[:, cv2.CC_STAT_AREA]
    labels_by_area = sorted(
        (label for label in range(1, count) if areas[label] >= MIN_PIXELS), key=lambda label: -areas[label]
    )
    return [
        _box(camera.apply(depth_to_points(image.depth, camera_info, labels == label)), frame, image.stamp)
        for label in labels_by_area
    ]


def depth_to_points(
    depth: NDArray[np.float32], camera_info: CameraInfo, pixels: NDArray[np.bool_]
) -> NDArray[np.float64]:
    """Return the positions (m) of *pixels* in the camera's optical frame: shape `(n, 3)`.

    The pinhole model gives x = (column - cx) z / fx and y = (row - cy) z / fy.

    Args:
        depth: The depth image (m, along z), shape `(height, width)`.
        camera_info: The camera's intrinsic parameters.
        pixels: The mask of the pixels to convert, shape `(height, width)`.
    """
    rows, columns = np.nonzero(pixels)
    z = depth[rows, columns].astype(np.float64)
    return np.stack(
        ((columns - camera_info.cx) * z / camera_info.fx, (rows - camera_info.cy) * z / camera_info.fy, z),
        axis=1,
    )


def _patches(image: CameraImage, depth: NDArray[np.float32], colours: ColourRange) -> NDArray[np.uint8]:
    """Return the mask of pixels with the colour and a depth, without the pixels just behind a depth step."""
    mask = np.isfinite(depth) & (depth > 0.0)
    # A missing depth counts as far away, so that its neighbours do not lose their edge pixels.
    z = np.where(mask, depth, NO_DEPTH)
    mask &= colour_mask(image, colours) > 0
    # A pixel is removed if its neighbour to the right, to the left, above or below is much nearer.
    for first, second in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        step = z[second] - z[first]
        mask[first] &= -step <= MAX_DEPTH_STEP * z[first]
        mask[second] &= step <= MAX_DEPTH_STEP * z[second]
    return mask.astype(np.uint8)


def _box(cloud: NDArray[np.float64], frame: str, stamp: int) -> BoundingBox3D:
    low, high = np.percentile(cloud, (OUTLIER_PERCENT, 100.0 - OUTLIER_PERCENT), axis=0)
    x, y, z = ((low + high) / 2).tolist()
    length, width, height = (high - low).tolist()
    return BoundingBox3D(frame, (x, y, z), (length, width, height), stamp)


class ObjectLocator(Lifecycle, SceneSource):
    """While active, detect wooden objects in the robot's camera images and locate them in *frame*.

    Images are requested only while the locator is active. An image waits until *transforms* knows the
    camera's pose at its stamp. `configure` returns False for a robot without a camera.

    Attributes:
        robot: The robot.
        transforms: The transform tree.
        frame: The frame of the results.
    """

    def __init__(self, robot: Robot, transforms: TransformTree, frame: str = MAP_FRAME) -> None:
        super().__init__()
        self.robot = robot
        self.transforms = transforms
        self.frame = frame
        self.boxes: Sequence[BoundingBox3D] = ()
        """The boxes of the objects in the newest image, the largest first."""
        self._stop_steps: Callable[[], None] | None = None
        self._images = TransformFilter[CameraImage](transforms, frame)

    def on_configure(self) -> bool:
        """Return whether the robot has a camera."""
        return self.robot.camera_info is not None

    def on_activate(self) -> bool:
        """Start to call `step` at `RATE`."""
        self._images = TransformFilter(self.transforms, self.frame)
        self._stop_steps = self.robot.schedule.add_task(RATE, Phase.HEAD, self.step)
        return True

    def on_deactivate(self) -> bool:
        """Stop the periodic steps and clear the results."""
        if self._stop_steps is not None:
            self._stop_steps()
            self._stop_steps = None
            self.boxes = ()
        return True

    def step(self, now: int) -> None:
        """Process the newest camera image whose transform is available. *now* is the time (ns)."""
        image, camera_info = self._images.newest(self.robot.camera()), self.robot.camera_info
        if image is None or camera_info is None:
            return
        camera = self.transforms.lookup(self.frame, image.frame, image.stamp)
        self.boxes = tuple(detect_boxes(image, camera_info, WOOD, self.frame, camera))

    def moving_scene(self) -> MovingScene:
        """Return the boxes of the objects in the newest image."""
        return MovingScene(
            boxes=[
                BoundingBox(name="object", frame=box.frame, position=box.centre, size=box.size)
                for box in self.boxes
            ]
        )
