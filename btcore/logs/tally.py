"""What a recording says of each node: how often, with which results, and for how long it was RUNNING."""

from dataclasses import dataclass

from btcore.logs.recording import RecordedNode, Recording
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
)


@dataclass(slots=True)
class RecordedStatistics:
    """One node's figures. *path* is its full path, with ``#uid`` where two are equal.

    *success*, *failure* and *skipped* count results, *halted* how often it went from RUNNING to IDLE.
    *runs* counts the stretches of time in which it was RUNNING; *total* and *longest* are their times (ns).
    A stretch that the recording ends in lasts to its last transition, and makes *running* true.
    """

    node: RecordedNode
    path: str
    success: int = 0
    failure: int = 0
    skipped: int = 0
    halted: int = 0
    runs: int = 0
    total: int = 0
    longest: int = 0
    running: bool = False

    @property
    def results(self) -> int:
        """How often it came to a result."""
        return self.success + self.failure + self.skipped

    @property
    def rate(self) -> float | None:
        """Share of SUCCESS (0–1) among SUCCESS and FAILURE; None without either."""
        ended = self.success + self.failure
        return self.success / ended if ended else None

    @property
    def mean(self) -> float:
        """Mean time of a run (ns); 0 without one."""
        return self.total / self.runs if self.runs else 0.0

    def _ran(self, ns: int) -> None:
        self.runs += 1
        self.total += ns
        self.longest = max(self.longest, ns)


def recorded_statistics(recording: Recording) -> list[RecordedStatistics]:
    """The figures of every node, in pre-order. One that ends at once is never RUNNING, and takes no time."""
    found = {uid: RecordedStatistics(recording.nodes[uid], path) for uid, path in recording.keys().items()}
    since: dict[int, int] = {}
    for stamp, uid, previous, status in recording.transitions:
        one = found[uid]
        if status is RUNNING:
            since.setdefault(uid, stamp)
            continue
        if uid in since:
            one._ran(stamp - since.pop(uid))
        if status is SUCCESS:
            one.success += 1
        elif status is FAILURE:
            one.failure += 1
        elif status is SKIPPED:
            one.skipped += 1
        elif status is IDLE and previous is RUNNING:
            one.halted += 1
    for uid, begun in since.items():
        found[uid]._ran(recording.end - begun)
        found[uid].running = True
    return list(found.values())
