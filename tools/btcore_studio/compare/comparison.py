"""Compare two versions of a document by the meaning of their trees, and draw them.

Comments, white space, and the order of attributes have no meaning. Trees of included documents are compared
if both versions have them: the included files of a version are often not available.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from typing import Final, Literal

from btcore.xml.define import TreeDefinition
from btcore.xml.read.element import Element
from btcore_studio.compare.matching import TREE, Matching, attributes_of, node_id, nodes_of
from btcore_studio.language.drawing import draw_document, shown_tree
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import Data, DocumentIdentifier, Drawing, DrawingParams, Place
from btcore_studio.language.tree_reading import TreeReading, read_trees

Change = Literal["added", "removed", "moved", "changed"]
ChangedAttribute = tuple[str, str | None, str | None]
"""The name of an attribute, and its texts in both versions; the name "" is the ID of the node itself."""

_MODELS: Final = "TreeNodesModel"


class Spot(Data, frozen=True):
    """Where a node that was moved is: below a parent, as its child with a number from 1."""

    parent: str
    number: int


class Difference(Data, frozen=True):
    """A difference between two versions.

    Attributes:
        changes: What happened to the node.
        tree: The ID of the tree, for which `compare` can be called; "" for the rest of the document.
        id: The ID of the node. Elements outside of trees have their tag, trees "BehaviorTree".
        name: The name of the node.
        count: The number of added or removed nodes: the node itself and those below it.
        attributes: The changed attributes.
        spots: If the node was moved, its place in both versions.
        old: The indices of the nodes in the drawing of the old version. The first is the node itself, unless
            it is not drawn.
        new: The same for the new version.
    """

    changes: list[Change]
    tree: str
    id: str
    name: str
    count: int = 1
    attributes: tuple[ChangedAttribute, ...] = ()
    spots: tuple[Spot, Spot] | None = None
    old: tuple[int, ...] = ()
    new: tuple[int, ...] = ()


class Comparison(Data, frozen=True):
    """Two versions of a document.

    Attributes:
        trees: The IDs of the trees that can be shown.
        tree: The ID of the shown tree, or "" if there is none.
        old: The drawing of the old version; None if it lacks the tree.
        new: The drawing of the new version.
        broken: For each version, why its text is not XML, or "".
        pairs: The indices of each node that both drawings show.
        differences: All differences, in the order of the document.
    """

    trees: list[str]
    tree: str
    old: Drawing | None
    new: Drawing | None
    broken: tuple[str, str]
    pairs: list[tuple[int, int]]
    differences: list[Difference]


def compare(
    project: Project, old: SourceDocument, new: SourceDocument, tree: str | None = None
) -> Comparison:
    """Compare two versions of a document.

    Args:
        project: The available nodes.
        old: The old version; an empty text if there is none.
        new: The new version.
        tree: The ID of the tree to draw; by default the main tree, if it shows a difference.
    """
    return _Comparer(read_trees(project, old), read_trees(project, new)).compare(project, tree)


class _Version:
    """A version of the document.

    Attributes:
        trees: The compared trees by ID.
        top: An element above their elements.
        tree_of: The compared tree of each element.
        order: The number of each element in the document.
        parents: The element above each element.
        drawing: The drawing of a tree, or None.
    """

    def __init__(self, reading: TreeReading) -> None:
        self.reading = reading
        self.trees: dict[str, TreeDefinition] = {}
        self.top = Element("", {}, 0)
        self.tree_of: dict[Element, TreeDefinition] = {}
        self.order: dict[Element, int] = {}
        self.parents: dict[Element, Element] = {}
        self.drawing: Drawing | None = None
        self._drawn: dict[Place, list[int]] = {}

    def choose_trees(self, other: "_Version") -> None:
        """Choose the trees to compare."""
        known = other.reading.definitions.by_id
        for id, tree in self.reading.definitions.by_id.items():
            if tree.document is not self.reading.document and id not in known:
                continue
            self.trees[id] = tree
            self.top.children.append(tree.element)
            for element in nodes_of(tree.element):
                self.tree_of[element] = tree
                self.order[element] = len(self.order)
                self.parents.update(dict.fromkeys(element.node_children(), element))

    def draw(self, project: Project, tree: TreeDefinition | None) -> None:
        self.drawing, self._drawn = None, defaultdict(list)
        if tree is None:
            return
        params = DrawingParams(DocumentIdentifier(self.reading.source.uri), tree.id)
        self.drawing = draw_document(project, self.reading.source, params)
        for index, node in enumerate(self.drawing.nodes):
            self._drawn[node.place].append(index)

    def drawn(self, elements: Iterable[Element]) -> tuple[int, ...]:
        """Return the indices of the nodes of *elements* in the drawing."""
        if self.drawing is None:
            return ()
        return tuple(
            index
            for element in elements
            for index in self._drawn.get(self.reading.place(self.tree_of[element].document, element), ())
        )

    def spot(self, element: Element) -> Spot:
        parent = self.parents[element]
        return Spot(name_of(parent), parent.node_children().index(element) + 1)


class _Comparer:
    """Compares two versions."""

    def __init__(self, old: TreeReading, new: TreeReading) -> None:
        self._old, self._new = _Version(old), _Version(new)
        self._old.choose_trees(self._new)
        self._new.choose_trees(self._old)
        self._matching = Matching(self._old.top, self._new.top)

    def compare(self, project: Project, tree: str | None) -> Comparison:
        old, new = self._old, self._new
        if tree not in old.trees and tree not in new.trees:
            tree = None
        main = shown_tree(new.reading, None) or shown_tree(old.reading, None)
        found = self._draw(project, tree or (main.id if main is not None else ""))
        if tree is None and not any(item.old or item.new for item in found):
            other = next((item.tree for item in found if item.tree), None)
            if other is not None:
                found = self._draw(project, other)
        shown = next((side.drawing for side in (new, old) if side.drawing is not None), None)
        pairs = [
            pair
            for element, other in self._matching.new_of.items()
            if element in old.tree_of
            for pair in zip(old.drawn([element]), new.drawn([other]), strict=False)
        ]
        removed = [id for id, tree in old.trees.items() if tree.element not in self._matching.new_of]
        return Comparison(
            [*new.trees, *(id for id in removed if id not in new.trees)],
            shown.tree if shown is not None else "",
            old.drawing,
            new.drawing,
            (old.reading.broken, new.reading.broken),
            pairs,
            found,
        )

    def _draw(self, project: Project, tree: str) -> list[Difference]:
        """Draw a tree in both versions, and return all differences."""
        old, new = self._old, self._new
        new_tree, old_tree = new.trees.get(tree), old.trees.get(tree)
        if new_tree is not None:
            before = self._matching.old_of.get(new_tree.element)
            old_tree = old.tree_of[before] if before is not None else None  # it may have had another ID
        old.draw(project, old_tree)
        new.draw(project, new_tree)
        outside = _compare_items(_items(old.reading), _items(new.reading))
        return [*outside, *self._compare_nodes()]

    def _compare_nodes(self) -> list[Difference]:
        old, new, matching = self._old, self._new, self._matching
        found: list[tuple[tuple[int, int, int], Difference]] = []
        for element, number in new.order.items():
            before = matching.old_of.get(element)
            if before is None:
                if new.parents.get(element) in matching.old_of or element.tag == TREE:
                    found.append(((number, 0, 0), self._region(element, "added")))
                continue
            attributes = _changed_attributes(
                {"": node_id(before), **attributes_of(before)},
                {"": node_id(element), **attributes_of(element)},
            )
            is_moved = element in matching.moved
            changes: list[Change] = ["moved"] if is_moved else []
            if attributes:
                changes.append("changed")
            if not changes:
                continue
            difference = Difference(
                changes,
                new.tree_of[element].id,
                node_id(element),
                name_of(element),
                attributes=attributes,
                spots=(old.spot(before), new.spot(element)) if is_moved else None,
                old=old.drawn([before]),
                new=new.drawn([element]),
            )
            found.append(((number, 0, 0), difference))
        # A removed node is listed where it was.
        last = -1
        for element, number in old.order.items():
            after = matching.new_of.get(element)
            if after is not None:
                last = new.order[after]
            elif old.parents.get(element) in matching.new_of or element.tag == TREE:
                found.append(((last, 1, number), self._region(element, "removed")))
        return [difference for _, difference in sorted(found, key=lambda item: item[0])]

    def _region(self, element: Element, change: Change) -> Difference:
        """Return the difference for nodes of one version alone, of which *element* is the topmost."""
        is_new = change == "added"
        version, paired = (self._new, self._matching.old_of) if is_new else (self._old, self._matching.new_of)
        region: list[Element] = []
        pending = [element]
        while pending:
            below = pending.pop()
            region.append(below)
            pending += [child for child in reversed(below.node_children()) if child not in paired]
        drawn = version.drawn(region)
        return Difference(
            [change],
            version.tree_of[element].id,
            node_id(element),
            name_of(element),
            sum(below.tag != TREE for below in region),
            old=() if is_new else drawn,
            new=drawn if is_new else (),
        )


def name_of(element: Element) -> str:
    """Return the name by which the drawing of a node or of a tree shows it."""
    called = element.get("ID") if element.tag.startswith(("SubTree", TREE)) else None
    return (element.get("name") if element.tag != TREE else None) or called or node_id(element)


def _items(reading: TreeReading) -> dict[tuple[str, str], dict[str, str]]:
    """Return the attributes of the document's elements outside of trees, by tag and ID, path or ordinal."""
    root = reading.document.root
    if reading.is_empty:
        return {}
    items = {(root.tag, ""): dict(root.attributes)}
    for element in _outside_of_trees(root):
        key = element.get("ID") or element.get("path") or ""
        attributes = {**element.attributes, **_port_attributes(element)}
        items.setdefault((element.tag, key), {}).update(attributes)
    return items


