"""Ticking at a fixed rate on the tree's clock, until something ends it.

Ticks are due on a grid of 1/rate from the start; a node that wants one earlier (its delay is
over, a thread woke the tree) gets it, and the grid stays. Ctrl-C and SIGTERM end the run between
two ticks, so that the tree is halted in order; a second one breaks the tick off.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, Literal

from btcore.clock import NS_PER_S
from btcore.status import Status
from btcore.tree import Tree

Until = Literal["done", "success", "failure", "never"]
Ending = Literal["done", "duration", "interrupted"]

_STATUSES_THAT_END: Final[dict[str, tuple[Status, ...]]] = {
    "done": (Status.SUCCESS, Status.FAILURE, Status.SKIPPED, Status.IDLE),
    "success": (Status.SUCCESS,),
    "failure": (Status.FAILURE,),
    "never": (),
}


class Pace:
    """The loop of one run.

    *rate* is in Hz, *duration* in s of the tree's clock (None = no limit). *on_tick* is called
    after every tick with its result. Afterwards *late* counts the ticks that were due while an
    earlier one was still under way, and were left out.
    """

    def __init__(
        self,
        tree: Tree,
        rate: float,
        duration: float | None,
        until: Until,
        on_tick: Callable[[Status], None],
    ) -> None:
        self.tree = tree
        self.period = round(NS_PER_S / rate)
        self.duration = None if duration is None else round(duration * NS_PER_S)
        self.endings = _STATUSES_THAT_END[until]
        self.on_tick = on_tick
        self.start = tree.clock.now()
        self.status = Status.IDLE
        self.late = 0
        self._stop = False
        self._waiting = False

    @property
    def elapsed(self) -> int:
        """How long (ns of the tree's clock) the run has taken so far."""
        return self.tree.clock.now() - self.start

    def run(self) -> Ending:
        """Tick until the tree's status, the duration or a signal ends it, and say which did."""
        with self._signals():
            due = self.start
            end = None if self.duration is None else self.start + self.duration
            while True:
                self.status = self.tree.tick_once()
                self.on_tick(self.status)
                if self._stop:
                    return "interrupted"
                if self.status in self.endings:
                    return "done"
                now = self.tree.clock.now()
                if now >= due:
                    missed = (now - due) // self.period
                    self.late += missed
                    due += (missed + 1) * self.period
                self._wait(due if end is None else min(due, end))
                if self._stop:
                    return "interrupted"
                if end is not None and self.tree.clock.now() >= end:
                    return "duration"

    def _wait(self, moment: int) -> None:
        self._waiting = True
        if not self._stop:
            self.tree.context.wait_until(moment)
        self._waiting = False

    @contextmanager
    def _signals(self) -> Iterator[None]:
        """SIGINT and SIGTERM end the loop instead of the process, where the thread may say so."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        before = [(number, signal.signal(number, self._heard)) for number in (signal.SIGINT, signal.SIGTERM)]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)

    def _heard(self, number: int, frame: FrameType | None) -> None:
        if self._stop:
            raise KeyboardInterrupt
        self._stop = True
        if self._waiting:
            # The handler may have interrupted the very lines that hold the signal's lock.
            threading.Thread(target=self.tree.context.wake_up, daemon=True).start()
