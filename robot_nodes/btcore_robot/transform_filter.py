"""Readings that wait for their transforms, as in tf2's message filter."""

from collections import deque
from typing import Generic, Protocol, TypeVar

from btcore_robot.time_limits import Stamped
from btcore_robot.transforms import TransformTree

MAX_WAITING = 10
"""The number of readings that wait: one second of a laser at 10 Hz."""


class FramedReading(Stamped, Protocol):
    """A reading with the time of its measurement and the frame of the sensor."""

    @property
    def frame(self) -> str:
        """The frame of the reading's coordinates."""


Reading = TypeVar("Reading", bound=FramedReading)


class TransformFilter(Generic[Reading]):
    """The readings of a sensor from the time on at which *tree* has the pose of their frame in *target*.

    The odometry may arrive later than a reading with the same stamp. Such a reading waits; without the filter
    it would be replaced by newer readings that have no transform yet either.

    Args:
        target: The frame to which the readings are transformed.
    """

    def __init__(self, tree: TransformTree, target: str) -> None:
        self._tree = tree
        self._target = target
        self._waiting: deque[Reading] = deque(maxlen=MAX_WAITING)
        self._last_stamp: int | None = None

    def newest(self, reading: Reading | None) -> Reading | None:
        """Return the newest reading whose transform at its stamp is available; each reading only once.

        Readings that are older than the returned reading are discarded.

        Args:
            reading: The sensor's newest reading, which may be the same as in the last call, or None.
        """
        if reading is not None and reading.stamp != self._last_stamp:
            self._last_stamp = reading.stamp
            self._waiting.append(reading)
        for place in reversed(range(len(self._waiting))):
            candidate = self._waiting[place]
            if self._tree.can_transform(self._target, candidate.frame, candidate.stamp):
                for _ in range(place + 1):
                    self._waiting.popleft()
                return candidate
        return None
