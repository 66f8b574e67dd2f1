"""The content of a log file, independent of its format: the nodes of the tree, and their transitions."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from btcore.clock import NS_PER_S
from btcore.errors import XmlSyntaxError
from btcore.logs.files import LogError
from btcore.names import unique_paths
from btcore.status import IDLE, NodeType, Status
from btcore.xml.read.element import Element, encoded
from btcore.xml.read.read import parse_bytes
from btcore.xml.read.tags import MODEL_TAGS

STATUSES: Final = {int(status): status for status in Status}

_NOT_PORTS: Final = frozenset({"name", "ID", "_uid", "_fullpath"})


class LoggedTransition(NamedTuple):
    """A change of a node's status.

    Attributes:
        stamp: The time (ns since 1970); log files have a resolution of 1 µs.
        uid: The number of the node.
        previous: The status before the change.
        status: The status after the change.
    """

    stamp: int
    uid: int
    previous: Status
    status: Status


class Gap(NamedTuple):
    """A place where transitions are missing: before the transition with index *at*, for a *reason*."""

    at: int
    reason: str


@dataclass(frozen=True, slots=True)
class RecordedNode:
    """A node of the recorded tree.

    Attributes:
        uid: The UID of the node in its tree.
        name: The name of the instance.
        id: The registration ID.
        type: The node type; UNDEFINED if the log does not contain it.
        path: The full path.
        children: The UIDs of the children.
        ports: The texts of ports and conditions in the XML, by name.
    """

    uid: int
    name: str
    id: str
    type: NodeType
    path: str
    children: tuple[int, ...]
    ports: Mapping[str, str] = field(default_factory=dict, hash=False)


@dataclass(frozen=True, slots=True)
class Recording:
    """The content of a log file.

    Attributes:
        path: The file.
        xml: The tree as written by BehaviorTree.CPP 4; "" for a log of format 3.
        start: The start of the log (ns since 1970); the first transition if the format does not contain it.
        nodes: The nodes of the tree by UID, in pre-order.
        transitions: The transitions in the order of the file.
        damage: Where the file is truncated or damaged, as a sentence; "" if it is complete.
        gaps: The places where the writer recorded that transitions are missing, in order.
    """

    path: Path
    xml: str
    start: int
    nodes: dict[int, RecordedNode]
    transitions: list[LoggedTransition]
    damage: str = ""
    gaps: tuple[Gap, ...] = ()

    @property
    def end(self) -> int:
        """The time of the last transition (ns since 1970)."""
        return self.transitions[-1].stamp if self.transitions else self.start

    @property
    def warnings(self) -> list[str]:
        """Warnings for users about missing data: a sentence for each gap, and for damage."""
        warnings = [f"{self.path}: a gap before transition {gap.at + 1}: {gap.reason}" for gap in self.gaps]
        if self.damage:
            warnings.append(f"{self.path}: {self.damage}; {len(self.transitions)} transitions are read")
        return warnings

    def keys(self) -> dict[int, str]:
        """Return the paths of all nodes by UID; equal paths are distinguished as by `Tree.nodes_by_path`."""
        return dict(zip(self.nodes, unique_paths([node.path for node in self.nodes.values()]), strict=True))

    def statuses(self, count: int | None = None) -> dict[int, Status]:
        """Return the status of each node after the first *count* transitions, by default after all."""
        statuses: dict[int, Status] = dict.fromkeys(self.nodes, IDLE)
        for change in self.transitions[:count]:
            statuses[change.uid] = change.status
        return statuses


def truncation_message(rest: int) -> str:
    """Return the `Recording.damage` of a file that ends with *rest* bytes of an incomplete transition."""
    if not rest:
        return ""
    return f"the file is truncated within a transition, {rest} bytes after the last complete transition"


class TransitionCollector:
    """Collects transitions from records that do not contain the previous status."""

    def __init__(self) -> None:
        self.changes: list[LoggedTransition] = []
        self._last: dict[int, Status] = {}

    def add(self, stamp: int, uid: int, status: Status) -> None:
        """Add a transition.

        Args:
            stamp: The time in ns since 1970.
        """
        self.changes.append(LoggedTransition(stamp, uid, self._last.get(uid, IDLE), status))
        self._last[uid] = status


def parse_nodes(xml: str | bytes, source: str) -> dict[int, RecordedNode]:
    """Return the nodes of a recorded tree by UID, in pre-order.

    Args:
        xml: The tree with `_uid` and `_fullpath` attributes, as BehaviorTree.CPP 4's WriteTreeToXML
            writes it (src/xml_parsing.cpp).
        source: The name of the log, for errors.
    """
    data = encoded(xml) if isinstance(xml, str) else xml
    try:
        root = parse_bytes(data, source).root
    except XmlSyntaxError as error:
        message = error.diagnostics[0].message
        raise LogError(f"{source}: the tree in this log is not valid XML: {message}") from None
    # Reversed, so that the first of several trees with the same path is kept.
    trees = {tree.get("_fullpath") or "": tree for tree in reversed(list(root.iterchildren("BehaviorTree")))}
    types = {
        model.get("ID"): MODEL_TAGS[model.tag]
        for models in root.iterchildren("TreeNodesModel")
        for model in models.iterchildren(*MODEL_TAGS)
    }
    if "" not in trees:
        raise LogError(f"{source}: the tree in this log has no main tree")
    return {node.uid: node for node in _walk(trees, types, source)}


def _walk(
    trees: dict[str, Element], types: dict[str | None, NodeType], source: str
) -> Iterator[RecordedNode]:
    """Yield the nodes depth first. Not recursive, since trees can be deeper than Python's recursion limit."""
    open_trees = dict(trees)
    waiting = [(element, "") for element in open_trees.pop("").children]
    seen: set[int] = set()
    while waiting:
        element, subtree = waiting.pop()
        uid = _uid(element, source)
        if uid in seen:
            raise LogError(f"{source}: the tree in this log has two nodes with _uid {uid}")
        seen.add(uid)
        tag = element.tag
        prefix = f"{subtree}/" if subtree else ""
        if tag == "SubTree":
            path = inside = element.get("_fullpath") or ""
            # Each instance of a subtree is written once. In a damaged log a tree may contain itself: `pop`
            # prevents an endless loop.
            below = open_trees.pop(path).children if path in open_trees else []
            name = path.removeprefix(prefix).removesuffix(f"::{uid}")
            node_type = NodeType.SUBTREE
        else:
            name, inside = element.attributes.get("name", tag), subtree
            path = f"{prefix}{name}::{uid}" if name == tag else prefix + name
            below = element.children
            node_type = types.get(tag, NodeType.UNDEFINED)
        children = tuple(_uid(child, source) for child in below)
        ports = {key: value for key, value in element.attributes.items() if key not in _NOT_PORTS}
        yield RecordedNode(uid, name, tag, node_type, path, children, ports)
        waiting += ((child, inside) for child in reversed(below))


def _uid(element: Element, source: str) -> int:
    text = element.get("_uid") or ""
    if not (text.isascii() and text.isdigit() and len(text) <= 10):
        raise LogError(f"{source}: the node <{element.tag}> in this log has the invalid _uid '{text}'")
    return int(text)


def format_transition(since: int, path: str, previous: Status, status: Status, width: int = 0) -> str:
    """Return a transition as a line of text.

    Args:
        since: The time since the start (ns).
        width: The minimum width of the column for *path*.
    """
    return f"{since / NS_PER_S:12.6f}  {path:<{width}}  {previous.name:>7} → {status.name}"
