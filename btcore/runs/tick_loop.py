"""Ticking a tree at a fixed rate on its clock, until the run ends.

Ticks are due at multiples of 1/rate from the start, also after a late tick: the sensors and controllers of a
robot have such times, too. In a `TickSchedule`, a late tick delays all later ticks. If a node needs an
earlier tick, because its delay has elapsed or a thread has woken the tree, an additional tick takes place.
"""

import threading
from collections.abc import Callable
from typing import Final, Literal

from btcore.clock import NS_PER_S
from btcore.errors import EndOfTimeError
from btcore.runs.settings import RunSettings
from btcore.status import Status
from btcore.tree.tree import Tree

Until = Literal["done", "success", "failure", "never"]
_CHECK_INTERVAL_S: Final = 0.05
"""The longest time (s) between two checks whether the file was saved, or a pause has ended."""

LoopEnd = Literal["done", "duration", "end_of_time", "interrupted"]
"""Why a loop ended: the tree is done, the duration is over, the time of the clock has ended (as that of a
recording), or `TickLoop.stop` was called."""
LoopPause = Literal["saved"]
"""Why a loop can continue with another tree: the file of the tree was saved."""

_STATUSES_THAT_END: Final[dict[str, tuple[Status, ...]]] = {
    "done": (Status.SUCCESS, Status.FAILURE, Status.SKIPPED, Status.IDLE),
    "success": (Status.SUCCESS,),
    "failure": (Status.FAILURE,),
    "never": (),
}


class TickLoop:
    """The tick loop of a run. The attribute `tree` may be replaced between two calls of `run`.

    Args:
        tree: The tree.
        settings: The rate, the duration, and whether time passes as fast as possible.
        until: The result of the tree that ends the run.
        on_tick: Called with the tree's status after every tick.
        was_saved: Called between ticks; the loop ends when it returns True.

    Attributes:
        is_paused: Whether no tick takes place.
        status: The tree's status after the last tick.
        skipped_ticks: The number of ticks that were skipped because an earlier tick was still in progress.
    """

    def __init__(
        self,
        tree: Tree,
        settings: RunSettings,
        until: Until,
        on_tick: Callable[[Status], None] | None = None,
        was_saved: Callable[[], bool] | None = None,
    ) -> None:
        self.tree = tree
        self.period_ns = round(NS_PER_S / settings.rate)
        self.end_statuses = _STATUSES_THAT_END[until]
        self.on_tick = on_tick
        self.was_saved = was_saved
        self.fast = settings.fast
        self.start_ns = tree.clock.now()
        duration = settings.duration
        self.end_ns = None if duration is None else self.start_ns + round(duration * NS_PER_S)
        self.is_paused = False
        self.status = Status.IDLE
        self.skipped_ticks = 0
        self._is_stopping = False
        self._is_waiting = False

    @property
    def elapsed_ns(self) -> int:
        """The time since the start of the run, in ns of the tree's clock."""
        return self.tree.clock.now() - self.start_ns

    def run(self) -> LoopEnd | LoopPause:
        """Tick until the end of the loop, or until the file was saved, and return the reason."""
        reason = self._wait_for_end_of_pause()
        if reason is not None:
            return reason
        due = self.tree.clock.now()
        while True:
            self.status = self.tree.tick_once()
            if self.on_tick is not None:
                self.on_tick(self.status)
            if self._is_stopping:
                return "interrupted"
            if self.status in self.end_statuses:
                return "done"
            if self.is_paused:
                reason = self._wait_for_end_of_pause()
                if reason is not None:
                    return reason
                due = self.tree.clock.now()  # the ticks of the pause have not been skipped
            now = self.tree.clock.now()
            # An additional tick before `due` leaves the due time unchanged.
            if now >= due:
                missed = (now - due) // self.period_ns
                self.skipped_ticks += missed
                due += (missed + 1) * self.period_ns
            try:
                saved = self._wait_until(due if self.end_ns is None else min(due, self.end_ns))
            except EndOfTimeError:
                return "end_of_time"
            if self._is_stopping:
                return "interrupted"
            if self.end_ns is not None and self.tree.clock.now() >= self.end_ns:
                return "duration"
            if saved:
                return "saved"

    def _wait_for_end_of_pause(self) -> LoopEnd | None:
        """Wait until the end of a pause, and return None; or the reason why the loop ends before."""
        while self.is_paused:
            if self._is_stopping:
                return "interrupted"
            if self.end_ns is not None and self.tree.clock.now() >= self.end_ns:
                return "duration"
            self.tree.context.wait_real_time(_CHECK_INTERVAL_S)
        return None

    def wait_for_save(self) -> LoopEnd | LoopPause:
        """Wait without ticking until a save, the duration or `stop` ends the wait; return the reason.

        In real time the clock, and a simulator that owns the clock, keep running. In simulated time nothing
        can happen any more: the clock advances to the end of the duration at once, or stands still without a
        duration.
        """
        while not self._is_stopping:
            now = self.tree.clock.now()
            if self.end_ns is not None and now >= self.end_ns:
                return "duration"
            if self.was_saved is not None and self.was_saved():
                return "saved"
            self._is_waiting = True
            # Checked again, because a `stop` before `_is_waiting` was set does not end the wait.
            try:
                if not self._is_stopping:
                    self._wait_poll_interval(now)
            except EndOfTimeError:
                return "end_of_time"
            finally:
                self._is_waiting = False
        return "interrupted"

    def _wait_poll_interval(self, now: int) -> None:
        context = self.tree.context
        if not self.fast:
            deadline = now + round(_CHECK_INTERVAL_S * NS_PER_S)
            context.wait_until(deadline if self.end_ns is None else min(deadline, self.end_ns))
        elif self.end_ns is not None:
            context.wait_until(self.end_ns)
        else:
            context.wait_real_time(_CHECK_INTERVAL_S)

    def _wait_until(self, deadline: int) -> bool:
        """Wait until *deadline*, a wake-up, a stop or a save; return whether the file was saved."""
        saved = self.was_saved is not None and self.was_saved()
        self._is_waiting = True
        try:
            while not (self._is_stopping or saved):
                step = deadline
                if self.was_saved is not None:
                    step = min(deadline, self.tree.clock.now() + round(_CHECK_INTERVAL_S * NS_PER_S))
                if self.tree.context.wait_until(step) or step == deadline:
                    break
                saved = self.was_saved is not None and self.was_saved()
        finally:
            self._is_waiting = False
        return saved

    def stop(self) -> None:
        """End the loop before the next tick. A signal handler may call this method."""
        self._is_stopping = True
        self.tree.context.interrupt()
        # In threads, since the handler may have interrupted code that holds the locks that these calls need.
        # The lambda matters: the access to `hooks` takes a lock, too.
        threading.Thread(target=lambda: self.tree.hooks.ignore_breakpoints(), daemon=True).start()
        if self._is_waiting:
            threading.Thread(target=self.tree.context.wake_up, daemon=True).start()
