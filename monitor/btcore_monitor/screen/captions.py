"""What is written in a node's pill: its name, and below it, smaller, what tells it from its namesakes."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from btcore_monitor.events import ObservedNode, ObservedTree
from btcore_monitor.screen import style
from btcore_monitor.screen.font import elide, width_of

BADGE_ROOM: Final = 2 * style.BADGE_RADIUS + 14.0
TEXT_GAP: Final = 20.0
VALUES_AT_MOST: Final = 28
"""Characters of ports' values that tell namesakes apart where a name stands alone."""


@dataclass(frozen=True, slots=True)
class Caption:
    """*name* is shortened to what a pill holds; *note* ("": none) is the line below it."""

    name: str
    note: str = ""

    @property
    def width(self) -> float:
        """Length of the pill that holds a badge and the caption."""
        text = max(width_of(self.name, style.TEXT_HEIGHT), width_of(self.note, style.NOTE_HEIGHT))
        return BADGE_ROOM + text + TEXT_GAP


def captions(tree: ObservedTree, whole: ObservedTree, noted: bool) -> Mapping[int, Caption]:
    """A caption for each uid of *tree*, which may be a folded part of *whole*; *noted*: with notes.

    A note has a node's registration ID where its name is another, and its ports as the XML has them.
    """
    return {
        node.uid: Caption(
            elide(node.name, style.NAME_ROOM) + _folded(node, whole),
            _note(node, whole) if noted else "",
        )
        for node in tree.nodes
    }


def ports(node: ObservedNode) -> str:
    """All ports, as the XML has them."""
    return "  ".join(f'{port}="{text}"' for port, text in node.ports.items())


def distinct_names(nodes: Sequence[ObservedNode]) -> list[str]:
    """Names of *nodes*; namesakes have their ports' values too, where those are short."""
    count = Counter(node.name for node in nodes)
    found = []
    for node in nodes:
        values = " ".join(node.ports.values()) if count[node.name] > 1 else ""
        found.append(f"{node.name} {values}" if values and len(values) <= VALUES_AT_MOST else node.name)
    return found


def _note(node: ObservedNode, whole: ObservedTree) -> str:
    node_id = whole.subtrees.get(node.path, node.name) if node.kind == "subtree" else node.id
    parts = [node_id] if node_id != node.name else []
    parts += [
        f"{port}={' '.join(text.split())}"
        for port, text in node.ports.items()
        if text and not port.startswith("_")
    ]
    note = "  ".join(parts)
    return note if len(note) <= style.NOTE_ROOM else note[: style.NOTE_ROOM - 1].rstrip() + "…"


def _folded(node: ObservedNode, whole: ObservedTree) -> str:
    """How many nodes are folded into *node*: `` +12``."""
    if node.children or not whole.by_uid[node.uid].children:
        return ""
    count, waiting = 0, list(whole.by_uid[node.uid].children)
    while waiting:
        count += 1
        waiting += whole.by_uid[waiting.pop()].children
    return f" +{count}"
