"""Occupancy maps and their files in the format of ROS 2's map_server.

A map is a YAML file with the name of an image and the rules for reading it:

    image: house.pgm
    resolution: 0.05            # m a pixel
    origin: [-9.93, -14.1, 0]   # x, y (m) of the lower-left corner in the frame map; yaw
    negate: 0
    occupied_thresh: 0.65
    free_thresh: 0.25
    mode: trinary               # or scale, or raw

Row 0 of the image has the highest y, row 0 of `OccupancyMap.cells` the lowest. Areas that a robot must not
enter, such as a table of which the laser sees only the legs, are rectangles in `house.keepout.yaml` beside
the map:

    keepout: [[xmin, ymin, xmax, ymax], …]
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import cv2
import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from btcore.input_files import read_file
from btcore.output_files import write_file
from btcore.typed_data import DataError, FieldError, Positive, convert
from btcore_robot.data_files import yaml_data
from btcore_robot.errors import RobotError

__all__ = [
    "Grid",
    "MapError",
    "MapImageError",
    "OccupancyMap",
    "Rectangle",
    "keepout_path",
    "load_map",
    "save_map",
]

Rectangle = tuple[float, float, float, float]
"""xmin, ymin, xmax, ymax (m) in the frame map."""

OCCUPIED_THRESHOLD = 0.65
"""Pixels at least this dark (0 white, 1 black) are occupied: the value of map_saver and map_server."""
FREE_THRESHOLD = 0.25
"""Pixels at most this dark are free: the value that map_saver writes."""

MAX_CELLS = 64_000_000
"""The maximum number of cells of a map that is read: 400 m x 400 m with cells of 5 cm."""

_WHITE, _BLACK = 254, 0
# map_saver's 205 is only 0.196 dark: with the threshold that map_saver writes, such a pixel would be free.
_GREY = 128
_RAW_UNKNOWN = 255


class MapError(RobotError):
    """A map can't be read, written or created; the message has the place, the reason and a remedy."""


class MapImageError(MapError):
    """The image of a map can't be read."""


class _MapFile(msgspec.Struct):
    image: str
    resolution: Positive
    origin: Annotated[tuple[float, ...], Meta(min_length=2, max_length=3)]
    negate: Literal[0, 1] | bool = False
    occupied_thresh: float = OCCUPIED_THRESHOLD
    free_thresh: float = FREE_THRESHOLD
    mode: Literal["trinary", "scale", "raw"] = "trinary"

    def __post_init__(self) -> None:
        if len(self.origin) == 3 and self.origin[2] != 0:
            turn = f"rotates the map by {self.origin[2]:g} rad, which is not supported"
            raise FieldError("origin", f"{turn}: rotate the image instead")
        free, occupied = self.free_thresh, self.occupied_thresh
        if self.mode != "raw" and not 0 <= free < occupied <= 1:
            key = "free_thresh" if free != FREE_THRESHOLD else "occupied_thresh"
            rule = f"0 ≤ free_thresh ({free:g}) < occupied_thresh ({occupied:g}) ≤ 1"
            raise FieldError(key, f"must satisfy {rule}")


class _KeepoutFile(msgspec.Struct):
    keepout: tuple[Rectangle, ...]

    def __post_init__(self) -> None:
        for xmin, ymin, xmax, ymax in self.keepout:
            if not (xmin < xmax and ymin < ymax):
                raise FieldError(
                    "keepout",
                    f"has the rectangle [{xmin:g}, {ymin:g}, {xmax:g}, {ymax:g}], but the order is "
                    "[xmin, ymin, xmax, ymax] with xmin < xmax and ymin < ymax",
                )


class Grid:
    """Square cells with a side of *resolution* (m); *origin* (m) is the first cell's lower-left corner."""

    __slots__ = ()
    resolution: float
    origin: tuple[float, float]

    def cell(self, x: float, y: float) -> tuple[int, int]:
        """Return the row and column of the cell that contains a point.

        Args:
            x: The point's x coordinate (m) in the grid's frame.
            y: The point's y coordinate (m) in the grid's frame.

        Returns:
            The row and column. For a point off the grid they are negative or too large.
        """
        return (
            math.floor((y - self.origin[1]) / self.resolution),
            math.floor((x - self.origin[0]) / self.resolution),
        )

    def center(self, row: int, col: int) -> tuple[float, float]:
        """Return the x and y (m) of a cell's centre in the grid's frame.

        Args:
            row: The row of the cell; row 0 has the lowest y.
            col: The column of the cell; column 0 has the lowest x.
        """
        return (
            self.origin[0] + (col + 0.5) * self.resolution,
            self.origin[1] + (row + 0.5) * self.resolution,
        )


