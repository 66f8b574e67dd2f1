"""The walls of a world that was made from a map: the map's occupied cells, extruded to the height of a room.

Cells are merged to rectangles. All rectangles together are a few static meshes of the physics engine, because
the time of a physics step grows with the number of bodies: on a map of 2,615 rectangles (1674 × 1006 cells) a
step takes 4 ms with a body for each rectangle, and 0.003 ms with one mesh.
"""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    # The module needs OpenCV, which the names of worlds do not.
    from btcore_robot.occupancy_map import OccupancyMap

WALL_HEIGHT = 2.5
"""Height (m) of the walls."""

WALL_COLOR = (217, 212, 199, 255)
"""Colour of the walls (RGBA, 0–255)."""

Floats = NDArray[np.float64]

_MESH = 4000  # rectangles in a mesh; PyBullet accepts 131,072 vertices, which is 16,384 rectangles

# The four sides of an upright box as triangles, by the numbers of its corners: 0–3 below, 4–7 above them.
_SIDES = np.array(
    [[a, b, b + 4, a, b + 4, a + 4] for a, b in ((0, 1), (1, 2), (2, 3), (3, 0))], dtype=np.int64
).ravel()


class MapWalls:
    """The walls of the world that *map* describes.

    Attributes:
        map: The map.
        rectangles: The smallest x, smallest y, greatest x and greatest y (m) of each piece of wall, shape
            `(n, 4)`. Together they cover exactly the occupied cells, without overlap.
    """

    def __init__(self, map: "OccupancyMap") -> None:
        self.map = map
        by_rows, by_columns = merge_cells(map.occupied), merge_cells(map.occupied.T)[:, [1, 0, 3, 2]]
        cells = by_rows if len(by_rows) <= len(by_columns) else by_columns
        self.rectangles: Floats = np.tile(map.origin, 2) + cells * map.resolution

    @cached_property
    def known(self) -> tuple[float, float, float, float]:
        """The bounding rectangle (m) of the cells that are not unknown; without any, the map's bounds."""
        rows, cols = np.nonzero(~self.map.unknown)
        if not len(rows):
            return self.map.bounds
        (x0, y0), (x1, y1) = self.map.origin, self.map.origin
        side = self.map.resolution
        return (
            x0 + int(cols.min()) * side,
            y0 + int(rows.min()) * side,
            x1 + (int(cols.max()) + 1) * side,
            y1 + (int(rows.max()) + 1) * side,
        )

    def distance(self, x: float, y: float) -> float:
        """Return the distance (m) from a point to the nearest wall; inf without walls, 0 off the free floor.

        Args:
            x: The x coordinate of the point in the world frame (m).
            y: The y coordinate of the point in the world frame (m).
        """
        if not self.map.inside(x, y) or not self.map.free[self.map.cell(x, y)]:
            return 0.0
        x0, y0, x1, y1 = self.rectangles.T
        away = np.hypot(
            np.maximum(np.maximum(x0 - x, x - x1), 0.0), np.maximum(np.maximum(y0 - y, y - y1), 0.0)
        )
        return float(away.min(initial=np.inf))

    def boxes(self) -> list[tuple[tuple[float, float, float], tuple[float, float, float]]]:
        """Return the size and the middle (x, y, z in m) of each piece of wall."""
        low, high = self.rectangles[:, :2], self.rectangles[:, 2:]
        sizes, middles = (high - low).tolist(), ((low + high) / 2).tolist()
        return [
            ((dx, dy, WALL_HEIGHT), (x, y, WALL_HEIGHT / 2))
            for (dx, dy), (x, y) in zip(sizes, middles, strict=True)
        ]

    def meshes(self) -> list[tuple[list[list[float]], list[int]]]:
        """Return the walls as triangle meshes: the vertices (x, y, z in m), and three indices a triangle."""
        return [
            _mesh(self.rectangles[first : first + _MESH]) for first in range(0, len(self.rectangles), _MESH)
        ]


def merge_cells(mask: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return rectangles that cover the cells of *mask*.

    The cells of a row that touch are a run. Equal runs in consecutive rows become a rectangle.

    Args:
        mask: The cells, shape `(rows, columns)`.

    Returns:
        The first column, the first row, and the column and the row after the last of each rectangle, shape
        `(n, 4)`.
    """
    edges = np.diff(np.pad(mask, ((0, 0), (1, 1))).astype(np.int8), axis=1)
    rows, firsts = np.nonzero(edges == 1)
    ends = np.nonzero(edges == -1)[1]
    order = np.lexsort((rows, ends, firsts))
    rows, firsts, ends = rows[order], firsts[order], ends[order]
    continued = (firsts[1:] == firsts[:-1]) & (ends[1:] == ends[:-1]) & (rows[1:] == rows[:-1] + 1)
    begins = np.flatnonzero(np.concatenate((np.ones(min(len(rows), 1), dtype=np.bool_), ~continued)))
    lasts = np.append(begins[1:], len(rows)) - 1 if len(rows) else begins
    return np.stack((firsts[begins], rows[begins], ends[begins], rows[lasts] + 1), axis=1)


def _mesh(rectangles: Floats) -> tuple[list[list[float]], list[int]]:
    count = len(rectangles)
    corners = rectangles[:, [0, 1, 2, 1, 2, 3, 0, 3]].reshape(count, 4, 2)
    vertices = np.zeros((count, 8, 3))
    vertices[:, :4, :2] = vertices[:, 4:, :2] = corners
    vertices[:, 4:, 2] = WALL_HEIGHT
    indices = _SIDES + 8 * np.arange(count)[:, None]
    return vertices.reshape(-1, 3).tolist(), indices.ravel().tolist()
