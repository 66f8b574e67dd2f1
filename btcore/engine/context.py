"""What the nodes of one tree share: its clock, its wake-up signal, its deadlines and observers."""

import threading
from collections.abc import Callable

from mypy_extensions import mypyc_attr

from btcore.clock import Clock
from btcore.engine.observers import Observers


@mypyc_attr(allow_interpreted_subclasses=True)
class TreeState:
    """What the leaves of one tree share: a leaf that asks for a subclass gets the tree's own instance.

    The first leaf that asks makes it, without arguments; every tree has its own.
    """


class TreeContext:
    """One per tree.

    *observers* is None while nobody listens, so that telling nobody costs one comparison.
    *deadlines* maps a node's uid to the time (ns) at which it wants the tree to be ticked.
    *on_wake* is called by a wake-up, from any thread; an event loop that runs the tree needs it. *lock*
    is held while something is put around a node's ticks, which any thread may do.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.wake = threading.Event()
        self._woken = False  # as the event is or is about to be, which takes far longer to ask
        self.lock = threading.Lock()
        self.observers: Observers | None = None
        self.deadlines: dict[int, int] = {}
        self.on_wake: Callable[[], object] | None = None

    @property
    def in_event_loop(self) -> bool:
        """Whether an event loop runs the tree, so that leaves may await what asyncio offers."""
        return self.on_wake is not None

    @property
    def is_woken(self) -> bool:
        """Whether a wake-up has come that no tick has served."""
        return self._woken

    def wake_up(self) -> None:
        """Ask for a tick as soon as possible. Any thread may."""
        self._woken = True
        self.wake.set()
        # Read once: the loop may end meanwhile.
        on_wake = self.on_wake
        if on_wake is not None:
            on_wake()

    def first_deadline(self, moment: int) -> int:
        """The earlier of *moment* (ns) and the first deadline."""
        return min(min(self.deadlines.values(), default=moment), moment)

    def take_wake_up(self) -> bool:
        """Whether a wake-up is due, by signal or by a deadline that has passed; takes it."""
        if self.deadlines:
            self._expire()
        return self._woken and self._take()

    def wait_until(self, moment: int) -> bool:
        """Wait until *moment* (ns), the first deadline, or a wake-up; returns whether woken."""
        if self.deadlines:
            self._expire()
            moment = self.first_deadline(moment)
        woken = self._woken or self.clock.wait_until(moment, self.wake)
        if not woken and self.deadlines:
            self._expire()
        # One that comes only now is told, or left for the next time.
        return (woken or self._woken) and self._take()

    def doze(self, seconds: float) -> None:
        """Wait for a wake-up, for at most *seconds* (s) of real time, whatever the clock."""
        if not self._woken:
            self.wake.wait(seconds)
        self._take()

    def _take(self) -> bool:
        # In this order, one that comes from another thread meanwhile may count twice, but is never lost.
        self._woken = False
        self.wake.clear()
        return True

    def _expire(self) -> None:
        now = self.clock.now()
        due = [uid for uid, deadline in self.deadlines.items() if deadline <= now]
        for uid in due:
            del self.deadlines[uid]
        if due:
            self._woken = True
            self.wake.set()
