"""Drawings of a robot's surroundings from above, in metres: x to the right, y up."""

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from btcore_robot.robot import Pose2D

Colour = tuple[int, int, int]

PAPER: Colour = (250, 249, 246)
GRID: Colour = (228, 226, 220)
INK: Colour = (60, 60, 64)
WALL: Colour = (52, 56, 64)
ROBOT: Colour = (255, 196, 60)

_FONT = cv2.FONT_HERSHEY_SIMPLEX
_SHIFT = 4  # bits for the fractions of pixel coordinates in OpenCV's drawing functions
_MARGIN = 26  # pixels
_PNG_PARAMETERS = [cv2.IMWRITE_PNG_COMPRESSION, 9]


class TopView:
    """A picture of a rectangle of the floor with a grid of 1 m. Colours are RGB (0–255).

    Args:
        low: The corner with the lowest x and y (m).
        high: The corner with the highest x and y (m).
        size: The width and height (pixels) of the picture.
    """

    def __init__(
        self, low: tuple[float, float], high: tuple[float, float], size: tuple[int, int] = (640, 480)
    ) -> None:
        width, height = size
        spans = high[0] - low[0], high[1] - low[1]
        self.scale = min((width - 2 * _MARGIN) / spans[0], (height - 2 * _MARGIN) / spans[1])
        """Pixels per metre."""
        self._middle = (low[0] + high[0]) / 2, (low[1] + high[1]) / 2
        self._size = size
        self.image: NDArray[np.uint8] = np.full((height, width, 3), PAPER, dtype=np.uint8)
        half = width / 2 / self.scale, height / 2 / self.scale
        for x in range(int(np.ceil(self._middle[0] - half[0])), int(self._middle[0] + half[0]) + 1):
            self.line([(x, self._middle[1] - half[1]), (x, self._middle[1] + half[1])], GRID)
        for y in range(int(np.ceil(self._middle[1] - half[1])), int(self._middle[1] + half[1]) + 1):
            self.line([(self._middle[0] - half[0], y), (self._middle[0] + half[0], y)], GRID)

    def points(self, positions: ArrayLike, colour: Colour = WALL, radius: float = 2.0) -> None:
        """Draw dots at *positions*, shape `(n, 2)` (m); *radius* is in pixels."""
        # Without anti-aliasing, because thousands of smooth dots make a PNG several times as large.
        for centre in self._pixels(positions):
            cv2.circle(self.image, centre.tolist(), round(radius * 16), colour, -1, cv2.LINE_8, _SHIFT)

    def line(self, positions: ArrayLike, colour: Colour = INK, width: int = 1) -> None:
        """Draw a line through *positions*, shape `(n, 2)` (m); *width* is in pixels."""
        cv2.polylines(self.image, [self._pixels(positions)], False, colour, width, cv2.LINE_AA, _SHIFT)

    def circle(self, x: float, y: float, radius: float, colour: Colour, width: int = -1) -> None:
        """Draw a circle with *radius* around x, y (m): filled, or an outline of *width* (pixels)."""
        centre = self._pixels([(x, y)])[0].tolist()
        cv2.circle(self.image, centre, round(radius * self.scale * 16), colour, width, cv2.LINE_AA, _SHIFT)

    def arrow(self, start: tuple[float, float], end: tuple[float, float], colour: Colour) -> None:
        """Draw an arrow from *start* to *end* (m). The size of its head does not depend on its length."""
        pixels = self._pixels([start, end]).astype(np.float64)
        length = float(np.hypot(*(pixels[1] - pixels[0]))) / 16
        if length < 2.0:
            return
        # `arrowedLine` expects the length of the head as a fraction of the arrow.
        tip = min(14.0 / length, 0.6)
        first, last = pixels.astype(np.int32).tolist()
        cv2.arrowedLine(self.image, first, last, colour, 3, cv2.LINE_AA, _SHIFT, tip)

    def robot(self, pose: Pose2D, radius: float) -> None:
        """Draw the robot at *pose* as a circle of *radius* (m) with a line towards its heading."""
        self.circle(pose.x, pose.y, radius, ROBOT)
        self.circle(pose.x, pose.y, radius, INK, 2)
        nose = pose.x + radius * np.cos(pose.yaw), pose.y + radius * np.sin(pose.yaw)
        self.line([(pose.x, pose.y), nose], INK, 2)

    def legend(self, entries: dict[str, Colour], title: str = "") -> None:
        """Draw the texts of *entries* with their colours at the lower left, and *title* at the upper left."""
        if title:
            cv2.putText(self.image, title, (12, 24), _FONT, 0.55, INK, 1, cv2.LINE_AA)
        left, base = 12, self._size[1] - 12
        for text, colour in entries.items():
            cv2.rectangle(self.image, (left, base - 11), (left + 12, base + 1), colour, -1)
            cv2.putText(self.image, text, (left + 18, base), _FONT, 0.45, INK, 1, cv2.LINE_AA)
            left += 18 + cv2.getTextSize(text, _FONT, 0.45, 1)[0][0] + 18

    def _pixels(self, positions: ArrayLike) -> NDArray[np.int32]:
        metres = np.asarray(positions, dtype=np.float64).reshape(-1, 2)
        width, height = self._size
        x = width / 2 + (metres[:, 0] - self._middle[0]) * self.scale
        y = height / 2 - (metres[:, 1] - self._middle[1]) * self.scale
        pixels: NDArray[np.int32] = np.round(np.stack((x, y), axis=1) * 2**_SHIFT).astype(np.int32)
        return pixels


def is_image_format_supported(path: Path) -> bool:
    """Return whether the suffix of *path* is a supported image format; a missing suffix means PNG."""
    return not path.suffix or bool(cv2.haveImageWriter(path.name))


def save_picture(image: NDArray[np.uint8], path: Path) -> None:
    """Write *image* (RGB) to *path* in the format of its suffix. Raises OSError if it cannot be written."""
    encoded, data = cv2.imencode(
        path.suffix or ".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR), _PNG_PARAMETERS
    )
    if not encoded:
        raise OSError(None, "the picture cannot be encoded", str(path))
    path.write_bytes(data.tobytes())
