"""What a log file tells, whatever its format: the tree's nodes, and how their statuses changed."""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, NamedTuple

from lxml import etree

from btcore.logs.files import LogError
from btcore.status import IDLE, NodeType, Status

STATUSES: Final = {int(status): status for status in Status}

_NOT_PORTS: Final = frozenset({"name", "ID", "_uid", "_fullpath"})
_TYPES: Final = {
    "Action": NodeType.ACTION,
    "Condition": NodeType.CONDITION,
    "Control": NodeType.CONTROL,
    "Decorator": NodeType.DECORATOR,
    "SubTree": NodeType.SUBTREE,
}


class LoggedTransition(NamedTuple):
    """One change of one node's status; *stamp* in ns since 1970 (the files hold µs)."""

    stamp: int
    uid: int
    previous: Status
    status: Status


class Gap(NamedTuple):
    """Something is missing before the change number *at* (0: the first); *said* tells what, and why."""

    at: int
    reason: str


@dataclass(frozen=True, slots=True)
class RecordedNode:
    """A node of the recorded tree.

    *id* is its registration ID, *path* its full path, *children* are uids, *ports* maps ports and conditions
    to their text in the XML.
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
    """A log file, read.

    *nodes* are the tree's by uid, in pre-order; *xml* is the tree as BehaviorTree.CPP 4 writes it ("" in
    a format-3 log); *start* is when the log began (ns since 1970; the first change's stamp where the file
    does not say). *damage* says, in one sentence, where the file stops making sense ("" if it does not);
    *gaps* tell what the writer knew to be missing, in order.
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
        """When the last change was (ns since 1970)."""
        return self.transitions[-1].stamp if self.transitions else self.start

    @property
    def warnings(self) -> list[str]:
        """What a reader has to know of what is missing: sentences on every gap, and on the damage."""
        told = [f"{self.path}: a gap before transition {gap.at + 1}: {gap.reason}" for gap in self.gaps]
        if self.damage:
            told.append(f"{self.path}: {self.damage}; {len(self.transitions)} transitions are read")
        return told

    def keys(self) -> dict[int, str]:
        """The path of every node by its uid; where paths are equal ``#<uid>`` is appended."""
        times = Counter(node.path for node in self.nodes.values())
        return {
            uid: node.path if times[node.path] == 1 else f"{node.path}#{uid}"
            for uid, node in self.nodes.items()
        }

    def statuses(self, count: int | None = None) -> dict[int, Status]:
        """How every node stands after the first *count* changes, by default after all."""
        found: dict[int, Status] = dict.fromkeys(self.nodes, IDLE)
        for change in self.transitions[:count]:
            found[change.uid] = change.status
        return found


class TransitionCollector:
    """Collects changes from records that don't tell the previous status."""

    def __init__(self) -> None:
        self.changes: list[LoggedTransition] = []
        self._last: dict[int, Status] = {}

    def add(self, stamp: int, uid: int, status: Status) -> None:
        """Node *uid* became *status* at *stamp* (ns since 1970)."""
        self.changes.append(LoggedTransition(stamp, uid, self._last.get(uid, IDLE), status))
        self._last[uid] = status


def parse_nodes(xml: str | bytes, source: str) -> dict[int, RecordedNode]:
    """The nodes of a tree as BehaviorTree.CPP 4 writes it with metadata (groot2.md §4.1), in pre-order.

    Raises LogError, about *source*, if *xml* isn't that.
    """
    data = xml.encode("utf-8", "replace") if isinstance(xml, str) else xml
    parser = etree.XMLParser(
        encoding="utf-8", resolve_entities=False, no_network=True, load_dtd=False, huge_tree=True
    )
    try:
        root = etree.fromstring(data, parser)
    except etree.XMLSyntaxError as error:
        raise LogError(f"{source}: the tree in this log is no XML: {error.msg}") from None
    trees = {str(tree.get("_fullpath", "")): tree for tree in reversed(root.findall("BehaviorTree"))}
    types = {
        str(model.get("ID")): _TYPES[str(model.tag)]
        for models in root.iterchildren("TreeNodesModel")
        for model in models.iterchildren(*_TYPES)
    }
    if "" not in trees:
        raise LogError(f"{source}: the tree in this log has no main tree")
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
            raise LogError(f"{source}: the tree in this log has two nodes with _uid {uid}")
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
        children = tuple(_uid(child, source) for child in below)
        ports = {str(key): str(value) for key, value in element.attrib.items() if key not in _NOT_PORTS}
        yield RecordedNode(uid, name, tag, kind, path, children, ports)
        waiting += ((child, inside) for child in reversed(below))


def _elements(parent: etree._Element) -> list[etree._Element]:
    return list(parent.iterchildren(etree.Element))


def _uid(element: etree._Element, source: str) -> int:
    text = element.get("_uid", "")
    if not (text.isascii() and text.isdigit() and len(text) <= 10):
        raise LogError(f"{source}: a node of the tree in this log, <{element.tag}>, has the _uid '{text}'")
    return int(text)
