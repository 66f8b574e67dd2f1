"""What is known about the times that remain until deadlines: a difference-bound matrix.

The time between two ticks is any time of at least 0, and so is the time between two moments of a tick. A
deadline that was set for 1 s ends before one of 5 s that was set later in the same tick, but the order of
other deadlines is often open. The bounds of the differences between all remaining times describe exactly what
may follow (D. Dill, "Timing Assumptions and Verification of Finite-State Concurrent Systems", 1989).
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

UNBOUNDED: Final = 1 << 62
_AT_MOST_0: Final = 1
_BELOW_0: Final = 0

Bounds = tuple[tuple[int, ...], ...]
"""Row i, column j holds the upper bound of (remaining time i) - (remaining time j); index 0 stands for 0.

A bound of at most v ns is the number 2v + 1, and a bound below v is 2v.
"""
NO_TIMERS: Final[Bounds] = ((_AT_MOST_0,),)


class Advance(NamedTuple):
    """What may have happened to the timers between two ticks.

    Attributes:
        expired: The indices of the timers that have expired, from 0.
        bounds: The bounds of the remaining times of all other timers, in the same order.
    """

    expired: tuple[int, ...]
    bounds: Bounds


def advances(bounds: Bounds) -> list[Advance]:
    """Return every set of timers that may expire before the next tick; the smallest sets come first."""
    count = len(bounds) - 1
    if not count:
        return [Advance((), bounds)]
    found: list[Advance] = []
    pending: list[tuple[int, tuple[int, ...], Bounds]] = [(0, (), after_any_time(bounds))]
    while pending:
        index, expired, known = pending.pop()
        if index == count:
            kept = [timer for timer in range(count) if timer not in expired]
            found.append(Advance(expired, without_timers(known, kept)))
            continue
        ended = _tighten(known, index + 1, 0, _AT_MOST_0)
        if ended is not None:
            pending.append((index + 1, (*expired, index), ended))
        remains = _tighten(known, 0, index + 1, _BELOW_0)
        if remains is not None:
            pending.append((index + 1, expired, remains))
    return sorted(found, key=lambda advance: len(advance.expired))


def after_any_time(bounds: Bounds) -> Bounds:
    """Return *bounds* after any time of at least 0; remaining times may be negative then."""
    # The remaining times decrease alike, so that only their lower bounds are lost.
    return ((_AT_MOST_0, *[UNBOUNDED] * (len(bounds) - 1)), *bounds[1:])


def with_timer(bounds: Bounds, duration: int) -> Bounds:
    """Return *bounds* with a further timer that is set to *duration* (ns) at this moment."""
    first = bounds[0]
    above = 2 * duration + 1
    below = -2 * duration + 1
    column = [_sum(row[0], below) for row in bounds]
    rows = [(*row, column[index]) for index, row in enumerate(bounds)]
    return (*rows, (*(_sum(above, bound) for bound in first), _AT_MOST_0))


def without_timers(bounds: Bounds, kept: Sequence[int]) -> Bounds:
    """Return the bounds of the timers *kept* (indices from 0), in this order."""
    places = [0, *(index + 1 for index in kept)]
    return tuple(tuple(bounds[i][j] for j in places) for i in places)


def _tighten(bounds: Bounds, i: int, j: int, bound: int) -> Bounds | None:
    """Return *bounds* with a further upper bound of time i - time j, or None if that is impossible."""
    if bound >= bounds[i][j]:
        return bounds
    if _sum(bound, bounds[j][i]) < _AT_MOST_0:
        return None
    beyond = [_sum(bound, next_bound) for next_bound in bounds[j]]
    return tuple(
        tuple(min(old, _sum(row[i], new)) for old, new in zip(row, beyond, strict=True)) for row in bounds
    )


def _sum(first: int, second: int) -> int:
    if first >= UNBOUNDED or second >= UNBOUNDED:
        return UNBOUNDED
    return first + second - ((first & 1) | (second & 1))
