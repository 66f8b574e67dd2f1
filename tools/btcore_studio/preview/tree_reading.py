"""Read a tree for the preview: its diagnostics, and a drawing even if its nodes are unknown."""

import contextlib
from collections.abc import Callable, Collection, Iterable
from dataclasses import dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any, Final

from btcore import diagnostic_codes
from btcore.blackboard.ports import Port
from btcore.diagnostics import Diagnostic, shown_diagnostics
from btcore.errors import RegistrationError, TreeError
from btcore.input_files import read_file
from btcore.lint.validate import validate_document
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.xml.define import define, parse_format
from btcore.xml.models.model_file import (
    add_document_models,
    add_explicit_nodes,
    add_mock,
    collect_ports,
)
from btcore.xml.plan.plan import Plans, plan
from btcore.xml.read.dialect import EXPLICIT_TAGS
from btcore.xml.read.document import Document
from btcore.xml.read.read import parse_file, parse_text, read
from btcore_drawing.diagram import DiagramNode, diagram_of_document
from btcore_drawing.folding import fold
from btcore_drawing.node_card import NODE_TYPE_COLOURS
from btcore_drawing.svg import diagram_to_svg
from btcore_studio.language.node_keys import diagram_keys, diagram_nodes

MAX_CARDS: Final = 5_000
"""Maximum number of nodes in a drawing. In a larger tree the deepest levels are folded."""

_DRAWABLE: Final = frozenset(
    {
        diagnostic_codes.UNDETERMINED_MAIN_TREE,
        diagnostic_codes.CONFLICTING_ENTRY_TYPES,
        diagnostic_codes.INCONVERTIBLE_TEXT,
        diagnostic_codes.MISSING_PORT,
        diagnostic_codes.MISSING_SUBTREE_PORT,
        diagnostic_codes.NOT_A_BOOLEAN,
        diagnostic_codes.SCRIPT_SYNTAX,
        diagnostic_codes.UNKNOWN_PORT,
    }
)
"""Errors in attributes of nodes: the nodes and their order are known."""


@dataclass(frozen=True, slots=True)
class TreeFile:
    """The file of a preview, and how to read it.

    Attributes:
        path: The XML file.
        nodes_for: Returns the available nodes for a document.
        tree: The ID of the tree to show; None for the main tree.
        format: The XML format (3 or 4); None for the file's own.
        confined: Whether includes from outside of the file's folder are errors.
    """

    path: Path
    nodes_for: Callable[[Document], Registry]
    tree: str | None = None
    format: int | None = None
    confined: bool = False

    def read(self, text: str | None = None) -> "TreeReading":
        """Read and check the file.

        Args:
            text: The content of the file, if an editor has not saved it; None reads the file.
        """
        if text is not None:
            # A lone surrogate, which no file can contain, becomes "?".
            text = text.encode(errors="replace").decode()
        try:
            if text is None:
                document = parse_file(self.path, confined=self.confined)
            else:
                document = parse_text(text, str(self.path), confined=self.confined)
            nodes = self.nodes_for(document)
            diagnostics = validate_document(document, nodes=nodes, tree=self.tree, format=self.format)
        except TreeError as error:
            return TreeReading(list(error.diagnostics), None, self._content() if text is None else text)
        drawn = nodes.copy()
        sources = read(document, drawn.documents)
        _add_undeclared_nodes(drawn, sources.documents)
        plans = plan(define(sources, self.tree, self.format), drawn)
        is_known = _DRAWABLE.issuperset(error.code for error in plans.diagnostics.errors)
        is_drawable = is_known and bool(plans.definitions.by_id)
        return TreeReading(diagnostics, plans if is_drawable else None, document.text)

    def _content(self) -> str:
        """Return the text of a file that is not valid XML, or "" if it cannot be read."""
        try:
            return read_file(self.path).decode(errors="replace")
        except OSError:
            return ""


@dataclass(frozen=True, slots=True)
class RecordedTree:
    """The tree of a recording, which is shown like a file without errors.

    Attributes:
        path: The file of the recording.
        plans: The plans of the tree.
        tree: None, because the main tree is shown.
    """

    path: Path
    plans: Plans
    tree: None = None

    def read(self, text: str | None = None) -> "TreeReading":
        """Return the recorded tree, whatever the unsaved *text* of an editor."""
        return TreeReading([], self.plans, self.plans.definitions.sources.main_document.text)


