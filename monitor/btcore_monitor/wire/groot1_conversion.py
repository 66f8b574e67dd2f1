"""Convert the tree of a Groot 1 reply to an :class:`ObservedTree`.

The protocol has neither paths nor the ID of the main tree. Paths follow BehaviorTree.CPP 4's rule, and the
main tree gets the name of its root node. A robot's process numbers the nodes of all its trees together; an
observed node gets its position in the tree as uid, as in Groot 1.
"""

from dataclasses import dataclass
from typing import Final

from btcore_monitor.events import Kind, ObservedNode, ObservedTree, kind_from_children
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot1_tree import ACTION, CONDITION, CONTROL, DECORATOR, SUBTREE, WireNode, WireTree

_KINDS: Final[dict[int, Kind]] = {
    ACTION: "action",
    CONDITION: "condition",
    CONTROL: "control",
    DECORATOR: "decorator",
    SUBTREE: "subtree",
}


@dataclass(frozen=True, slots=True)
class Groot1ObservedTree:
    """An observed tree, its uids by the robot's uids, and the statuses in the robot's reply by uid."""

    tree: ObservedTree
    uids: dict[int, int]
    statuses: dict[int, int]


def read_groot1(tree: WireTree, tree_id: str) -> Groot1ObservedTree:
    """Return the observed tree of *tree*.

    Args:
        tree: The nodes and models of the robot's reply.
        tree_id: The ID of the observed tree, 32 hexadecimal digits. The protocol itself has no tree IDs.

    Raises:
        ProtocolError: The nodes do not form one tree.
    """
    ordered = _depth_first(tree)
    uids = {node.uid: place for place, (node, _) in enumerate(ordered, start=1)}
    kinds = {model.id: _KINDS.get(model.type) for model in tree.models}
    nodes: list[ObservedNode] = []
    subtrees = {"": ordered[0][0].name}
    subtree_below: dict[int, str] = {0: ""}
    for node, parent in ordered:
        uid, above = uids[node.uid], uids.get(parent, 0)
        kind = kinds.get(node.id) or kind_from_children(len(node.children))
        subtree = subtree_below[above]
        path = node.name if node.name != node.id and kind != "subtree" else f"{node.name}::{uid}"
        if subtree:
            path = f"{subtree}/{path}"
        subtree_below[uid] = subtree
        if kind == "subtree":
            subtree_below[uid] = path
            subtrees[path] = node.name
        children = tuple(uids[child] for child in node.children)
        nodes.append(
            ObservedNode(uid, node.name, node.id, kind, path, above, children, dict(node.ports), subtree)
        )
    statuses = {uids[node.uid]: node.status for node, _ in ordered}
    return Groot1ObservedTree(ObservedTree(tree_id, subtrees[""], tuple(nodes), subtrees), uids, statuses)


def _depth_first(tree: WireTree) -> list[tuple[WireNode, int]]:
    """Return the nodes in pre-order, each with its parent's uid (-1 for the root)."""
    if not tree.nodes:
        raise ProtocolError("expected nodes in the tree, and got none")
    by_uid = {node.uid: node for node in tree.nodes}
    if len(by_uid) != len(tree.nodes):
        raise ProtocolError(
            f"expected unique uids, and {len(tree.nodes)} nodes have {len(by_uid)} different uids"
        )
    ordered: list[tuple[WireNode, int]] = []
    waiting = [(tree.nodes[0].uid, -1)]
    while waiting:
        uid, parent = waiting.pop()
        node = by_uid.pop(uid, None)
        if node is None:
            raise ProtocolError(
                f"expected a tree, and node {parent} has node {uid} as a child that is missing or used twice"
            )
        ordered.append((node, parent))
        waiting.extend((child, uid) for child in reversed(node.children))
    if by_uid:
        raise ProtocolError(f"expected a tree, and node {next(iter(by_uid))} has no parent")
    return ordered
