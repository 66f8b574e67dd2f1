"""Clocks: the time in integer nanoseconds, and a way to wait.

A tree gets its clock as an argument. `SystemClock` is real time. `SimClock` does not sleep: a
wait advances its time at once, so that a test of simulated minutes takes milliseconds. A simulated world has
its own clock: waiting on that clock advances the physics simulation.
"""

import threading
import time
from collections.abc import Callable
from math import inf
from typing import Final, Protocol, TypeGuard

from mypy_extensions import mypyc_attr

NS_PER_US: Final = 1_000
NS_PER_MS: Final = 1_000_000
NS_PER_S: Final = 1_000_000_000

POLL_INTERVAL_S: Final = 0.05
"""The longest time (s) between two checks whether a file was saved, or a pause of a run has ended."""


class Clock(Protocol):
    """The interface of a clock.

    Every object with these methods is a clock. A class cannot inherit from `Clock` in the compiled build.

    Examples:
        >>> import btcore
        >>> class Ticks:
        ...     def __init__(self):
        ...         self.time = 0
        ...     def now(self):
        ...         return self.time
        ...     def wait_until(self, deadline, wake):
        ...         self.time = deadline
        ...         return wake.is_set()
        >>> b = btcore.Builder()
        >>> b.build(b.Sleep(msec=500), clock=Ticks()).tick_while_running()
        <Status.SUCCESS: 2>
    """

    def now(self) -> int:
        """Return the time (ns) since a fixed origin. It never decreases."""
        ...

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Wait until *deadline*, or until *wake* is set. The caller clears *wake*.

        Args:
            deadline: The time (ns).
            wake: An event that any thread may set.

        Returns:
            Whether *wake* was set.

        Raises:
            EndOfTimeError: The time ends before *deadline*, as the time of a recording does.
        """
        ...


def is_clock(value: object) -> TypeGuard[Clock]:
    """Return whether *value* has the methods of a clock."""
    return hasattr(value, "now") and hasattr(value, "wait_until")


@mypyc_attr(allow_interpreted_subclasses=True)
class SystemClock:
    """Real time: the system's monotonic clock.

    Examples:
        >>> from btcore import SystemClock
        >>> clock = SystemClock()
        >>> clock.now() <= clock.now()
        True
    """

    def now(self) -> int:
        """Return the monotonic time (ns)."""
        return time.monotonic_ns()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Sleep until a deadline, or until a thread sets an event.

        Args:
            deadline: The monotonic time to sleep until (ns); after this time, return at once.
            wake: The event that ends the sleep early; it is not cleared.

        Returns:
            Whether *wake* was set.
        """
        left = deadline - time.monotonic_ns()
        if left <= 0:
            return wake.is_set()
        return wake.wait(left / NS_PER_S)


@mypyc_attr(allow_interpreted_subclasses=True)
class SimClock:
    """Simulated time, which advances only by waiting and by `advance`. *start* is in ns.

    Examples:
        >>> from btcore import SimClock
        >>> clock = SimClock()
        >>> clock.advance(1.5)
        >>> clock.now()
        1500000000
    """

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        """Return the simulated time (ns)."""
        return self._now

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Advance the time to a deadline without sleeping, unless an event is set.

        Args:
            deadline: The simulated time to advance to (ns); a deadline in the past does not change the time.
            wake: If this event is set, the time does not advance. It is not cleared.

        Returns:
            Whether *wake* was set.
        """
        if wake.is_set():
            return True
        self._now = max(self._now, deadline)
        return False

    def advance(self, seconds: float) -> None:
        """Advance the time by *seconds* (s)."""
        self._now += round(seconds * NS_PER_S)


FAST_NOW: Final[dict[type, Callable[[], int]]] = {SystemClock: time.monotonic_ns}
"""For classes of clocks, a function that returns the same time (ns) as their `now`, but faster."""


class TickSchedule:
    """The due times of periodic ticks, which are *period* (s) apart; the first tick is at *now* (ns).

    Missed ticks are not made up for. After a delay of more than a period, the next tick is due at once, and
    the following due times count from this tick; if the schedule *keeps_multiples*, the next tick is due at
    the next multiple of the period from the start.

    Attributes:
        due: When the next tick is due (ns).
        missed_ticks: The number of multiples that a delay has skipped.
    """

    def __init__(self, period: float, now: int, keeps_multiples: bool = False) -> None:
        if not 0 <= period < inf:  # also False for NaN
            raise ValueError(f"invalid period {period!r}: use a number of seconds between ticks, 0 or more")
        self.period_ns = round(period * NS_PER_S)
        self.due = now
        self.missed_ticks = 0
        self._keeps_multiples = keeps_multiples

    def next(self, now: int) -> int:
        """Return the due time (ns) of the next tick.

        A call before the current due time returns that time. A later call starts the next period.

        Args:
            now: The current time (ns).
        """
        if now >= self.due:
            self.due += self.period_ns
            if self._keeps_multiples and now >= self.due:
                missed = (now - self.due) // self.period_ns + 1
                self.missed_ticks += missed
                self.due += missed * self.period_ns
            else:
                self.due = max(self.due, now)
        return self.due
