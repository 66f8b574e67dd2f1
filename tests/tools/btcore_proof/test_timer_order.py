"""The bounds of remaining times, against all times on a grid on which every order of their ends appears."""

import random
from collections.abc import Iterator, Sequence
from functools import cache

import pytest

from btcore_proof.timer_order import NO_TIMERS, Bounds, advances, after_any_time, with_timer, without_timers

GRID = 6
"""The grid is a unit divided by the number of moments: every order of ends that is possible appears on it."""
Timers = tuple[tuple[int, int], ...]
"""The number and the remaining time of each pending timer."""
Script = Sequence[Sequence[int]]
"""For each tick, the durations of the timers that it sets, in units."""
Ends = tuple[tuple[int, ...], ...]
"""For each tick, the numbers of the timers that have expired since the tick before."""


def concrete_ends(script: Script, instant: bool) -> set[Ends]:
    """Return which timers may have expired by each tick, by trying all times between the moments."""

    @cache
    def ends_from(tick: int, timers: Timers) -> set[Ends]:
        if tick == len(script):
            return {()}
        found: set[Ends] = set()
        for later in passed(timers):
            expired = tuple(number for number, left in later if left <= 0)
            kept = tuple((number, left) for number, left in later if left > 0)
            for timers_after in after_setting(tick, 0, kept):
                found |= {(expired, *more) for more in ends_from(tick + 1, timers_after)}
        return found

    @cache
    def after_setting(tick: int, done: int, timers: Timers) -> set[Timers]:
        """Return the timers after the tick, of which the first *done* timers are set."""
        if done == len(script[tick]):
            return {timers}
        new = (sum(map(len, script[:tick])) + done, script[tick][done] * GRID)
        moments = [timers] if instant else passed(timers)
        return {after for then in moments for after in after_setting(tick, done + 1, (*then, new))}

    return ends_from(0, ())


def passed(timers: Timers) -> list[Timers]:
    """Return the timers after each time up to the end of the last timer."""
    longest = max((left for _, left in timers), default=0)
    return [tuple((number, left - time) for number, left in timers) for time in range(max(longest, 0) + 1)]


def symbolic_ends(script: Script, instant: bool) -> Iterator[Ends]:
    """Return which timers may have expired by each tick, by the bounds."""
    pending: list[tuple[int, Bounds, list[int], Ends]] = [(0, NO_TIMERS, [], ())]
    while pending:
        tick, bounds, numbers, ends = pending.pop()
        if tick == len(script):
            yield ends
            continue
        for advance in advances(bounds):
            expired = tuple(numbers[index] for index in advance.expired)
            kept = [number for index, number in enumerate(numbers) if index not in advance.expired]
            later = advance.bounds
            for duration in script[tick]:
                later = with_timer(later if instant else after_any_time(later), duration)
            first = sum(map(len, script[:tick]))
            new = range(first, first + len(script[tick]))
            pending.append((tick + 1, later, [*kept, *new], (*ends, expired)))


@pytest.mark.parametrize("instant", [True, False])
@pytest.mark.parametrize("seed", range(12))
def test_the_timers_end_in_every_order_that_is_possible_and_in_no_other(seed: int, instant: bool) -> None:
    rng = random.Random(seed)
    counts = rng.choice([(1, 0, 2, 0), (2, 1, 0, 0), (1, 1, 1, 0), (3, 0, 0), (1, 2, 0), (0, 1, 2, 0)])
    script = [[rng.randint(1, 3) for _ in range(count)] for count in counts]
    found = list(symbolic_ends(script, instant))
    assert len(found) == len(set(found))
    assert set(found) == concrete_ends(script, instant)


def test_a_shorter_timer_of_the_same_tick_ends_first() -> None:
    bounds = with_timer(with_timer(NO_TIMERS, 5), 1)
    assert [advance.expired for advance in advances(bounds)] == [(), (1,), (0, 1)]


def test_equal_knowledge_has_equal_bounds() -> None:
    # Without the timer between them, it does not matter how the others were set.
    straight = with_timer(with_timer(NO_TIMERS, 4), 2)
    around = without_timers(with_timer(with_timer(with_timer(NO_TIMERS, 4), 3), 2), [0, 2])
    assert straight == around
