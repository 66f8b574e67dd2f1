"""One schedule for a whole world: what happens next, in a fixed order at equal times."""

import heapq
from collections.abc import Callable
from enum import IntEnum

NS_PER_S = 1_000_000_000


class Rank(IntEnum):
    """The order of things that are due at the same moment. What waits for that moment (a tree) comes last."""

    PHYSICS = 0
    SENSORS = 1


class Schedule:
    """Periodic tasks, run in the order of their times, then ranks, then registration.

    The k-th call of a task at *hertz* is due at ``k * 1e9 / hertz`` ns after its first, rounded down, so that
    no error piles up.
    """

    def __init__(self, start: int = 0) -> None:
        self.now = start
        self._due: list[tuple[int, int, int, int]] = []
        self._tasks: list[tuple[Callable[[int], None], float, int]] = []

    def every(self, hertz: float, rank: Rank, task: Callable[[int], None], *, first: int) -> None:
        """Call *task* with the time (ns) at *first* (ns) and from then on at *hertz*."""
        number = len(self._tasks)
        self._tasks.append((task, hertz, first))
        heapq.heappush(self._due, (first, rank, number, 0))

    def next_due(self) -> int | None:
        """When (ns) the next task is due, or None if there is none."""
        return self._due[0][0] if self._due else None

    def run_next(self) -> None:
        """Move the time to the next task, and run it."""
        due, rank, number, count = self._due[0]
        task, hertz, first = self._tasks[number]
        later = first + int((count + 1) * NS_PER_S / hertz)
        heapq.heapreplace(self._due, (later, rank, number, count + 1))
        self.now = due
        task(due)
