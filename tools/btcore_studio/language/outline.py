"""The outline of a document, the search for symbols in the whole project, and folding."""

from collections.abc import Iterator
from typing import Final

from lsprotocol.types import (
    DocumentSymbol,
    FoldingRange,
    FoldingRangeKind,
    Location,
    SymbolKind,
    WorkspaceSymbol,
)

from btcore.registry.registry import Registry
from btcore.status import NodeType
from btcore.suggestions import shortened
from btcore.xml.read.scan import ScannedAttribute, ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import ProjectSymbols, symbols_of
from btcore_studio.language.symbols import is_call, node_id, written_format

MAX_OUTLINE_DEPTH: Final = 100
"""Maximum number of levels of an outline. Deeper elements are listed on the last level."""
MAX_FOUND_SYMBOLS: Final = 500
"""Maximum number of symbols that a search returns."""
MAX_LABEL_LENGTH: Final = 200
"""Maximum number of characters of the label or the details of a symbol."""

_KINDS: Final = {
    NodeType.ACTION: SymbolKind.Method,
    NodeType.CONDITION: SymbolKind.Boolean,
    NodeType.CONTROL: SymbolKind.Struct,
    NodeType.DECORATOR: SymbolKind.Operator,
    NodeType.SUBTREE: SymbolKind.Module,
}
_STRUCTURE: Final = {
    "root": SymbolKind.File,
    "include": SymbolKind.File,
    "TreeNodesModel": SymbolKind.Namespace,
    "BehaviorTree": SymbolKind.Class,
}


def find_document_symbols(project: Project, document: SourceDocument) -> list[DocumentSymbol]:
    """Return the outline: the trees with their nodes, the includes and the models."""
    # The other files are not read, because editors request the outline after each change.
    nodes, format = project.registry, written_format(document.scan)
    outline: list[DocumentSymbol] = []
    # For each element the list that gets the symbols of its children, and their level.
    lists: dict[ScannedElement | None, tuple[list[DocumentSymbol], int]] = {None: (outline, 0)}
    for element in document.scan.elements:
        siblings, level = lists[element.parent]
        if element.tag == "root":
            lists[element] = (siblings, level)
            continue
        symbol = _document_symbol(nodes, format, document, element)
        siblings.append(symbol)
        children: list[DocumentSymbol] = []
        symbol.children = children
        lists[element] = (children, level + 1) if level + 1 < MAX_OUTLINE_DEPTH else (siblings, level)
    return outline


def find_workspace_symbols(project: Project, query: str) -> list[WorkspaceSymbol]:
    """Return the trees, models and named nodes whose names contain the characters of *query* in their order.

    Names that begin with *query* come first, then names that contain *query*. Upper and lower case are equal.

    Args:
        query: What the user types; "" finds everything.
    """
    folded_query = query.casefold()
    ranked: list[tuple[int, int, WorkspaceSymbol]] = []
    symbols = symbols_of(project)
    for uri in symbols.files:
        for name, kind, container, attribute in _names(symbols, uri):
            rank = _rank(name.casefold(), folded_query)
            if rank is not None:
                place = symbols.documents[uri].positions.range(attribute.value_start, attribute.value_end)
                symbol = WorkspaceSymbol(
                    location=Location(uri, place), name=_label(name), kind=kind, container_name=container
                )
                ranked.append((rank, len(ranked), symbol))
    return [symbol for *_, symbol in sorted(ranked, key=lambda item: item[:2])[:MAX_FOUND_SYMBOLS]]


def find_folding_ranges(project: Project, document: SourceDocument) -> list[FoldingRange]:
    """Return the ranges of lines that an editor can fold: elements, comments and groups of includes."""
    line = document.positions.line
    ranges: list[FoldingRange] = []
    includes: list[ScannedElement] = []
    for element in document.scan.elements:
        # The line of the end tag stays visible.
        last = line(element.end_tag_start) - 1 if element.end_tag_start >= 0 else line(element.end)
        if line(element.start) < last:
            ranges.append(FoldingRange(line(element.start), last))
        if element.tag == "include" and (not includes or includes[-1].parent is element.parent):
            includes.append(element)
    if includes and line(includes[0].start) < line(includes[-1].end):
        first, last = line(includes[0].start), line(includes[-1].end)
        ranges.append(FoldingRange(first, last, kind=FoldingRangeKind.Imports))
    for start, end in document.scan.comments:
        if line(start) < line(end):
            ranges.append(FoldingRange(line(start), line(end), kind=FoldingRangeKind.Comment))
    return ranges


def _document_symbol(
    nodes: Registry, format: int, document: SourceDocument, element: ScannedElement
) -> DocumentSymbol:
    element_range = document.positions.range(element.start, element.end)
    attribute = element.attribute("name") or element.attribute("ID")
    start, end = element.tag_start, element.tag_end
    if attribute is not None and attribute.value:
        start, end = attribute.value_start, attribute.value_end
    label, detail = _description(element)
    return DocumentSymbol(
        name=_label(label) or element.tag,
        kind=_kind(nodes, format, element),
        range=element_range,
        selection_range=document.positions.range(start, end),
        detail=_label(detail),
    )


def _description(element: ScannedElement) -> tuple[str, str]:
    """Return the label of an element and further details."""
    id, name = element.get("ID") or "", element.get("name") or ""
    if element.tag == "include":
        return element.get("path") or "", "include"
    if is_call(element):
        return name or id, f"SubTree {id}" if name else "SubTree"
    if element.tag in _STRUCTURE:
        return id, ""
    own = node_id(element) or element.tag
    ports = [
        f'{attribute.name}="{attribute.value}"'
        for attribute in element.attributes
        if attribute.value is not None and attribute.name not in ("ID", "name")
    ]
    details = [own, *ports] if name else ports
    return name or own, " ".join(details)


def _kind(nodes: Registry, format: int, element: ScannedElement) -> SymbolKind:
    if element.tag in _STRUCTURE:
        return _STRUCTURE[element.tag]
    if is_call(element):
        return SymbolKind.Module
    manifest = nodes.get(node_id(element), format)
    node_type = manifest.type if manifest is not None else EXPLICIT_TAGS.get(element.tag)
    # A port or another element of a model, or an unknown node.
    return _KINDS.get(node_type, SymbolKind.Method) if node_type is not None else SymbolKind.Property


def _names(symbols: ProjectSymbols, uri: str) -> Iterator[tuple[str, SymbolKind, str, ScannedAttribute]]:
    """Yield (name, kind, name of the container, place of the name) of each symbol of a file."""
    file = symbols.files[uri]
    nodes, format = symbols.registry, file.format
    name_of_file = symbols.file_name(uri)
    for tree in file.trees:
        attribute = tree.element.attribute("ID")
        if attribute is not None and tree.id:
            yield tree.id, SymbolKind.Class, name_of_file, attribute
        for element in tree.nodes:
            attribute = element.attribute("name")
            if attribute is not None and attribute.value:
                yield attribute.value, _kind(nodes, format, element), tree.id or name_of_file, attribute
    for model in file.models:
        attribute = model.element.attribute("ID")
        if attribute is not None and model.id:
            yield model.id, _kind(nodes, format, model.element), name_of_file, attribute


def _rank(name: str, query: str) -> int | None:
    """Return how well *name* matches: 0 is best, 2 means that only the order matches, None is no match."""
    at = name.find(query)
    if at >= 0:
        return min(at, 1)
    rest = iter(name)
    return 2 if all(character in rest for character in query) else None


def _label(text: str) -> str:
    """Return *text* as one line of limited length."""
    return shortened(" ".join(text.split()), MAX_LABEL_LENGTH)
