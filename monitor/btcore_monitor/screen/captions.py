"""The text in a node's pill (the rounded bar that represents a node in the drawing of a tree).

The text is the node's name, and a smaller line that distinguishes nodes with the same name.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from btcore_monitor.events import ObservedNode, ObservedTree
from btcore_monitor.screen import style
from btcore_monitor.screen.font import elide, width_of

BADGE_WIDTH: Final = 2 * style.BADGE_RADIUS + 14.0
TEXT_GAP: Final = 20.0
MAX_VALUES: Final = 28
"""Maximum length (characters) of port values that are added to a name, so that equal names differ."""


@dataclass(frozen=True, slots=True)
class Caption:
    """A *name*, shortened to fit into a pill, and a *note* for the line below it ("" for none)."""

    name: str
    note: str = ""

    @property
    def width(self) -> float:
        """The length (drawing units) of a pill with a badge (the disc of the symbol) and this caption."""
        text = max(width_of(self.name, style.TEXT_HEIGHT), width_of(self.note, style.NOTE_HEIGHT))
        return BADGE_WIDTH + text + TEXT_GAP


def create_captions(tree: ObservedTree, full_tree: ObservedTree, with_notes: bool) -> Mapping[int, Caption]:
    """Return a caption for each uid of a tree.

    A note has a node's registration ID if its name is different, and its ports as in the XML.

    Args:
        tree: The tree, which may be a folded version of *full_tree*.
        full_tree: The complete tree.
        with_notes: Whether captions have notes.
    """
    return {
        node.uid: Caption(
            elide(node.name, style.MAX_NAME_CHARS) + _folded(node, full_tree),
            _note(node, full_tree) if with_notes else "",
        )
        for node in tree.nodes
    }


def format_ports(node: ObservedNode) -> str:
    """Return the ports of *node* as in the XML: `port="text"`, separated by spaces."""
    return "  ".join(f'{port}="{text}"' for port, text in node.ports.items())


def distinct_names(nodes: Sequence[ObservedNode]) -> list[str]:
    """Return a different name for each of *nodes*, in their order.

    Nodes with the same name also get the values of their ports, if these are short and different. Otherwise
    they get the innermost names of their subtrees, and as a last resort their uids.
    """
    same: dict[str, list[ObservedNode]] = {}
    for node in nodes:
        same.setdefault(node.name, []).append(node)
    names = {uid: name for group in same.values() for uid, name in _distinct(group).items()}
    return [names[node.uid] for node in nodes]


def _distinct(group: Sequence[ObservedNode]) -> Mapping[int, str]:
    """Return a different name for each uid of *group*, whose nodes have the same name."""
    if len(group) == 1:
        return {group[0].uid: group[0].name}
    values = {node.uid: " ".join(node.ports.values()) for node in group}
    named = {
        uid: f"{group[0].name} {text}".rstrip() if len(text) <= MAX_VALUES else group[0].name
        for uid, text in values.items()
    }
    if len(set(named.values())) == len(group):
        return named
    subtrees = {node.uid: node.subtree.split("/") for node in group}
    for count in range(1, max(map(len, subtrees.values())) + 1):
        places = {uid: "/".join(parts[-count:]) for uid, parts in subtrees.items()}
        if len(set(places.values())) == len(group):
            return {node.uid: _placed(node.name, places[node.uid]) for node in group}
    return {node.uid: f"{_placed(node.name, subtrees[node.uid][-1])} #{node.uid}" for node in group}


def _placed(name: str, place: str) -> str:
    return f"{name} · {place}" if place else name


def _note(node: ObservedNode, full_tree: ObservedTree) -> str:
    node_id = full_tree.subtrees.get(node.path, node.name) if node.type == "subtree" else node.id
    parts = [node_id] if node_id != node.name else []
    parts += [
        f"{port}={' '.join(text.split())}"
        for port, text in node.ports.items()
        if text and not port.startswith("_")
    ]
    note = "  ".join(parts)
    return note if len(note) <= style.MAX_NOTE_CHARS else note[: style.MAX_NOTE_CHARS - 1].rstrip() + "…"


def _folded(node: ObservedNode, full_tree: ObservedTree) -> str:
    """Return the number of nodes that are folded into *node* as text, such as ` +12`."""
    if node.children or not full_tree.by_uid[node.uid].children:
        return ""
    count, waiting = 0, list(full_tree.by_uid[node.uid].children)
    while waiting:
        count += 1
        waiting += full_tree.by_uid[waiting.pop()].children
    return f" +{count}"
