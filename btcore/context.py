"""What the nodes of one tree share: its clock, its wake-up signal, its deadlines and observers."""

import threading

from btcore.clock import Clock
from btcore.observers import Observers


class TreeContext:
    """One per tree.

    *observers* is None while nobody listens, so that telling nobody costs one comparison.
    *deadlines* maps a node's uid to the time (ns) at which it wants the tree to be ticked.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.wake = threading.Event()
        self.observers: Observers | None = None
        self.deadlines: dict[int, int] = {}

    def wake_up(self) -> None:
        """Ask for a tick as soon as possible. Any thread may."""
        self.wake.set()

    def take_wake_up(self) -> bool:
        """Whether a wake-up is due, by signal or by a deadline that has passed; takes it."""
        self._expire()
        woken = self.wake.is_set()
        self.wake.clear()
        return woken

    def wait_until(self, moment: int) -> bool:
        """Wait until *moment* (ns), the first deadline, or a wake-up; returns whether woken."""
        self._expire()
        until = min(self.deadlines.values(), default=moment)
        woken = self.clock.wait_until(min(until, moment), self.wake)
        if not woken and self.deadlines:
            self._expire()
            woken = self.wake.is_set()
        self.wake.clear()
        return woken

    def _expire(self) -> None:
        if self.deadlines:
            now = self.clock.now()
            due = [uid for uid, deadline in self.deadlines.items() if deadline <= now]
            for uid in due:
                del self.deadlines[uid]
            if due:
                self.wake.set()
