"""What a log file tells, whatever its format: the tree's nodes, and how their statuses changed."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

from lxml import etree

from btcore.logs.files import LogFault
from btcore.status import IDLE, NodeType, Status

STATUSES: Final = {int(status): status for status in Status}

_TYPES: Final = {
    "Action": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "Control": NodeType.CONTROL,
    "Decorator": NodeType.DECORATOR,
    "SubTree": NodeType.SUBTREE,
}


class Change(NamedTuple):
    """One change of one node's status; *stamp* in ns since 1970 (the files hold µs)."""

    stamp: int
    uid: int
    previous: Status
    status: Status


@dataclass(frozen=True, slots=True)
class RecordedNode:
    """A node of the recorded tree: *id* is its registration ID, *path* its full path, *children* are uids."""

    uid: int
    name: str
    id: str
    type: NodeType
    path: str
    children: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class Recording:
    """A log file, read.

    *nodes* are the tree's by uid, in pre-order; *xml* is the tree as BehaviorTree.CPP 4 writes it ("" in
    a format-3 log); *start* is when the log began (ns since 1970; the first change's stamp where the file
    does not say). *damage* says, in one sentence, where the file stops making sense ("" if it does not).
    """

    path: Path
    xml: str
    start: int
    nodes: dict[int, RecordedNode]
    changes: list[Change]
    damage: str = ""

    def statuses(self) -> dict[int, Status]:
        """How every node stands after the last change."""
        found: dict[int, Status] = dict.fromkeys(self.nodes, IDLE)
        for change in self.changes:
            found[change.uid] = change.status
        return found


class History:
    """Collects changes from records that don't tell the previous status."""

    def __init__(self) -> None:
        self.changes: list[Change] = []
        self._last: dict[int, Status] = {}

    def add(self, stamp: int, uid: int, status: Status) -> None:
        """Node *uid* became *status* at *stamp* (ns since 1970)."""
        self.changes.append(Change(stamp, uid, self._last.get(uid, IDLE), status))
        self._last[uid] = status


def nodes_of(xml: str | bytes, source: str) -> dict[int, RecordedNode]:
    """The nodes of a tree as BehaviorTree.CPP 4 writes it with metadata (groot2.md §4.1), in pre-order.

    Raises LogFault, about *source*, if *xml* isn't that.
    """
    data = xml.encode("utf-8", "replace") if isinstance(xml, str) else xml
    parser = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise LogFault(f"{source}: the tree in this log is no XML: {error.msg}") from None
    trees = {str(tree.get("_fullpath", "")): tree for tree in reversed(root.findall("BehaviorTree"))}
    types = {
        str(model.get("ID")): _TYPES[str(model.tag)]
        for models in root.iterchildren("TreeNodesModel")
        for model in models.iterchildren(*_TYPES)
    }
    if "" not in trees:
        raise LogFault(f"{source}: the tree in this log has no main tree")
    return {node.uid: node for node in _walk(trees, types, source)}


def _walk(
    trees: dict[str, etree._Element], types: dict[str, NodeType], source: str
) -> Iterator[RecordedNode]:
    """Depth first, without recursion: trees can be very deep."""
    open_trees = dict(trees)
    waiting = [(element, "") for element in _elements(open_trees.pop(""))]
    seen: set[int] = set()
    while waiting:
        element, subtree = waiting.pop()
        uid = _uid(element, source)
        if uid in seen:
            raise LogFault(f"{source}: the tree in this log has two nodes with _uid {uid}")
        seen.add(uid)
        tag = str(element.tag)
        prefix = f"{subtree}/" if subtree else ""
        if tag == "SubTree":
            path = inside = str(element.get("_fullpath", ""))
            # Each instance is written once, so a tree that contains itself ends here.
            below = _elements(open_trees.pop(path)) if path in open_trees else []
            name = path.removeprefix(prefix).removesuffix(f"::{uid}")
            kind = NodeType.SUBTREE
        else:
            name, inside = str(element.get("name", tag)), subtree
            path = f"{prefix}{name}::{uid}" if name == tag else prefix + name
            below = _elements(element)
            kind = types.get(tag, NodeType.UNDEFINED)
        yield RecordedNode(uid, name, tag, kind, path, tuple(_uid(child, source) for child in below))
        waiting += ((child, inside) for child in reversed(below))


def _elements(parent: etree._Element) -> list[etree._Element]:
    return list(parent.iterchildren(etree.Element))


def _uid(element: etree._Element, source: str) -> int:
    text = element.get("_uid", "")
    if not (text.isascii() and text.isdigit() and len(text) <= 10):
        raise LogFault(f"{source}: a node of the tree in this log, <{element.tag}>, has the _uid '{text}'")
    return int(text)
