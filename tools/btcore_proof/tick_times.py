"""Times of a search and of a run: the clock of the nodes, and times at which timers expire as in the search.

Leaves take time, so that each reading of the clock within a tick may be later than the reading before.
"""

import threading
from collections.abc import Iterable, Iterator, Sequence
from itertools import count
from typing import Final, NamedTuple

from btcore.clock import NS_PER_MS, Clock, SimClock
from btcore.tree.tree import Tree

TICK_START_NS: Final = 10**18
"""The time (ns) at which every tick of a search begins."""
READING_INTERVAL_NS: Final = 10**19
"""The time (ns) between two readings of the clock in a tick of a search: longer than any duration."""
FIRST_PENDING_NS: Final = 10**30
"""The first deadline (ns) of timers that were pending before a tick: later than a node can set one."""
USUAL_PERIOD_NS: Final = 100 * NS_PER_MS


class TickClock:
    """The clock of the nodes of one tree, with a given time for each reading within a tick.

    The first reading of a tick is the time at which the tick begins.

    Args:
        tree: The tree, of which this becomes the clock.
        followed_by: The clock of all other users of the time, such as a log, which advances with this clock.

    Attributes:
        readings: The number of readings in the present tick.
        replaced: The clock with which the tree was loaded.
    """

    def __init__(self, tree: Tree, followed_by: SimClock | None = None) -> None:
        clock = tree.clock
        self.readings = 0
        self.replaced: Clock = clock.replaced if isinstance(clock, TickClock) else clock
        self._follower = followed_by
        self._time = TICK_START_NS
        self._times: Iterator[int] = iter(())
        self._wake = threading.Event()
        tree.context.clock = self
        tree.context.uses_time = True

    def begin(self, times: Iterable[int]) -> None:
        """Begin a tick with these times (ns) of its readings; the last time is repeated."""
        self.readings = 0
        self._times = iter(times)

    def begin_in_search(self, start: int, instant: bool) -> None:
        """Begin a tick of a search at *start* (ns), with other times for later readings unless *instant*."""
        self.begin((start,) if instant else count(start, READING_INTERVAL_NS))

    def now(self) -> int:
        """Return the time (ns) of the next reading."""
        self.readings += 1
        self._time = next(self._times, self._time)
        if self._follower is not None:
            self._follower.wait_until(self._time, self._wake)
        return self._time

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Return at once: the times of the readings are given."""
        return wake.is_set()


class Deadline(NamedTuple):
    """A timer of a run.

    Attributes:
        set_in: The tick in which the timer was set.
        reading: The reading of the clock in this tick at which the timer was set, from 0.
        duration: Its duration (ns).
        expired_in: The first tick in which it has expired, or None.
        last_pending: The last tick of the run in which it was pending.
    """

    set_in: int
    reading: int
    duration: int
    expired_in: int | None
    last_pending: int


def tick_times(ticks: int, deadlines: Sequence[Deadline]) -> list[list[int]] | None:
    """Return times (ns) for the ticks of a run that agree with all deadlines, or None if there are none.

    The time of the first tick is 0. Ticks are 100 ms apart if the deadlines allow it, and take no time if
    the deadlines allow it.

    Returns:
        For each tick the times of its readings of the clock; the last time is that of all further readings.
    """
    for period in (USUAL_PERIOD_NS, 10 * NS_PER_MS, NS_PER_MS, 0):
        times = _solve(ticks, deadlines, period)
        if times is not None:
            return times
    return None


def _solve(ticks: int, deadlines: Sequence[Deadline], period: int) -> list[list[int]] | None:
    readings = [1] * ticks
    for deadline in deadlines:
        readings[deadline.set_in] = max(readings[deadline.set_in], deadline.reading + 1)
    first = [sum(readings[:tick]) for tick in range(ticks)]
    # Longest paths in the graph of the constraints time[b] >= time[a] + weight (Bellman and Ford).
    constraints = [(place, place + 1, 0) for place in range(sum(readings) - 1)]
    constraints += [(first[tick], first[tick + 1], period) for tick in range(ticks - 1)]
    for set_in, reading, duration, expired_in, last_pending in deadlines:
        moment = first[set_in] + reading
        if expired_in is not None:
            constraints.append((moment, first[expired_in], duration))
        if last_pending > set_in:
            constraints.append((first[last_pending], moment, 1 - duration))
    times = [0] * sum(readings)
    for _ in range(len(times) + 1):
        has_changed = False
        for before, after, weight in constraints:
            if times[before] + weight > times[after]:
                times[after] = times[before] + weight
                has_changed = True
        if not has_changed:
            start = times[0]
            return [
                [time - start for time in times[place : place + number]]
                for place, number in zip(first, readings, strict=True)
            ]
    return None
