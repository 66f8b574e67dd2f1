"""Maps, costmaps, named places and keep-out areas on the floor of a scene."""

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.screen.row_buffer import RowBuffer, Series, entity_part, image_format
from btcore_monitor.screen.style import Palette
from btcore_scene import Grid, MovingScene, StaticScene

_KEPT_OUT: Final = 0xFF6B6BB0
_LAYERS: Final = {"occupancy": 0.004, "costs": 0.012}
"""Height (m) of a grid above the floor, by the grid's kind."""
_STEP: Final = 0.006
"""Height (m) that is added for each grid that was received earlier, so that grids do not coincide."""
_OPACITY: Final = 0.99
"""Slightly below 1, because the viewer ignores the alpha of colours in an opaque image."""
_HATCH: Final = 0.25
"""Distance (m) between the strokes of an area's hatching."""
_MAX_STROKES: Final = 200

Rgba = NDArray[np.uint8]


def _mix_colours(low: Sequence[int], high: Sequence[int], count: int) -> Rgba:
    share = np.linspace(0.0, 1.0, count)[:, None]
    return np.rint(np.array(low) * (1 - share) + np.array(high) * share).astype(np.uint8)


def _occupancy_colours() -> Rgba:
    """Return the colours of the cell values, shape `(256, 4)`: 0 free … 100 occupied, 255 unknown."""
    # Unknown cells (-1, read as 255) stay transparent.
    colours = np.zeros((256, 4), dtype=np.uint8)
    colours[:101] = _mix_colours((52, 66, 88, 150), (150, 174, 210, 255), 101)
    return colours


def _cost_colours() -> Rgba:
    """Return the colours of Nav2's costs, as in RViz, shape `(256, 4)`.

    Costs from 1 to 252 are blue to red. 253 (the robot's centre must not be there) is cyan, and 254 (an
    obstacle) is magenta.
    """
    colours = np.zeros((256, 4), dtype=np.uint8)
    colours[1:253] = _mix_colours((0, 40, 255, 34), (255, 30, 20, 150), 252)
    colours[253] = (0, 225, 225, 120)
    colours[254] = (255, 0, 220, 190)
    return colours


_COLOURS: Final = {"occupancy": _occupancy_colours(), "costs": _cost_colours()}


class Floor:
    """The drawing of grids, places and areas below the entity *origin*."""

    def __init__(self, rows: RowBuffer, palette: Palette, origin: str) -> None:
        self._rows = rows
        self._palette = palette
        self._origin = origin
        self._grids: dict[str, Series[Grid]] = {}

    def draw_static(self, data: StaticScene, root: str) -> None:
        """Draw static data and the present grids.

        Args:
            data: The scene.
            root: The frame of data that names no frame.
        """
        log = self._rows.log
        places = data.places
        if places:
            points = rr.Points3D(
                [place.position for place in places],
                labels=[place.name for place in places],
                colors=np.full(len(places), self._palette.text, dtype=np.uint32),
                radii=[0.06],
                show_labels=True,
            )
            log(f"{self._origin}/places", self._rows.in_frame(root), points, static=True)
        if data.areas:
            strips = [strip for area in data.areas for strip in _hatch(*area.corners)]
            drawn = rr.LineStrips3D(strips, colors=[_KEPT_OUT], radii=[0.012])
            log(f"{self._origin}/areas", self._rows.in_frame(root), drawn, static=True)
        # Not logged as static: in rerun, static data hides data that is logged later.
        self.draw_moving(data, root)

    def draw_moving(self, data: StaticScene | MovingScene, root: str) -> None:
        """Draw the grids that have changed; see `static` for the parameters."""
        for grid in data.grids:
            self._known(grid, root).add(grid)

    def _known(self, grid: Grid, root: str) -> Series[Grid]:
        series = self._grids.get(grid.name)
        if series is None:
            entity = f"{self._origin}/grids/{entity_part(grid.name)}"
            height = _LAYERS[grid.kind] + _STEP * len(self._grids)
            encode = partial(_create_grid_columns, height=height)
            series = self._grids[grid.name] = self._rows.create_series(entity, encode)
            frame = self._rows.in_frame(grid.frame or root)
            self._rows.log(entity, frame, static=True)
        return series


def image(grid: Grid) -> Rgba:
    """Return the colours of a grid's cells, the highest row first, shape `(rows, columns, 4)`."""
    width, height = grid.size
    cells = np.frombuffer(grid.cells, dtype=np.uint8).reshape(height, width)
    # The first row of a grid is the lowest, the first row of an image is the highest.
    return _COLOURS[grid.kind][cells[::-1]]


def _create_grid_columns(grids: list[Grid], height: float) -> Iterable[Any]:
    return rr.GridMap.columns(
        data=[image(grid).tobytes() for grid in grids],
        format=[image_format(grid.size, "RGBA") for grid in grids],
        cell_size=[grid.resolution for grid in grids],
        translation=[[*grid.origin, height] for grid in grids],
        opacity=[_OPACITY] * len(grids),
    )


def _hatch(xmin: float, ymin: float, xmax: float, ymax: float) -> list[list[tuple[float, float, float]]]:
    """Return the outline of a rectangle, and diagonal strokes across it."""
    z = 0.03
    strokes = [[(xmin, ymin, z), (xmax, ymin, z), (xmax, ymax, z), (xmin, ymax, z), (xmin, ymin, z)]]
    edges = (xmax - xmin) + (ymax - ymin)
    for along in np.arange(_HATCH, edges, max(_HATCH, edges / _MAX_STROKES)):
        start = xmin + min(along, xmax - xmin), ymin + max(0.0, along - (xmax - xmin)), z
        end = xmin + max(0.0, along - (ymax - ymin)), ymin + min(along, ymax - ymin), z
        strokes.append([start, end])
    return strokes
