"""Time as the engine sees it: integer nanoseconds, and a way to wait for a moment.

A clock is handed in. :class:`SystemClock` waits on the wall clock; :class:`SimClock` jumps
straight to the moment asked for, so that a tree of minutes is tested in milliseconds. A
simulated world brings a clock of its own, whose waiting is stepping the physics.
"""

import threading
import time
from collections.abc import Callable
from typing import Final, Protocol

from mypy_extensions import mypyc_attr

NS_PER_US: Final = 1_000
NS_PER_MS: Final = 1_000_000
NS_PER_S: Final = 1_000_000_000


class Clock(Protocol):
    """What the engine asks of a clock."""

    def now(self) -> int:
        """The time (ns) since an origin that never moves; never decreasing."""
        ...

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Return at *deadline* (ns), or earlier, as soon as *wake* is set.

        Returns whether *wake* was set. The caller clears it.
        """
        ...


@mypyc_attr(allow_interpreted_subclasses=True)
class SystemClock:
    """Real time, by the monotonic clock."""

    def now(self) -> int:
        """The monotonic time (ns)."""
        return time.monotonic_ns()

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Sleep until *deadline* (ns) or until *wake* is set, from any thread."""
        left = deadline - time.monotonic_ns()
        if left <= 0:
            return wake.is_set()
        return wake.wait(left / NS_PER_S)


@mypyc_attr(allow_interpreted_subclasses=True)
class SimClock:
    """Simulated time, which stands still until somebody waits."""

    def __init__(self, start: int = 0) -> None:
        self._now = start

    def now(self) -> int:
        """The simulated time (ns)."""
        return self._now

    def wait_until(self, deadline: int, wake: threading.Event) -> bool:
        """Jump to *deadline* (ns), unless *wake* is set already."""
        if wake.is_set():
            return True
        self._now = max(self._now, deadline)
        return False

    def advance(self, seconds: float) -> None:
        """Let *seconds* (s) pass."""
        self._now += round(seconds * NS_PER_S)


def now_function(clock: Clock) -> Callable[[], int]:
    """The shortest way to the time (ns) of *clock*: Python's own function, where it does nothing else."""
    return time.monotonic_ns if type(clock) is SystemClock else clock.now


class TickSchedule:
    """Ticks are due at multiples of *period* seconds after *now* (ns).

    One that comes late moves the next ones, and none is made up for.
    """

    def __init__(self, period: float, now: int) -> None:
        self.step = round(period * NS_PER_S)
        self.due = now

    def next(self, now: int) -> int:
        """The time (ns) of the next tick, it being *now*; an early tick doesn't move it."""
        if now >= self.due:
            self.due = max(self.due + self.step, now)
        return self.due
