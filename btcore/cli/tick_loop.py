"""Ticking at a fixed rate on the tree's clock, until something ends it.

Ticks are due on a grid of 1/rate from the start; a node that wants one earlier (its delay is
over, a thread woke the tree) gets it, and the grid stays. Ctrl-C, SIGTERM and the closing of the
terminal (SIGHUP) end the run between two ticks, so that the tree is halted in order; a second one
breaks the tick off.
"""

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final, Literal

from btcore.clock import NS_PER_S
from btcore.status import Status
from btcore.tree.tree import Tree

Until = Literal["done", "success", "failure", "never"]
EndReason = Literal["done", "duration", "interrupted", "saved"]

POLL_INTERVAL_S: Final = 0.05
"""The longest time (s) without a look at whether the file was saved."""

_STATUSES_THAT_END: Final[dict[str, tuple[Status, ...]]] = {
    "done": (Status.SUCCESS, Status.FAILURE, Status.SKIPPED, Status.IDLE),
    "success": (Status.SUCCESS,),
    "failure": (Status.FAILURE,),
    "never": (),
}


class TickLoop:
    """The loop of one run, whose *tree* may be exchanged between two calls of it.

    *rate* is in Hz, *duration* in s of the tree's clock (None = no limit). *on_tick* is called
    after every tick with its result; *saved*, if given, between ticks: when it is true the loop ends.
    *fast* says that the clock jumps, or runs as fast as it goes. Afterwards *late* counts the ticks
    that were due while an earlier one was still under way, and were left out.
    """

    def __init__(
        self,
        tree: Tree,
        rate: float,
        duration: float | None,
        until: Until,
        on_tick: Callable[[Status], None],
        saved: Callable[[], bool] | None = None,
        fast: bool = False,
    ) -> None:
        self.tree = tree
        self.period = round(NS_PER_S / rate)
        self.endings = _STATUSES_THAT_END[until]
        self.on_tick = on_tick
        self.saved = saved
        self.fast = fast
        self.start = tree.clock.now()
        self.end = None if duration is None else self.start + round(duration * NS_PER_S)
        self.status = Status.IDLE
        self.late = 0
        self._stop = False
        self._waiting = False

    @property
    def elapsed(self) -> int:
        """How long (ns of the tree's clock) the run has taken so far."""
        return self.tree.clock.now() - self.start

    def run(self) -> EndReason:
        """Tick until the tree's status, the duration, a save or a signal ends it, and say which did."""
        due = self.tree.clock.now()
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
            saved = self._wait(due if self.end is None else min(due, self.end))
            if self._stop:
                return "interrupted"
            if self.end is not None and self.tree.clock.now() >= self.end:
                return "duration"
            if saved:
                return "saved"

    def wait_for_save(self) -> EndReason:
        """Tick no more until the duration, a save or a signal ends that.

        Real time goes on, and a world with it. With *fast* nothing is left to happen: the clock goes to
        the end of the duration, or stands still if there is none.
        """
        while not self._stop:
            now = self.tree.clock.now()
            if self.end is not None and now >= self.end:
                return "duration"
            if self.saved is not None and self.saved():
                return "saved"
            self._waiting = True
            if not self._stop:
                self._rest_until(now)
            self._waiting = False
        return "interrupted"

    def _rest_until(self, now: int) -> None:
        context = self.tree.context
        if not self.fast:
            moment = now + round(POLL_INTERVAL_S * NS_PER_S)
            context.wait_until(moment if self.end is None else min(moment, self.end))
        elif self.end is not None:
            context.wait_until(self.end)
        else:
            context.doze(POLL_INTERVAL_S)

    def _wait(self, moment: int) -> bool:
        """Wait until *moment*, or less: until woken, stopped or (the answer) the file is saved."""
        saved = self.saved is not None and self.saved()
        self._waiting = True
        while not (self._stop or saved):
            step = moment
            if self.saved is not None:
                step = min(moment, self.tree.clock.now() + round(POLL_INTERVAL_S * NS_PER_S))
            if self.tree.context.wait_until(step) or step == moment:
                break
            saved = self.saved is not None and self.saved()
        self._waiting = False
        return saved

    @contextmanager
    def signals(self) -> Iterator[None]:
        """What ends a process ends the loop instead, where the thread may say so."""
        if threading.current_thread() is not threading.main_thread():
            yield
            return
        numbers = [signal.SIGINT, signal.SIGTERM]
        # nohup asks to outlive the terminal; and not every system has one to close.
        if hasattr(signal, "SIGHUP") and signal.getsignal(signal.SIGHUP) is not signal.SIG_IGN:
            numbers.append(signal.SIGHUP)
        before = [(number, signal.signal(number, self._heard)) for number in numbers]
        try:
            yield
        finally:
            for number, handler in before:
                signal.signal(number, handler)

    def _heard(self, number: int, frame: FrameType | None) -> None:
        if self._stop:
            raise KeyboardInterrupt
        self._stop = True
        # The handler may have interrupted the very lines that hold a lock.
        threading.Thread(target=self._leave_breakpoint, daemon=True).start()
        if self._waiting:
            threading.Thread(target=self.tree.context.wake_up, daemon=True).start()

    def _leave_breakpoint(self) -> None:
        self.tree.hooks.ignore_breakpoints()
