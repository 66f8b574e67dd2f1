"""Ticking trees at a fixed rate on their clock, until the run ends.

Ticks are due at multiples of 1/rate from the start, also after a late tick: the sensors and controllers of a
robot have such times, too. If a node needs an earlier tick, because its delay has elapsed or a thread has
woken its tree, this tree gets an additional tick.
"""

import threading
from collections.abc import Callable, Sequence
from typing import Final, Literal, Protocol

from btcore.clock import NS_PER_S, POLL_INTERVAL_S, Clock, TickSchedule
from btcore.errors import EndOfTimeError, NodeExecutionError
from btcore.runs.settings import RunSettings
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.tree.tree import Tree

Until = Literal["done", "success", "failure", "never"]
OnTick = Callable[[Status], None]
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


class ReloadRequest(Protocol):
    """A request for another tree, such as that of a client of a published run."""

    @property
    def text(self) -> str:
        """The XML of the tree."""

    def finish(self, error: str = "") -> None:
        """End the request. *error* is why the tree was not replaced, or ""."""
        ...


class ReloadRequests(Protocol):
    """The requests for other trees: the attribute `reload_requests` of a provided object."""

    is_used: bool
    """Whether the program takes the requests, which sets it."""

    def take(self) -> ReloadRequest | None:
        """Remove and return the next request, or None."""
        ...


