"""A buffer of rows for rerun, collected by entity and sent as columns.

A row that is logged alone costs 40–90 µs, and about 1.2 kB of the file for each flush. A row in a column
costs an append to a list, and 17–27 bytes of the file. So all data that changes over time uses this buffer.
A run that is faster than real time gives longer columns.

All texts of a recording pass this module, where characters are replaced that the viewer cannot draw.
"""

import contextlib
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any, Final, Generic, Literal, TypeVar

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import NDArray

from btcore_monitor.screen.font import legible, spell

Value = TypeVar("Value")
Encode = Callable[[list[Value]], Iterable[Any]]

_MAX_NAME_CHARS: Final = 100
# The log's first column, which shows the time, is as wide as the name of the timeline.
TREE_TIMELINE: Final = "time of the tree"
WALL_TIMELINE: Final = "time of the day"


class Series(Generic[Value]):
    """The unsent rows of an *entity* of *buffer*. *encode* converts their values to rerun's columns."""

    def __init__(self, buffer: "RowBuffer", entity: str, encode: Encode[Value]) -> None:
        self.entity = entity
        self._buffer = buffer
        self._encode = encode
        self._stamps: list[int] = []
        self._walls: list[int] = []
        self._values: list[Value] = []

    def add(self, value: Value) -> None:
        """Add a row with the present time of the buffer. *encode* converts the value later."""
        self._stamps.append(self._buffer.stamp)
        self._walls.append(self._buffer.wall)
        self._values.append(value)

    def send(self) -> None:
        """Send the rows, and clear the buffer."""
        if not self._values:
            return
        since = np.array(self._stamps, dtype=np.int64) - self._buffer.start_stamp
        times = [
            rr.TimeColumn(TREE_TIMELINE, duration=since.astype("timedelta64[ns]")),
            rr.TimeColumn(WALL_TIMELINE, timestamp=np.array(self._walls, dtype="datetime64[ns]")),
        ]
        values, self._values = self._values, []
        self._stamps.clear()
        self._walls.clear()
        self._buffer.recording.send_columns(
            self.entity, times, map(_make_column_legible, self._encode(values))
        )


class RowBuffer:
    """All series of a robot's tree in *recording*, and the time of the rows that are added.

    If several robots share a recording, *entity_path_prefix* is the entity above all entities of this robot,
    and the prefix of its frames' names. Displayed times count from *start_stamp* (ns of the tree's clock),
    since a robot's clock may have any beginning.
    """

    def __init__(
        self, recording: rr.RecordingStream, entity_path_prefix: str = "", start_stamp: int = 0
    ) -> None:
        self.recording = recording
        self.start_stamp = start_stamp
        self.entity_path_prefix = entity_path_prefix
        self._prefix = f"{entity_path_prefix}/" if entity_path_prefix else ""
        self._series: list[Series[Any]] = []
        self.stamp = 0
        """The present time of the tree (ns)."""
        self.wall = 0
        """The present wall-clock time (ns since the epoch)."""

    def move_to(self, stamp: int, wall: int) -> None:
        """Change the present time."""
        self.stamp, self.wall = stamp, wall

    @contextlib.contextmanager
    def at(self, stamp: int, wall: int) -> Iterator[None]:
        """Change the present time during the `with` block."""
        before = self.stamp, self.wall
        self.move_to(stamp, wall)
        yield
        self.move_to(*before)

    def create_series(self, entity: str, encode: Encode[Value]) -> Series[Value]:
        """Return a new series for *entity*, whose values *encode* converts to columns."""
        series = Series(self, self._prefix + entity, encode)
        self._series.append(series)
        return series

    def to_seconds(self, stamp: int) -> float:
        """Return the displayed time (s) of tree time *stamp* (ns)."""
        return (stamp - self.start_stamp) / 1e9

    def log(self, entity: str, *components: Any, static: bool) -> None:
        """Log data without buffering.

        Args:
            entity: The path of the entity, without the robot's *entity_path_prefix*.
            components: The archetypes or components to log.
            static: Whether the data is valid for all times.
        """
        batches = [batch for component in components for batch in _make_batches_legible(component)]
        self.recording.log(self._prefix + entity, batches, static=static)

    def frame_name(self, name: str) -> str:
        """Return the name of the robot's frame *name* in the recording."""
        return self._prefix + spell(name)

    def in_frame(self, name: str) -> rr.CoordinateFrame:
        """Return the component that places an entity in the robot's frame *name*."""
        return rr.CoordinateFrame(self.frame_name(name))

    def send(self) -> None:
        """Send the rows of every series."""
        for series in self._series:
            series.send()


class _Texts:
    """A component batch of texts that the viewer can draw."""

    def __init__(self, texts: pa.Array) -> None:
        self._texts = pa.array(
            [text if text is None else legible(text) for text in texts.to_pylist()], pa.utf8()
        )

    def as_arrow_array(self) -> pa.Array:
        return self._texts


def _make_batches_legible(components: Any) -> Iterable[Any]:
    """Yield the component batches of *components* (an archetype, or batches) as the viewer can draw them."""
    batches = components.as_component_batches() if hasattr(components, "as_component_batches") else components
    for batch in batches:
        array = batch.as_arrow_array()
        if array is not None and pa.types.is_string(array.type):
            yield rr.DescribedComponentBatch(_Texts(array), batch.component_descriptor())
        else:
            yield batch


def _make_column_legible(column: Any) -> Any:
    """Return a column of components as the viewer can draw it."""
    rows = column.as_arrow_array()
    if not pa.types.is_string(rows.type.value_type):
        return column
    lengths = rows.value_lengths().to_numpy()
    return rr.ComponentColumn(column.component_descriptor(), _Texts(rows.values), lengths=lengths)


def entity_part(name: str) -> str:
    """Return *name* as a part of an entity's path, without characters that rerun shows with escapes."""
    return re.sub(r"[^\w.-]+", "_", spell(name[:_MAX_NAME_CHARS])).strip("_") or "_"


def rounded(values: NDArray[np.floating], step: float) -> NDArray[np.float32]:
    """Return *values*, rounded to multiples of *step*, of which rerun's compression stores many in less room.

    Args:
        values: The values, of any shape.
        step: A power of two: only such multiples have few bits.
    """
    # float64, because a robot may send the largest number of float32, which a division makes greater.
    multiples = np.round(values.astype(np.float64) / step) * step
    return multiples.astype(np.float32)


def create_scalar_columns(values: list[float]) -> Iterable[Any]:
    """Return columns with a number in each row."""
    return rr.Scalars.columns(scalars=np.array(values, dtype=np.float64))


def image_format(size: tuple[int, int], color_model: Literal["RGB", "RGBA"]) -> Any:
    """Return the format of an image with a byte for each channel; *size* is width and height."""
    width, height = size
    return rr.components.ImageFormat(
        width=width, height=height, color_model=color_model, channel_datatype="U8"
    )


def create_curve_style(name: str, colour: int) -> Any:
    """Return the name and colour of a curve in a plot."""
    return rr.SeriesLines(colors=[int(colour)], names=[name], widths=[1.6])


def create_colour_columns(values: list[Any]) -> Iterable[Any]:
    """Return columns with the colours of a LineStrips2D (a uint32 array) in each row."""
    return rr.LineStrips2D.columns(colors=np.concatenate(values)).partition([len(row) for row in values])
