"""The scene of a robot in the file of `--save`, to be shown beside a recording of the same run."""

from collections.abc import Iterator
from pathlib import Path
from typing import Final, cast

import pyarrow as pa
import rerun as rr
from rerun.chunk import Chunk, RrdReader

from btcore_monitor.screen.camera_view import CAMERA
from btcore_monitor.screen.panels import TICK_MS
from btcore_monitor.screen.rerun_process import ScreenError
from btcore_monitor.screen.row_buffer import TREE_TIMELINE
from btcore_monitor.screen.scene_view import BATTERY, COLOURS, ORIGIN, SPEED, Eye

_ENTITIES: Final = (ORIGIN, CAMERA, SPEED, BATTERY, COLOURS)
_EYE: Final = "EyeControls3D"
_Point = tuple[float, float, float]


class SavedScene:
    """The scene in *file*, in which the tick number *tick* is moved to *time* (ns).

    Attributes:
        eye: From where the scene is shown.
        has_speed: Whether it has the speed of the robot.

    Raises:
        ScreenError: The file cannot be read, has no scene, or does not have this tick.
    """

    def __init__(self, file: Path, tick: int, time: int) -> None:
        entities: set[str] = set()
        ticks: list[int] = []
        try:
            self._reader = RrdReader(file)
            for chunk in self._reader.stream():
                if not chunk.is_static or _first(chunk) == COLOURS:
                    entities.add(f"{chunk.entity_path}/")
                if chunk.entity_path == f"/{TICK_MS}" and not chunk.is_static:
                    ticks += chunk.to_record_batch().column(TREE_TIMELINE).cast("int64").to_pylist()
            position, target, robot = self._read_eye()
        except (OSError, RuntimeError, ValueError) as error:
            raise ScreenError(f"cannot read the scene {file}: {error}") from None
        if position is None or target is None:
            raise ScreenError(
                f"{file} has no scene: btcore run --save {file} writes that of a simulated robot"
            )
        if not 0 < tick <= len(ticks):
            raise ScreenError(
                f"{file} is of another run: it has {len(ticks):,} ticks, but the recording begins with tick "
                f"{tick:,}"
            )
        self._shift = time - sorted(ticks)[tick - 1]

        def has(path: str) -> bool:
            return any(entity.startswith(f"/{path}/") for entity in entities)

        self.has_speed = has(SPEED)
        self.eye = Eye(
            position,
            target,
            robot,
            has_pictures=has(f"{CAMERA}/pictures"),
            has_battery=has(BATTERY),
            has_navigation=has(COLOURS),
        )

    def _read_eye(self) -> tuple[_Point | None, _Point | None, str]:
        """Return the position and the target of the eye, and the entity of the robot, of the last layout."""
        position, target, robot = None, None, ""
        for chunk in self._reader.stream(store=self._reader.blueprints()[-1]):
            batch = chunk.to_record_batch()
            if f"{_EYE}:position" not in batch.schema.names:
                continue
            if f"{_EYE}:tracking_entity" in batch.schema.names:
                robot = str(batch.column(f"{_EYE}:tracking_entity")[-1].as_py()[0]).removeprefix("/")
            else:
                position, target = (
                    cast(_Point, tuple(batch.column(f"{_EYE}:{name}")[-1].as_py()[0]))
                    for name in ("position", "look_target")
                )
        return position, target, robot

    def copy_to(self, recording: rr.RecordingStream) -> None:
        """Send the scene to *recording*."""
        recording.send_chunks(self._chunks())

    def _chunks(self) -> Iterator[Chunk]:
        for chunk in self._reader.stream():
            if _first(chunk) not in _ENTITIES:
                continue
            if chunk.is_static or not self._shift:
                yield chunk
                continue
            batch = chunk.to_record_batch()
            index = batch.schema.get_field_index(TREE_TIMELINE)
            times = batch.column(index).cast("int64").to_numpy() + self._shift
            field = batch.schema.field(index)
            yield from Chunk.from_record_batch(
                batch.set_column(index, field, pa.array(times).cast(field.type))
            )


def _first(chunk: Chunk) -> str:
    """Return the first part of the path of the entity of *chunk*."""
    return str(chunk.entity_path).split("/")[1]
