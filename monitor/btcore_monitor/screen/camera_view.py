"""The pictures of a robot's cameras with detected objects, and the cameras' fields of view."""

from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.screen.row_buffer import RowBuffer, Series, entity_part, image_format
from btcore_scene import Camera, Detection, MovingScene, Picture, StaticScene

CAMERA: Final = "camera"
_DETECTED: Final = 0xFFD54AFF
_SIGHT: Final = 0xFFD54A90
_DEPTH: Final = 0.4
"""Length (m) of the pyramid that shows a camera's field of view."""
_MIN_FOCAL_LENGTH: Final = 1e-3
"""Minimum focal length (pixels); a camera without focal length has no field of view."""
_OLD: Final = 1_000_000_000
"""Age (ns of the tree's clock) above which a picture is drawn faint, with the time when it was taken."""
_FAINT: Final = 0.3
_PICTURE_INTERVAL_NS: Final = 150_000_000
"""Smallest time (ns of the tree's clock) between two recorded pictures: of pictures at 10 Hz, 5 Hz remain."""
_TEXT_COLOUR: Final = 0xF5F7FAFF


class CameraView:
    """The drawing of pictures (below the entity `CAMERA`) and of fields of view (below *origin*)."""

    def __init__(self, rows: RowBuffer, origin: str) -> None:
        self._rows = rows
        self._origin = origin
        self.has_pictures = False
        """Whether a picture has been received."""
        self._series: dict[tuple[str, str], Series[Any]] = {}
        self._recorded: dict[tuple[str, str], int] = {}
        self._ages: dict[tuple[str, str], _Age] = {}
        self._detections: Series[Sequence[Detection]] = rows.create_series(
            f"{CAMERA}/detections", _create_box_columns
        )
        self._shown: object = None

    def draw_static(self, data: StaticScene) -> None:
        """Draw the cameras' fields of view."""
        for camera in data.cameras:
            if min(map(abs, camera.focal)) < _MIN_FOCAL_LENGTH:
                continue
            entity = f"{self._origin}/sight/{entity_part(camera.name)}"
            # A negative radius is in pixels of the screen (in rerun).
            lines = rr.LineStrips3D(_create_pyramid(camera), colors=[_SIGHT], radii=[-1.0])
            self._rows.log(entity, self._rows.in_frame(camera.frame), lines, static=True)

    def draw_moving(self, data: MovingScene) -> None:
        """Draw new pictures and detections."""
        for picture in data.pictures:
            self.has_pictures = True
            key = picture.name, picture.format
            if key not in self._series:
                entity = f"{CAMERA}/pictures/{entity_part(picture.name)}"
                self._series[key] = self._rows.create_series(
                    entity, _create_jpeg_columns if key[1] == "jpeg" else _create_image_columns
                )
                self._ages[key] = _Age(self._rows, picture)
            before, stamp = self._recorded.get(key), self._rows.stamp
            # The time of a new run may begin again.
            if before is None or stamp < before or stamp >= before + _PICTURE_INTERVAL_NS:
                self._recorded[key] = stamp
                self._series[key].add(picture)
            self._ages[key].renew()
        for age in self._ages.values():
            age.update()
        detections = data.detections
        if detections is not None and detections != self._shown:
            self._shown = detections
            self._detections.add(detections)


class _Age:
    """The fading of a camera's *picture* when no new picture follows."""

    def __init__(self, rows: RowBuffer, picture: Picture) -> None:
        self._rows = rows
        name, drawn = entity_part(picture.name), rr.EncodedImage if picture.format == "jpeg" else rr.Image
        self._middle = picture.size[0] / 2, picture.size[1] / 2
        self._opacity: Series[float] = rows.create_series(
            f"{CAMERA}/pictures/{name}", lambda values: drawn.columns(opacity=values)
        )
        self._captions: Series[str] = rows.create_series(
            f"{CAMERA}/ages/{name}", self._create_caption_columns
        )
        self._seen = 0
        self._is_faint = False

    def renew(self) -> None:
        """Show a new picture without fading."""
        self._seen = self._rows.stamp
        if self._is_faint:
            self._is_faint = False
            self._opacity.add(1.0)
            self._captions.add("")

    def update(self) -> None:
        """Fade the picture if it is too old."""
        if not self._is_faint and self._rows.stamp - self._seen > _OLD:
            self._is_faint = True
            self._opacity.add(_FAINT)
            self._captions.add(f"as of {self._rows.to_seconds(self._seen):.1f} s")

    def _create_caption_columns(self, values: list[str]) -> Iterable[Any]:
        captions = [text for text in values if text]
        columns = rr.Points2D.columns(
            positions=np.array([self._middle] * len(captions), dtype=np.float32).reshape(-1, 2),
            labels=captions,
            show_labels=[True] * len(captions),
            colors=[_TEXT_COLOUR] * len(captions),
            radii=[0.0] * len(captions),
        )
        return columns.partition([int(text != "") for text in values])


def _create_pyramid(camera: Camera) -> list[NDArray[np.float64]]:
    width, height = camera.size
    # The first pixel's centre is at 0, so the picture's centre is at (width - 1) / 2.
    cx, cy = camera.center or ((width - 1) / 2, (height - 1) / 2)
    fx, fy = camera.focal
    columns, rows = np.array([0, width, width, 0, 0]), np.array([0, 0, height, height, 0])
    rim = _DEPTH * np.stack(((columns - cx) / fx, (rows - cy) / fy, np.ones(5)), axis=1)
    return [rim, *(np.stack((np.zeros(3), corner)) for corner in rim[:4])]


def _create_jpeg_columns(pictures: list[Picture]) -> Iterable[Any]:
    return rr.EncodedImage.columns(
        blob=[picture.data for picture in pictures], media_type=["image/jpeg"] * len(pictures)
    )


def _create_image_columns(pictures: list[Picture]) -> Iterable[Any]:
    formats = [image_format(picture.size, "RGB") for picture in pictures]
    return rr.Image.columns(buffer=[picture.data for picture in pictures], format=formats)


def _create_box_columns(values: list[Sequence[Detection]]) -> Iterable[Any]:
    all_detections = [detection for detections in values for detection in detections]
    boxes = np.array([detection.box for detection in all_detections], dtype=np.float32).reshape(-1, 4)
    columns = rr.Boxes2D.columns(
        centers=boxes[:, :2] + boxes[:, 2:] / 2,
        half_sizes=boxes[:, 2:] / 2,
        colors=np.full(len(all_detections), _DETECTED, dtype=np.uint32),
        radii=[-1.5] * len(all_detections),
        labels=[detection.name for detection in all_detections],
    )
    return columns.partition([len(detections) for detections in values])
