"""Counting the results of each node, in a running tree and in a recording."""

from dataclasses import dataclass, replace

from btcore.errors import BtcoreError
from btcore.logs.log import AttachedObserver
from btcore.logs.recording import RecordedNode, Recording
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status, Transition
from btcore.suggestions import join_names, nearest_name
from btcore.tree.tree import Tree


@dataclass(slots=True)
class NodeStatistics:
    """The statistics of a node in a running tree.

    Attributes:
        last_result: The last SUCCESS or FAILURE; IDLE before the first.
        current_status: The current status.
        transitions_count: The number of transitions, without those to IDLE.
        success_count: The number of transitions to SUCCESS.
        failure_count: The number of transitions to FAILURE.
        skip_count: The number of transitions to SKIPPED. A node that is skipped by its pre-condition does not
            change its status, and is not counted.
        last_timestamp: The time of the last transition, including those to IDLE, in ns since 1970; 0 before
            the first.
    """

    last_result: Status = IDLE
    current_status: Status = IDLE
    transitions_count: int = 0
    success_count: int = 0
    failure_count: int = 0
    skip_count: int = 0
    last_timestamp: int = 0


class TreeObserver(AttachedObserver):
    """An observer that counts the results of each node of *tree* until it is closed.

    It counts in the same way as BehaviorTree.CPP's TreeObserver (src/loggers/bt_observer.cpp). Nodes are
    identified by UID or by path; equal paths are distinguished by `#<uid>`, as in
    `btcore.Tree.nodes_by_path`.

    Attributes:
        path_to_uid: The UID of each node by path.
        uid_to_path: The path of each node by UID.

    Examples:
        >>> import btcore
        >>> from btcore.logs import TreeObserver
        >>> b = btcore.Builder()
        >>> tree = b.build(b.AlwaysSuccess(name="door"))
        >>> with TreeObserver(tree) as observer:
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> observer.get_statistics("door").success_count
        1
    """

    def __init__(self, tree: Tree) -> None:
        self._statistics = {
            node.config.uid: NodeStatistics(current_status=node._status) for node in tree.nodes
        }
        self.path_to_uid = {path: node.config.uid for path, node in tree.nodes_by_path().items()}
        self.uid_to_path = {uid: path for path, uid in self.path_to_uid.items()}
        super().__init__(tree)
        self.attach()

    def transition(self, change: Transition) -> None:
        """Count the transition *change*."""
        status = change.status
        node = self._statistics[change.uid]
        node.current_status = status
        node.last_timestamp = self.wall(change.stamp)
        if status is IDLE:
            return
        node.transitions_count += 1
        if status is SUCCESS:
            node.last_result = status
            node.success_count += 1
        elif status is FAILURE:
            node.last_result = status
            node.failure_count += 1
        elif status is SKIPPED:
            node.skip_count += 1

    def get_statistics(self, node: int | str) -> NodeStatistics:
        """Return a copy of the current statistics of a node, given by its UID or path.

        Raises:
            BtcoreError: There is no such node, or several nodes have this path.
        """
        uid = node if isinstance(node, int) else self.path_to_uid.get(node)
        if uid not in self._statistics:
            raise BtcoreError(self._unknown(node))
        return replace(self._statistics[uid])

    def statistics(self) -> dict[str, NodeStatistics]:
        """Return a copy of the current statistics of all nodes by path, in pre-order."""
        return {path: replace(self._statistics[uid]) for path, uid in self.path_to_uid.items()}

    def reset_statistics(self) -> None:
        """Reset the statistics of all nodes, except for the current statuses."""
        for uid, node in self._statistics.items():
            self._statistics[uid] = NodeStatistics(current_status=node.current_status)

    def _unknown(self, node: int | str) -> str:
        if isinstance(node, int):
            return f"the tree has no node {node}; its nodes are 1 to {max(self._statistics)}"
        equal = [path for path in self.path_to_uid if path.rpartition("#")[0] == node]
        if equal:
            return f"'{node}' is the path of {len(equal)} nodes; use {join_names(equal, 'or')}"
        guess = nearest_name(node, self.path_to_uid)
        return f"the tree has no node '{node}'" + (f"; did you mean '{guess}'?" if guess else "")


@dataclass(slots=True)
class RecordedStatistics:
    """The statistics of a node in a recording.

    A run is a period in which the node was RUNNING. A run that is not finished at the end of the recording
    counts up to the last transition.

    Attributes:
        node: The node.
        path: Its full path, with `#<uid>` if several nodes have the same path.
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
        >>> from btcore.logs import open_log, read_log, recorded_statistics
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
