"""Read a document of a project with its includes, as trees that can be drawn and edited despite errors."""

import contextlib
from bisect import bisect_left
from collections.abc import Callable, Iterable, Iterator
from functools import cached_property
from itertools import islice
from pathlib import Path
from typing import Final
from weakref import WeakKeyDictionary

from btcore.blackboard.ports import Port, braced_key
from btcore.diagnostic_codes import DOCUMENT_TOO_LARGE
from btcore.errors import RegistrationError, TreeError
from btcore.lint.validate import validate_plans
from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.xml.define import Definitions, define
from btcore.xml.edit.editor import Edit, EditError, apply_edits
from btcore.xml.models.model_file import (
    add_document_models,
    add_mock,
    collect_ports,
    model_elements,
)
from btcore.xml.plan.plan import Plans, plan
from btcore.xml.read.document import CollectedDiagnostics, Document
from btcore.xml.read.element import Element, encoded
from btcore.xml.read.positions import LineIndex, SourceMap
from btcore.xml.read.read import Sources, parse_text, read
from btcore.xml.read.scan import Scan, ScannedElement, scan
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore_studio.language.node_attributes import is_in_tree
from btcore_studio.language.project import PROJECT_SUFFIX, Project, SourceDocument
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.studio_protocol import Place, Position

_MAX_KNOWN: Final = 4
"""Maximum number of readings of a project that are kept: of the shown text, and of texts after edits."""
_NO_TREES: Final = '<root BTCPP_format="4"/>'
_TYPES_BY_CHILDREN: Final = (NodeType.ACTION, NodeType.DECORATOR, NodeType.CONTROL)
# Memories of results, which follow from the project and the texts alone.
_EXTENDED: Final["WeakKeyDictionary[Registry, dict[tuple[object, ...], Registry]]"] = WeakKeyDictionary()
_KNOWN: Final["WeakKeyDictionary[Project, list[TreeReading]]"] = WeakKeyDictionary()


