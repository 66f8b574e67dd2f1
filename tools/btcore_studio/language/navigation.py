"""Go to the definition of what the cursor is on, and find all places that name it."""

import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Final, NamedTuple

from lsprotocol.types import Location, Position, Range

from btcore.input_files import read_file
from btcore.registry.nodes_without_code import is_mock
from btcore.xml.read.scan import Place, ScannedElement
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore_studio.language.key_links import KeyLinks, TreeKey, links_of
from btcore_studio.language.project import Project, SourceDocument, file_uri
from btcore_studio.language.project_symbols import ProjectSymbols, included_path
from btcore_studio.language.symbols import KeyForm, KeyUse, ModelElement, is_call, node_id

_START_OF_FILE: Final = Range(Position(0, 0), Position(0, 0))


class NamedKey(NamedTuple):
    """The cursor is on a blackboard key: *use* is the place, *keys* are the keys that it names."""

    use: KeyUse
    keys: list[TreeKey]


class NamedTree(NamedTuple):
    """The cursor is on the ID of a tree, from offset *start* to *end*."""

    id: str
    start: int
    end: int


class NamedNode(NamedTuple):
    """The cursor is on the ID of a node, or on the name of its *port*, from offset *start* to *end*."""

    id: str
    start: int
    end: int
    port: str = ""


class NamedFile(NamedTuple):
    """The cursor is on the path of an include."""

    path: Path


def find_definition(project: Project, document: SourceDocument, offset: int) -> list[Location]:
    """Return the places that define what the cursor is on; several if the ID of a tree is ambiguous.

    A key is defined where the trees first write it, else where they first name it. A node is defined by the
    source of its Python leaf, else by its model.
    """
    links = links_of(project)
    symbols = links.symbols
    named = named_at(links, document, offset)
    if isinstance(named, NamedKey):
        first = links.first_use(named.keys)
        return _locations(symbols, [(first.file, first.start, first.end)]) if first is not None else []
    if isinstance(named, NamedTree):
        trees = symbols.trees_called(named.id, document.uri)
        return _locations(symbols, [(tree.file, *_id_span(tree.element)) for tree in trees])
    if isinstance(named, NamedNode):
        return _node_definitions(project, symbols, document, named)
    if isinstance(named, NamedFile):
        file = project.file(named.path)
        return [Location(file.uri, _START_OF_FILE)] if file is not None else []
    return []


def find_references(
    project: Project, document: SourceDocument, offset: int, include_declaration: bool = True
) -> list[Location]:
    """Return the places that name what the cursor is on.

    The places of a key are all places whose entry is the same, across subtrees, remappings and scripts.

    Args:
        document: The document with the cursor.
        offset: The offset of the cursor.
        include_declaration: Whether to include the definition.
    """
    links = links_of(project)
    symbols = links.symbols
    named = named_at(links, document, offset)
    if isinstance(named, NamedKey):
        declaration = None if include_declaration else links.first_use(named.keys)
        uses = [use for use in links.entry_uses(named.keys) if use.form is not KeyForm.DEFAULT]
        return _locations(symbols, [(use.file, use.start, use.end) for use in uses if use is not declaration])
    if isinstance(named, NamedTree):
        return _locations(
            symbols,
            [
                (file, attribute.value_start, attribute.value_end)
                for file, attribute, is_definition in symbols.places_of_tree(named.id, document.uri)
                if include_declaration or not is_definition
            ],
        )
    if isinstance(named, NamedNode):
        places = [(file, *node_span(element)) for file, element in symbols.nodes(named.id)]
        if include_declaration:
            places += [(model.file, *_id_span(model.element)) for model in symbols.node_models(named.id)]
        return _locations(symbols, places)
    return []


def named_at(
    links: KeyLinks, document: SourceDocument, offset: int
) -> NamedKey | NamedTree | NamedNode | NamedFile | None:
    """Return what the cursor is on, or None.

    Args:
        links: The keys of the project.
        document: The document with the cursor.
        offset: The offset of the cursor.
    """
    file = links.symbols.files.get(document.uri)
    if file is None:
        return None
    place = document.scan.element_at(offset)
    if place.element is None:
        return None
    if place.kind in ("attribute", "value"):
        use = file.key_at(offset)
        keys = links.named.get(use, []) if use is not None else []
        if use is not None and keys:
            return NamedKey(use, keys)
    return _named_by(document, place, place.element)


