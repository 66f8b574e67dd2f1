"""Matching one scan to others: a search over a grid of poses, then Gauss-Newton steps to parts of a cell.

The others are drawn into grids of cells and blurred, so that a wall is a ridge (Olson, *Real-time correlative
scan matching*, 2009). The search tries every pose about a guess, so it isn't caught by the wrong wall nearby.
The steps start at the best of them: across a ridge b with the width σ, -σ²·∇b/b is the way from its middle.
Each point counts along the normal of the wall that it is on. The two sides of a wall are seen from different
rooms: they are ridges on different grids.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.mapping.pose_arrays import Floats, transform_points
from btcore_robot.rigid_transform import wrap_angle

FloatImage = NDArray[np.float32]

RESOLUTION = 0.05
"""The side (m) of a cell."""
BLUR = 0.09
"""How wide (m, one deviation) a wall is in the grid that is searched."""
RIDGE = 0.06
"""How wide in those that the steps are taken on."""
NEAREST = 0.2
"""What is farther (m) from a ridge is not on that wall."""
BEAM_DEVIATION = 0.12
"""How sure (m) one point is across its wall. Its noise is less, but points on one wall err together."""
_MARGIN = 1.0  # m around the points, where a scan that lies a little off still finds cells
_SATURATION = 3.0  # scans that saw a cell; more make it hardly surer
_STEPS = 12
_ENOUGH = 1e-4  # a step shorter than this (m, rad) is the last
_SIDES = 4  # grids, one for each direction that a wall may look in
_LOOKS = 0.5  # the least cosine between a wall's normal and the direction of its grid
_FAINT = 1e-3  # what a ridge has where nothing is
_NEARER = 0.02  # of the score: what a pose at the end of the window has to be better by
# σ² of a ridge: the blur, what interpolation adds, and what noise is left in the points.
_WIDTH = RIDGE**2 + RESOLUTION**2 / 4 + 0.02**2
_DAMPING = 1.0


@dataclass(frozen=True, slots=True)
class PoseUncertainty:
    """How far (m, rad; one deviation) a guess may be off: what the points don't tell stays near it."""

    way: float
    turn: float

    def information(self) -> Floats:
        """The inverse of the covariance of x, y, yaw, shape ``(3, 3)``."""
        return np.diag((self.way**-2, self.way**-2, self.turn**-2))


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """What is searched about a guess: *way* (m) and *turn* (rad) to each side, in steps (cells, rad)."""

    way: float
    turn: float
    cells: int
    step: float


NEARBY = SearchWindow(0.3, 0.21, 1, 0.035)
"""For a scan that follows another (within Karto's 0.5 m a side, at its coarse step)."""


@dataclass(frozen=True, slots=True)
class MatchResult:
    """The *pose* (x, y, yaw) where the points lie on the walls best.

    *score* (0 … 1) is how well they do; *information* (``(3, 3)``, of x, y and yaw in the frame of the walls)
    how sure that is. Along a corridor it is 0.
    """

    pose: Floats
    score: float
    information: Floats


class Outline(NamedTuple):
    """*points* on walls (m), and the walls' *normals*, ``(k, 2)`` each.

    Normals look to where they were seen from; one that isn't known is (0, 0). *weight* is what a point
    counts: those of several scans of the same walls are no further witnesses.
    """

    points: Floats
    normals: Floats
    weight: float = 1.0

    def at(self, pose: Floats) -> "Outline":
        """The same, in the frame that *pose* is told in."""
        turned = transform_points(self.normals, np.array((0.0, 0.0, pose[2])))
        return Outline(transform_points(self.points, pose), turned, self.weight)


