"""Match a scan with other scans: a search over a grid of poses, then Gauss-Newton steps below cell size.

The other scans are drawn into grids of cells and blurred, so that a wall becomes a ridge (Olson, *Real-time
correlative scan matching*, 2009). The search tries every pose around a guess, so that the result is not
attracted to a wrong wall nearby. The Gauss-Newton steps start at the best pose of the search. They use that
-σ²·∇b/b is the offset from the centre line of a ridge b of width σ. Only a point's offset along the normal of
its wall is used. The two sides of a wall are seen from different rooms; they are ridges on different grids.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from btcore_navigation.mapping.pose_arrays import Floats, transform_points
from btcore_robot.rigid_transform import wrap_angle

FloatImage = NDArray[np.float32]

RESOLUTION = 0.05
"""The side (m) of a cell."""
SEARCH_BLUR = 0.09
"""The standard deviation (m) of the blur of a wall in the grid that the search uses."""
RIDGE_BLUR = 0.06
"""The standard deviation (m) of the blur of a wall in the grids that the Gauss-Newton steps use."""
MAX_OFFSET = 0.2
"""The maximum offset (m) of a point from a ridge; a point farther away is not on that wall."""
BEAM_DEVIATION = 0.12
"""The standard deviation (m) of a point across its wall.

A laser's noise is smaller, but the errors of points on the same wall are correlated.
"""
_GRID_MARGIN = 1.0  # m around the points, so that a slightly displaced scan still falls on the grid
_SATURATION = 3.0  # number of scans of a cell after which further scans add little certainty
_MAX_STEPS = 12  # of the iteration
_MIN_STEP = 1e-4  # m, rad: the iteration ends with a shorter step
_DIRECTIONS = 4  # number of grids, one for each direction that a wall may face
_MIN_COSINE = 0.5  # between the normal of a wall and the direction of its grid
_MIN_RIDGE = 1e-3  # a lower value of a ridge grid means that there is no wall
_DISTANCE_PENALTY = 0.02  # subtracted from the score of a pose at the edge of the search window
# σ² of a ridge: the blur, the effect of interpolation, and the remaining noise of the points.
_RIDGE_VARIANCE = RIDGE_BLUR**2 + RESOLUTION**2 / 4 + 0.02**2
_DAMPING = 1.0  # added to the normal matrix, so that it is never singular


@dataclass(frozen=True, slots=True)
class PoseUncertainty:
    """The standard deviations *distance* (m) and *turn* (rad) of a prior pose.

    The prior pose matters in directions in which the points give little information.
    """

    distance: float
    turn: float

    def information(self) -> Floats:
        """Return the inverse of the covariance of x, y and yaw, shape `(3, 3)`."""
        return np.diag((self.distance**-2, self.distance**-2, self.turn**-2))


@dataclass(frozen=True, slots=True)
class SearchWindow:
    """The poses to search around a guess: *distance* (m) and *turn* (rad) to each side.

    *cell_step* (cells) and *turn_step* (rad) are the distances between neighbouring poses.
    """

    distance: float
    turn: float
    cell_step: int
    turn_step: float


NEARBY = SearchWindow(0.3, 0.21, 1, 0.035)
"""The window for consecutive key scans; the angle step is Karto's coarse angle step."""


@dataclass(frozen=True, slots=True)
class MatchResult:
    """The *pose* (x, y in m, yaw in rad) at which the points fit the walls best.

    *score* (0 … 1) is the quality of the fit. *information* is the inverse covariance of x, y and yaw in the
    frame of the walls, shape `(3, 3)`; in the direction of a corridor the information is close to 0.
    """

    pose: Floats
    score: float
    information: Floats


class Outline(NamedTuple):
    """Points on walls (m) and the *normals* of the walls, shape `(k, 2)` each.

    Normals point towards the laser; an unknown normal is (0, 0). *weight* is the weight of each point.
    It is below 1 for points of several scans, because scans of the same walls are not independent.
    """

    points: Floats
    normals: Floats
    weight: float = 1.0

    def at(self, pose: Floats) -> "Outline":
        """Return the outline in the frame in which *pose* is given."""
        turned = transform_points(self.normals, np.array((0.0, 0.0, pose[2])))
        return Outline(transform_points(self.points, pose), turned, self.weight)