class Reloader(Protocol):
    """What replaces the first tree between ticks, such as that of `btcore run --watch`."""

    @property
    def is_endless(self) -> bool:
        """Whether the loop waits for another tree after the end of all trees."""

    def reload(self) -> bool:
        """Call `Run.replace_tree` if there is a new tree, and return whether there was."""
        ...

    def on_end(self, error: NodeExecutionError | None) -> None:
        """Take note of the end of all trees, or of the exception of a leaf: the loop waits for a new tree."""
        ...


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
        schedule: When all trees are ticked, and the number of missed ticks.
    """

    def __init__(self, settings: RunSettings) -> None:
        self._settings = settings
        self._clock: Clock  # of the trees; set by `start`
        self._start_ns = 0
        self._end_ns: int | None = None
        self._unfinished: list[Tree] = []
        self._error: NodeExecutionError | None = None  # of a leaf; it ends all trees, until one is replaced
        self._wake_event = threading.Event()
        self._is_stopping = False
        self.trees: list[Tree] = []
        self.is_paused = False
        self.status: Status = IDLE
        self.schedule = self._create_schedule(0)

    def _create_schedule(self, now: int) -> TickSchedule:
        return TickSchedule(1 / self._settings.rate, now, keeps_multiples=True)

    @property
    def elapsed_ns(self) -> int:
        """The time since the start, in ns of the trees' clock."""
        return self._clock.now() - self._start_ns

    def start(self) -> None:
        """Begin the time of the loop; all trees are ticked, also those that have ended before."""
        self._clock = self.trees[0].clock
        self._start_ns = self._clock.now()
        self.schedule = self._create_schedule(self._start_ns)
        duration = self._settings.duration
        self._end_ns = None if duration is None else self._start_ns + round(duration * NS_PER_S)
        self._unfinished = self.trees
        self._error = None
        self._is_stopping = False
        self.status = IDLE
        for tree in self.trees:
            tree.context.wake_event = self._wake_event
            # The end of an earlier loop, such as by a signal, has no effect on this one.
            tree.context.limit.is_interrupted = False

    def run(self, until: Until, on_tick: OnTick | None, reloader: Reloader | None) -> LoopEnd:
        """Tick until the loop ends, also after reloads of trees that have ended, and return the reason.

        The arguments are those of `Run.tick_to_end`.

        Raises:
            NodeExecutionError: A leaf raised an exception, and no other tree has replaced its tree.
        """
        end_statuses = _STATUSES_THAT_END[until]
        end = self._find_end()
        while end is None:
            if self.is_paused and not self._is_done:
                self.trees[0].context.wait_real_time(POLL_INTERVAL_S)
                # No tick of the pause is missed.
                self.schedule.due = max(self.schedule.due, self._clock.now())
            elif trees := self._take_due_trees():
                try:
                    self._tick(trees, end_statuses, on_tick)
                except NodeExecutionError as error:
                    self._error = error
                if self._is_done and not self._is_stopping:
                    if reloader is None or not reloader.is_endless:
                        end = "done"
                    else:
                        reloader.on_end(self._error)
            else:
                was_replaced = reloader is not None and reloader.reload()
                if not was_replaced:
                    end = self._wait(polls=reloader is not None)
            end = end or self._find_end()
        if self._error is not None:
            raise self._error
        return end

    @property
    def _is_done(self) -> bool:
        """Whether no tree is ticked any more, until one is replaced."""
        return self._error is not None or not self._unfinished

    def _find_end(self) -> LoopEnd | None:
        """Return why the loop ends between two ticks, or None."""
        if self._is_stopping:
            return "interrupted"
        is_over = self._end_ns is not None and self._clock.now() >= self._end_ns
        return "duration" if is_over else None

    def _take_due_trees(self) -> list[Tree]:
        """Return all unfinished trees if they are due, else those that were woken."""
        if self._is_done:
            return []
        woken = [tree for tree in self._unfinished if tree.context.consume_wake_up()]
        return self._unfinished if self._clock.now() >= self.schedule.due else woken

    def _tick(self, trees: Sequence[Tree], end_statuses: Sequence[Status], on_tick: OnTick | None) -> None:
        for tree in trees:
            if not self._is_stopping and tree.tick_once() in end_statuses:
                self._unfinished = [other for other in self._unfinished if other is not tree]
        self.status = _join_statuses(self.trees)
        if on_tick is not None:
            on_tick(self.status)
        self.schedule.next(self._clock.now())

    def _wait(self, polls: bool) -> LoopEnd | None:
        """Wait until a tree is due or woken, until the end of the duration or, with *polls*, for a moment.

        Returns:
            "end_of_time" if the time of the clock ends before, otherwise None.
        """
        due = self.schedule.due
        times = [] if self._is_done else [tree.context.first_deadline(due) for tree in self._unfinished]
        # Without ticks nothing happens in simulated time: it advances to the end of the duration at once.
        if polls and not (self._is_done and self._settings.fast):
            times.append(self._clock.now() + _POLL_INTERVAL_NS)
        if self._end_ns is not None:
            times.append(self._end_ns)
        if not times:
            self._wake_event.wait(POLL_INTERVAL_S)
            return None
        try:
            is_early = self._clock.wait_until(min(times), self._wake_event)
        except EndOfTimeError:
            return "end_of_time"
        if is_early and self._wake_event.is_set():
            self._wake_event.clear()  # before the trees are asked: a later wake-up sets it again
        elif is_early:  # the clock has ended the wait, as that of a simulation in lockstep may
            self.schedule.due = self._clock.now()
        return None

    def step(self) -> None:
        """Tick the trees that are RUNNING once, or all trees if none is."""
        for tree in [tree for tree in self.trees if tree.status is RUNNING] or self.trees:
            tree.tick_once()
        self.status = _join_statuses(self.trees)

    def replace_tree(self, tree: Tree) -> None:
        """Tick *tree* in place of the first, and at once."""
        first, *others = self.trees
        self.trees = [tree, *others]
        self._error = None
        self._unfinished = [tree, *(other for other in self._unfinished if other is not first)]
        if first.context.wake_event is self._wake_event:  # the loop has started
            tree.context.wake_event = self._wake_event
            self.schedule.due = tree.clock.now()

    def stop(self) -> None:
        """End the loop before the next tick, and let the present one repeat no more nodes.

        A signal handler may call this method.
        """
        self._is_stopping = True
        for tree in self.trees:
            tree.interrupt()
