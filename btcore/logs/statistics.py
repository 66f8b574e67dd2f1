"""How often each node came to which result, as BehaviorTree.CPP's TreeObserver counts (groot2.md §14)."""

from dataclasses import dataclass, replace

from btcore.errors import BtcoreError
from btcore.logs.log import AttachedObserver
from btcore.logs.recording import RecordedNode, Recording
from btcore.status import (
    FAILURE,
    IDLE,
    RUNNING,
    SKIPPED,
    SUCCESS,
    Status,
    Transition,
)
from btcore.suggestions import join_names, nearest_name
from btcore.tree.tree import Tree


@dataclass(slots=True)
class NodeStatistics:
    """What is known of one node.

    *last_result* is its last SUCCESS or FAILURE (IDLE before); *transitions_count* counts all
    transitions but those to IDLE; *last_timestamp* is that of its last transition, also to IDLE, in ns
    since 1970 (0 before). A node that is skipped by its pre-condition does not change its status, so
    *skip_count* counts only those that say SKIPPED themselves.
    """

    last_result: Status = IDLE
    current_status: Status = IDLE
    transitions_count: int = 0
    success_count: int = 0
    failure_count: int = 0
    skip_count: int = 0
    last_timestamp: int = 0


class TreeObserver(AttachedObserver):
    """Counts the results of every node of *tree*, until closed.

    Nodes are looked up by uid or by path; where two paths are equal ``#<uid>`` tells them apart, as in
    :meth:`btcore.Tree.keys`.
    """

    def __init__(self, tree: Tree) -> None:
        self._statistics = {node.uid: NodeStatistics(current_status=node.status) for node in tree.nodes}
        self.path_to_uid = {path: node.uid for path, node in tree.nodes_by_path().items()}
        self.uid_to_path = {uid: path for path, uid in self.path_to_uid.items()}
        super().__init__(tree)
        self.attach()

    def transition(self, change: Transition) -> None:
        """Count *change*."""
        status = change.status
        one = self._statistics[change.uid]
        one.current_status = status
        one.last_timestamp = self.wall(change.stamp)
        if status is IDLE:
            return
        one.transitions_count += 1
        if status is SUCCESS:
            one.last_result = status
            one.success_count += 1
        elif status is FAILURE:
            one.last_result = status
            one.failure_count += 1
        elif status is SKIPPED:
            one.skip_count += 1

    def get_statistics(self, node: int | str) -> NodeStatistics:
        """What is known now of the node with that uid or path. Raises BtcoreError if there is none."""
        uid = node if isinstance(node, int) else self.path_to_uid.get(node)
        if uid not in self._statistics:
            raise BtcoreError(self._unknown(node))
        return replace(self._statistics[uid])

    def statistics(self) -> dict[str, NodeStatistics]:
        """What is known now of every node, by path, in pre-order."""
        return {path: replace(self._statistics[uid]) for path, uid in self.path_to_uid.items()}

    def reset_statistics(self) -> None:
        """Count from zero again."""
        for uid, one in self._statistics.items():
            self._statistics[uid] = NodeStatistics(current_status=one.current_status)

    def _unknown(self, node: int | str) -> str:
        if isinstance(node, int):
            return f"the tree has no node {node}; its nodes are 1 to {max(self._statistics)}"
        alike = [path for path in self.path_to_uid if path.rpartition("#")[0] == node]
        if alike:
            return f"'{node}' is the path of {len(alike)} nodes; say which: {join_names(alike, 'or')}"
        guess = nearest_name(node, self.path_to_uid)
        return f"the tree has no node '{node}'" + (f"; did you mean '{guess}'?" if guess else "")


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