class CorrelationGrid:
    """Walls as ridges in grids of cells, drawn from scans in a common frame."""

    def __init__(self, scans: Sequence[Outline]) -> None:
        points = np.concatenate([scan.points for scan in scans])
        normals = np.concatenate([scan.normals for scan in scans])
        self._low = np.floor((points.min(axis=0) - _GRID_MARGIN) / RESOLUTION).astype(np.intp)
        high = np.ceil((points.max(axis=0) + _GRID_MARGIN) / RESOLUTION).astype(np.intp)
        width, height = (int(side) for side in high - self._low)
        self._shape = height, width
        hits = np.zeros(width * height, dtype=np.float32)
        for scan in scans:
            cells = np.floor(scan.points / RESOLUTION).astype(np.intp) - self._low
            hits[np.unique(cells[:, 1] * width + cells[:, 0])] += 1.0
        # A scan counts once per cell, and further scans add ever less: the value approaches 1.
        hits /= hits + np.float32(_SATURATION)
        spread = SEARCH_BLUR / RESOLUTION
        ridges = cv2.GaussianBlur(hits.reshape(height, width), (0, 0), spread)
        # A wall of one row of cells, each with the value 0.5, gets a ridge of about 0.7.
        self._field: FloatImage = -np.expm1(-ridges * np.float32(2.5 * math.tau**0.5 * spread))
        self._sides = np.stack([self._draw_ridges(points, normals, side) for side in range(_DIRECTIONS)])

    def _draw_ridges(self, points: Floats, normals: Floats, side: int) -> FloatImage:
        """Return the ridges of the walls that face *side*; a point is shared by its four nearest cells."""
        height, width = self._shape
        turned = math.tau * side / _DIRECTIONS
        facing = normals @ np.array((math.cos(turned), math.sin(turned))) > _MIN_COSINE
        position = points[facing] / RESOLUTION - self._low - 0.5
        cells = np.floor(position).astype(np.intp)
        across, up = (position - cells).T
        first = cells[:, 1] * width + cells[:, 0]
        # A point is shared between its four nearest cells, by its distance from their centres.
        shares = ((1 - across) * (1 - up), across * (1 - up), (1 - across) * up, across * up)
        drawn = np.bincount(
            np.concatenate((first, first + 1, first + width, first + width + 1)),
            np.concatenate(shares),
            minlength=width * height,
        )
        image = drawn.reshape(height, width).astype(np.float32)
        return np.asarray(cv2.GaussianBlur(image, (0, 0), RIDGE_BLUR / RESOLUTION), dtype=np.float32)

    def search(self, guess: Floats, points: Floats, window: SearchWindow) -> Floats:
        """Return the pose around *guess* at which *points* fit the walls best.

        Args:
            guess: The centre of the search: x, y (m) and yaw (rad).
            points: The points (m) in the robot's frame, shape `(k, 2)`.
            window: The poses to search.

        Returns:
            The best pose; of poses with equal scores, the nearest to the guess.
        """
        height, width = self._shape
        reach = round(window.distance / RESOLUTION / window.cell_step) * window.cell_step
        shifts = np.arange(-reach, reach + 1, window.cell_step)
        max_turn = round(window.turn / window.turn_step)
        edge = reach + 1
        stride = width + 2 * edge
        # The padding has no walls and is wide enough that every shifted point stays inside the array.
        flat = np.pad(self._field, edge).ravel()
        # All shifts as offsets in the flattened grid, so that a single `take` evaluates them.
        offsets = (shifts[:, None] * stride + shifts).ravel()
        penalty = (shifts[:, None] ** 2 + shifts**2).ravel() * (_DISTANCE_PENALTY / max(1, reach) ** 2)
        best_score, best_pose = -1.0, guess
        # Small turns first: of equal scores the first is kept.
        for turn in sorted(range(-max_turn, max_turn + 1), key=abs):
            yaw = guess[2] + turn * window.turn_step
            moved = transform_points(points, np.array((guess[0], guess[1], yaw)))
            cells = np.floor(moved / RESOLUTION).astype(np.intp) - self._low
            # Points off the grid are moved to its padded edge, which has no walls.
            cells = np.clip(cells, -1, (width, height))
            indices = (cells[:, 1] + edge) * stride + cells[:, 0] + edge
            indices = np.clip(indices, reach * (stride + 1), len(flat) - 1 - reach * (stride + 1))
            scores = flat.take(indices + offsets[:, None]).mean(axis=1) - penalty
            index = int(np.argmax(scores))
            score = float(scores[index]) - _DISTANCE_PENALTY * (turn / max(1, max_turn)) ** 2
            if score > best_score:
                row, col = divmod(index, len(shifts))
                best_score = score
                best_pose = np.array(
                    (guess[0] + shifts[col] * RESOLUTION, guess[1] + shifts[row] * RESOLUTION, yaw)
                )
        return best_pose

    def refine(
        self,
        guess: Floats,
        outline: Outline,
        prior: Floats | None = None,
        uncertainty: PoseUncertainty | None = None,
    ) -> MatchResult:
        """Move *guess* by Gauss-Newton steps to the pose at which *outline* lies on the ridges.

        Args:
            guess: The first pose: x, y (m) and yaw (rad).
            outline: The points and normals in the robot's frame.
            prior: A pose that attracts the result; *guess* if omitted.
            uncertainty: The uncertainty of the prior; without it the prior has no effect.
        """
        at = guess.astype(np.float64).copy()
        prior_information = np.zeros((3, 3)) if uncertainty is None else uncertainty.information()
        prior = at.copy() if prior is None else prior
        information = np.zeros((3, 3))
        for _ in range(_MAX_STEPS):
            moved = outline.at(at)
            offsets, weight = self._ridge_offsets(moved)
            # The derivatives of an offset by x, y and yaw: the normal, and its moment about the robot.
            arm = moved.points - at[:2]
            jacobian = np.stack(
                (
                    moved.normals[:, 0],
                    moved.normals[:, 1],
                    moved.normals[:, 1] * arm[:, 0] - moved.normals[:, 0] * arm[:, 1],
                )
            )
            weighted = jacobian * (weight * outline.weight / BEAM_DEVIATION**2)
            information = weighted @ jacobian.T
            to_prior = prior - at
            to_prior[2] = wrap_angle(float(to_prior[2]))
            # The damping keeps the step short in directions that neither the points nor the prior determine.
            normal_matrix = information + prior_information + _DAMPING * np.eye(3)
            step = np.linalg.solve(normal_matrix, prior_information @ to_prior - weighted @ offsets)
            at += step
            if float(np.abs(step).max()) < _MIN_STEP:
                break
        at[2] = wrap_angle(float(at[2]))
        return MatchResult(at, self.score(at, outline.points), information)

    def score(self, at: Floats, points: Floats) -> float:
        """Return the fit (0 … 1) of points to the walls: the mean value of the cells in which the points lie.

        Args:
            at: The robot's pose in the frame of the walls: x, y (m) and yaw (rad), shape `(3,)`.
            points: The points (m) in the robot's frame, shape `(k, 2)`. A point off the grid counts as 0.
        """
        height, width = self._shape
        cells = np.floor(transform_points(points, at) / RESOLUTION).astype(np.intp) - self._low
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
        cells[~inside] = 0
        return float((self._field[cells[:, 1], cells[:, 0]] * inside).mean())

    def _ridge_offsets(self, moved: Outline) -> tuple[Floats, Floats]:
        """Return the offsets (m) of points from their ridges along their normals, and weights (0 … 1)."""
        height, width = self._shape
        position = moved.points / RESOLUTION - self._low - 0.5
        inside = (position >= 0).all(axis=1) & (position[:, 0] < width - 1) & (position[:, 1] < height - 1)
        position[~inside] = 0.0
        cells = position.astype(np.intp)
        across, up = (position - cells).T
        turned = np.arctan2(moved.normals[:, 1], moved.normals[:, 0])
        side = np.rint(turned / (math.tau / _DIRECTIONS)).astype(np.intp) % _DIRECTIONS
        # The grids of all directions lie one behind another in the flattened array.
        first = (side * height + cells[:, 1]) * width + cells[:, 0]
        flat = self._sides.ravel()
        # Bilinear interpolation between the four nearest cells, and its gradient along the normal.
        v00, v01, v10, v11 = (flat.take(first + step).astype(np.float64) for step in (0, 1, width, width + 1))
        low, high = v00 + across * (v01 - v00), v10 + across * (v11 - v10)
        value = low + up * (high - low)
        along = ((1 - up) * (v01 - v00) + up * (v11 - v10)) * moved.normals[:, 0]
        along += (high - low) * moved.normals[:, 1]
        # For a Gaussian ridge b of variance σ² the offset from its centre line is -σ²·∇b/b.
        offsets = -_RIDGE_VARIANCE * along / RESOLUTION / np.maximum(value, _MIN_RIDGE)
        known = inside & (value > _MIN_RIDGE) & (np.abs(offsets) < MAX_OFFSET)
        # The Geman-McClure kernel: points far from their ridge count less.
        weight = known * (MAX_OFFSET / 2) ** 4 / ((MAX_OFFSET / 2) ** 2 + offsets**2) ** 2
        return np.where(known, offsets, 0.0), weight