class TreeReading:
    """The trees of a document and of its includes.

    Attributes:
        source: The document.
        document: The document with its elements. If the text is not XML, they are those of its scan.
        broken: Why the text is not XML, or "".
        is_empty: Whether the text has no elements, except for comments.
        fault: Where the text stops to be XML; its end, if it is XML.
        sources: The document and its includes.
        files: The documents of *sources* with the file or the text from which they come.
        definitions: The trees.
        nodes: The available nodes. Unknown nodes of the trees are mock nodes.
        missing: The IDs of nodes that are known from their elements only, without a model.
    """

    def __init__(self, project: Project, source: SourceDocument) -> None:
        self.source = source
        self.broken, self.fault = "", len(source.text)
        self.is_empty = False
        self.document = self._parse(source)
        self.document.unsaved = project.unsaved
        self._registry = project.registry
        self._given = tuple(braced_key(key) or key for key in project.settings.given)
        self.sources = read(self.document, [*project.registry.documents, *_documents_around(project, source)])
        self._entry_format = self._format_of_entry(project)
        self.definitions = define(self.sources, format=self._entry_format)
        format = self.definitions.format
        self.nodes, self.missing = _nodes_for(project.registry, self.sources, format)
        self.files = {document: self._source_of(project, document) for document in self.sources.documents}
        self._parsed: dict[ScannedElement, Element] = {}

    def _parse(self, source: SourceDocument) -> Document:
        file = str(source.path) if source.path is not None else ""
        # A lone surrogate, which no file can contain, becomes "?".
        text = encoded(source.text).decode()
        try:
            return parse_text(text, file)
        except TreeError as error:
            first = error.diagnostics[0]
        if first.code == DOCUMENT_TOO_LARGE:
            self.broken, self.fault = first.message, 0
            return parse_text(_NO_TREES, file)
        if not source.scan.roots and not _without(source.text, source.scan.opaque).strip("\ufeff \t\r\n"):
            self.is_empty = True
            return parse_text(_NO_TREES, file)
        self.broken = f"line {first.line}: {first.message}" if first.line else first.message
        if first.line:
            self.fault = LineIndex(source.text).offset(first.line, max(1, first.column))
        text = text.replace("\0", "?")
        return _scanned_document(source.scan if text == source.text else scan(text), file)

    def _format_of_entry(self, project: Project) -> int | None:
        """Return the format of the file that includes a document without a format, or None."""
        if self.document.root.get("BTCPP_format") is not None:
            return None
        symbols, uri = symbols_of(project), self.source.uri
        return symbols.format_of(uri) if symbols.entry_of(uri) != uri else None

    def _source_of(self, project: Project, document: Document) -> SourceDocument:
        if document is self.document:
            return self.source
        known = project.file(Path(document.file)) if document.file else None
        return known if known is not None else SourceDocument(document.file, document.text)

    def is_current(self, project: Project) -> bool:
        """Return whether the reading of the same text has the same result."""
        return (
            project.registry is self._registry
            and self.definitions.are_complete
            and self._format_of_entry(project) == self._entry_format
            and all(
                project.file(source.path) is source
                for source in self.files.values()
                if source is not self.source and source.path is not None
            )
        )

    @cached_property
    def plans(self) -> Plans:
        """The plans of every tree."""
        return plan(self.definitions, self.nodes, every_tree=True)

    def plans_of(self, tree: str | None) -> Plans:
        """Return the plans of a tree and of the trees that it calls; None for the main tree."""
        return plan(self.definitions_of(tree), self.nodes)

    def definitions_of(self, tree: str | None) -> Definitions:
        """Return the definitions of a tree and of the trees that it calls; None for the main tree."""
        return define(self.sources, tree, self._entry_format)

    def knows(self, id: str) -> bool:
        """Return whether a node has code or a model."""
        return id not in self.missing and any(self.nodes.get(id, format) is not None for format in (3, 4))

    @property
    def size(self) -> int:
        """The number of elements of the document."""
        return len(self.document.source_map.scan.elements)

    @cached_property
    def diagnostics(self) -> CollectedDiagnostics:
        """The errors and warnings about the document and its includes, as far as the nodes are known."""
        return validate_plans(self.plans, given=self._given)

    def element_at(self, position: Position) -> ScannedElement | None:
        """Return the element of the document that begins at a position, or None."""
        offset = self.source.positions.offset_at(position.line, position.character)
        offset -= self.source.mark_length
        elements = self.document.source_map.scan.elements
        index = bisect_left(elements, offset, key=lambda element: element.start)
        found = elements[index] if index < len(elements) and not self.is_empty else None
        return found if found is not None and found.start == offset else None

    def node_at(self, position: Position) -> ScannedElement:
        """Return the element of the node or of the tree that begins at a position.

        Raises:
            EditError: No node and no tree begins there.
        """
        element = self.element_at(position)
        if element is None or not is_in_tree(element):
            raise no_node_error(position)
        return element

    def not_xml_error(self) -> EditError:
        """Return the error of an operation that needs a text that is XML."""
        return EditError(f"the text is not XML ({self.broken}): correct it first")

    def parsed(self, element: ScannedElement) -> Element:
        """Return an element of the document as the plans know it."""
        if not self._parsed:
            elements = self.document.source_map.scan.elements
            self._parsed = dict(zip(elements, self.document.root.iter(), strict=False))
        return self._parsed[element]

    def place(self, document: Document, element: Element) -> Place:
        """Return the place of an element in one of the documents."""
        source = self.files[document]
        return Place(source.uri, source.position(document.source_map.scanned(element).start))


def no_node_error(position: Position) -> EditError:
    """Return the error of an operation on a node that does not begin at *position*."""
    line = position.line + 1
    return EditError(f"no node begins at this place in line {line}: the text has changed meanwhile")


def known_document(project: Project, uri: str) -> SourceDocument:
    """Return a document of *project*.

    Raises:
        EditError: It is not open, and cannot be read as a file.
    """
    source = project.document(uri)
    if source is None:
        raise EditError(f"{uri} is not open, and cannot be read as a UTF-8 file")
    return source


def read_trees(project: Project, source: SourceDocument) -> TreeReading:
    """Return the reading of a document of *project*, or of its text after an edit.

    Args:
        source: A document; it need not be the present text.
    """
    known = _KNOWN.setdefault(project, [])
    for reading in known:
        own = reading.source
        if own.uri == source.uri and own.text == source.text and reading.is_current(project):
            known.remove(reading)
            break
    else:
        reading = TreeReading(project, source)
    known.insert(0, reading)  # the last used is the first
    del known[_MAX_KNOWN:]
    return reading


def read_xml(project: Project, uri: str) -> TreeReading:
    """Return the trees of a document and of its includes; otherwise as `read_trees`.

    Raises:
        EditError: The document is not known, or its text is not XML.
    """
    reading = read_trees(project, known_document(project, uri))
    if reading.broken:
        raise reading.not_xml_error()
    return reading


def _documents_around(project: Project, source: SourceDocument) -> Iterator[Document]:
    """Yield the projects of Groot that include a document: its trees may call the trees of their files."""
    if source.path is not None:
        for root in project.roots_of(source.path):
            if root != source.path:
                with contextlib.suppress(TreeError):
                    yield project.parse_path(root)


