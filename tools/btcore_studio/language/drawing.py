"""Draw a tree of a document, with the places of its nodes and what an editor needs to know about them.

A drawing needs the elements of a tree only, and not that the tree can be loaded: a tree that is being written
may lack children and trees, call itself, and contain unknown nodes. Of a tree without errors, the drawing has
the nodes of the running tree, with the same numbers.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from operator import attrgetter
from typing import Final, cast
from weakref import WeakKeyDictionary

from btcore.blackboard.ports import SCRIPT_ROLES
from btcore.names import SCRIPT_ATTRIBUTES
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.xml.define import TreeDefinition
from btcore.xml.plan.plan import MAX_DEPTH, TreeSize
from btcore.xml.plan.tree_plan import SubtreeCall
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element
from btcore.xml.read.tags import EXPLICIT_TAGS, SUBTREE_TAGS
from btcore_drawing.diagram import DiagramNode
from btcore_drawing.folding import fold
from btcore_drawing.node_card import Card, card_of
from btcore_drawing.svg import DrawnCard, diagram_to_svg, draw_diagram
from btcore_studio.edit.tree_editor import is_disabled
from btcore_studio.language.node_keys import diagram_nodes, keyed_nodes, node_keys
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import (
    Drawing,
    DrawingParams,
    DrawnNode,
    MovedNode,
    NodeKind,
    Place,
    TreeSummary,
)
from btcore_studio.language.tree_reading import TreeReading, read_trees

MAX_CARDS: Final = 5_000
"""Maximum number of nodes in a drawing. In a larger tree the deepest levels are folded."""
MAX_ROWS: Final = 20_000
"""Maximum number of nodes that are listed. The trees of further calls are left out."""
_MAX_DRAWN: Final = 4
"""Maximum number of drawings of a project that are kept, from which clients may request the changes."""
_NUMBERS: Final = itertools.count(1)
_DRAWN: Final["WeakKeyDictionary[Project, dict[int, list[DrawnNode]]]"] = WeakKeyDictionary()
_LOOKS: Final["WeakKeyDictionary[Registry, dict[tuple[object, ...], _Look]]"] = WeakKeyDictionary()


def draw_document(project: Project, source: SourceDocument, params: DrawingParams) -> Drawing:
    """Return the drawing of a tree of a document.

    Args:
        params: The tree, and what to fold.
    """
    reading = read_trees(project, source)
    tree = shown_tree(reading, params.tree)
    id, format = "" if tree is None else tree.id, reading.definitions.format
    root = None if tree is None else diagram_of_tree(reading, tree)
    if root is None:
        return Drawing(id, format, "", [], {}, tree_summaries(reading), reading.broken)
    nodes = diagram_nodes(root)
    keys = node_keys(keyed_nodes(nodes), params.call)
    children = {node.uid: [child.uid for child in node.children] for node, _ in nodes}
    hidden: dict[int, int] = {}
    if params.folded or len(nodes) > MAX_CARDS:
        hidden = fold(children, (), MAX_CARDS, {uid for uid, key in keys.items() if key in params.folded})
    for node, _ in nodes:
        if node.uid in hidden:
            node.hidden, node.children = hidden[node.uid], []
    about = {node.id: node.about for node, _ in nodes if node.about}
    is_leaf = {uid: not below for uid, below in children.items()}
    if params.styled:
        svg = diagram_to_svg(root, id, format)
        rows = [_row(reading, node, parent, keys[node.uid], is_leaf[node.uid]) for node, parent in nodes]
        return Drawing(id, format, svg, rows, about, tree_summaries(reading), reading.broken)
    picture = draw_diagram(root, id, format, _card_of, is_page=True)
    cards = {card.uid: card for card in picture.cards}
    rows = [
        _row(reading, node, parent, keys[node.uid], is_leaf[node.uid], cards.get(node.uid))
        for node, parent in nodes
    ]
    number, drawn = next(_NUMBERS), _DRAWN.setdefault(project, {})
    moved = _moved(drawn.get(params.since, ()), rows)
    drawn[number] = rows
    if len(drawn) > _MAX_DRAWN:
        del drawn[next(iter(drawn))]
    known = {index for index, *_ in moved}
    return Drawing(
        id,
        format,
        f"{picture.head}\n{picture.tail}",
        [row for index, row in enumerate(rows) if index not in known],
        about,
        tree_summaries(reading),
        reading.broken,
        number,
        moved,
        picture.left,
        picture.top,
        picture.width,
        picture.height,
    )


def _moved(before: Sequence[DrawnNode], rows: Sequence[DrawnNode]) -> list[MovedNode]:
    """Return the nodes that differ from those of an earlier drawing in their places alone."""
    earlier = {row.key: index for index, row in enumerate(before)}
    moved: list[MovedNode] = []
    for index, row in enumerate(rows):
        known = earlier.get(row.key)
        if known is not None and _content(before[known]) == _content(row):
            start, end = row.place.position, row.end
            lines = start.line, start.character, end.line, end.character
            edge = None if row.edge == before[known].edge else row.edge
            moved.append((index, known, row.parent, *lines, row.x, row.y, edge))
    return moved


_content = attrgetter(
    "card",
    "hidden",
    "calls",
    "children",
    "disabled",
    "name",
    "leaf",
    "ports",
    "kind",
    "id",
    "place.uri",
)


def shown_tree(reading: TreeReading, id: str | None) -> TreeDefinition | None:
    """Return the tree *id*, else the main tree, else the first tree of the document, else any tree."""
    definitions = reading.definitions
    own = (tree for tree in definitions.by_id.values() if tree.document is reading.document)
    return (
        definitions.by_id.get(id or "")
        or main_tree_of(reading)
        or next(own, None)
        or next(iter(definitions.by_id.values()), None)
    )


def main_tree_of(reading: TreeReading) -> TreeDefinition | None:
    """Return the main tree of a document, or of its includes if it has no trees, as a project of Groot 2."""
    definitions = reading.definitions
    if definitions.main_tree is not None or any(
        tree.document is reading.document for tree in definitions.by_id.values()
    ):
        return definitions.main_tree
    named = (document.root.get("main_tree_to_execute") for document in reading.sources.documents)
    return next((tree for id in named if (tree := definitions.by_id.get(id or "")) is not None), None)


def tree_summaries(reading: TreeReading) -> list[TreeSummary]:
    """Return the trees of the document, then those of its includes."""
    definitions = reading.definitions
    callers: dict[str, dict[str, None]] = {}
    for tree in definitions.by_id.values():
        for call in tree.element.iter(*SUBTREE_TAGS[definitions.format]):
            callers.setdefault(call.get("ID") or "", {})[tree.id] = None
    main = main_tree_of(reading)
    trees = sorted(definitions.by_id.values(), key=lambda tree: tree.document is not reading.document)
    return [
        TreeSummary(
            tree.id,
            reading.place(tree.document, tree.element),
            list(callers.get(tree.id, ())),
            tree is main,
        )
        for tree in trees
    ]


def child_limits(reading: TreeReading, tag: str, id: str) -> tuple[int, int | None]:
    """Return the minimum and the maximum number of children with which a node can be ticked.

    Args:
        reading: The document.
        tag: The tag of the node.
        id: The ID of the node.
    """
    definitions = reading.definitions
    manifest = reading.nodes.get(id, definitions.format)
    is_guessed = id in reading.missing and tag not in EXPLICIT_TAGS
    if tag in SUBTREE_TAGS[definitions.format]:
        return 0, 0
    if manifest is None or is_guessed:
        return 0, None
    return manifest.spec.child_count if manifest.type in (NodeType.CONTROL, NodeType.DECORATOR) else (0, 0)


def node_kind(node_type: NodeType) -> NodeKind:
    """Return the name of a node type in the protocol."""
    return cast(NodeKind, node_type.name.lower())


@dataclass(slots=True)
class _Pending:
    """A node that is not in the drawing yet; *callers* are the trees in which its tree is called."""

    document: Document
    element: Element
    parent: DiagramNode | None
    depth: int
    callers: tuple[str, ...]


def diagram_of_tree(reading: TreeReading, tree: TreeDefinition) -> DiagramNode | None:
    """Return the nodes of a tree and of the trees that it calls; None if the tree has no nodes."""
    top: DiagramNode | None = None
    pending = _root_of(tree, None, 1, ())
    count = depth = 0
    while pending and count < MAX_ROWS:
        item = pending.pop()
        count += 1
        depth = max(depth, item.depth)
        node, called = _diagram_node(reading, item, count)
        if item.parent is None:
            top = node
        else:
            item.parent.children.append(node)
        if item.depth >= MAX_DEPTH:
            continue
        if called is not None:
            if called.id not in item.callers:
                pending += _root_of(called, node, item.depth + 1, item.callers)
        elif not node.tree:
            pending += [
                _Pending(item.document, child, node, item.depth + 1, item.callers)
                for child in reversed(item.element.node_children())
            ]
    TreeSize(count, depth).ensure_recursion_limit()
    return top


def _root_of(
    tree: TreeDefinition, parent: DiagramNode | None, depth: int, callers: tuple[str, ...]
) -> list[_Pending]:
    # Further roots are an error.
    roots = tree.element.node_children()[:1]
    return [_Pending(tree.document, root, parent, depth, (*callers, tree.id)) for root in roots]


@dataclass(slots=True)
class _Look:
    """What follows from the tag and the attributes of an element alone.

    Attributes:
        ports: The ports of the drawing, see `DiagramNode`.
        texts: The ports and the conditions of the row.
        limits: The minimum and the maximum number of children.
        cards: The cards, by the number of digits of the node's number.
    """

    id: str
    name: str
    type: NodeType
    ports: list[tuple[str, str, str]]
    conditions: dict[str, str]
    about: str
    tree: str
    symbol: str
    texts: list[tuple[str, str]]
    limits: tuple[int, int | None]
    is_disabled: bool
    cards: dict[int, Card] = field(default_factory=dict)


@dataclass(slots=True)
class _ShownNode(DiagramNode):
    """A node of a drawing, with its look."""

    look: _Look = field(kw_only=True)


def _card_of(node: DiagramNode) -> Card:
    """Return the card of a node without the description, which would be half of a drawing."""
    assert isinstance(node, _ShownNode)
    digits, cards = len(str(node.uid)), node.look.cards
    card = cards.get(digits)
    if card is None:
        card = card_of(replace(node, about=""))
        # The page writes the number.
        card = cards[digits] = card._replace(drawing=card.drawing + card.number(""))
    return card


def _diagram_node(reading: TreeReading, item: _Pending, uid: int) -> tuple[_ShownNode, TreeDefinition | None]:
    """Return a node without children, and the tree that it calls, if there is that tree."""
    definitions, element = reading.definitions, item.element
    is_call = element.tag in SUBTREE_TAGS[definitions.format]
    if is_call:
        look = _look_of(reading, element)  # it also follows from the model of the tree
    else:
        looks = _LOOKS.setdefault(reading.nodes, {})
        written = (definitions.format, element.tag, *element.attributes.items())
        known = looks.get(written)
        if known is None:
            if len(looks) >= MAX_ROWS:
                looks.clear()
            known = looks[written] = _look_of(reading, element)
        look = known
    node = _ShownNode(
        uid,
        look.id,
        look.name,
        look.type,
        look.ports,
        look.conditions,
        look.about,
        look.tree,
        look.symbol,
        origin=(item.document, element),
        look=look,
    )
    return node, definitions.by_id.get(look.tree) if is_call else None


def _look_of(reading: TreeReading, element: Element) -> _Look:
    definitions = reading.definitions
    format = definitions.format
    tag, attributes = element.tag, element.attributes
    is_call = tag in SUBTREE_TAGS[definitions.format]
    id = (attributes.get("ID") or tag) if tag in EXPLICIT_TAGS else tag
    manifest = reading.nodes.get(id, format)
    name, called = attributes.get("name"), ""
    if is_call:
        called = attributes.get("ID") or ""
        call = SubtreeCall(element, format, definitions.subtree_models.get(called, {}))
        ports = [(port, text, "") for port, text in call.port_texts.items()]
        if format == 3:  # which ignores the name of a call
            name = called
    else:
        known = manifest.ports if manifest is not None else {}
        ports = [
            (port.name, text, "script" if port.role in SCRIPT_ROLES else port.direction.value)
            for attribute, text in attributes.items()
            if (port := known.get(attribute)) is not None
        ]
    node_type = manifest.type if manifest is not None else NodeType.UNDEFINED
    conditions: dict[str, str] = {}
    if definitions.format == 4:
        conditions = {key: attributes[key] for key in SCRIPT_ATTRIBUTES if key in attributes}
    return _Look(
        id,
        name or called or id,
        NodeType.SUBTREE if is_call else node_type,
        ports,
        conditions,
        manifest.description if manifest is not None else "",
        called,
        manifest.spec.symbol if manifest is not None else "",
        [*((name, text) for name, text, _ in ports), *conditions.items()],
        child_limits(reading, tag, id),
        is_disabled(conditions.get("_skipIf")),
    )


def _row(
    reading: TreeReading,
    node: DiagramNode,
    parent: int,
    key: str,
    is_leaf: bool,
    card: DrawnCard | None = None,
) -> DrawnNode:
    assert isinstance(node, _ShownNode)
    assert node.origin is not None
    document, element = node.origin
    look, source, scanned = node.look, reading.files[document], document.source_map.scanned(element)
    return DrawnNode(
        key,
        parent,
        look.id,
        look.name,
        node_kind(look.type),
        look.tree,
        look.texts,
        Place(source.uri, source.position(scanned.start)),
        source.position(scanned.end),
        node.hidden,
        is_leaf,
        look.is_disabled,
        look.limits,
        *((card.x, card.y, card.width, card.height, card.svg, card.edge) if card is not None else ()),
    )
