"""What a robot's cameras see: their pictures with what was found in them, and where they look."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.screen.row_buffer import RowBuffer, Series
from btcore_scene import Camera, Detection, MovingScene, Picture, StaticScene

CAMERA: Final = "camera"
_FOUND: Final = 0xFFD54AFF
_SIGHT: Final = 0xFFD54A90
_DEPTH: Final = 0.7
"""m; how long the pyramid of a camera's sight is drawn."""
_OLD: Final = 1_000_000_000
"""ns of the tree's clock; a picture that no other has followed within that is drawn faint, and says so."""
_FAINT: Final = 0.3
_WORDS: Final = 0xF5F7FAFF


class CameraView:
    """Draws pictures below the entity `CAMERA`, and pyramids of sight below *origin* in the scene."""

    def __init__(self, rows: RowBuffer, origin: str) -> None:
        self._rows = rows
        self._origin = origin
        self.pictured = False
        """Whether there has been a picture."""
        self._series: dict[tuple[str, str], Series[Any]] = {}
        self._ages: dict[tuple[str, str], _Age] = {}
        self._found: Series[Sequence[Detection]] = rows.series(f"{CAMERA}/detections", _boxes)
        self._shown: object = None

    def static(self, data: StaticScene) -> None:
        """Draw where cameras look."""
        for camera in data.cameras:
            entity = f"{self._origin}/sight/{camera.name}"
            lines = rr.LineStrips3D(_pyramid(camera), colors=[_SIGHT], radii=[-1.0])
            self._rows.log(entity, self._rows.in_frame(camera.frame), lines, static=True)

    def moving(self, t: int, wall: int, data: MovingScene) -> None:
        """New pictures, and what was found."""
        for picture in data.pictures:
            self.pictured = True
            key = picture.name, picture.format
            if key not in self._series:
                entity = f"{CAMERA}/pictures/{picture.name}"
                self._series[key] = self._rows.series(entity, _jpegs if key[1] == "jpeg" else _images)
                self._ages[key] = _Age(self._rows, picture)
            self._series[key].add(t, wall, picture)
            self._ages[key].renewed(t, wall)
        for age in self._ages.values():
            age.look(t, wall)
        found = data.detections
        if found is not None and found != self._shown:
            self._shown = found
            self._found.add(t, wall, found)


class _Age:
    """Lets a camera's picture, such as *picture*, fade when no other follows it."""

    def __init__(self, rows: RowBuffer, picture: Picture) -> None:
        name, drawn = picture.name, rr.EncodedImage if picture.format == "jpeg" else rr.Image
        self._middle = picture.size[0] / 2, picture.size[1] / 2
        self._opacity: Series[float] = rows.series(
            f"{CAMERA}/pictures/{name}", lambda values: drawn.columns(opacity=values)
        )
        self._words: Series[str] = rows.series(f"{CAMERA}/ages/{name}", self._said)
        self._seen = 0
        self._faint = False

    def renewed(self, t: int, wall: int) -> None:
        """There is a new picture."""
        self._seen = t
        if self._faint:
            self._faint = False
            self._opacity.add(t, wall, 1.0)
            self._words.add(t, wall, "")

    def look(self, t: int, wall: int) -> None:
        """Time went on."""
        if not self._faint and t - self._seen > _OLD:
            self._faint = True
            self._opacity.add(t, wall, _FAINT)
            self._words.add(t, wall, f"as of {self._seen / 1e9:.1f} s")

    def _said(self, values: list[str]) -> Iterable[Any]:
        words = [one for one in values if one]
        columns = rr.Points2D.columns(
            positions=np.array([self._middle] * len(words), dtype=np.float32).reshape(-1, 2),
            labels=words,
            show_labels=[True] * len(words),
            colors=[_WORDS] * len(words),
            radii=[0.0] * len(words),
        )
        return columns.partition([int(one != "") for one in values])


def _pyramid(camera: Camera) -> list[NDArray[np.float64]]:
    width, height = camera.size
    cx, cy = camera.center or ((width - 1) / 2, (height - 1) / 2)
    fx, fy = camera.focal
    columns, rows = np.array([0, width, width, 0, 0]), np.array([0, 0, height, height, 0])
    rim = _DEPTH * np.stack(((columns - cx) / fx, (rows - cy) / fy, np.ones(5)), axis=1)
    return [rim, *(np.stack((np.zeros(3), corner)) for corner in rim[:4])]


def _jpegs(pictures: list[Picture]) -> Iterable[Any]:
    return rr.EncodedImage.columns(
        blob=[one.data for one in pictures], media_type=["image/jpeg"] * len(pictures)
    )


def _images(pictures: list[Picture]) -> Iterable[Any]:
    formats = [
        rr.components.ImageFormat(
            width=one.size[0], height=one.size[1], color_model="RGB", channel_datatype="U8"
        )
        for one in pictures
    ]
    return rr.Image.columns(buffer=[one.data for one in pictures], format=formats)


def _boxes(values: list[Sequence[Detection]]) -> Iterable[Any]:
    there = [one for found in values for one in found]
    boxes = np.array([one.box for one in there], dtype=np.float32).reshape(-1, 4)
    columns = rr.Boxes2D.columns(
        centers=boxes[:, :2] + boxes[:, 2:] / 2,
        half_sizes=boxes[:, 2:] / 2,
        colors=np.full(len(there), _FOUND, dtype=np.uint32),
        radii=[-1.5] * len(there),
        labels=[one.name for one in there],
    )
    return columns.partition([len(found) for found in values])
