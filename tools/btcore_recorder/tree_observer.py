"""Counting the results of each node in a running tree."""

from dataclasses import dataclass, replace

from btcore.errors import BtcoreError
from btcore.logs.log import AttachedObserver
from btcore.status import FAILURE, IDLE, SKIPPED, SUCCESS, Status, Transition
from btcore.suggestions import did_you_mean, join_names
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
    identified by UID or by path; equal paths are distinguished as in
    `btcore.Tree.nodes_by_path`.

    Attributes:
        path_to_uid: The UID of each node by path.
        uid_to_path: The path of each node by UID.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import TreeObserver
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
        return f"the tree has no node '{node}'{did_you_mean(node, self.path_to_uid)}"
