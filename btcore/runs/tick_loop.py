"""Ticking trees at a fixed rate on their clock, until the run ends.

Ticks are due at multiples of 1/rate from the start, also after a late tick: the sensors and controllers of a
robot have such times, too. In a `TickSchedule`, a late tick delays all later ticks. If a node needs an
earlier tick, because its delay has elapsed or a thread has woken its tree, this tree gets an additional tick.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Final, Literal

from btcore.clock import NS_PER_S, POLL_INTERVAL_S, Clock
from btcore.errors import EndOfTimeError, NodeExecutionError
from btcore.runs.settings import RunSettings
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.tree.tree import Tree

Until = Literal["done", "success", "failure", "never"]
OnTick = Callable[[Status], None]
Reload = Callable[[], bool]
OnEnd = Callable[[NodeExecutionError | None], None]
_POLL_INTERVAL_NS: Final = round(POLL_INTERVAL_S * NS_PER_S)

LoopEnd = Literal["done", "duration", "end_of_time", "interrupted"]
"""Why a loop ended: all trees are done, the duration is over, the time of the clock has ended (as that of a
recording), or `TickLoop.stop` was called."""

_STATUSES_THAT_END: Final[dict[str, tuple[Status, ...]]] = {
    "done": (SUCCESS, FAILURE, SKIPPED, IDLE),
    "success": (SUCCESS,),
    "failure": (FAILURE,),
    "never": (),
}


def _join_statuses(trees: Sequence[Tree]) -> Status:
    """Return RUNNING or FAILURE, if a tree has it, otherwise the status of the first tree."""
    statuses = [tree.status for tree in trees]
    return RUNNING if RUNNING in statuses else FAILURE if FAILURE in statuses else statuses[0]


class TickLoop:
    """The tick loop of a run: its trees, and the time and the result of their ticks.

    Call `start`, and then `run`.

    Args:
        settings: The rate, the duration, and whether time passes as fast as possible.

    Attributes:
        trees: The trees, in the order in which they are ticked; they have the same clock.
        is_paused: Whether no tick takes place.
        status: The joint status of the trees after the last tick.
        missed_ticks: The number of ticks that did not take place because an earlier tick was in progress.
    """

    def __init__(self, settings: RunSettings) -> None:
        self._settings = settings
        self._period_ns = round(NS_PER_S / settings.rate)
        self._start_ns = 0
        self._due_ns = 0
        self._end_ns: int | None = None
        self._end_statuses: tuple[Status, ...] = ()
        self._on_tick: OnTick | None = None
        self._reload: Reload | None = None
        self._on_end: OnEnd | None = None
        self._unfinished: list[Tree] = []
        self._wake_event = threading.Event()
        self._is_stopping = False
        self.trees: list[Tree] = []
        self.is_paused = False
        self.status: Status = IDLE
        self.missed_ticks = 0

    def start(
        self, until: Until, on_tick: OnTick | None, reload: Reload | None, on_end: OnEnd | None
    ) -> None:
        """Begin the time of the loop; all trees are ticked, also those that have ended before.

        The arguments are those of `Run.tick_to_end`.
        """
        self._start_ns = self.clock.now()
        duration = self._settings.duration
        self._end_ns = None if duration is None else self._start_ns + round(duration * NS_PER_S)
        self._end_statuses = _STATUSES_THAT_END[until]
        self._on_tick = on_tick
        self._reload = reload
        self._on_end = on_end
        self._unfinished = self.trees
        self._is_stopping = False
        self.status = IDLE
        self.missed_ticks = 0
        for tree in self.trees:
            tree.context.wake_event = self._wake_event
            # The end of an earlier loop, such as by a signal, has no effect on this one.
            tree.context.limit.resume()
            tree.context.consume_wake_up()

    @property
    def clock(self) -> Clock:
        """The clock of the trees."""
        return self.trees[0].clock

    @property
    def elapsed_ns(self) -> int:
        """The time since the start, in ns of the trees' clock."""
        return self.clock.now() - self._start_ns

    def run(self) -> LoopEnd:
        """Tick until the loop ends, also after reloads of trees that have ended, and return the reason.

        Raises:
            NodeExecutionError: A leaf raised an exception, and no other tree has replaced its tree.
        """
        if self._reload is None:
            return self._tick_trees()
        while True:
            error: NodeExecutionError | None = None
            try:
                end: LoopEnd | None = self._tick_trees()
            except NodeExecutionError as raised:
                end, error = "done", raised
            if end == "done":
                if self._on_end is not None:
                    self._on_end(error)
                end = self._wait_for_reload()
            if end is not None:
                if error is not None:
                    raise error
                return end

    def _tick_trees(self) -> LoopEnd:
        """Tick until all trees have ended, or the loop ends, and return the reason."""
        end = self._wait_for_end_of_pause()
        if end is not None:
            return end
        self._due_ns = self.clock.now()
        ticked = self._unfinished
        while True:
            self._tick(ticked)
            if self._is_stopping:
                return "interrupted"
            if not self._unfinished:
                return "done"
            if self.is_paused:
                end = self._wait_for_end_of_pause()
                if end is not None:
                    return end
                self._due_ns = self.clock.now()  # the ticks of the pause have not been missed
            now = self.clock.now()
            # An additional tick before the due time leaves it unchanged.
            if now >= self._due_ns:
                missed = (now - self._due_ns) // self._period_ns
                self.missed_ticks += missed
                self._due_ns += (missed + 1) * self._period_ns
            try:
                deadline = self._due_ns if self._end_ns is None else min(self._due_ns, self._end_ns)
                woken = self._wait_for_tick(deadline)
            except EndOfTimeError:
                return "end_of_time"
            end = self._find_end()
            if end is not None:
                return end
            ticked = woken if woken and self.clock.now() < self._due_ns else self._unfinished

    def _find_end(self) -> LoopEnd | None:
        """Return why the loop ends between two ticks, or None."""
        if self._is_stopping:
            return "interrupted"
        is_over = self._end_ns is not None and self.clock.now() >= self._end_ns
        return "duration" if is_over else None

    def _tick(self, trees: Sequence[Tree]) -> None:
        for tree in trees:
            if not self._is_stopping and tree.tick_once() in self._end_statuses:
                self._unfinished = [other for other in self._unfinished if other is not tree]
        self.status = _join_statuses(self.trees)
        if self._on_tick is not None:
            self._on_tick(self.status)

    def step(self) -> None:
        """Tick the trees that are RUNNING once, or all trees if none is."""
        for tree in [tree for tree in self.trees if tree.status is RUNNING] or self.trees:
            tree.tick_once()
        self.status = _join_statuses(self.trees)

    def replace_tree(self, tree: Tree) -> None:
        """Tick *tree* in place of the first, and at once."""
        first, *others = self.trees
        self.trees = [tree, *others]
        self._unfinished = [tree, *(other for other in self._unfinished if other is not first)]
        if first.context.wake_event is self._wake_event:  # the loop has started
            tree.context.wake_event = self._wake_event
            self._due_ns = tree.clock.now()

    def _wait_for_end_of_pause(self) -> LoopEnd | None:
        """Wait until the end of a pause, and return None; or the reason why the loop ends before."""
        while self.is_paused:
            end = self._find_end()
            if end is not None:
                return end
            self.trees[0].context.wait_real_time(POLL_INTERVAL_S)
        return None

    def _wait_for_reload(self) -> LoopEnd | None:
        """Wait without ticking until a reload, and return None; or the reason why the loop ends before.

        In real time the clock, and a simulator that owns the clock, keep running. In simulated time nothing
        can happen any more: the clock advances to the end of the duration at once, if there is one.
        """
        context = self.trees[0].context
        while not self._reload_if_saved():
            end = self._find_end()
            if end is not None:
                return end
            deadline = self._end_ns if self._settings.fast else self._find_next_poll(self._end_ns)
            try:
                if deadline is None:
                    context.wait_real_time(POLL_INTERVAL_S)
                else:
                    context.wait_until(deadline)
            except EndOfTimeError:
                return "end_of_time"
        return None

    def _reload_if_saved(self) -> bool:
        """Let `reload` replace the first tree, unless the loop ends; return whether it did."""
        return self._reload is not None and self._find_end() is None and self._reload()

    def _find_next_poll(self, latest: int | None) -> int:
        """Return the time of the next poll, at the latest *latest*."""
        deadline = self.clock.now() + _POLL_INTERVAL_NS
        return deadline if latest is None else min(deadline, latest)

    def _wait_for_tick(self, deadline: int) -> list[Tree]:
        """Wait until *deadline*, a wake-up, a stop or a reload; return the woken unfinished trees."""
        is_due = False
        while not self._is_stopping and not self._reload_if_saved():
            woken = [tree for tree in self._unfinished if tree.context.consume_wake_up()]
            if woken or is_due:
                return woken
            latest = deadline if self._reload is None else self._find_next_poll(deadline)
            first = min([tree.context.first_deadline(latest) for tree in self._unfinished])
            if not self.clock.wait_until(first, self._wake_event):
                is_due = first == deadline
            elif self._wake_event.is_set():
                self._wake_event.clear()  # before the trees are asked: a later wake-up sets it again
            else:  # the clock has ended the wait, as that of a simulation in lockstep may
                return self._unfinished
        return []

    def stop(self) -> None:
        """End the loop before the next tick, and let the present one repeat no more nodes.

        A signal handler may call this method.
        """
        self._is_stopping = True
        for tree in self.trees:
            tree.context.limit.interrupt()
        # In a thread, since the handler may have interrupted code that holds the locks that these calls need.
        # The access to `hooks` takes a lock, too.
        threading.Thread(target=self._end_waits, daemon=True).start()

    def _end_waits(self) -> None:
        self.trees[0].context.wake_up()
        for tree in self.trees:
            tree.hooks.ignore_breakpoints()
