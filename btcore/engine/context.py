"""What the nodes of one tree share: clock, wake-ups, deadlines, the limit of ticks, and observers."""

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Final

from btcore.clock import NS_PER_S, Clock, SystemClock, TickSchedule
from btcore.engine.observers import Observers

if TYPE_CHECKING:
    from btcore.engine.journal import Journal  # imported when a recording begins

_REPETITIONS_PER_CHECK: Final = 16
"""Without a tick limit, a node lets Python handle signals after this number of repetitions."""


class TickLimit:
    """Ends a tick that repeats nodes: after a time, or by an interruption. Those nodes check it.

    Attributes:
        has_timed_out: Whether the time of `start` has ended the tick.
        is_interrupted: Whether ticks end as soon as possible. Any thread may set it.
    """

    def __init__(self) -> None:
        self.has_timed_out = False
        self.is_interrupted = False
        self._end = 0  # ns of real time, 0 = none
        self._event = threading.Event()

    @property
    def is_set(self) -> bool:
        """Whether there is a limit or an interruption, so that nodes check it after each repetition."""
        return self._end != 0 or self.is_interrupted

    def start(self, seconds: float) -> None:
        """Limit the tick that begins now to *seconds* of real time, whatever clock the tree has."""
        self._end = time.monotonic_ns() + round(seconds * NS_PER_S)
        self.has_timed_out = False

    def stop(self) -> None:
        """End the effect of `start`."""
        self._end = 0

    def extend(self, nanoseconds: int) -> None:
        """Do not count *nanoseconds*, during which the tick was stopped at a breakpoint."""
        if self._end:
            self._end += nanoseconds

    def check(self) -> bool:
        """Return whether the tick must end now; set `has_timed_out`, and let Python handle signals."""
        if self.is_interrupted:
            return True
        if self._end and time.monotonic_ns() >= self._end:
            self.has_timed_out = True
            return True
        # Python handles signals only in interpreted functions, such as this method of Event. A tick of
        # compiled nodes might call none.
        self._event.is_set()
        return self.is_interrupted


