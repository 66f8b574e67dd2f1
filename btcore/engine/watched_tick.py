"""Watching the ticks of a node: counters, and a report of the start of each tick."""

from collections.abc import Callable

from btcore.engine.node import TickWrapper, TreeNode
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status


class TickCounts:
    """The counters of one node: ticks, results, and halts while it was RUNNING."""

    def __init__(self) -> None:
        self.ticks = 0
        self.success = 0
        self.failure = 0
        self.skipped = 0
        self.halted = 0

    def by_name(self) -> dict[str, int]:
        """Return the counters by their names."""
        return {
            "ticks": self.ticks,
            "success": self.success,
            "failure": self.failure,
            "skipped": self.skipped,
            "halted": self.halted,
        }

    def add_result(self, status: Status) -> None:
        """Count the result *status* of a tick."""
        if status is SUCCESS:
            self.success += 1
        elif status is FAILURE:
            self.failure += 1
        elif status is SKIPPED:
            self.skipped += 1


class WatchedTick(TickWrapper):
    """The wrapper of a node whose ticks are counted or reported.

    Attributes:
        counts: The counters, or None.
        on_tick_start: Called at the start of each tick, before the pre-conditions; or None.
    """

    def __init__(self, former: TickWrapper | None = None) -> None:
        super().__init__(former)
        self.counts: TickCounts | None = None
        self.on_tick_start: Callable[[], object] | None = None
        if isinstance(former, WatchedTick):
            self.counts = former.counts
            self.on_tick_start = former.on_tick_start

    @property
    def is_empty(self) -> bool:
        """Whether the node needs no wrapper."""
        return super().is_empty and self.counts is None and self.on_tick_start is None

    def tick(self, node: TreeNode) -> Status:
        """Count the tick and its result."""
        counts = self.counts
        if counts is not None:
            counts.ticks += 1
        if self.on_tick_start is not None:
            self.on_tick_start()
        status = super().tick(node)
        if counts is not None:
            counts.add_result(status)
        return status

    def halt(self, node: TreeNode) -> None:
        """Count the halt if *node* is RUNNING."""
        if self.counts is not None and node._status is RUNNING:
            self.counts.halted += 1
        super().halt(node)


def watch(node: TreeNode) -> WatchedTick:
    """Return the wrapper of *node*, which becomes a WatchedTick."""
    wrapper = node._wrapper
    if not isinstance(wrapper, WatchedTick):
        node._wrapper = wrapper = WatchedTick(wrapper)
    return wrapper


def start_tick_counts(node: TreeNode) -> TickCounts:
    """Count the ticks of *node* from now on. Return the counters."""
    with node._context.lock:
        wrapper = watch(node)
        wrapper.counts = counts = wrapper.counts or TickCounts()
    return counts


def tick_counts_of(node: TreeNode) -> TickCounts | None:
    """Return the tick counters of *node*; None before `start_tick_counts` was called."""
    wrapper = node._wrapper
    return wrapper.counts if isinstance(wrapper, WatchedTick) else None
