"""What happens in the ticks of a node besides its `tick`: conditions, callbacks and counters."""

from collections.abc import Callable
from typing import Any

from btcore.engine.conditions import NodeConditions
from btcore.status import FAILURE, SKIPPED, SUCCESS, Status


class TickCounts:
    """The counters of one node: ticks, results, and halts while it was RUNNING."""

    def __init__(self) -> None:
        self.ticks = 0
        self.success = 0
        self.failure = 0
        self.skipped = 0
        self.halted = 0

    def add_result(self, status: Status) -> None:
        """Count the result *status* of a tick."""
        if status is SUCCESS:
            self.success += 1
        elif status is FAILURE:
            self.failure += 1
        elif status is SKIPPED:
            self.skipped += 1


class TickExtras:
    """The conditions, callbacks and counters of one node.

    Most nodes of a tree in a program have none; under `btcore run` all nodes have counters.
    """

    def __init__(self) -> None:
        self.conditions: NodeConditions | None = None
        self.tick_counts: TickCounts | None = None
        self.pre_tick: Callable[[Any], Status] | None = None
        self.post_tick: Callable[[Any, Status], Status] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether the node has no conditions, callbacks or counters."""
        return (
            self.conditions is None
            and self.tick_counts is None
            and self.pre_tick is None
            and self.post_tick is None
        )
