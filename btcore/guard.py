"""What surrounds the ticks of a node that has more to it than a tick: its conditions, a count of results."""

from btcore.conditions import Conditions
from btcore.status import FAILURE, SKIPPED, SUCCESS, Status


class Tally:
    """How often one node was ticked, halted while it ran, and with which results."""

    def __init__(self) -> None:
        self.ticks = 0
        self.success = 0
        self.failure = 0
        self.skipped = 0
        self.halted = 0

    def count(self, status: Status) -> None:
        """Count the result *status* of a tick."""
        if status is SUCCESS:
            self.success += 1
        elif status is FAILURE:
            self.failure += 1
        elif status is SKIPPED:
            self.skipped += 1


class Guard:
    """What surrounds the ticks of a node that has more than a tick: conditions, a tally."""

    def __init__(self) -> None:
        self.conditions: Conditions | None = None
        self.tally: Tally | None = None
