"""What surrounds the ticks of a node that has more to it than a tick: conditions, callbacks, a count."""

from collections.abc import Callable
from typing import Any

from btcore.engine.conditions import ConditionScripts
from btcore.status import (
    FAILURE,
    IDLE,
    SKIPPED,
    SUCCESS,
    Status,
)


class TickCounts:
    """How often one node was ticked, halted while it ran, and with which results."""

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


class Instrumentation:
    """What surrounds the ticks of a node that has more than a tick: conditions, callbacks, a tally."""

    def __init__(self) -> None:
        self.conditions: ConditionScripts | None = None
        self.tick_counts: TickCounts | None = None
        self.pre_tick: Callable[[Any], Status] | None = None
        self.post_tick: Callable[[Any, Status], Status] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing more than a tick."""
        return (
            self.conditions is None
            and self.tick_counts is None
            and self.pre_tick is None
            and self.post_tick is None
        )

    def call_pre_tick(self, node: Any, status: Status) -> Status:
        """What takes the place of a tick of *node*, which stands at *status*; IDLE = nothing does."""
        callback = self.pre_tick
        if callback is not None and status is not SUCCESS and status is not FAILURE:
            forced = callback(node)
            if forced is SUCCESS or forced is FAILURE:
                return forced
        return IDLE

    def call_post_tick(self, node: Any, status: Status) -> Status:
        """What *node* returns in the end, when *status* is what its tick came to."""
        callback = self.post_tick
        if callback is not None:
            forced = callback(node, status)
            if forced is SUCCESS or forced is FAILURE:
                return forced
        return status
