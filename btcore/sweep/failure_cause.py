"""Which node made a tree fail."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

from btcore.engine.observers import Observer
from btcore.run_extension import RunExtension
from btcore.status import Status, Transition
from btcore.tree.tree import Tree


class FailureCause(Observer, RunExtension):
    """A run's extension that knows afterwards which node failed *first* in the last tick.

    That is the node at the end of the way from the root over children that failed in that tick, over the
    last of them where there are several.
    """

    def __init__(self) -> None:
        self._tick = 0
        self._failed: list[int] = []
        self.node_path: str | None = None

    def transition(self, change: Transition) -> None:
        """Note who fails."""
        if change.status is Status.FAILURE:
            if change.tick != self._tick:
                self._tick = change.tick
                self._failed.clear()
            self._failed.append(change.uid)

    @contextmanager
    def attach(self, tree: Tree, resources: Sequence[object], settings: Mapping[str, Any]) -> Iterator[None]:
        """Listen while the run lasts."""
        end = tree.subscribe(self)
        try:
            yield
        finally:
            end()
            if tree.ticks == self._tick:
                self.node_path = self._found(tree)

    def _found(self, tree: Tree) -> str | None:
        when = {uid: number for number, uid in enumerate(self._failed)}
        if tree.root.uid not in when:
            return None
        keys = {node.uid: key for key, node in tree.nodes_by_path().items()}
        node = tree.root
        while below := [child for child in node.children if child.uid in when]:
            node = max(below, key=lambda child: when[child.uid])
        return keys[node.uid]