class CorrelationGrid:
    """Where walls are by some scans, all in one frame."""

    def __init__(self, scans: Sequence[Outline]) -> None:
        points = np.concatenate([one.points for one in scans])
        normals = np.concatenate([one.normals for one in scans])
        self._low = np.floor((points.min(axis=0) - _MARGIN) / RESOLUTION).astype(np.intp)
        high = np.ceil((points.max(axis=0) + _MARGIN) / RESOLUTION).astype(np.intp)
        width, height = (int(side) for side in high - self._low)
        self._shape = height, width
        seen = np.zeros(width * height, dtype=np.float32)
        for one in scans:
            cells = np.floor(one.points / RESOLUTION).astype(np.intp) - self._low
            seen[np.unique(cells[:, 1] * width + cells[:, 0])] += 1.0
        seen /= seen + np.float32(_SATURATION)
        spread = BLUR / RESOLUTION
        ridges = cv2.GaussianBlur(seen.reshape(height, width), (0, 0), spread)
        # A wall of one row of cells, half sure, has a ridge of about 0.7.
        self._field: FloatImage = -np.expm1(-ridges * np.float32(2.5 * math.tau**0.5 * spread))
        self._sides = np.stack([self._side(points, normals, side) for side in range(_SIDES)])

    def _side(self, points: Floats, normals: Floats, side: int) -> FloatImage:
        """The ridges of the walls that look in one direction, a point shared by the four cells about it."""
        height, width = self._shape
        turned = math.tau * side / _SIDES
        looks = normals @ np.array((math.cos(turned), math.sin(turned))) > _LOOKS
        place = points[looks] / RESOLUTION - self._low - 0.5
        cells = np.floor(place).astype(np.intp)
        across, up = (place - cells).T
        first = cells[:, 1] * width + cells[:, 0]
        shares = ((1 - across) * (1 - up), across * (1 - up), (1 - across) * up, across * up)
        drawn = np.bincount(
            np.concatenate((first, first + 1, first + width, first + width + 1)),
            np.concatenate(shares),
            minlength=width * height,
        )
        image = drawn.reshape(height, width).astype(np.float32)
        return np.asarray(cv2.GaussianBlur(image, (0, 0), RIDGE / RESOLUTION), dtype=np.float32)

    def search(self, guess: Floats, points: Floats, window: SearchWindow) -> Floats:
        """The pose about *guess* at which *points* fall on walls best; of equals the nearest to the guess."""
        height, width = self._shape
        reach = round(window.way / RESOLUTION / window.cells) * window.cells
        shifts = np.arange(-reach, reach + 1, window.cells)
        most = round(window.turn / window.step)
        edge = reach + 1
        stride = width + 2 * edge
        flat = np.pad(self._field, edge).ravel()
        offsets = (shifts[:, None] * stride + shifts).ravel()
        away = (shifts[:, None] ** 2 + shifts**2).ravel() * (_NEARER / max(1, reach) ** 2)
        best, found = -1.0, guess
        for turn in sorted(range(-most, most + 1), key=abs):
            yaw = guess[2] + turn * window.step
            moved = transform_points(points, np.array((guess[0], guess[1], yaw)))
            cells = np.floor(moved / RESOLUTION).astype(np.intp) - self._low
            # What falls off the grid finds its edge, where nothing is.
            cells = np.clip(cells, -1, (width, height))
            places = (cells[:, 1] + edge) * stride + cells[:, 0] + edge
            places = np.clip(places, reach * (stride + 1), len(flat) - 1 - reach * (stride + 1))
            scores = flat.take(places + offsets[:, None]).mean(axis=1) - away
            index = int(np.argmax(scores))
            score = float(scores[index]) - _NEARER * (turn / max(1, most)) ** 2
            if score > best:
                row, col = divmod(index, len(shifts))
                best = score
                found = np.array(
                    (guess[0] + shifts[col] * RESOLUTION, guess[1] + shifts[row] * RESOLUTION, yaw)
                )
        return found

    def refine(
        self,
        guess: Floats,
        outline: Outline,
        prior: Floats | None = None,
        trust: PoseUncertainty | None = None,
    ) -> MatchResult:
        """Step from *guess* to where *outline* lies on the ridges; a *prior* pulls with its *trust*."""
        at = guess.astype(np.float64).copy()
        pull = np.zeros((3, 3)) if trust is None else trust.information()
        prior = at.copy() if prior is None else prior
        certain = np.zeros((3, 3))
        for _ in range(_STEPS):
            moved = outline.at(at)
            off, weight = self._off(moved)
            arm = moved.points - at[:2]
            slopes = np.stack(
                (
                    moved.normals[:, 0],
                    moved.normals[:, 1],
                    moved.normals[:, 1] * arm[:, 0] - moved.normals[:, 0] * arm[:, 1],
                )
            )
            weighed = slopes * (weight * outline.weight / BEAM_DEVIATION**2)
            certain = weighed @ slopes.T
            back = prior - at
            back[2] = wrap_angle(float(back[2]))
            step = np.linalg.solve(certain + pull + _DAMPING * np.eye(3), pull @ back - weighed @ off)
            at += step
            if float(np.abs(step).max()) < _ENOUGH:
                break
        at[2] = wrap_angle(float(at[2]))
        return MatchResult(at, self.score(at, outline.points), certain)

    def score(self, at: Floats, points: Floats) -> float:
        """How well (0 … 1) *points* fall on walls with the robot at *at*."""
        height, width = self._shape
        cells = np.floor(transform_points(points, at) / RESOLUTION).astype(np.intp) - self._low
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
        cells[~inside] = 0
        return float((self._field[cells[:, 1], cells[:, 0]] * inside).mean())

    def _off(self, moved: Outline) -> tuple[Floats, Floats]:
        """How far (m) points are from their ridges, along their normals, and what each counts (0 … 1)."""
        height, width = self._shape
        place = moved.points / RESOLUTION - self._low - 0.5
        inside = (place >= 0).all(axis=1) & (place[:, 0] < width - 1) & (place[:, 1] < height - 1)
        place[~inside] = 0.0
        cells = place.astype(np.intp)
        across, up = (place - cells).T
        turned = np.arctan2(moved.normals[:, 1], moved.normals[:, 0])
        side = np.rint(turned / (math.tau / _SIDES)).astype(np.intp) % _SIDES
        first = (side * height + cells[:, 1]) * width + cells[:, 0]
        flat = self._sides.ravel()
        one, two, three, four = (
            flat.take(first + step).astype(np.float64) for step in (0, 1, width, width + 1)
        )
        low, high = one + across * (two - one), three + across * (four - three)
        value = low + up * (high - low)
        along = ((1 - up) * (two - one) + up * (four - three)) * moved.normals[:, 0]
        along += (high - low) * moved.normals[:, 1]
        off = -_WIDTH * along / RESOLUTION / np.maximum(value, _FAINT)
        known = inside & (value > _FAINT) & (np.abs(off) < NEAREST)
        weight = known * (NEAREST / 2) ** 4 / ((NEAREST / 2) ** 2 + off**2) ** 2
        return np.where(known, off, 0.0), weight
