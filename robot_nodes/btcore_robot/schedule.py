"""Clocks with a schedule of periodic tasks, for worlds, robots and programs without a robot.

`RealTime` follows the wall clock, `SimulatedTime` jumps from one due task to the next. Both run their tasks
on the thread that waits, one at a time, while it waits: in the order of due times, then of ranks, then
of the calls of `every`. The k-th period of a task at *hertz* ends ``k * 1e9 / hertz`` ns after its start,
rounded down, so that no error accumulates.
"""

import heapq
import threading
import time
from collections.abc import Callable

from btcore_robot.robot import NS_PER_S, Phase

Task = Callable[[int], None]
Pace = Callable[[int, int, threading.Event], bool]


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
        # Counted from now, the calls of all rates meet at whole seconds, to the ns.
        start, count = (now, 1) if first is None else (max(first, now), 0)
        self._tasks[number] = (task, hertz, start)
        heapq.heappush(self._due, (start + int(count * NS_PER_S / hertz), rank, number, count))

        def end() -> None:
            self._tasks.pop(number, None)

        return end

    def next_due(self) -> int | None:
        """Return when (ns) the next task is due, or None if there is none."""
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
            due = self.next_due()
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
    """Time that stands still until `wait_until` is called, and then advances as fast as the tasks do.

    *pace* may slow it down: called with the time, the next moment (both ns) and the wake-up of the waiting
    thread, it returns when that moment may begin; True ends the wait.
    """

    def __init__(self, start: int = 0, pace: Pace | None = None) -> None:
        self._now = start
        self._pace = pace
        super().__init__()

    def now(self) -> int:
        """Return the simulated time (ns)."""
        return self._now

    def run_next(self) -> None:
        """Advance the time to the next task, and run it. Raises LookupError if no task is scheduled."""
        due = self.next_due()
        if due is None:
            raise LookupError("nothing is scheduled")
        self._now = max(self._now, due)
        self._run(self._now)

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Run all tasks due until *deadline* (ns), or until *wake* is set; return whether it was set."""
        while not wake.is_set():
            due = self.next_due()
            until = deadline if due is None else min(due, deadline)
            if self._pace is not None and self._pace(self._now, until, wake):
                return True
            if due is None or due > deadline:
                self._now = max(self._now, deadline)
                return False
            self.run_next()
        return True
