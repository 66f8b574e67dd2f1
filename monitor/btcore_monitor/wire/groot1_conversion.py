"""The tree that a Groot 1 publisher answers with, as an :class:`ObservedTree`.

The wire tells neither paths nor the main tree's ID: paths are made by BehaviorTree.CPP 4's rule, and the
main tree goes by the name of its root. A process counts its nodes through all of its trees; here a
node's uid is its place in the tree, as Groot 1 has it too.
"""

from dataclasses import dataclass
from typing import Final

from btcore_monitor.events import Kind, ObservedNode, ObservedTree, kind_from_children
from btcore_monitor.wire.errors import ProtocolError
from btcore_monitor.wire.groot1_tree import (
    ACTION,
    CONDITION,
    CONTROL,
    DECORATOR,
    SUBTREE,
    WireNode,
    WireTree,
)

_KINDS: Final[dict[int, Kind]] = {
    ACTION: "action",
    CONDITION: "condition",
    CONTROL: "control",
    DECORATOR: "decorator",
    SUBTREE: "subtree",
}


@dataclass(frozen=True, slots=True)
class Groot1ObservedTree:
    """The *tree*, with its uids by the robot's, and the statuses that the tree came with."""

    tree: ObservedTree
    uids: dict[int, int]
    statuses: dict[int, int]


def read_groot1(tree: WireTree, tree_id: str) -> Groot1ObservedTree:
    """The observed tree of *tree*, with the *tree_id* (32 hex digits).

    Raises :class:`ProtocolError` if its nodes aren't one tree.
    """
    ordered = _depth_first(tree)
    uids = {node.uid: place for place, (node, _) in enumerate(ordered, start=1)}
    kinds = {model.id: _KINDS.get(model.type) for model in tree.models}
    nodes: list[ObservedNode] = []
    subtrees = {"": ordered[0][0].name}
    insides: dict[int, str] = {0: ""}
    for node, parent in ordered:
        uid, above = uids[node.uid], uids.get(parent, 0)
        kind = kinds.get(node.id) or kind_from_children(len(node.children))
        subtree = insides[above]
        path = node.name if node.name != node.id and kind != "subtree" else f"{node.name}::{uid}"
        if subtree:
            path = f"{subtree}/{path}"
        insides[uid] = subtree
        if kind == "subtree":
            insides[uid] = path
            subtrees[path] = node.name
        children = tuple(uids[child] for child in node.children)
        nodes.append(
            ObservedNode(uid, node.name, node.id, kind, path, above, children, dict(node.ports), subtree)
        )
    statuses = {uids[node.uid]: node.status for node, _ in ordered}
    return Groot1ObservedTree(ObservedTree(tree_id, subtrees[""], tuple(nodes), subtrees), uids, statuses)


def _depth_first(tree: WireTree) -> list[tuple[WireNode, int]]:
    """The nodes in pre-order, each with its parent's uid (the root: -1)."""
    if not tree.nodes:
        raise ProtocolError("expected nodes in the tree, and got none")
    by_uid = {node.uid: node for node in tree.nodes}
    if len(by_uid) != len(tree.nodes):
        raise ProtocolError(
            f"expected every uid once, and {len(tree.nodes)} nodes have {len(by_uid)} of them"
        )
    found: list[tuple[WireNode, int]] = []
    waiting = [(tree.nodes[0].uid, -1)]
    while waiting:
        uid, parent = waiting.pop()
        node = by_uid.pop(uid, None)
        if node is None:
            raise ProtocolError(
                f"expected a tree, and node {parent} has node {uid} as a child, which is gone or another's"
            )
        found.append((node, parent))
        waiting.extend((child, uid) for child in reversed(node.children))
    if by_uid:
        raise ProtocolError(f"expected a tree, and node {next(iter(by_uid))} is no node's child")
    return found
