"""Where on the whole map a scan may have been taken: every free place, every heading, a slice at a time."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from btcore_robot.navigation.likelihood import distances
from btcore_robot.navigation.occupancy_map import OccupancyMap
from btcore_robot.rigid_transform import wrap_angle
from btcore_robot.robot import Pose2D

Floats = NDArray[np.float64]

SPACING = 0.1
"""How far (m) the places that are tried lie apart, or the map's resolution if that is coarser."""
HEADINGS = 120
"""How many headings are tried at each place: every 3 degrees."""
SECTORS = 12
"""Of the headings within a sector of 30 degrees the best one is kept for each place."""
BLUR = 0.2
"""How far (m, one deviation) off a wall a beam may end: half of SPACING, and 3 degrees at 4 m."""
CLEARANCE = 0.25
"""No robot's centre is nearer (m) to what is mapped."""
APART = 0.5
"""Two places nearer (m) than this, with headings less than a sector apart, are one."""

_FULL = 255  # what a beam scores that ends on a wall; a hundred beams fit into 16 bits


@dataclass(frozen=True, slots=True)
class Candidate:
    """A pose, and the share (0 … 1) of a perfect score that its beams have."""

    pose: Pose2D
    score: float


class SearchSpace:
    """What of a map is the same for every search. Built once, as the images are large."""

    def __init__(self, field_map: OccupancyMap) -> None:
        self.stride = max(1, round(SPACING / field_map.resolution))
        self.resolution = field_map.resolution
        self.origin = field_map.origin
        distance = distances(field_map, 10.0 * BLUR)
        image = np.rint(_FULL * np.exp(-((distance / BLUR) ** 2) / 2.0)).astype(np.uint16)
        # A beam's end, seen from every stride-th cell, falls on every stride-th cell: one small image for
        # each remainder makes all of them neighbours in memory.
        step = self.stride
        rows, columns = (math.ceil(length / step) for length in field_map.cells.shape)
        padded = np.zeros((rows * step, columns * step), dtype=np.uint16)
        padded[: field_map.height, : field_map.width] = image
        self.parts = [
            [np.ascontiguousarray(padded[row::step, column::step]) for column in range(step)]
            for row in range(step)
        ]
        room = np.zeros(padded.shape, dtype=np.bool_)
        room[: field_map.height, : field_map.width] = field_map.free & (distance >= CLEARANCE)
        self.room = room[::step, ::step]

    def place(self, row: int, column: int) -> tuple[float, float]:
        """The x and y (m) of a place that is tried."""
        return (
            self.origin[0] + (column * self.stride + 0.5) * self.resolution,
            self.origin[1] + (row * self.stride + 0.5) * self.resolution,
        )


class GlobalSearch:
    """One search for *points*, where beams end in the robot's frame (m; shape ``(k, 2)``).

    `advance` does a slice of the work until it says that all is done; then `candidates` has the best places.
    """

    def __init__(self, space: SearchSpace, points: Floats) -> None:
        self._space = space
        self._points = points
        self._next = 0
        self._best = np.zeros((SECTORS, *space.room.shape), dtype=np.uint16)
        self._heading = np.zeros((SECTORS, *space.room.shape), dtype=np.uint8)

    def advance(self, headings: int) -> bool:
        """Try so many *headings* more at every place; whether all have been tried."""
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
        height, width = space.room.shape
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
        total[~space.room] = 0
        return total

    def candidates(self, most: int) -> list[Candidate]:
        """The best places, best first, no two of them the same; at most *most*."""
        best = self._best.copy()
        full = _FULL * max(1, len(self._points))
        radius = max(1, round(APART / (self._space.stride * self._space.resolution)))
        found = []
        for _ in range(most):
            place = int(np.argmax(best))
            sector, row, column = (int(i) for i in np.unravel_index(place, best.shape))
            score = int(best[sector, row, column])
            if score == 0:
                break
            yaw = wrap_angle(math.tau * int(self._heading[sector, row, column]) / HEADINGS)
            found.append(Candidate(Pose2D(*self._space.place(row, column), yaw), score / full))
            around = (
                slice(max(0, row - radius), row + radius + 1),
                slice(max(0, column - radius), column + radius + 1),
            )
            for near in (sector - 1, sector, sector + 1):
                best[(near % SECTORS, *around)] = 0
        return found