@dataclass(frozen=True, slots=True)
class TreeReading:
    """The *diagnostics* and the *text* of a file, and its *plans*: None if the file cannot be drawn."""

    diagnostics: list[Diagnostic]
    plans: Plans | None
    text: str

    def summary(self) -> dict[str, Any]:
        """Return the diagnostics, the IDs of the trees, and the text of a broken file as JSON data."""
        shown, more = shown_diagnostics(self.diagnostics)
        trees = list(self.plans.definitions.by_id) if self.plans is not None else []
        return {
            "diagnostics": [
                {
                    "code": item.code,
                    "severity": item.code.severity,
                    "url": item.code.url,
                    "message": item.message,
                    "file": item.file,
                    "line": item.line,
                    "column": item.column,
                    "hint": item.hint,
                }
                for item in shown
            ],
            "more": more,
            "trees": trees,
            # The text of a file with a drawing comes with the drawing.
            "text": self.text if self.plans is None else None,
        }


def draw(plans: Plans, tree: str | None, folded: Collection[str], styled: bool = False) -> dict[str, Any]:
    """Return a drawing of a tree, its nodes and its source texts as JSON data.

    Args:
        plans: The plans of a document without errors that prevent a drawing.
        tree: The ID of the tree; None or an unknown ID is the main tree, or the first tree.
        folded: The keys of the nodes whose children are hidden.
        styled: Whether the drawing contains its style sheet.
    """
    definitions = plans.definitions
    trees = definitions.by_id
    main_tree = trees.get(tree or "") or definitions.main_tree or next(iter(trees.values()))
    if main_tree is not definitions.main_tree:
        plans = plan(definitions._replace(main_tree=main_tree), plans.registry)
        fatal = [error for error in plans.diagnostics.errors if error.code not in _DRAWABLE]
        if fatal:
            return {"tree": main_tree.id, "error": fatal[0].message}
    root = diagram_of_document(plans)
    nodes = diagram_nodes(root)
    keys = diagram_keys(nodes)
    children = {node.uid: [child.uid for child in node.children] for node, _ in nodes}
    hidden = fold(children, (), MAX_CARDS, {uid for uid, key in keys.items() if key in folded})
    files: dict[str, tuple[int, Document]] = {}
    rows = []
    for node, parent in nodes:
        assert node.origin is not None
        document, element = node.origin
        number, _ = files.setdefault(document.file, (len(files), document))
        place = document.source_map.span(element)
        rows.append(
            {
                "key": keys[node.uid],
                "parent": parent,
                "id": node.id,
                "name": node.name,
                "kind": NODE_TYPE_COLOURS[node.type][0],
                "calls": node.tree,
                "ports": [[name, text] for name, text, _ in node.ports]
                + [[*item] for item in node.conditions.items()],
                "file": number,
                "line": 0 if place is None else place.line,
                "column": 0 if place is None else place.column,
                "last": 0 if place is None else document.source_map.last_line(element),
                "hidden": hidden.get(node.uid, 0),
                "leaf": not node.children,
            }
        )
    return {
        "tree": main_tree.id,
        "file": definitions.sources.main_document.file,
        "svg": diagram_to_svg(_pruned(root, hidden), main_tree.id, plans.dialect.format, styled),
        "nodes": rows,
        "about": {node.id: node.about for node, _ in nodes if node.about},
        "files": [{"name": name, "text": document.text} for name, (_, document) in files.items()],
    }


def _pruned(node: DiagramNode, hidden: dict[int, int]) -> DiagramNode:
    """Return the drawing without the children of nodes in *hidden*."""
    children = [] if node.uid in hidden else [_pruned(child, hidden) for child in node.children]
    return replace(node, children=children, hidden=hidden.get(node.uid, 0))


def _add_undeclared_nodes(nodes: Registry, documents: Iterable[Document]) -> None:
    """Register a mock node for every unknown node of *documents*, so that their trees can be drawn.

    The models and the explicit tags of the documents come first. For any other unknown tag, the number of
    child elements determines the node type.
    """
    documents = list(documents)
    for document in documents:
        with contextlib.suppress(TreeError):
            add_document_models(nodes, document)
    add_explicit_nodes(nodes, documents)
    seen: dict[str, tuple[Document, int, dict[str, Port]]] = {}
    for document in documents:
        format = parse_format(document.root.get("BTCPP_format")) or 4
        for tree in document.root.iterchildren("BehaviorTree"):
            for element in islice(tree.iter(), 1, None):
                id = element.tag
                if id in EXPLICIT_TAGS or nodes.get(id, 3) is not None or nodes.get(id, 4) is not None:
                    continue
                _, children, ports = seen.get(id, (document, 0, {}))
                collect_ports(element, ports, format)
                seen[id] = (document, max(children, len(element.children)), ports)
    node_types = (NodeType.ACTION, NodeType.DECORATOR, NodeType.CONTROL)
    for id, (document, children, ports) in seen.items():
        with contextlib.suppress(RegistrationError):
            add_mock(nodes, id, node_types[min(children, 2)], list(ports.values()), "", document)