def _named_by(
    document: SourceDocument, place: Place, element: ScannedElement
) -> NamedTree | NamedNode | NamedFile | None:
    """Return the tree, node or file that the cursor is on."""
    attribute = place.attribute
    if place.kind == "tag" or place.kind == "end_tag":
        start, end = element.tag_start, element.tag_end
        if is_call(element):
            return _tree(element, start, end)
        return NamedNode(node_id(element), start, end) if _is_node(element) else None
    if attribute is None:
        return None
    start, end = attribute.value_start, attribute.value_end
    if element.tag == "include" and attribute.name == "path":
        path = included_path(document, element)
        return NamedFile(path) if path is not None else None
    if attribute.name == "main_tree_to_execute" and element.parent is None:
        return NamedTree(attribute.value or "", start, end) if attribute.value else None
    if attribute.name == "ID" and place.kind == "value":
        if is_call(element) or element.tag == "BehaviorTree":
            return _tree(element, start, end)
        return NamedNode(node_id(element), start, end) if element.tag in EXPLICIT_TAGS else None
    if place.kind == "attribute" and _is_node(element) and attribute.name not in ("ID", "name"):
        return NamedNode(node_id(element), attribute.start, attribute.name_end, attribute.name)
    return None


def _tree(element: ScannedElement, start: int, end: int) -> NamedTree | None:
    id = element.get("ID")
    return NamedTree(id, start, end) if id else None


def _is_node(element: ScannedElement) -> bool:
    """Return whether *element* is a node of a tree, and not a call, or a model of a node."""
    if is_call(element) or not node_id(element) or element.tag == "BehaviorTree":
        return False
    tags = {around.tag for around in element.ancestors()}
    return "BehaviorTree" in tags or (element.tag in EXPLICIT_TAGS and "TreeNodesModel" in tags)


# --- definitions of nodes


def _node_definitions(
    project: Project, symbols: ProjectSymbols, document: SourceDocument, named: NamedNode
) -> list[Location]:
    known = project.models.get(named.id)
    if known is not None and known.file.endswith(".py"):
        line = max(0, known.line - 1)
        uri = file_uri(known.file)
        return [Location(uri, Range(Position(line, 0), Position(line, 0)))]
    models = symbols.models(named.id, document.uri, of_subtree=False)
    if models:
        return _locations(symbols, [_model_place(model, named.port) for model in models])
    return _builtin_source(symbols, named.id, symbols.files[document.uri].format)


def _model_place(model: ModelElement, port: str) -> tuple[str, int, int]:
    declared = model.ports.get(port)
    if declared is not None:
        return model.file, declared.name.start, declared.name.end
    return (model.file, *_id_span(model.element))


def _builtin_source(symbols: ProjectSymbols, id: str, format: int) -> list[Location]:
    """Return the place of a built-in node in the source of btcore; nothing if the source is not installed."""
    manifest = symbols.registry.get(id, format)
    module = sys.modules.get(manifest.cls.__module__) if manifest is not None else None
    if manifest is None or is_mock(manifest.cls) or module is None or not module.__file__:
        return []
    # The file of a compiled module is in the same folder as its source.
    file = Path(module.__file__).parent / (module.__name__.rpartition(".")[2] + ".py")
    try:
        source = read_file(file).decode()
    except (OSError, ValueError):
        return []
    match = re.search(rf"^class ({re.escape(manifest.cls.__name__)})\b", source, re.MULTILINE)
    if match is None:
        return []
    start = Position(source.count("\n", 0, match.start()), match.start(1) - match.start())
    end = Position(start.line, start.character + len(match[1]))
    return [Location(file_uri(file), Range(start, end))]


# --- places


def node_span(element: ScannedElement) -> tuple[int, int]:
    """Return the place of a node's ID: its tag, or the attribute `ID` of an explicit tag."""
    return _id_span(element) if element.tag in EXPLICIT_TAGS else (element.tag_start, element.tag_end)


def _id_span(element: ScannedElement) -> tuple[int, int]:
    """Return the place of the value of `ID`, or of the tag if the element has none."""
    attribute = element.attribute("ID")
    if attribute is None or not attribute.value:
        return element.tag_start, element.tag_end
    return attribute.value_start, attribute.value_end


def _locations(symbols: ProjectSymbols, places: Iterable[tuple[str, int, int]]) -> list[Location]:
    """Return the places (file, start, end) as locations, sorted by file and offset."""
    order = {file: index for index, file in enumerate(symbols.documents)}
    unique = sorted(set(places), key=lambda place: (order[place[0]], place[1]))
    return [
        Location(file, symbols.documents[file].positions.range(start, end)) for file, start, end in unique
    ]
