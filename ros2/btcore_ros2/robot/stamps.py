"""Conversion of a robot's stamps to the clock of this process, and detection of jumps."""

from collections.abc import Hashable

from btcore.clock import NS_PER_S
from btcore_ros2.errors import RosError

JUMP = NS_PER_S
"""A change (ns) of the robot's clock relative to ours from which it is a jump."""
WINDOW = 30 * NS_PER_S
"""The period (ns) over which the shortest delay is searched; drifts of the clocks are followed after it."""
SETTLING = 2 * NS_PER_S
"""The time (ns) after the first message in which the shortest delay may still be far too long."""


class ClockJumpError(RosError):
    """Raised when the clock of a robot jumped, so that its stamps cannot be related any longer."""


class LateMessageError(RosError):
    """Raised for a message that arrived after a newer message of the same source, as over a bridge."""


class StampConverter:
    """Converts the stamps of a robot's messages to the clock of this process.

    The robot's stamps are those of another machine, with an unknown offset. A message arrives after its
    measurement, so the smallest difference between arrival and stamp within the present `WINDOW` and the
    previous window is the best estimate of the offset. Converted stamps are never later than the arrival
    and, for each key, never decrease. A message that is older than an earlier one by at most `JUMP` is late,
    otherwise the clock has jumped back.

    Args:
        shared: Whether the stamps are of our clock already, as with `use_sim_time`.
        offset: Our clock minus that of shared stamps (ns).
    """

    def __init__(self, *, shared: bool = False, offset: int = 0) -> None:
        self._shared = shared
        self._shared_offset = offset
        self._first: int | None = None
        self._began = 0
        # The smallest differences in the current window and in the one before.
        self._current: int | None = None
        self._previous: int | None = None
        self._newest: dict[Hashable, tuple[int, int]] = {}

    def convert(self, key: Hashable, stamp: int, arrival: int) -> int:
        """Return *stamp* in our clock.

        Args:
            key: The source of the message: its topic, and its frame if several frames share the topic.
            stamp: The stamp of the message (ns); 0 = not set, which counts as *arrival*.
            arrival: The time at which the message arrived (ns, our clock).

        Raises:
            ClockJumpError: The robot's clock jumped by more than `JUMP`.
            LateMessageError: A newer message of the same source was converted before.
        """
        before, converted_before = self._newest.get(key, (stamp, 0))
        if stamp and stamp < before:
            age = (before - stamp) / NS_PER_S
            if before - stamp > JUMP:
                raise ClockJumpError(f"its stamps jumped back by {age:.1f} s")
            raise LateMessageError(f"a message that is {age:.3f} s older than the newest")
        if not stamp:
            converted = arrival
        elif self._shared:
            converted = min(stamp + self._shared_offset, arrival)
        else:
            converted = stamp + self._offset(arrival - stamp, arrival)
        converted = max(converted, converted_before)
        self._newest[key] = stamp or before, converted
        return converted

    def _offset(self, difference: int, arrival: int) -> int:
        """Return the offset, including the message with *difference*."""
        if self._first is None:
            self._first = self._began = arrival
        elif arrival - self._began > WINDOW:
            self._previous, self._current, self._began = self._current, None, arrival
        known = [value for value in (self._previous, self._current) if value is not None]
        if known and difference < min(known) - JUMP and arrival - self._first > SETTLING:
            ahead = (min(known) - difference) / NS_PER_S
            raise ClockJumpError(f"its stamps jumped ahead by {ahead:.1f} s")
        self._current = difference if self._current is None else min(self._current, difference)
        return min([self._current, *known])
