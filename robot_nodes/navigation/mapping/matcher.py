"""Matching one scan to others: a search over a grid of poses, then Gauss-Newton steps to a fraction of a cell.

The others are drawn into a grid of cells and blurred, so that a wall is a ridge as wide as its noise (Olson,
*Real-time correlative scan matching*, 2009). The search tries every pose about a guess, so it isn't caught by
the wrong wall nearby; the steps climb the ridge from the best of them (Kohlbrecher and others, *A flexible and
scalable SLAM system*, 2011).
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from robot_nodes.navigation.mapping.placing import Floats, placed, wrapped

RESOLUTION = 0.05
"""The side (m) of a cell."""
BLUR = 0.09
"""How wide (m, one deviation) a wall is in the grid."""
BEAM_DEVIATION = 0.12
"""How sure (m) one point is across its wall. Its noise is less, but points on one wall err together."""
_MARGIN = 1.0  # m around the points, where a scan that lies a little off still finds cells
_SATURATION = 3.0  # scans that saw a cell; more make it hardly surer
_STEPS = 12
_ENOUGH = 1e-4  # a step shorter than this (m, rad) is the last
_DAMPING = 1e-3


@dataclass(frozen=True, slots=True)
class Trust:
    """How far (m, rad; one deviation) a guess may be off: what the points don't tell stays near it."""

    way: float
    turn: float

    def information(self) -> Floats:
        """The inverse of the covariance of x, y, yaw, shape ``(3, 3)``."""
        return np.diag((self.way**-2, self.way**-2, self.turn**-2))


@dataclass(frozen=True, slots=True)
class Window:
    """What is searched about a guess: *way* (m) to each side and *turn* (rad), at these steps (cells, rad)."""

    way: float
    turn: float
    cells: int
    step: float


NEARBY = Window(0.3, 0.21, 1, 0.035)
"""For a scan that follows another (within Karto's 0.5 m a side, at its coarse step)."""


@dataclass(frozen=True, slots=True)
class Found:
    """The *pose* (x, y, yaw) where the points lie on the walls best.

    *score* (0 … 1) is how well they do; *information* (``(3, 3)``, of x, y and yaw in the frame of the walls)
    how sure that is. Along a corridor it is 0.
    """

    pose: Floats
    score: float
    information: Floats


