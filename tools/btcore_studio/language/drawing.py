"""Draw a tree of a document, with the places of its nodes and what an editor needs to know about them.

A drawing needs the elements of a tree only, and not that the tree can be loaded: a tree that is being written
may lack children and trees, call itself, and contain unknown nodes. Of a tree without errors, the drawing has
the nodes of the running tree, with the same numbers.
"""

from dataclasses import dataclass
from typing import Final, cast

from btcore.blackboard.ports import SCRIPT_ROLES
from btcore.names import SCRIPT_ATTRIBUTES
from btcore.status import NodeType
from btcore.xml.define import TreeDefinition
from btcore.xml.plan.plan import MAX_DEPTH, TreeSize
from btcore.xml.plan.tree_plan import SubtreeCall
from btcore.xml.read.dialect import EXPLICIT_TAGS
from btcore.xml.read.document import Document
from btcore.xml.read.element import Element
from btcore_drawing.diagram import DiagramNode
from btcore_drawing.folding import fold
from btcore_drawing.svg import diagram_to_svg
from btcore_studio.edit.tree_editor import is_disabled
from btcore_studio.language.node_keys import diagram_keys, diagram_nodes
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import Drawing, DrawingParams, DrawnNode, NodeKind, TreeSummary
from btcore_studio.language.tree_reading import TreeReading, read_trees

MAX_CARDS: Final = 5_000
"""Maximum number of nodes in a drawing. In a larger tree the deepest levels are folded."""
MAX_ROWS: Final = 20_000
"""Maximum number of nodes that are listed. The trees of further calls are left out."""


def draw_document(project: Project, source: SourceDocument, params: DrawingParams) -> Drawing:
    """Return the drawing of a tree of a document.

    Args:
        project: The project.
        source: The document.
        params: The tree, and what to fold.
    """
    reading = read_trees(project, source)
    tree = shown_tree(reading, params.tree)
    id, format = "" if tree is None else tree.id, reading.definitions.dialect.format
    root = None if tree is None else diagram_of_tree(reading, tree)
    if root is None:
        return Drawing(id, format, "", [], {}, tree_summaries(reading), reading.broken)
    nodes = diagram_nodes(root)
    keys = diagram_keys(nodes, params.call)
    children = {node.uid: [child.uid for child in node.children] for node, _ in nodes}
    hidden = fold(children, (), MAX_CARDS, {uid for uid, key in keys.items() if key in params.folded})
    rows = [_row(reading, node, parent, keys[node.uid], hidden.get(node.uid, 0)) for node, parent in nodes]
    for node, _ in nodes:
        if node.uid in hidden:
            node.hidden, node.children = hidden[node.uid], []
    about = {node.id: node.about for node, _ in nodes if node.about}
    if not params.styled:
        for node, _ in nodes:
            node.about = ""  # half of a drawing would be descriptions
    svg = diagram_to_svg(root, id, format, params.styled)
    return Drawing(id, format, svg, rows, about, tree_summaries(reading), reading.broken)


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
    return next((definitions.by_id[id] for id in named if id in definitions.by_id), None)


def tree_summaries(reading: TreeReading) -> list[TreeSummary]:
    """Return the trees of the document, then those of its includes."""
    definitions = reading.definitions
    callers: dict[str, dict[str, None]] = {}
    for tree in definitions.by_id.values():
        for call in tree.element.iter(*definitions.dialect.subtree_tags):
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
    manifest = reading.nodes.get(id, definitions.dialect.format)
    is_guessed = id in reading.missing and tag not in EXPLICIT_TAGS
    if tag in definitions.dialect.subtree_tags:
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


def _diagram_node(
    reading: TreeReading, item: _Pending, uid: int
) -> tuple[DiagramNode, TreeDefinition | None]:
    """Return a node without children, and the tree that it calls, if there is that tree."""
    definitions, element = reading.definitions, item.element
    format = definitions.dialect.format
    tag, attributes = element.tag, element.attributes
    is_call = tag in definitions.dialect.subtree_tags
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
    has_conditions = definitions.dialect.has_conditions
    node_type = manifest.type if manifest is not None else NodeType.UNDEFINED
    node = DiagramNode(
        uid,
        id,
        name or called or id,
        NodeType.SUBTREE if is_call else node_type,
        ports,
        {key: attributes[key] for key in SCRIPT_ATTRIBUTES if key in attributes} if has_conditions else {},
        manifest.description if manifest is not None else "",
        called,
        manifest.spec.symbol if manifest is not None else "",
        origin=(item.document, element),
    )
    return node, definitions.by_id.get(called) if is_call else None


def _row(reading: TreeReading, node: DiagramNode, parent: int, key: str, hidden: int) -> DrawnNode:
    assert node.origin is not None
    document, element = node.origin
    scanned = document.source_map.scanned(element)
    return DrawnNode(
        key,
        parent,
        node.id,
        node.name,
        node_kind(node.type),
        node.tree,
        [*((name, text) for name, text, _ in node.ports), *node.conditions.items()],
        reading.place(document, element),
        reading.position(document, scanned.end),
        hidden,
        not node.children,
        is_disabled(node.conditions.get("_skipIf")),
        child_limits(reading, element.tag, node.id),
    )
