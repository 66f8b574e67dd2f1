"""Coloured objects as boxes in space, from a picture with depth (an exercise of the book's chapter 6)."""

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.perception.colour import ColourRange, mask
from btcore_robot.rigid_transform import Transform
from btcore_robot.robot import CameraImage, CameraInfo

LEAST = 20
"""The least patch (pixels) that is an object."""
JUMP = 0.1
"""Where the depth of two pixels side by side differs by more than this share, one thing hides another."""
NOWHERE = 1e9
"""The depth (m) of a pixel that has none: behind all others, so that nothing loses its edge to it."""
OUTLIERS = 1.0
"""How many percent of a patch's points are left out at either end of each axis: what the depth gets wrong."""


@dataclass(frozen=True, slots=True)
class Box:
    """What is seen of an object: a box along the axes of *frame*, by its *centre* and full *size* (m).

    A camera sees the sides that look to it, so the box is at most as large as the object.
    """

    frame: str
    centre: tuple[float, float, float]
    size: tuple[float, float, float]
    stamp: int


def boxes(
    picture: CameraImage, lens: CameraInfo, colours: ColourRange, frame: str, camera: Transform
) -> list[Box]:
    """A box for every patch of *colours* in *picture*, the largest patch first; none without depth.

    *camera* takes points of the picture's frame to *frame*. Patches end where the colour does, and where the
    depth jumps: of two things in a row the one behind is another patch.
    """
    if picture.depth is None:
        return []
    found = _patches(picture, picture.depth, colours)
    count, labels, figures, _ = cv2.connectedComponentsWithStats(found, connectivity=4)
    areas = figures[:, cv2.CC_STAT_AREA]
    order = sorted((label for label in range(1, count) if areas[label] >= LEAST), key=lambda one: -areas[one])
    return [
        _box(camera.apply(points(picture.depth, lens, labels == one)), frame, picture.stamp) for one in order
    ]


def points(depth: NDArray[np.float32], lens: CameraInfo, chosen: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Where the *chosen* pixels of *depth* (m along z) are in the camera's frame: shape ``(n, 3)``, m.

    The pinhole backwards: x = (column - cx) z / fx, y = (row - cy) z / fy.
    """
    rows, columns = np.nonzero(chosen)
    z = depth[rows, columns].astype(np.float64)
    return np.stack(((columns - lens.cx) * z / lens.fx, (rows - lens.cy) * z / lens.fy, z), axis=1)


def _patches(picture: CameraImage, depth: NDArray[np.float32], colours: ColourRange) -> NDArray[np.uint8]:
    """The pixels of the colour that have a depth, without those just behind an edge in it."""
    found = np.isfinite(depth) & (depth > 0.0)
    z = np.where(found, depth, NOWHERE)
    found &= mask(picture, colours) > 0
    for one, other in ((np.s_[:, :-1], np.s_[:, 1:]), (np.s_[:-1, :], np.s_[1:, :])):
        step = z[other] - z[one]
        found[one] &= -step <= JUMP * z[one]
        found[other] &= step <= JUMP * z[other]
    return found.astype(np.uint8)


def _box(cloud: NDArray[np.float64], frame: str, stamp: int) -> Box:
    low, high = np.percentile(cloud, (OUTLIERS, 100.0 - OUTLIERS), axis=0)
    x, y, z = ((low + high) / 2).tolist()
    length, width, height = (high - low).tolist()
    return Box(frame, (x, y, z), (length, width, height), stamp)
