"""One schedule for a whole world: what happens next, in a fixed order at equal times."""

import heapq
from collections.abc import Callable

from btcore_robot.robot import Phase
from btcore_robot.robot import Schedule as RobotSchedule

NS_PER_S = 1_000_000_000


class TaskSchedule(RobotSchedule):
    """Periodic tasks, run in the order of their times, then ranks, then registration.

    The k-th period of a task at *hertz* ends ``k * 1e9 / hertz`` ns after its start, rounded down, so that no
    error piles up.
    """

    def __init__(self, start: int = 0) -> None:
        self.now = start
        self._due: list[tuple[int, int, int, int]] = []
        self._tasks: dict[int, tuple[Callable[[int], None], float, int]] = {}
        self._made = 0

    def every(
        self, hertz: float, rank: Phase, task: Callable[[int], None], *, first: int | None = None
    ) -> Callable[[], None]:
        """Call *task* with the time (ns) at *first* (ns; one period from now unless given), then at *hertz*.

        Gives a callable that ends the task; ended once, it stays ended.
        """
        if not hertz > 0.0:
            raise ValueError(f"a task at {hertz} Hz is never due: a frequency is above 0")
        number = self._made
        self._made += 1
        # Counted from now, the calls of all rates meet at whole seconds, to the ns.
        start, count = (self.now, 1) if first is None else (max(first, self.now), 0)
        self._tasks[number] = (task, hertz, start)
        heapq.heappush(self._due, (start + int(count * NS_PER_S / hertz), rank, number, count))

        def end() -> None:
            self._tasks.pop(number, None)

        return end

    def next_due(self) -> int | None:
        """When (ns) the next task is due, or None if there is none."""
        due = self._due
        while due and due[0][2] not in self._tasks:
            heapq.heappop(due)
        return due[0][0] if due else None

    def run_next(self) -> None:
        """Move the time to the next task, and run it."""
        if self.next_due() is None:
            raise LookupError("nothing is scheduled")
        due, rank, number, count = self._due[0]
        task, hertz, start = self._tasks[number]
        later = start + int((count + 1) * NS_PER_S / hertz)
        heapq.heapreplace(self._due, (later, rank, number, count + 1))
        self.now = due
        task(due)