def _scanned_document(scanned: Scan, file: str) -> Document:
    """Return the document of a text that is not XML, with the elements of its scan.

    Offsets are those of the text. Elements before the `<root>` are left out.
    """
    start = next((root.start for root in scanned.roots if root.tag == "root"), -1)
    if start < 0:
        return parse_text(_NO_TREES, file)
    if scanned.roots[0].start != start:
        scanned = scan(" " * start + scanned.text[start:])
    elements: dict[ScannedElement | None, Element] = {}
    for element in scanned.elements:
        elements[element] = made = element.parsed()
        if len(elements) > 1:
            # After an end tag that is too much, the rest of the text belongs to the root.
            elements[element.parent or scanned.roots[0]].children.append(made)
    root = elements[scanned.roots[0]]
    return Document(root, scanned.text, file, source_map=SourceMap(scanned.text, root, scanned))


def _without(text: str, parts: Iterable[tuple[int, int]]) -> str:
    """Return a text without some of its parts."""
    return apply_edits(text, (Edit(start, end, "") for start, end in parts))


def _nodes_for(registry: Registry, sources: Sources, format: int) -> tuple[Registry, frozenset[str]]:
    """Return the nodes for the trees of *sources*, and the IDs of those without code and model.

    Nodes of models follow those of *registry*, then nodes of explicit tags such as `<Action ID="…">`. For any
    other unknown tag, the number of child elements determines the node type.
    """
    documents = sources.documents
    is_project = sources.main_document.file.endswith(PROJECT_SUFFIX)
    with_models = [document for document in documents if model_elements(document)]

    def add_models(nodes: Registry) -> None:
        for document in with_models:
            with contextlib.suppress(TreeError):
                add_document_models(nodes, document, override=is_project)

    models = tuple((document.file, _models_text(document)) for document in with_models)
    modelled = _extended(registry, (is_project, models), add_models)
    seen = _unknown_nodes(modelled, documents, format)

    def add_unknown(nodes: Registry) -> None:
        for id, (document, node_type, ports) in seen.items():
            # No class can have the name of an ID with a NUL character or a lone surrogate.
            with contextlib.suppress(RegistrationError, ValueError):
                add_mock(nodes, id, node_type, list(ports.values()), "", document)

    unknown = tuple(
        (id, document.file, node_type, tuple((port.name, port.direction) for port in ports.values()))
        for id, (document, node_type, ports) in seen.items()
    )
    return _extended(modelled, unknown, add_unknown), frozenset(seen)


def _models_text(document: Document) -> str:
    """Return the text of the models of a document."""
    sections = [
        document.source_map.scanned(section) for section in document.root.iterchildren("TreeNodesModel")
    ]
    return "".join(document.text[section.start : section.end] for section in sections)


def _extended(registry: Registry, key: tuple[object, ...], extend: Callable[[Registry], None]) -> Registry:
    """Return a copy of a registry after *extend*, which depends on *key* alone, or an earlier such copy."""
    if not any(key):
        return registry
    known = _EXTENDED.setdefault(registry, {})
    nodes = known.pop(key, None)
    if nodes is None:
        nodes = registry.copy()
        extend(nodes)
    known[key] = nodes  # the last is the newest
    if len(known) > _MAX_KNOWN:
        del known[next(iter(known))]
    return nodes


def _unknown_nodes(
    nodes: Registry, documents: Iterable[Document], format: int
) -> dict[str, tuple[Document, NodeType, dict[str, Port]]]:
    """Return a document, the type and the ports of each node that only elements of trees name."""
    seen: dict[str, tuple[Document, NodeType, dict[str, Port]]] = {}
    for document in documents:
        for tree in document.root.iterchildren("BehaviorTree"):
            for element in islice(tree.iter(), 1, None):
                tag = element.tag
                explicit = EXPLICIT_TAGS.get(tag)
                id = tag if explicit is None else element.get("ID") or ""
                if not id or nodes.get(id, 3) is not None or nodes.get(id, 4) is not None:
                    continue
                node_type = explicit or _TYPES_BY_CHILDREN[min(len(element.children), 2)]
                _, known, ports = seen.get(id, (document, node_type, {}))
                collect_ports(element, ports, format)
                if explicit is None and known in _TYPES_BY_CHILDREN:
                    node_type = max(known, node_type, key=_TYPES_BY_CHILDREN.index)
                seen[id] = (document, node_type, ports)
    return seen
