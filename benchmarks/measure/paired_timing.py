"""Contenders measured side by side: in turns, round by round, so that what disturbs one disturbs all.

A round gives every contender the same number of slices, one after the other in an order that changes,
and keeps the shortest slice of each, which is the one that the rest of the machine disturbed least. A
ratio is taken within its round; what is reported is the median over the rounds, with its quartiles.
Times are of the processor, on the thread that works: on an idle machine the same as by the wall clock,
on a busy one without what others take.
"""

import gc
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat

SLICES = 12
SLICE = 1_000_000
"""ns that a slice lasts, about: shorter than the time that a system gives a process at once."""

Work = Callable[[], object]


@dataclass(frozen=True, slots=True)
class Spread:
    """A median with its quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """The spread of *values*; their extremes where they are fewer than four."""
        if len(values) < 4:
            return cls(statistics.median(values), min(values), max(values))
        low, median, high = statistics.quantiles(values, n=4, method="inclusive")
        return cls(median, low, high)

    def times(self, factor: float) -> "Spread":
        """The same, *factor* times as much."""
        return Spread(self.median * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True, slots=True)
class Measured:
    """What each contender took in each round (ns a call)."""

    rounds: Mapping[str, Sequence[float]]

    def time(self, name: str) -> Spread:
        """What one call of *name* takes (ns)."""
        return Spread.of(self.rounds[name])

    def ratio(self, dividend: str, divisor: str) -> Spread:
        """How many times as long as *divisor* does *dividend* take."""
        pairs = zip(self.rounds[dividend], self.rounds[divisor], strict=True)
        return Spread.of([one / other for one, other in pairs])


def measure(works: Mapping[str, Work], rounds: int, slices: int = SLICES, slice_ns: int = SLICE) -> Measured:
    """Call each of *works* many times in each of *rounds* rounds."""
    calls = {name: _calls_within(work, slice_ns) for name, work in works.items()}
    taken: dict[str, list[float]] = {name: [] for name in works}
    names = list(works)
    gc.collect()
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        for _ in range(rounds):
            best = dict.fromkeys(names, float("inf"))
            for _ in range(slices):
                for name in names:
                    best[name] = min(best[name], _timed(works[name], calls[name]) / calls[name])
                names.append(names.pop(0))
            for name in names:
                taken[name].append(best[name])
            gc.collect()
    finally:
        if was_enabled:
            gc.enable()
    return Measured(taken)


def _timed(work: Work, calls: int) -> int:
    """How long *calls* calls of *work* take (ns)."""
    start = time.thread_time_ns()
    for _ in repeat(None, calls):
        work()
    return time.thread_time_ns() - start


def _calls_within(work: Work, slice_ns: int) -> int:
    """How often *work* can be called in a slice; this warms it up, too."""
    calls = 1
    while True:
        taken = _timed(work, calls)
        if taken >= slice_ns / 4:
            return max(1, round(calls * slice_ns / taken))
        calls *= 2
