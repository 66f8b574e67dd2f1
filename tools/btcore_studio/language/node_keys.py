"""Keys that identify nodes of a drawing and of a running tree, also after the tree was edited."""

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from hashlib import blake2b
from typing import NamedTuple

from btcore.status import NodeType
from btcore_drawing.diagram import DiagramNode


class KeyedNode(NamedTuple):
    """What the key of a node depends on: the numbers of the node and its parent, its ID and its name.

    Attributes:
        uid: Number of the node.
        parent: Number of the parent, or 0.
        id: ID of the node.
        name: Name of the node; an empty name counts as the ID, which a drawing shows in its place.
        is_subtree: Whether the node calls a tree. The name of a call is not part of its key.
    """

    uid: int
    parent: int
    id: str
    name: str
    is_subtree: bool = False


def node_keys(nodes: Iterable[KeyedNode], call: str = "") -> dict[int, str]:
    """Return the key of each node by its number.

    A key consists of the IDs and names from the root to the node. Equal siblings are counted. The same node
    therefore has the same key in the file and in the running tree, unless an ancestor differs.

    Args:
        nodes: The nodes, each after its parent.
        call: The key of the SubTree node that calls the tree of these nodes; "" for a main tree.

    Examples:
        >>> from btcore_studio.language.node_keys import KeyedNode, node_keys
        >>> root, door = KeyedNode(1, 0, "Sequence", "round"), KeyedNode(2, 1, "Open", "door")
        >>> node_keys([root, door])[2] == node_keys([root, door._replace(uid=7)])[7]
        True
    """
    keys: dict[int, str] = {}
    seen: Counter[str] = Counter()
    for node in nodes:
        label = "SubTree" if node.is_subtree else f"{node.id}\0{node.name or node.id}"
        text = f"{keys.get(node.parent, call)}\0{label}"
        seen[text] += 1
        keys[node.uid] = blake2b(f"{text}\0{seen[text]}".encode(), digest_size=8).hexdigest()
    return keys


def diagram_nodes(root: DiagramNode) -> list[tuple[DiagramNode, int]]:
    """Return the nodes of a drawing in pre-order, each with the number of its parent, or 0."""
    nodes: list[tuple[DiagramNode, int]] = []
    pending = [(root, 0)]
    while pending:
        node, parent = pending.pop()
        nodes.append((node, parent))
        pending += [(child, node.uid) for child in reversed(node.children)]
    return nodes


def keyed_nodes(nodes: Iterable[tuple[DiagramNode, int]]) -> list[KeyedNode]:
    """Return the result of `diagram_nodes` for `node_keys`."""
    return [
        KeyedNode(node.uid, parent, node.id, node.name, node.type is NodeType.SUBTREE)
        for node, parent in nodes
    ]


class RunningCall(NamedTuple):
    """A SubTree node of a running tree: its key, the called *tree*, and the number of nodes below (*size*).

    The *path* consists of the names of the calls from the root to this call.
    """

    key: str
    tree: str
    path: str
    size: int


def running_calls(
    nodes: Sequence[KeyedNode], keys: Mapping[int, str], trees: Mapping[int, str]
) -> list[RunningCall]:
    """Return the calls in a running tree.

    Args:
        nodes: The nodes in pre-order.
        keys: The key of each node by its number.
        trees: The ID of the called tree by the number of each SubTree node.
    """
    sizes: Counter[int] = Counter()
    for node in reversed(nodes):
        sizes[node.parent] += 1 + sizes[node.uid]
    paths: dict[int, str] = {}
    calls: list[RunningCall] = []
    for node in nodes:
        path = paths.get(node.parent, "")
        if node.uid in trees:
            path = f"{path} / {node.name}" if path else node.name
            calls.append(RunningCall(keys[node.uid], trees[node.uid], path, sizes[node.uid]))
        paths[node.uid] = path
    return calls
