"""Counting the results of each node in a recording."""

from dataclasses import dataclass

from btcore.logs import RecordedNode, Recording
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS


@dataclass(slots=True)
class RecordedStatistics:
    """The statistics of a node in a recording.

    A run is a period in which the node was RUNNING. A run that is not finished at the end of the recording
    counts up to the last transition.

    Attributes:
        node: The node.
        path: Its full path, as in `Tree.nodes_by_path`.
        success: The number of transitions to SUCCESS.
        failure: The number of transitions to FAILURE.
        skipped: The number of transitions to SKIPPED.
        halted: The number of transitions from RUNNING to IDLE.
        runs: The number of runs.
        total: The total duration of all runs (ns).
        longest: The duration of the longest run (ns).
        running: Whether the last run is not finished.
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
        """The number of results: SUCCESS, FAILURE and SKIPPED."""
        return self.success + self.failure + self.skipped

    @property
    def rate(self) -> float | None:
        """The fraction (0 to 1) of SUCCESS among SUCCESS and FAILURE; None without either."""
        ended = self.success + self.failure
        return self.success / ended if ended else None

    @property
    def mean(self) -> float:
        """The mean duration of the runs (ns); 0 without runs."""
        return self.total / self.runs if self.runs else 0.0

    def _add_run(self, ns: int) -> None:
        self.runs += 1
        self.total += ns
        self.longest = max(self.longest, ns)


def recorded_statistics(recording: Recording) -> list[RecordedStatistics]:
    """Return the statistics of all nodes in pre-order.

    A node that returns its result in the tick in which it starts is never RUNNING: it has no runs.

    Examples:
        >>> import btcore
        >>> from btcore.logs import open_log, read_log
        >>> from btcore_recorder import recorded_statistics
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"))
        >>> with open_log(tree, "run.btlog"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> [(node.path, node.success) for node in recorded_statistics(read_log("run.btlog"))]
        [('door', 1)]
    """
    statistics = {
        uid: RecordedStatistics(recording.nodes[uid], path) for uid, path in recording.keys().items()
    }
    running_since: dict[int, int] = {}
    for stamp, uid, previous, status in recording.transitions:
        node = statistics[uid]
        if status is RUNNING:
            running_since.setdefault(uid, stamp)
            continue
        if uid in running_since:
            node._add_run(stamp - running_since.pop(uid))
        if status is SUCCESS:
            node.success += 1
        elif status is FAILURE:
            node.failure += 1
        elif status is SKIPPED:
            node.skipped += 1
        elif status is IDLE and previous is RUNNING:
            node.halted += 1
    for uid, start in running_since.items():
        statistics[uid]._add_run(recording.end - start)
        statistics[uid].running = True
    return list(statistics.values())
