"""A clock and a schedule for robots without a simulated world, and for programs without a robot.

`RealTime` goes by the wall clock, `SimulatedTime` jumps from one due task to the next. Both run their tasks
on the thread that waits, one at a time, while it waits: in the order of due times, then of ranks, then
of the calls of `every`.
"""

import heapq
import threading
import time
from collections.abc import Callable

from btcore_robot.robot import Phase

NS_PER_S = 1_000_000_000

Task = Callable[[int], None]


class _Tasks:
    """Periodic tasks, in the order in which they are due."""

    def __init__(self) -> None:
        self._due: list[tuple[int, int, int, int]] = []
        self._tasks: dict[int, tuple[Task, float, int]] = {}
        self._made = 0

    def now(self) -> int:
        """The time (ns), never decreasing."""
        raise NotImplementedError

    def every(self, hertz: float, rank: Phase, task: Task, *, first: int | None = None) -> Callable[[], None]:
        """Call *task* with the time (ns) at *hertz*; see `Schedule.every`."""
        if not hertz > 0.0:
            raise ValueError(f"a task at {hertz} Hz is never due: a frequency is above 0")
        number = self._made
        self._made += 1
        now = self.now()
        start, count = (now, 1) if first is None else (max(first, now), 0)
        self._tasks[number] = (task, hertz, start)
        heapq.heappush(self._due, (start + int(count * NS_PER_S / hertz), rank, number, count))

        def end() -> None:
            self._tasks.pop(number, None)

        return end

    def _next(self) -> int | None:
        """When (ns) the next task is due, or None if there is none."""
        due = self._due
        while due and due[0][2] not in self._tasks:
            heapq.heappop(due)
        return due[0][0] if due else None

    def _run(self, now: int) -> int:
        """Run the next task at *now* (ns), and plan its next call after that; how many calls were missed."""
        _, rank, number, count = self._due[0]
        task, hertz, start = self._tasks[number]
        following = max(count + 1, int((now - start) * hertz / NS_PER_S) + 1)
        heapq.heapreplace(self._due, (start + int(following * NS_PER_S / hertz), rank, number, following))
        task(now)
        return following - count - 1


class RealTime(_Tasks):
    """The monotonic clock of the machine. Tasks run while somebody is in `wait_until`, and not otherwise.

    A task that comes late is called with the time that it is; the calls that it missed are left out, so that
    a slow task delays others and never piles up. *missed* counts them.
    """

    def __init__(self) -> None:
        super().__init__()
        self.missed = 0

    def now(self) -> int:
        """The time (ns) since some moment before the start."""
        return time.monotonic_ns()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Run what is due until *deadline* (ns) or until *wake* is set; whether it was set."""
        while not wake.is_set():
            due = self._next()
            moment = deadline if due is None else min(due, deadline)
            left = moment - time.monotonic_ns()
            if left > 0 and wake.wait(left / NS_PER_S):
                return True
            now = time.monotonic_ns()
            if due is not None and due <= min(now, deadline):
                self.missed += self._run(now)
            elif now >= deadline:
                return False
        return True


class SimulatedTime(_Tasks):
    """Time that stands still until somebody waits, and then goes as fast as the tasks do."""

    def __init__(self, start: int = 0) -> None:
        self._now = start
        super().__init__()

    def now(self) -> int:
        """The simulated time (ns)."""
        return self._now

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Run what is due until *deadline* (ns) or until *wake* is set; whether it was set."""
        while not wake.is_set():
            due = self._next()
            if due is None or due > deadline:
                self._now = max(self._now, deadline)
                return False
            self._now = max(self._now, due)
            self._run(self._now)
        return True
