"""Find which elements of two versions of trees are the same node.

Nodes have no identity in a text, so that this is a guess. First, unmistakable nodes are matched: equal
branches that occur once, and nodes with the same ID and name. Then children of matched nodes are matched by
their order, and the others by their parents and children.
"""

from bisect import bisect_left
from collections import Counter, defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from difflib import SequenceMatcher
from itertools import count
from typing import Final

from btcore.xml.read.element import Element
from btcore.xml.read.tags import EXPLICIT_TAGS

TREE: Final = "BehaviorTree"
_MAX_COMPARED: Final = 2_000
"""Maximum number of nodes that are matched by their order. In longer lists, the order does not matter."""

Label = Callable[[Element], Hashable]


def node_id(element: Element) -> str:
    """Return the ID of a node; of an element that calls a tree or defines one, its tag."""
    tag = element.tag
    return (element.get("ID") or tag) if tag in EXPLICIT_TAGS else tag


def attributes_of(element: Element) -> dict[str, str]:
    """Return the attributes of a node, without the ID of an explicit tag such as `<Action ID="…">`."""
    attributes = element.attributes
    if element.tag not in EXPLICIT_TAGS:
        return attributes
    return {name: text for name, text in attributes.items() if name != "ID"}


def nodes_of(top: Element) -> Iterator[Element]:
    """Yield an element and those below it, in document order."""
    pending = [top]
    while pending:
        element = pending.pop()
        yield element
        pending += reversed(element.node_children())


class Matching:
    """The nodes that two versions have in common.

    Args:
        old: An element whose children are the trees of the old version.
        new: The same for the new version.

    Attributes:
        new_of: The elements of the old version, with those of the new version that are the same node.
        old_of: The opposite.
        moved: The elements of the new version that have another parent or another place among their
            siblings. Nodes that were inserted or removed around a node or beside it do not move it.
    """

    def __init__(self, old: Element, new: Element) -> None:
        self.new_of: dict[Element, Element] = {}
        self.old_of: dict[Element, Element] = {}
        self._old_order, self._new_order = list(nodes_of(old)), list(nodes_of(new))
        self._old_parents, self._new_parents = _parents(self._old_order), _parents(self._new_order)
        self._contents = _contents([*self._old_order, *self._new_order])
        self._pair(old, new)
        self._pair_unique(lambda element: self._contents[element] if _is_distinctive(element) else None)
        self._pair_unique(lambda element: _label(element) if _name(element) else None)
        self._pair_parents(lambda element, other, votes: node_id(element) == node_id(other))
        self._pair_children()
        self._pair_parents(_share_most)
        self._pair_children()
        self.moved = self._find_moved(old)

    def _pair(self, old: Element, new: Element) -> None:
        self.new_of[old] = new
        self.old_of[new] = old

    def _pair_branch(self, old: Element, new: Element) -> None:
        """Pair two nodes, and the nodes below them if they are equal."""
        if self._contents[old] != self._contents[new]:
            self._pair(old, new)
            return
        for first, second in zip(nodes_of(old), nodes_of(new), strict=True):
            if first not in self.new_of and second not in self.old_of:
                self._pair(first, second)

    def _free(self, elements: Iterable[Element]) -> list[Element]:
        return [element for element in elements if element not in self.new_of and element not in self.old_of]

    def _pair_unique(self, label: Label) -> None:
        """Pair the nodes whose label, unless it is None, occurs once in each version."""
        sides = []
        for order in (self._old_order, self._new_order):
            labels = [(element, key) for element in self._free(order) if (key := label(element)) is not None]
            counts = Counter(key for _, key in labels)
            sides.append({key: element for element, key in labels if counts[key] == 1})
        old_side, new_side = sides
        for key, element in old_side.items():
            other = new_side.get(key)
            # A node of an equal branch above may have them already.
            if other is not None and element not in self.new_of and other not in self.old_of:
                self._pair_branch(element, other)

    def _pair_parents(self, is_same: Callable[[Element, Element, int], bool]) -> None:
        """Pair nodes of which children are paired, beginning with the deepest."""
        for element in reversed(self._old_order):
            if element in self.new_of:
                continue
            parents = (
                self._new_parents.get(self.new_of[child])
                for child in element.node_children()
                if child in self.new_of
            )
            votes = Counter(parent for parent in parents if parent is not None and parent not in self.old_of)
            for other, number in votes.most_common():
                if (element.tag == TREE) == (other.tag == TREE) and is_same(element, other, number):
                    self._pair(element, other)
                    break

    def _pair_children(self) -> None:
        """Pair the children of paired nodes, from the root down."""
        for element in self._old_order:
            other = self.new_of.get(element)
            if other is None:
                continue
            # Nodes may have been inserted between a node and its parent, or removed there.
            is_top = element is self._old_order[0]
            if not is_top:
                self._pair_lists(
                    self._free_below(element), self._free_below(other), self._contents.__getitem__
                )
            for label in (_label, _renamed_label, _typed_label, _changed_label):
                below, other_below = element.node_children(), other.node_children()
                self._pair_lists(self._free(below), self._free(other_below), label)
            if not is_top:
                self._pair_lists(self._free_below(element), self._free_below(other), _label)

    def _pair_lists(self, old: Sequence[Element], new: Sequence[Element], label: Label) -> None:
        """Pair nodes with the same label that is not None: first those in the same order."""
        if not old or not new:
            return
        if max(len(old), len(new)) <= _MAX_COMPARED:
            old_labels, new_labels = ([label(element) for element in elements] for elements in (old, new))
            matcher = SequenceMatcher(None, old_labels, new_labels)
            for start, new_start, size in matcher.get_matching_blocks():
                for first, second in zip(
                    old[start : start + size], new[new_start : new_start + size], strict=True
                ):
                    if label(first) is not None and first not in self.new_of and second not in self.old_of:
                        self._pair_branch(first, second)
        if label is _changed_label:
            return
        rest = defaultdict(list)
        for second in reversed(self._free(new)):
            rest[label(second)].append(second)
        for first in self._free(old):
            key = label(first)
            while key is not None and rest[key] and first not in self.new_of:
                second = rest[key].pop()
                if second not in self.old_of:
                    self._pair_branch(first, second)

    def _free_below(self, element: Element) -> list[Element]:
        """Return the nodes without a counterpart that are below a node, and have none between."""
        found: list[Element] = []
        pending = self._free(reversed(element.node_children()))
        while pending:
            below = pending.pop()
            found.append(below)
            pending += self._free(reversed(below.node_children()))
        return found

    # --- moved nodes

    def _find_moved(self, old: Element) -> set[Element]:
        old_above = _paired_parents(self._old_order, self._old_parents, self.new_of)
        new_above = _paired_parents(self._new_order, self._new_parents, self.old_of)
        moved: set[Element] = set()
        kept: dict[Element, list[Element]] = defaultdict(list)
        for element in self._new_order:
            if element not in self.old_of or element.tag == TREE or element not in new_above:
                continue
            parent = new_above[element]
            if old_above[self.old_of[element]] is self.old_of[parent]:
                kept[parent].append(element)
            else:
                moved.add(element)
        ranks = {element: rank for rank, element in enumerate(self._old_order)}
        for siblings in kept.values():
            moved.update(_out_of_order(siblings, [ranks[self.old_of[element]] for element in siblings]))
        return moved


