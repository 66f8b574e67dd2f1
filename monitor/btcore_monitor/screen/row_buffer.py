"""Rows on their way to rerun: gathered by entity, sent as columns.

A row logged by itself costs 40–90 µs and some 1.2 kB of file for each flush; a row in a column costs a list's
append now and 17–27 bytes later. So everything that changes over time goes through here, and a run that comes
faster than real time is simply sent in longer columns.
"""

from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

import numpy as np
import rerun as rr

Value = TypeVar("Value")
Encode = Callable[[list[Value]], Iterable[Any]]

TREE_TIME = "t"
WALL_TIME = "wall"


class Series(Generic[Value]):
    """The rows of one *entity* that have not been sent. *encode* turns their values into rerun's columns."""

    def __init__(self, entity: str, encode: Encode[Value]) -> None:
        self.entity = entity
        self._encode = encode
        self._t: list[int] = []
        self._wall: list[int] = []
        self._values: list[Value] = []

    def add(self, t: int, wall: int, value: Value) -> None:
        """One row at tree time *t* (ns) and *wall* (ns since the epoch)."""
        self._t.append(t)
        self._wall.append(wall)
        self._values.append(value)

    def send(self, recording: rr.RecordingStream) -> None:
        """Send what has gathered, and forget it."""
        if not self._values:
            return
        times = [
            rr.TimeColumn(TREE_TIME, duration=np.array(self._t, dtype="timedelta64[ns]")),
            rr.TimeColumn(WALL_TIME, timestamp=np.array(self._wall, dtype="datetime64[ns]")),
        ]
        values, self._values = self._values, []
        self._t.clear()
        self._wall.clear()
        recording.send_columns(self.entity, times, self._encode(values))


class RowBuffer:
    """All series of one robot's tree, in *recording*.

    Where several robots share one, each has a *place*: an entity that all its entities are below, and that
    its frames are called by.
    """

    def __init__(self, recording: rr.RecordingStream, place: str = "") -> None:
        self.recording = recording
        self._below = f"{place}/" if place else ""
        self._series: list[Series[Any]] = []

    def series(self, entity: str, encode: Encode[Value]) -> Series[Value]:
        """A new series for *entity*."""
        made = Series(self._below + entity, encode)
        self._series.append(made)
        return made

    def log(self, entity: str, *what: Any, static: bool) -> None:
        """Log *what* of *entity* at once; *static* is for all times."""
        self.recording.log(self._below + entity, *what, static=static)

    def frame(self, name: str) -> str:
        """What the robot's frame *name* is called in the recording."""
        return self._below + name

    def in_frame(self, name: str) -> rr.CoordinateFrame:
        """That an entity is in the robot's frame *name*."""
        return rr.CoordinateFrame(self._below + name)

    def send(self) -> None:
        """Send what has gathered in every series."""
        for one in self._series:
            one.send(self.recording)


def scalars(values: list[float]) -> Iterable[Any]:
    """Columns of one number a row."""
    return rr.Scalars.columns(scalars=np.array(values, dtype=np.float64))


def strip_colours(values: list[Any]) -> Iterable[Any]:
    """Columns of colours of a LineStrips2D: one uint32 array a row."""
    return rr.LineStrips2D.columns(colors=np.concatenate(values)).partition([len(one) for one in values])