@dataclass(frozen=True, slots=True, eq=False)
class OccupancyMap(Grid):
    """A map of the floor in square cells.

    *cells* is int8 of shape `(height, width)`: 0 is free, 100 occupied, a value between them a likelihood
    in percent, and -1 unknown; row 0 has the lowest y. *resolution* (m) is the side length of a cell,
    *origin* (m) the lower-left corner of the first cell in the frame map. The robot must stay out of the
    rectangles *keepout*, even where the cells are free.

    Raises:
        MapError: The cells are not two-dimensional, there are no cells, or the resolution is not a positive
            number.

    Examples:
        >>> import numpy as np
        >>> from btcore_robot.occupancy_map import OccupancyMap
        >>> cells = np.zeros((20, 30), dtype=np.int8)
        >>> room = OccupancyMap(cells, resolution=0.05, origin=(0.0, 0.0))
        >>> room.cells.shape
        (20, 30)
    """

    cells: NDArray[np.int8]
    resolution: float
    origin: tuple[float, float]
    keepout: tuple[Rectangle, ...] = ()

    def __post_init__(self) -> None:
        if self.cells.ndim != 2 or self.cells.size == 0:
            raise MapError(f"a map needs rows and columns, but these cells have the shape {self.cells.shape}")
        if not (math.isfinite(self.resolution) and self.resolution > 0):
            raise MapError(f"the side of a cell must be greater than 0 m, not {self.resolution}")

    @property
    def height(self) -> int:
        """The number of rows."""
        return len(self.cells)

    @property
    def width(self) -> int:
        """The number of columns."""
        return len(self.cells[0])

    @property
    def bounds(self) -> Rectangle:
        """The map's outer edges (m) in the frame map."""
        x, y = self.origin
        return x, y, x + self.width * self.resolution, y + self.height * self.resolution

    @property
    def occupied(self) -> NDArray[np.bool_]:
        """The mask of cells that are certainly occupied (100), shape `(height, width)`."""
        mask: NDArray[np.bool_] = self.cells == 100
        return mask

    @property
    def free(self) -> NDArray[np.bool_]:
        """The mask of cells that are certainly free (0), shape `(height, width)`."""
        mask: NDArray[np.bool_] = self.cells == 0
        return mask

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """The mask of unknown cells (-1), shape `(height, width)`."""
        mask: NDArray[np.bool_] = self.cells == -1
        return mask

    def inside(self, x: float, y: float) -> bool:
        """Return whether a point is on the map.

        Args:
            x: The point's x coordinate (m) in the frame map.
            y: The point's y coordinate (m) in the frame map.
        """
        row, col = self.cell(x, y)
        return 0 <= row < self.height and 0 <= col < self.width

    def indices(self, points: NDArray[np.floating]) -> NDArray[np.intp]:
        """Return the row and column of each point, shape `(n, 2)`, also for points off the map.

        Args:
            points: The points (x, y in m), shape `(n, 2)`.
        """
        places = np.floor((points - np.asarray(self.origin)) / self.resolution)
        cells: NDArray[np.intp] = places[:, ::-1].astype(np.intp)
        return cells

    def centers(self, rows: NDArray[np.integer], cols: NDArray[np.integer]) -> NDArray[np.float64]:
        """Return the x and y (m) of the centres of cells, shape `(n, 2)`.

        Args:
            rows: The rows of the cells, shape `(n,)`.
            cols: The columns of the cells, shape `(n,)`.
        """
        places = np.stack((cols, rows), axis=1) + 0.5
        return np.asarray(self.origin) + places * self.resolution

    def keepout_mask(self) -> NDArray[np.bool_]:
        """Return the mask of cells that the keep-out rectangles touch, shape `(height, width)`."""
        mask = np.zeros(self.cells.shape, dtype=np.bool_)
        for xmin, ymin, xmax, ymax in self.keepout:
            low_row, low_col = self.cell(xmin, ymin)
            rows = slice(max(0, low_row), max(0, _ceiling((ymax - self.origin[1]) / self.resolution)))
            cols = slice(max(0, low_col), max(0, _ceiling((xmax - self.origin[0]) / self.resolution)))
            mask[rows, cols] = True
        return mask


def _ceiling(cells: float) -> int:
    # Rounding must not move an edge off the grid: (0.1 + 0.2) / 0.05 is slightly more than 6.
    return math.ceil(cells - 1e-9)


def load_map(path: Path) -> OccupancyMap:
    """Return the map in the YAML file at *path*, read by map_server's rules.

    The keep-out rectangles are read from `keepout_path`, if that file exists.

    Raises:
        MapError: A file cannot be read or is invalid; the message has the file and the line.
        MapImageError: This file is the image.
    """
    with yaml_data(path, "a map, not an image", MapError) as data:
        file = convert(data, _MapFile)
    with yaml_data(path, "a map", MapImageError):
        pixels, opaque = _read_image(file.image, path)
    if file.mode == "raw":
        cells = np.where(pixels <= 100, pixels, -1).astype(np.int8)
    else:
        dark = pixels / 255.0 if file.negate else (255.0 - pixels) / 255.0
        cells = _occupancy(dark, file.occupied_thresh, file.free_thresh, scaled=file.mode == "scale")
        cells[~opaque] = -1
    cells = np.ascontiguousarray(np.flipud(cells))
    origin = file.origin[0], file.origin[1]
    return OccupancyMap(cells, file.resolution, origin, _load_keepout(keepout_path(path)))


