"""Where a run fails: the first tick in which the tree returns FAILURE or a node raises."""

from typing import NamedTuple

from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.engine.transition_records import Transitions
from btcore.errors import NodeExecutionError
from btcore.status import FAILURE, Status
from btcore.tree.tree import Tree


class Failure(NamedTuple):
    """A failure of a run.

    Attributes:
        tick: The number of the tick.
        node: The path of the node that made the tree fail, or that raised.
        error: The class of the exception; "" if the tree returned FAILURE.
        text: The text of the exception.
    """

    tick: int
    node: str
    error: str = ""
    text: str = ""

    def __str__(self) -> str:
        if not self.error:
            return f"the tree fails in tick {self.tick}, because of '{self.node}'"
        return f"'{self.node}' raises {self.error} in tick {self.tick}: {self.text}"


class FailureObserver(Observer):
    """Finds the first failure of a run of *tree*.

    Attributes:
        found: The failure, or None so far.
    """

    def __init__(self, tree: Tree) -> None:
        self.found: Failure | None = None
        self._tree = tree
        self._changes: list[Transitions] = []

    def reset(self) -> None:
        """Find the first failure from now on."""
        self.found = None
        self._changes.clear()

    def transitions(self, changes: Transitions) -> None:
        """Keep the transitions until the end of the tick."""
        self._changes.append(changes)

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Note that the tree fails."""
        if status is FAILURE and self.found is None:
            self.found = Failure(tick, self._failed_node().path)
        self._changes.clear()

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Note that a node raised."""
        if self.found is None:
            cause = error.cause
            self.found = Failure(self._tree.ticks, error.path, type(cause).__name__, str(cause))
        self._changes.clear()

    def _failed_node(self) -> TreeNode:
        """Return the node that made the tree fail: from the root down, the child that failed last."""
        changes = (change for batch in self._changes for change in batch)
        failed = {change.uid: index for index, change in enumerate(changes) if change.status is FAILURE}
        node = self._tree.root
        while children := [child for child in node.children if child.config.uid in failed]:
            node = max(children, key=lambda child: failed[child.config.uid])
        return node
