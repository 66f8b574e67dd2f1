"""Search the whole map for the pose of a scan: try all free places, with a few headings at a time."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_navigation.likelihood import obstacle_distances
from btcore_robot.occupancy_map import OccupancyMap
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

SPACING = 0.1
"""The distance (m) between the places that are tried, or the map's resolution if that is coarser."""
HEADINGS = 120
"""The number of headings that are tried at each place: every 3 degrees."""
SECTORS = 12
"""For each place, the best heading of every sector of 30 degrees is kept."""
BLUR = 0.2
"""The standard deviation (m) of a beam's end from a wall.

It covers half of SPACING, and a heading error of 3 degrees at a distance of 4 m.
"""
CLEARANCE = 0.25
"""The minimum distance (m) of a place from occupied cells: nearer places don't fit the robot."""
APART = 0.5
"""Places nearer (m) than this, with headings in the same or neighbouring sectors, count as the same."""

_FULL = 255  # the score of a beam that ends on a wall; the sum of a hundred beams fits into 16 bits


@dataclass(frozen=True, slots=True)
class Candidate:
    """A possible *pose* of the robot; *score* is the share (0 … 1) of a perfect score."""

    pose: Pose2D
    score: float


class SearchSpace:
    """The data of a map that all searches share. Create it once per map, because its images are large."""

    def __init__(self, field_map: OccupancyMap) -> None:
        self.stride = max(1, round(SPACING / field_map.resolution))
        self.resolution = field_map.resolution
        self.origin = field_map.origin
        distance = obstacle_distances(field_map, 10.0 * BLUR)
        image = np.rint(_FULL * np.exp(-((distance / BLUR) ** 2) / 2.0)).astype(np.uint16)
        # Seen from every stride-th cell, a beam's end falls on every stride-th cell: with a small image for
        # each remainder, all of these cells are neighbours in memory.
        step = self.stride
        rows, columns = (math.ceil(length / step) for length in field_map.cells.shape)
        padded = np.zeros((rows * step, columns * step), dtype=np.uint16)
        padded[: field_map.height, : field_map.width] = image
        self.parts = [
            [np.ascontiguousarray(padded[row::step, column::step]) for column in range(step)]
            for row in range(step)
        ]
        is_open = np.zeros(padded.shape, dtype=np.bool_)
        is_open[: field_map.height, : field_map.width] = field_map.free & (distance >= CLEARANCE)
        self.is_open = is_open[::step, ::step]

    def place(self, row: int, column: int) -> tuple[float, float]:
        """Return the x and y (m) of a place of the search grid, in the frame of the map.

        Args:
            row: The row in the search grid, whose spacing is *stride* cells of the map.
            column: The column in the search grid.
        """
        return (
            self.origin[0] + (column * self.stride + 0.5) * self.resolution,
            self.origin[1] + (row * self.stride + 0.5) * self.resolution,
        )


class GlobalSearch:
    """A search for the pose of a scan whose beams end at *points* in the robot's frame (m; shape `(k, 2)`).

    Call `advance` until it returns True; then `candidates` returns the best places.
    """

    def __init__(self, space: SearchSpace, points: Floats) -> None:
        self._space = space
        self._points = points
        self._next = 0
        self._best = np.zeros((SECTORS, *space.is_open.shape), dtype=np.uint16)
        self._heading = np.zeros((SECTORS, *space.is_open.shape), dtype=np.uint8)

    def advance(self, headings: int) -> bool:
        """Try further headings at every place; return whether all headings have been tried.

        Args:
            headings: The number of headings to try in this call.
        """
        for number in range(self._next, min(HEADINGS, self._next + headings)):
            score = self._scores(2.0 * math.pi * number / HEADINGS)
            sector = number * SECTORS // HEADINGS
            better = score > self._best[sector]
            self._best[sector][better] = score[better]
            self._heading[sector][better] = number
        self._next = min(HEADINGS, self._next + headings)
        return self._next == HEADINGS

    def _scores(self, yaw: float) -> NDArray[np.uint16]:
        space = self._space
        height, width = space.is_open.shape
        total = np.zeros((height, width), dtype=np.uint16)
        cos, sin = math.cos(yaw), math.sin(yaw)
        columns = np.rint((cos * self._points[:, 0] - sin * self._points[:, 1]) / space.resolution)
        rows = np.rint((sin * self._points[:, 0] + cos * self._points[:, 1]) / space.resolution)
        for row, column in zip(rows.astype(int).tolist(), columns.astype(int).tolist(), strict=True):
            down, row_part = divmod(row, space.stride)
            across, column_part = divmod(column, space.stride)
            if abs(down) >= height or abs(across) >= width:
                continue
            part = space.parts[row_part][column_part]
            total[max(0, -down) : height - max(0, down), max(0, -across) : width - max(0, across)] += part[
                max(0, down) : height + min(0, down), max(0, across) : width + min(0, across)
            ]
        # A robot cannot stand there, however well the scan fits.
        total[~space.is_open] = 0
        return total

    def candidates(self, most: int) -> list[Candidate]:
        """Return at most *most* different places, the best first."""
        best = self._best.copy()
        full = _FULL * max(1, len(self._points))
        radius = max(1, round(APART / (self._space.stride * self._space.resolution)))
        candidates = []
        for _ in range(most):
            place = int(np.argmax(best))
            sector, row, column = (int(i) for i in np.unravel_index(place, best.shape))
            score = int(best[sector, row, column])
            if score == 0:
                break
            yaw = wrap_angle(math.tau * int(self._heading[sector, row, column]) / HEADINGS)
            candidates.append(Candidate(Pose2D(*self._space.place(row, column), yaw), score / full))
            around = (
                slice(max(0, row - radius), row + radius + 1),
                slice(max(0, column - radius), column + radius + 1),
            )
            for near in (sector - 1, sector, sector + 1):
                best[(near % SECTORS, *around)] = 0
        return candidates
