"""How far a tick has come: what the nodes that are being ticked have in their local variables.

Two moments of different ticks have the same future if the state of the tree is the same and if the same nodes
are being ticked, with the same local variables. Those follow from the node's state when its tick started, and
from the results of its children since then.
"""

from collections.abc import Callable, Hashable
from functools import partial
from typing import Any, NamedTuple

from btcore.engine.node import TreeNode
from btcore.engine.tick_extras import TickExtras, WatchedConditions
from btcore.status import SKIPPED, Status
from btcore.tree.saved_state import state_fields_of
from btcore.tree.tree import Tree
from btcore_proof.tree_state import StateKeeper
from btcore_proof.user_code import has_user_code


class _Unfinished(NamedTuple):
    """A node that is being ticked.

    Attributes:
        node: The node.
        reads: Whether the node reads entries.
        start: What decides what the node does, at the start of its tick.
        since: The results of its children and the choices since then.
    """

    node: TreeNode
    reads: bool
    start: Hashable
    since: list[Hashable]


class TickProgress:
    """Follows the ticks of one tree.

    Args:
        tree: The tree.
        keeper: Captures the states of its nodes.
    """

    def __init__(self, tree: Tree, keeper: StateKeeper) -> None:
        self._keeper = keeper
        self._unfinished: list[_Unfinished] = []
        self._parents: dict[int, TreeNode] = {}
        for node in tree.nodes:
            for child in node.children:
                self._parents[child.config.uid] = node
        for number, node in enumerate(tree.nodes):
            extras = node._tick_extras = node._tick_extras or TickExtras()
            if node.children:
                reads = _reads_entries(node)
                config = node.config
                start = partial(self._start, node, reads, bool(state_fields_of(type(node))))
                extras.conditions = WatchedConditions(
                    config.conditions, config.enums, node._blackboard, start
                )
            extras.post_tick = partial(self._end, number, extras.post_tick)

    def begin(self) -> None:
        """Begin a tick of the tree."""
        self._unfinished.clear()

    def add_choice(self, node: TreeNode | None, choice: int) -> None:
        """Record a choice within the tick of *node*; None = the innermost node with children."""
        if self._unfinished and (node is None or node is self._unfinished[-1].node):
            self._unfinished[-1].since.append(choice)

    def moment(self, node: TreeNode | None) -> Hashable:
        """Return what decides the rest of the tick, in addition to the state of the tree.

        Args:
            node: The node that has a choice; None = the innermost node with children.

        Returns:
            A value that is equal for equal futures; None if it is not known.
        """
        unfinished = self._unfinished
        place = len(unfinished) - 1
        if node is None or (place >= 0 and node is unfinished[place].node):
            if place < 0:
                return None
            node = unfinished[place].node
            place -= 1
        asking = node.config.uid
        # A node that ticks a child while it is being halted is not found here.
        parent = self._parents.get(node.config.uid)
        while parent is not None:
            if place < 0 or unfinished[place].node is not parent:
                return None
            place -= 1
            parent = self._parents.get(parent.config.uid)
        if place >= 0:
            return None
        return (asking, *[(start, tuple(since)) for _, _, start, since in unfinished])

    def _start(self, node: TreeNode, reads: bool, has_fields: bool) -> None:
        start: Hashable = (
            node._status,
            bytes([child._status for child in node.children]),
            self._keeper.fields_of(node) if has_fields else (),
            self._keeper.entries() if reads else None,
        )
        self._unfinished.append(_Unfinished(node, reads, start, []))

    def _end(
        self,
        number: int,
        observer: Callable[[Any, Status], Status] | None,
        node: TreeNode,
        status: Status,
    ) -> Status:
        unfinished = self._unfinished
        if node.children:
            while unfinished and unfinished.pop().node is not node:
                pass
        if unfinished:
            _, reads, _, since = unfinished[-1]
            since.append((number, status, node._status if status is SKIPPED else status))
            if reads:
                since.append(self._keeper.entries())
        return status if observer is None else observer(node, status)


def _reads_entries(node: TreeNode) -> bool:
    """Return whether what a node does may depend on entries: by users' code, scripts, keys or texts."""
    config = node.config
    return (
        has_user_code(node)
        or bool(config.conditions)
        or any(port.key is not None or isinstance(port.literal, str) for port in config.inputs.values())
    )
