"""The bounds of remaining times, against all times on a grid on which every order of their ends appears."""

import random
from collections.abc import Iterator, Sequence

import pytest

from btcore.proof.timer_order import NO_TIMERS, Bounds, advances, with_timer, without_timers

TICKS = 4
"""The grid is a unit divided by the number of ticks, on which all orders of ends that are possible appear."""
Timers = tuple[tuple[int, int], ...]
"""The number and the remaining time of each pending timer."""
Script = Sequence[Sequence[int]]
"""For each tick, the durations of the timers that it sets, in units."""


def concrete_ends(script: Script) -> set[tuple[tuple[int, ...], ...]]:
    """Return which timers may have expired by each tick, by trying all times between the ticks."""
    found: set[tuple[tuple[int, ...], ...]] = set()

    def go(tick: int, timers: Timers, ends: tuple[tuple[int, ...], ...]) -> None:
        if tick == len(script):
            found.add(ends)
            return
        longest = max((left for _, left in timers), default=0)
        for elapsed in range(longest + 1):
            expired = tuple(number for number, left in timers if left <= elapsed)
            kept = tuple((number, left - elapsed) for number, left in timers if left > elapsed)
            first = sum(map(len, script[:tick]))
            new = tuple((first + n, duration * TICKS) for n, duration in enumerate(script[tick]))
            go(tick + 1, (*kept, *new), (*ends, expired))

    go(0, (), ())
    return found


def symbolic_ends(script: Script) -> Iterator[tuple[tuple[int, ...], ...]]:
    """Return which timers may have expired by each tick, by the bounds."""
    pending: list[tuple[int, Bounds, list[int], tuple[tuple[int, ...], ...]]] = [(0, NO_TIMERS, [], ())]
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
                later = with_timer(later, duration)
            first = sum(map(len, script[:tick]))
            new = range(first, first + len(script[tick]))
            pending.append((tick + 1, later, [*kept, *new], (*ends, expired)))


@pytest.mark.parametrize("seed", range(25))
def test_the_timers_end_in_every_order_that_is_possible_and_in_no_other(seed: int) -> None:
    chance = random.Random(seed)
    script = [[chance.randint(1, 3) for _ in range(chance.choice([0, 1, 1, 2]))] for _ in range(TICKS)]
    found = list(symbolic_ends(script))
    assert len(found) == len(set(found))
    assert set(found) == concrete_ends(script)


def test_a_shorter_timer_of_the_same_tick_ends_first() -> None:
    bounds = with_timer(with_timer(NO_TIMERS, 5), 1)
    assert [advance.expired for advance in advances(bounds)] == [(), (1,), (0, 1)]


def test_equal_knowledge_has_equal_bounds() -> None:
    # Without the timer between them, it does not matter how the others were set.
    straight = with_timer(with_timer(NO_TIMERS, 4), 2)
    around = without_timers(with_timer(with_timer(with_timer(NO_TIMERS, 4), 3), 2), [0, 2])
    assert straight == around
