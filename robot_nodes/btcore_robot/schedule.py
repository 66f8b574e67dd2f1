"""Clocks with a schedule of periodic tasks, for worlds, robots and programs without a robot.

`RealTimeSchedule` follows the wall clock, `SimulatedSchedule` jumps from one due task to the next. Both run
their tasks on the thread that waits, one at a time, in the order of due times. At the same time, tasks run in
the order of phases; in the same phase, in the order of the calls of `add_task`. The k-th period of a task at
*hertz* ends `k * 1e9 / hertz` ns after its start, rounded down, so that no error accumulates.
"""

import heapq
import threading
import time
from collections.abc import Callable

from btcore.clock import NS_PER_S
from btcore_robot.robot import Phase

Task = Callable[[int], None]
"""A function that is called with the time (ns) at which it is due."""

Pace = Callable[[int, int, threading.Event], bool]
"""A function that waits until simulated time may advance, see `SimulatedSchedule`."""


class _PeriodicTasks:
    """Periodic tasks in the order in which they are due."""

    def __init__(self) -> None:
        self._due: list[tuple[int, int, int, int]] = []
        self._tasks: dict[int, tuple[Task, float, int]] = {}
        self._count = 0

    def now(self) -> int:
        """Return the time (ns). It never decreases."""
        raise NotImplementedError

    def add_task(
        self, hertz: float, phase: Phase, task: Task, *, first: int | None = None
    ) -> Callable[[], None]:
        """Call *task* with the time (ns) at *hertz*; see `Schedule.add_task`.

        Raises:
            ValueError: *hertz* is not above 0.
        """
        if not hertz > 0.0:
            raise ValueError(f"the rate of a task must be above 0 Hz, not {hertz}")
        number = self._count
        self._count += 1
        now = self.now()
        # Periods count from now, so that tasks of all rates coincide at whole seconds, to the nanosecond.
        start, count = (now, 1) if first is None else (max(first, now), 0)
        self._tasks[number] = (task, hertz, start)
        heapq.heappush(self._due, (start + int(count * NS_PER_S / hertz), phase, number, count))

        def end() -> None:
            self._tasks.pop(number, None)

        return end

    def next_due(self) -> int | None:
        """Return when (ns) the next task is due, or None if there is none."""
        due = self._due
        # Ended tasks stay in the heap until they are due.
        while due and due[0][2] not in self._tasks:
            heapq.heappop(due)
        return due[0][0] if due else None

    def _run(self, now: int) -> int:
        """Run the next task at *now* (ns), schedule its next call, and return the number of missed calls."""
        _, phase, number, count = self._due[0]
        task, hertz, start = self._tasks[number]
        next_count = max(count + 1, int((now - start) * hertz / NS_PER_S) + 1)
        heapq.heapreplace(self._due, (start + int(next_count * NS_PER_S / hertz), phase, number, next_count))
        task(now)
        return next_count - count - 1


class RealTimeSchedule(_PeriodicTasks):
    """The monotonic clock of the machine. Tasks run only while a thread waits in `wait_until`.

    A late task is called with the actual time, and its missed calls are omitted. A slow task delays the
    other tasks, but its calls never accumulate. *missed_calls* counts the omitted calls.
    """

    def __init__(self) -> None:
        super().__init__()
        self.missed_calls = 0

    def now(self) -> int:
        """Return the time (ns) of the monotonic clock; only differences have a meaning."""
        return time.monotonic_ns()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Wait until *deadline* and run the tasks that become due.

        Args:
            deadline: The time (ns) of the monotonic clock at which to return.
            wake: An event that ends the wait early; another thread may set it.

        Returns:
            Whether the wait ended because *wake* was set.
        """
        while not wake.is_set():
            due = self.next_due()
            if self._sleep_until(deadline if due is None else min(due, deadline), wake):
                return True
            now = self.now()
            if due is not None and due <= min(now, deadline):
                self.missed_calls += self._run(now)
            elif now >= deadline:
                return False
        return True

    def _sleep_until(self, until: int, wake: threading.Event) -> bool:
        """Wait until *until* (ns) at the latest, and return whether *wake* was set.

        A subclass that overrides `now` overrides this method too. It may return before *until*.
        """
        remaining = until - time.monotonic_ns()
        return remaining > 0 and wake.wait(remaining / NS_PER_S)


class SimulatedSchedule(_PeriodicTasks):
    """A time that advances only in `wait_until` and `run_next`, as fast as the tasks run.

    *pace* can slow it down. Before each advance in `wait_until`, *pace* is called with the current time, the
    next time (both ns) and the event that ends the wait. It returns when the time may advance. It returns
    True to end the wait, otherwise False.

    Args:
        start: The first time (ns).
        pace: The function, or None. The attribute may be replaced.

    Examples:
        >>> from btcore_robot.robot import Phase
        >>> from btcore_robot.schedule import SimulatedSchedule
        >>> schedule = SimulatedSchedule()
        >>> end = schedule.add_task(10.0, Phase.CONTROLLER, lambda now: print(now))
        >>> schedule.run_next()
        100000000
        >>> schedule.run_next()
        200000000
    """

    def __init__(self, start: int = 0, pace: Pace | None = None) -> None:
        self._now = start
        self.pace = pace
        super().__init__()

    def now(self) -> int:
        """Return the simulated time (ns)."""
        return self._now

    def run_next(self) -> None:
        """Advance the time to the next task, and run it.

        Raises:
            LookupError: No task is scheduled.
        """
        due = self.next_due()
        if due is None:
            raise LookupError("nothing is scheduled")
        self._now = max(self._now, due)
        self._run(self._now)

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Advance the time to *deadline* and run the tasks that become due.

        Args:
            deadline: The simulated time (ns) at which to return.
            wake: An event that ends the wait early; a task, *pace* or another thread may set it.

        Returns:
            Whether the wait ended early, because *wake* was set or *pace* returned True.
        """
        while not wake.is_set():
            due = self.next_due()
            until = deadline if due is None or due > deadline else due
            if self.pace is not None and self.pace(self._now, until, wake):
                return True
            self._now = max(self._now, until)
            if until != due:
                return False
            self._run(self._now)
        return True
