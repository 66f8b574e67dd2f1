"""Latency of sensors: the time between a measurement, which is its stamp, and its arrival."""

from collections import deque
from typing import Generic, TypeVar

from btcore.clock import NS_PER_S

Reading = TypeVar("Reading")


class DelayedReadings(Generic[Reading]):
    """The readings of a sensor that arrive *latency* (s) after they were measured.

    A reading of time 0 has arrived when the run begins.
    """

    def __init__(self, latency: float) -> None:
        self._latency = round(latency * NS_PER_S)
        self._newest: Reading | None = None
        self._pending: deque[tuple[int, Reading]] = deque()

    def add(self, reading: Reading, stamp: int) -> None:
        """Add a *reading* that was measured at *stamp* (ns), which must not decrease."""
        # Arrived readings are removed here too, because a sensor may be measured and never read.
        self.newest(stamp)
        self._pending.append((stamp + self._latency if stamp else 0, reading))

    def newest(self, now: int) -> Reading | None:
        """Return the newest reading that has arrived at *now* (ns), or None without a reading."""
        while self._pending and self._pending[0][0] <= now:
            self._newest = self._pending.popleft()[1]
        return self._newest
