"""Finding the node that made a tree fail."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from btcore.engine.observers import Observer
from btcore.run_extension import RunExtension
from btcore.status import Status, Transition
from btcore.tree.tree import Tree


class FailureCause(Observer, RunExtension):
    """An extension of a run that finds the node that made the tree fail in the last tick.

    The search starts at the root and descends to the child that failed in that tick, to the last child if
    several failed. The path of the lowest failed node is `node_path` after the run.
    """

    def __init__(self) -> None:
        self._tick = 0
        self._failed: list[int] = []
        self.node_path: str | None = None

    def transition(self, change: Transition) -> None:
        """Record a transition to FAILURE."""
        if change.status is Status.FAILURE:
            if change.tick != self._tick:
                self._tick = change.tick
                self._failed.clear()
            self._failed.append(change.uid)

    @contextmanager
    def attach(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> Iterator[None]:
        """Return a context in which the transitions of *tree* are recorded."""
        unsubscribe = tree.subscribe(self)
        try:
            yield
        finally:
            unsubscribe()
            if tree.ticks == self._tick:
                self.node_path = self._find_cause(tree)

    def _find_cause(self, tree: Tree) -> str | None:
        order = {uid: number for number, uid in enumerate(self._failed)}
        if tree.root.uid not in order:
            return None
        paths = {node.uid: path for path, node in tree.nodes_by_path().items()}
        node = tree.root
        while failed := [child for child in node.children if child.uid in order]:
            node = max(failed, key=lambda child: order[child.uid])
        return paths[node.uid]
