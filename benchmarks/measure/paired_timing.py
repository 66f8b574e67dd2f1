"""Measuring the times of several functions, the contenders, side by side.

The contenders are measured in rounds, so that a disturbance of the machine affects all of them. `measure`
gives every contender the same number of slices (series of calls) in each round, in an order that changes. The
shortest slice of each contender counts, because other programs disturbed it least. `measure_rounds` calls
every contender once in each round. In both cases a ratio is computed within a round, and reports contain the
median over the rounds with its quartiles.

All times are processor times: on an idle machine they equal the wall-clock times, and on a busy machine they
exclude the time that other programs take.
"""

import gc
import statistics
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import repeat

SLICES = 12
SLICE = 1_000_000
"""The approximate duration (ns) of a slice: shorter than the time slice that the system gives a process."""

Work = Callable[[], object]


def percentile(values: Sequence[float], share: float) -> float:
    """Return the value that the fraction *share* of *values* does not exceed."""
    return sorted(values)[min(len(values) - 1, int(share * len(values)))]


@dataclass(frozen=True, slots=True)
class Spread:
    """A median with its quartiles."""

    median: float
    low: float
    high: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Spread":
        """Return the spread of *values*: median and quartiles, or extremes for fewer than four values."""
        if len(values) < 4:
            return cls(statistics.median(values), min(values), max(values))
        low, median, high = statistics.quantiles(values, n=4, method="inclusive")
        return cls(median, low, high)

    def times(self, factor: float) -> "Spread":
        """Return this spread, multiplied by *factor*."""
        return Spread(self.median * factor, self.low * factor, self.high * factor)


@dataclass(frozen=True, slots=True)
class Measured:
    """The time (ns) of a call of each contender in each round, by name."""

    rounds: Mapping[str, Sequence[float]]

    def time(self, name: str) -> Spread:
        """Return the time of a call of *name* (ns)."""
        return Spread.of(self.rounds[name])

    def ratio(self, dividend: str, divisor: str) -> Spread:
        """Return the time of *dividend* divided by the time of *divisor*, computed within each round."""
        pairs = zip(self.rounds[dividend], self.rounds[divisor], strict=True)
        return Spread.of([longer / shorter for longer, shorter in pairs])


def measure(works: Mapping[str, Work], rounds: int, slices: int = SLICES, slice_ns: int = SLICE) -> Measured:
    """Call each of *works* many times in each round.

    Args:
        works: The contenders by name.
        rounds: The number of rounds.
        slices: The number of slices of each contender in a round. A slice is a series of calls.
        slice_ns: The approximate duration of a slice (ns).
    """
    calls = {name: _count_calls_within(work, slice_ns) for name, work in works.items()}
    taken: dict[str, list[float]] = {name: [] for name in works}
    names = list(works)
    # A garbage collection within a slice would add to the time of the contender that happens to run.
    gc.collect()
    was_enabled = gc.isenabled()
    gc.disable()
    try:
        for _ in range(rounds):
            best = dict.fromkeys(names, float("inf"))
            for _ in range(slices):
                for name in names:
                    best[name] = min(best[name], _measure_calls(works[name], calls[name]) / calls[name])
                names.append(names.pop(0))
            for name in names:
                taken[name].append(best[name])
            gc.collect()
    finally:
        if was_enabled:
            gc.enable()
    return Measured(taken)


def processor_time(work: Work) -> int:
    """Return the processor time (ns) of a call of *work*."""
    start = time.process_time_ns()
    work()
    return time.process_time_ns() - start


def measure_rounds(
    rounds: Iterable[Mapping[str, Work]], timer: Callable[[Work], int] = processor_time, warm_up: int = 1
) -> Measured:
    """Call each contender once in each round, for work that takes long or differs between rounds.

    Args:
        rounds: The contenders of each round by name. The iterator is advanced after each round.
        timer: Calls the work and returns its time (ns).
        warm_up: The number of first rounds that do not count.
    """
    taken: dict[str, list[float]] = {}
    for index, works in enumerate(rounds):
        for name, work in works.items():
            duration = timer(work)
            if index >= warm_up:
                taken.setdefault(name, []).append(duration)
    return Measured(taken)


def _measure_calls(work: Work, calls: int) -> int:
    """Return the time (ns) of *calls* calls of *work*."""
    start = time.thread_time_ns()
    for _ in repeat(None, calls):
        work()
    return time.thread_time_ns() - start


def _count_calls_within(work: Work, slice_ns: int) -> int:
    """Return how often *work* can be called in a slice. The calls for this are also its warm-up."""
    calls = 1
    while True:
        taken = _measure_calls(work, calls)
        if taken >= slice_ns / 4:
            return max(1, round(calls * slice_ns / taken))
        calls *= 2