class Walls:
    """Where walls are by some scans: their points, ``(k, 2)`` each (m), all in one frame."""

    def __init__(self, scans: Sequence[Floats]) -> None:
        together = np.concatenate(scans)
        low = np.floor((together.min(axis=0) - _MARGIN) / RESOLUTION).astype(np.intp)
        high = np.ceil((together.max(axis=0) + _MARGIN) / RESOLUTION).astype(np.intp)
        width, height = (int(side) for side in high - low)
        seen = np.zeros(width * height, dtype=np.float32)
        for points in scans:
            cells = np.floor(points / RESOLUTION).astype(np.intp) - low
            seen[np.unique(cells[:, 1] * width + cells[:, 0])] += 1.0
        seen /= seen + np.float32(_SATURATION)
        spread = BLUR / RESOLUTION
        ridges = cv2.GaussianBlur(seen.reshape(height, width), (0, 0), spread)
        # A wall of one row of cells, half sure, has a ridge of about 0.7.
        self._field: NDArray[np.float32] = -np.expm1(-ridges * np.float32(2.5 * math.tau**0.5 * spread))
        self._low = low * RESOLUTION
        self._shape = height, width

    def search(self, guess: Floats, points: Floats, window: Window) -> Floats:
        """The pose about *guess* at which *points* fall on walls best; of equals the nearest to the guess."""
        height, width = self._shape
        reach = round(window.way / RESOLUTION / window.cells) * window.cells
        shifts = np.arange(-reach, reach + 1, window.cells)
        turns = np.arange(-round(window.turn / window.step), round(window.turn / window.step) + 1)
        # What falls off the grid finds the margin, where nothing is.
        padded = np.pad(self._field, reach + 1)
        stride = width + 2 * (reach + 1)
        offsets = (shifts[:, None] * stride + shifts).ravel()
        flat = padded.ravel()
        best, found = -1.0, guess
        away = (shifts[:, None] ** 2 + shifts**2).ravel() * (0.02 / max(1, reach) ** 2)
        for turn in sorted(turns, key=abs):
            yaw = guess[2] + turn * window.step
            moved = placed(points, np.array((guess[0], guess[1], yaw)))
            cells = np.floor((moved - self._low) / RESOLUTION).astype(np.intp)
            np.clip(cells[:, 0], -1, width, out=cells[:, 0])
            np.clip(cells[:, 1], -1, height, out=cells[:, 1])
            places = (cells[:, 1] + reach + 1) * stride + cells[:, 0] + reach + 1
            np.clip(places, reach * (stride + 1), len(flat) - 1 - reach * (stride + 1), out=places)
            scores = flat.take(places + offsets[:, None]).mean(axis=1) - away
            index = int(np.argmax(scores))
            score = float(scores[index]) - 0.02 * (turn / max(1, turns[-1])) ** 2
            if score > best:
                row, col = divmod(index, len(shifts))
                best = score
                found = np.array(
                    (guess[0] + shifts[col] * RESOLUTION, guess[1] + shifts[row] * RESOLUTION, yaw)
                )
        return found

    def refine(
        self, guess: Floats, points: Floats, normals: Floats, prior: Floats | None = None, trust: Trust | None = None
    ) -> Found:
        """Climb from *guess* to where *points* lie on the ridges; a *prior* pulls with its *trust*."""
        at = guess.astype(np.float64).copy()
        pull = np.zeros((3, 3)) if trust is None else trust.information() * BEAM_DEVIATION**2
        prior = at if prior is None else prior
        for _ in range(_STEPS):
            value, along_x, along_y = self._at(placed(points, at))
            cos, sin = math.cos(at[2]), math.sin(at[2])
            turned_x = -sin * points[:, 0] - cos * points[:, 1]
            turned_y = cos * points[:, 0] - sin * points[:, 1]
            # In metres: a slope of 1 over the ridge's width.
            slopes = BLUR * np.stack((along_x, along_y, along_x * turned_x + along_y * turned_y))
            off = prior - at
            off[2] = float(wrapped(off[2:])[0])
            normal = slopes @ slopes.T + pull + _DAMPING * np.eye(3)
            step = np.linalg.solve(normal, slopes @ (BLUR * (1.0 - value)) + pull @ off)
            length = float(np.hypot(step[0], step[1]))
            step *= min(1.0, RESOLUTION / max(length, 1e-9))
            at += step
            if float(np.abs(step).max()) < _ENOUGH:
                break
        at[2] = float(wrapped(at[2:])[0])
        value, _, _ = self._at(placed(points, at))
        return Found(at, float(value.mean()), _information(at, points, normals, value))

    def _at(self, places: Floats) -> tuple[Floats, Floats, Floats]:
        """The field at *places* (m), linear between the middles of cells, and its slopes along x and y (1/m)."""
        u = (places - self._low) / RESOLUTION - 0.5
        height, width = self._shape
        inside = (u[:, 0] >= 0) & (u[:, 1] >= 0) & (u[:, 0] < width - 1) & (u[:, 1] < height - 1)
        u[~inside] = 0.0
        cells = u.astype(np.intp)
        across, up = (u - cells).T
        first = cells[:, 1] * width + cells[:, 0]
        flat = self._field.ravel()
        corners = flat.take(np.stack((first, first + 1, first + width, first + width + 1))).astype(np.float64)
        low = corners[0] + across * (corners[1] - corners[0])
        high = corners[2] + across * (corners[3] - corners[2])
        value = (low + up * (high - low)) * inside
        along_x = ((1 - up) * (corners[1] - corners[0]) + up * (corners[3] - corners[2])) / RESOLUTION * inside
        along_y = (high - low) / RESOLUTION * inside
        return value, along_x, along_y


def _information(at: Floats, points: Floats, normals: Floats, value: Floats) -> Floats:
    """How sure a match is: each point counts across its wall, as far as it lies on one."""
    across = placed(normals, np.array((0.0, 0.0, at[2])))
    cos, sin = math.cos(at[2]), math.sin(at[2])
    x, y = cos * points[:, 0] - sin * points[:, 1], sin * points[:, 0] + cos * points[:, 1]
    slopes = np.stack((across[:, 0], across[:, 1], across[:, 1] * x - across[:, 0] * y))
    certain: Floats = (slopes * value) @ slopes.T / BEAM_DEVIATION**2
    return certain