def save_map(map: OccupancyMap, path: Path) -> None:
    """Write a map as a YAML file, a PGM image beside it, and a keep-out file if the map has keep-outs.

    `load_map` restores the same cells: a map with likelihoods between free and occupied is written in mode
    raw.

    Args:
        map: The map to write.
        path: The YAML file; the names of the other files are derived from it.

    Raises:
        MapError: A file cannot be written.
    """
    cells = np.flipud(map.cells)
    if np.isin(cells, (-1, 0, 100)).all():
        mode = "trinary"
        image = np.select([cells == 0, cells == 100], [_WHITE, _BLACK], _GREY).astype(np.uint8)
    else:
        mode = "raw"
        is_known = (cells >= 0) & (cells <= 100)
        image = np.where(is_known, cells.astype(np.uint8), _RAW_UNKNOWN).astype(np.uint8)
    image_file = path.with_suffix(".pgm")
    contents = {
        image_file: b"P5\n%d %d\n255\n" % (map.width, map.height) + image.tobytes(),
        path: (
            f'image: "{image_file.name}"\nmode: {mode}\nresolution: {map.resolution!r}\n'
            f"origin: [{map.origin[0]!r}, {map.origin[1]!r}, 0]\nnegate: 0\n"
            f"occupied_thresh: {OCCUPIED_THRESHOLD}\nfree_thresh: {FREE_THRESHOLD}\n"
        ).encode(),
    }
    beside = keepout_path(path)
    if map.keepout:
        lines = [f"  - [{', '.join(repr(float(edge)) for edge in rectangle)}]\n" for rectangle in map.keepout]
        contents[beside] = ("keepout: # xmin, ymin, xmax, ymax (m)\n" + "".join(lines)).encode()
    try:
        if not map.keepout:
            beside.unlink(missing_ok=True)
        for file, content in contents.items():
            write_file(file, content)
    except OSError as error:
        raise MapError(f"{error.filename}: cannot write the map: {error.strerror}") from None


def keepout_path(path: Path) -> Path:
    """Return the path of the file with the keep-out rectangles of the map at *path* (a YAML file)."""
    return path.with_name(f"{path.stem}.keepout.yaml")


def _occupancy(dark: NDArray[np.float64], occupied: float, free: float, *, scaled: bool) -> NDArray[np.int8]:
    cells = np.full(dark.shape, -1, dtype=np.int8)
    if scaled:
        cells[:] = np.rint(np.clip((dark - free) / (occupied - free), 0.0, 1.0) * 100)
    cells[dark <= free] = 0
    cells[dark >= occupied] = 100
    return cells


def _read_image(name: str, path: Path) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    file = path.parent / name
    try:
        content = np.frombuffer(read_file(file), dtype=np.uint8)
    except FileNotFoundError:
        raise DataError(("image",), f"is '{name}', but there is no file {file}") from None
    except OSError as error:
        raise DataError(("image",), f"is '{name}', which cannot be read: {error.strerror}") from None
    too_large = DataError(("image",), f"is '{name}', which has more than {MAX_CELLS:,} pixels")
    if _png_pixels(content) > MAX_CELLS:
        raise too_large
    try:
        image = cv2.imdecode(content, cv2.IMREAD_UNCHANGED) if content.size else None
    except cv2.error:
        image = None
    if image is None:
        raise DataError(("image",), f"is '{name}', which is not a readable image: use a PGM or PNG file")
    if image.shape[0] * image.shape[1] > MAX_CELLS:
        raise too_large
    pixels = np.atleast_3d(image).astype(np.float64)
    if image.dtype == np.uint16:
        pixels /= 257.0  # 65535 becomes 255
    channels = pixels.shape[2]
    opaque = pixels[:, :, channels - 1] == 255 if channels in (2, 4) else np.ones(pixels.shape[:2], np.bool_)
    colors = channels - 1 if channels in (2, 4) else channels
    grey: NDArray[np.float64] = pixels[:, :, :colors].mean(axis=2)
    return grey, opaque


def _png_pixels(content: NDArray[np.uint8]) -> int:
    """Return the number of pixels of a PNG image, of which a small file can describe billions; else 0."""
    if bytes(content[:8]) != b"\x89PNG\r\n\x1a\n" or len(content) < 24:
        return 0
    return int.from_bytes(content[16:20].tobytes()) * int.from_bytes(content[20:24].tobytes())


def _load_keepout(path: Path) -> tuple[Rectangle, ...]:
    if not path.exists():
        return ()
    with yaml_data(path, "keep-outs", MapError) as data:
        return convert(data, _KeepoutFile).keepout