def _outside_of_trees(root: Element) -> Iterator[Element]:
    for element in root.children:
        if element.tag == _MODELS:
            yield from element.children
        elif element.tag != TREE:
            yield element


def _port_attributes(model: Element) -> dict[str, str]:
    """Return the ports of a model as texts."""
    texts: dict[str, str] = {}
    for port in model.children:
        words = [f'{name}="{text}"' for name, text in port.attributes.items() if name != "name"]
        texts[f"{port.tag} {port.get('name') or ''}".strip()] = " ".join(words)
    return texts


def _compare_items(
    old: dict[tuple[str, str], dict[str, str]], new: dict[tuple[str, str], dict[str, str]]
) -> Iterator[Difference]:
    for tag, key in old | new:
        before, after = old.get((tag, key)), new.get((tag, key))
        changes: list[Change] = ["added" if before is None else "removed" if after is None else "changed"]
        if before is None or after is None:
            if tag != "root":  # an empty file has none
                yield Difference(changes, "", tag, key)
        elif before != after:
            yield Difference(changes, "", tag, key, attributes=_changed_attributes(before, after))


def _changed_attributes(before: dict[str, str], after: dict[str, str]) -> tuple[ChangedAttribute, ...]:
    return tuple(
        (name, before.get(name), after.get(name))
        for name in before | after
        if before.get(name) != after.get(name)
    )
