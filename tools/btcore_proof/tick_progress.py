"""How far a tick has come: what the nodes that are being ticked have in their local variables.

Two moments of different ticks have the same future if the state of the tree is the same and if the same nodes
are being ticked, with the same local variables. Those follow from the node's state when its tick started, and
from the results of its children since then.
"""

from collections.abc import Callable, Hashable, Sequence
from functools import partial
from typing import Any, NamedTuple

from btcore.engine.node import TreeNode, tick_wrapper
from btcore.status import SKIPPED, Status
from btcore.tree.tree import Tree, parents_of
from btcore_proof.tree_state import StateKeeper, state_fields_of
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
        keeper: Captures the states of its nodes.
    """

    def __init__(self, tree: Tree, keeper: StateKeeper) -> None:
        self._keeper = keeper
        self._unfinished: list[_Unfinished] = []
        self._parents = parents_of(tree)
        for number, node in enumerate(tree.nodes):
            wrapper = tick_wrapper(node)
            if node.children:
                reads = _reads_entries(node)
                wrapper.on_tick_start = partial(self._start, node, reads, bool(state_fields_of(type(node))))
            wrapper.post_tick = partial(self._end, number, wrapper.post_tick)

    def begin(self) -> None:
        """Begin a tick of the tree."""
        self._unfinished.clear()

    def add_choice(self, node: TreeNode | None, choice: int) -> None:
        """Record a choice within the tick of *node*; None = the innermost node with children."""
        if self._unfinished and (node is None or node is self._unfinished[-1].node):
            self._unfinished[-1].since.append(choice)

    def moment(self, node: TreeNode | None) -> Hashable:
        """Return what decides the rest of the tick, in addition to the state of the tree.

        For example, if the leaf B of the tree `<Sequence> <A/> <B/> </Sequence>` has a choice, the moment is
        the uid of B, the state of the Sequence when its tick started, and the result of A.

        Args:
            node: The node that has a choice; None = the innermost node with children.

        Returns:
            A value that is equal for equal futures; None if it is not known.
        """
        unfinished = self._unfinished
        if node is None:
            if not unfinished:
                return None
            node = unfinished[-1].node
        has_started = bool(unfinished) and unfinished[-1].node is node
        # A node that ticks a child while it is being halted is not unfinished.
        if not self._are_ancestors(unfinished[:-1] if has_started else unfinished, node):
            return None
        return (node.config.uid, *[(start, tuple(since)) for _, _, start, since in unfinished])

    def _are_ancestors(self, unfinished: Sequence[_Unfinished], node: TreeNode) -> bool:
        """Return whether the unfinished nodes are all ancestors of *node*, from the root to its parent."""
        parent = self._parents.get(node.config.uid)
        for entry in reversed(unfinished):
            if entry.node.config.uid != parent:
                return False
            parent = self._parents.get(entry.node.config.uid)
        return parent is None

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
        next_post_tick: Callable[[Any, Status], Status] | None,
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
        return status if next_post_tick is None else next_post_tick(node, status)


def _reads_entries(node: TreeNode) -> bool:
    """Return whether what a node does may depend on entries: by users' code, scripts, keys or texts."""
    config = node.config
    return (
        has_user_code(node)
        or bool(config.conditions)
        or any(port.key is not None or isinstance(port.literal, str) for port in config.inputs.values())
    )