def _parents(order: Iterable[Element]) -> dict[Element, Element]:
    return {child: element for element in order for child in element.node_children()}


def _paired_parents(
    order: Iterable[Element], parents: dict[Element, Element], paired: dict[Element, Element]
) -> dict[Element, Element]:
    """Return the nearest element above each element that has a counterpart."""
    above: dict[Element, Element] = {}
    for element in order:
        parent = parents.get(element)
        if parent is not None:
            above[element] = parent if parent in paired else above[parent]
    return above


def _contents(elements: Iterable[Element]) -> dict[Element, int]:
    """Return a number for each element. Equal numbers mean equal branches."""
    numbers: dict[tuple[object, ...], int] = defaultdict(count().__next__)
    contents: dict[Element, int] = {}
    for element in reversed(list(elements)):  # children first
        below = tuple(contents[child] for child in element.node_children())
        contents[element] = numbers[node_id(element), frozenset(attributes_of(element).items()), below]
    return contents


def _is_distinctive(element: Element) -> bool:
    """Return whether an equal branch is more than a node without attributes, such as `<AlwaysSuccess/>`."""
    return bool(attributes_of(element) or element.node_children())


def _name(element: Element) -> str | None:
    """Return the name that a node has in the text; the ID of a tree."""
    return element.get("ID" if element.tag == TREE else "name")


def _label(element: Element) -> Hashable:
    called = element.get("ID") if element.tag not in EXPLICIT_TAGS else None
    return node_id(element), called, _name(element)


def _renamed_label(element: Element) -> Hashable:
    """Return the label of a node whose name alone may have changed."""
    others = (item for item in attributes_of(element).items() if item[0] != "name")
    return None if element.tag == TREE else (node_id(element), frozenset(others))


def _changed_label(element: Element) -> Hashable:
    """Return the label of a node without a name, whose attributes may have changed."""
    return None if element.tag == TREE or _name(element) else node_id(element)


def _typed_label(element: Element) -> Hashable:
    """Return the label of a node whose type may have changed."""
    return None if element.tag == TREE else _name(element)


def _share_most(element: Element, other: Element, votes: int) -> bool:
    """Return whether two nodes, perhaps of different types, have most of their children in common."""
    return 2 * votes > max(len(element.node_children()), len(other.node_children()))


def _out_of_order(items: Sequence[Element], ranks: Sequence[int]) -> list[Element]:
    """Return the fewest of *items* without which *ranks* would be ascending."""
    tails: list[int] = []  # the last index of the best ascending sequence of each length
    before: list[int] = []
    for index, rank in enumerate(ranks):
        length = bisect_left(tails, rank, key=lambda tail: ranks[tail])
        before.append(tails[length - 1] if length else -1)
        tails[length : length + 1] = [index]
    kept: set[int] = set()
    index = tails[-1]
    while index >= 0:
        kept.add(index)
        index = before[index]
    return [item for index, item in enumerate(items) if index not in kept]
