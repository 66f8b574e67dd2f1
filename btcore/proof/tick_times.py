"""Real times for the ticks of a run, so that the ordinary engine's timers expire as in the search."""

from collections.abc import Sequence
from typing import Final, NamedTuple

from btcore.clock import NS_PER_MS

USUAL_PERIOD: Final = 100 * NS_PER_MS


class Deadline(NamedTuple):
    """A timer that was set in a tick: its duration (ns), and the tick in which it has expired first, or None.

    *last_pending* is the last tick of the run in which it was pending.
    """

    set_in: int
    duration: int
    expired_in: int | None
    last_pending: int


def tick_times(ticks: int, deadlines: Sequence[Deadline]) -> list[int] | None:
    """Return times (ns) for the ticks of a run that agree with all deadlines, or None if there are none.

    The time of the first tick is 0. Ticks are 100 ms apart if the deadlines allow it.
    """
    for period in (USUAL_PERIOD, 10 * NS_PER_MS, NS_PER_MS, 0):
        found = _solved(ticks, deadlines, period)
        if found is not None:
            return found
    return None


def _solved(ticks: int, deadlines: Sequence[Deadline], period: int) -> list[int] | None:
    # Longest paths in the graph of the constraints time[b] >= time[a] + weight (Bellman and Ford).
    constraints = [(tick, tick + 1, period) for tick in range(ticks - 1)]
    for deadline in deadlines:
        if deadline.expired_in is not None:
            constraints.append((deadline.set_in, deadline.expired_in, deadline.duration))
        if deadline.last_pending > deadline.set_in:
            constraints.append((deadline.last_pending, deadline.set_in, 1 - deadline.duration))
    times = [0] * ticks
    for _ in range(ticks + 1):
        changed = False
        for first, second, weight in constraints:
            if times[first] + weight > times[second]:
                times[second] = times[first] + weight
                changed = True
        if not changed:
            return [time - times[0] for time in times]
    return None