class TreeContext:
    """What the engine keeps for all nodes of one tree: time, wake-ups, limits and observers.

    Attributes:
        clock: The clock of the tree.
        wake_event: Set by each wake-up; the trees of a run share one, for which the run waits.
        is_woken: Whether a wake-up of this tree is pending. Event.is_set() would take much longer.
        observers: None while nothing is subscribed, so that a transition costs one comparison.
        deadlines: For each node that requested a tick, by uid: the time (ns) at which the tick is due.
        on_wake_up: Called by each wake-up, on any thread; set by an event loop that runs the tree.
        lock: Held while a node gets its wrapper, or the tree its hooks, which any thread may cause.
        woken_by: The UID of the node that last requested a tick, −1 for `Tree.wake`, 0 for no request.
        limit: The limit of ticks that repeat nodes.
        uses_time: Whether a node has read the clock, so that the tree reads it at the start of each tick.
        tick_start: The time (ns) at which the present tick began, by which its timers are judged, or -1.
        recorded_pause: In a replay, answers `must_pause` as in the recorded run.
    """

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.wake_event = threading.Event()
        self.is_woken = False
        self.lock = threading.Lock()
        self.observers: Observers | None = None
        self.deadlines: dict[int, int] = {}
        self.on_wake_up: Callable[[], object] | None = None
        self.woken_by = 0
        self.limit = TickLimit()
        self.uses_time = False  # most trees without timers never read the clock, which takes time
        self.tick_start = -1
        self.recorded_pause: Callable[[int, int], bool] | None = None

    @property
    def journal(self) -> "Journal | None":
        """Records what the ticks depend on; None = nothing is recorded."""
        return None if self.observers is None else self.observers.journal

    @property
    def is_in_event_loop(self) -> bool:
        """Whether an event loop runs the tree, so that leaves may await asyncio's functions."""
        return self.on_wake_up is not None

    def wake_up(self, woken_by: int = -1) -> None:
        """Request a tick as soon as possible. Thread-safe."""
        self._set_woken(woken_by)
        # Read once: the event loop's thread may set it to None at any time.
        on_wake_up = self.on_wake_up
        if on_wake_up is not None:
            on_wake_up()

    def take_woken_by(self) -> int:
        """Return `woken_by` of the tick that begins, and forget it unless another request is pending."""
        woken_by = self.woken_by
        if not self.is_woken:
            self.woken_by = 0
        return woken_by

    def first_deadline(self, deadline: int) -> int:
        """Return the earlier of *deadline* (ns) and the first deadline of a node."""
        return min(min(self.deadlines.values(), default=deadline), deadline)

    def consume_wake_up(self) -> bool:
        """Return whether a wake-up was pending, by a signal or a deadline that has passed. Consume it."""
        if self.deadlines:
            self._expire_deadlines()
        return self.is_woken and self._clear_wake_up()

    def wait_until(self, deadline: int) -> bool:
        """Wait until *deadline* (ns), the first deadline or a wake-up, and consume the wake-up.

        Returns:
            Whether a wake-up was pending, by a signal or a deadline that has passed.
        """
        if self.deadlines:
            self._expire_deadlines()
            deadline = self.first_deadline(deadline)
        woken = self.is_woken or self.clock.wait_until(deadline, self.wake_event)
        if not woken and self.deadlines:
            self._expire_deadlines()
        # A wake-up that arrives here is consumed now if `is_woken` is set already, else by the next call.
        return (woken or self.is_woken) and self._clear_wake_up()

    def next_tick_time(self, schedule: TickSchedule) -> int:
        """Return the time (ns) of the next tick: the due time of *schedule* or the first deadline before it.

        Without a period, a clock that advances only by waiting would stand still, so that no deadline would
        ever pass. If no time has passed since the previous tick, the next tick is at the first deadline.
        """
        clock = self.clock
        now = clock.now()
        # The system clock never stands still, but may have a low resolution.
        stands_still = schedule.period_ns == 0 and now == schedule.due and not isinstance(clock, SystemClock)
        if stands_still and self.deadlines:
            schedule.due = max(min(self.deadlines.values()), now)
            return schedule.due
        return self.first_deadline(schedule.next(now))

    def wait_real_time(self, seconds: float) -> None:
        """Wait at most *seconds* (s, real time even with another clock) for a wake-up, and consume it."""
        if not self.is_woken:
            self.wake_event.wait(seconds)
        self._clear_wake_up()

    def exclude_time(self, nanoseconds: int) -> None:
        """Do not count *nanoseconds*, during which the tick was stopped at a breakpoint."""
        self.limit.extend(nanoseconds)
        if self.observers is not None:
            self.observers.exclude_time(nanoseconds)

    def must_pause(self, uid: int, count: int) -> bool:
        """Return whether the node *uid*, which has repeated its child *count* times, must pause.

        A pause is recorded; in a replay, the recording answers.
        """
        if self.recorded_pause is not None:
            return self.recorded_pause(uid, count)
        # Without a limit, a check only lets Python handle signals, which takes time and may be late.
        if not self.limit.is_set and count % _REPETITIONS_PER_CHECK != 0:
            return False
        must_end = self.limit.check()
        if must_end and self.journal is not None:
            self.journal.add_pause(uid, count)
        return must_end

    def _set_woken(self, woken_by: int) -> None:
        self.woken_by = woken_by
        self.is_woken = True
        self.wake_event.set()

    def _clear_wake_up(self) -> bool:
        # A wake-up that another thread sends between these lines may count twice, but is never lost.
        self.is_woken = False
        self.wake_event.clear()
        return True

    def _expire_deadlines(self) -> None:
        now = self.clock.now()
        due = [uid for uid, deadline in self.deadlines.items() if deadline <= now]
        for uid in due:
            del self.deadlines[uid]
        if due:
            self._set_woken(due[0])
