"""The symbols of all files of a project, and which tree an ID means in which file."""

from collections.abc import Iterable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Final
from weakref import WeakKeyDictionary

from btcore.input_files import real_path
from btcore.registry.registry import Registry
from btcore.xml.plan.tree_plan import SubtreeCall
from btcore.xml.read.read import MAX_INCLUDED_FILES
from btcore.xml.read.scan import ScannedAttribute, ScannedElement
from btcore_studio.language.project import Project, SourceDocument, is_usable_path
from btcore_studio.language.symbols import (
    CallPort,
    FileSymbols,
    ModelElement,
    ScriptNames,
    TreeCall,
    TreeSymbol,
    node_id,
    read_symbols,
    written_format,
)

MAX_KNOWN_SCRIPTS: Final = 100_000
"""Maximum number of scripts whose names are remembered while documents change."""
# A memory of results, which follow from the project alone: symbols are read again when a text changes.
_KNOWN: Final["WeakKeyDictionary[Project, ProjectSymbols]"] = WeakKeyDictionary()


def symbols_of(project: Project) -> "ProjectSymbols":
    """Return the symbols of the files of *project*, with unsaved changes and included files."""
    known = _KNOWN.get(project)
    documents = _with_includes(project)
    if known is None or known.registry is not project.registry or known.documents != documents:
        known = _KNOWN[project] = ProjectSymbols(documents, project.registry, known)
    return known


def included_path(document: SourceDocument, element: ScannedElement) -> Path | None:
    """Return the file that an `<include>` element names, or None if it is in a ROS package or missing."""
    written = element.get("path") or ""
    if not is_usable_path(written):
        return None
    path = Path(written)
    if path.is_absolute():
        return path
    if element.get("ros_pkg") is not None:
        return None
    return (document.path.parent if document.path is not None else Path()) / path


def _with_includes(project: Project) -> dict[str, SourceDocument]:
    """Return the documents of the project and the files that they include, by URI."""
    documents = {document.uri: document for document in project.documents()}
    pending = list(documents.values())
    most = len(pending) + MAX_INCLUDED_FILES
    while pending:
        document = pending.pop()
        for element in _includes(document):
            path = included_path(document, element)
            included = project.file(path) if path is not None and len(documents) < most else None
            # As in the engine, only documents of trees can be included: the path may be that of any file.
            if included is not None and included.uri not in documents and "<root" in included.text:
                documents[included.uri] = included
                pending.append(included)
    return documents


def _includes(document: SourceDocument) -> Iterable[ScannedElement]:
    if "<include" not in document.text:
        return ()
    return [element for element in document.scan.elements if element.tag == "include"]


class ProjectSymbols:
    """The symbols of several documents.

    A document that no other document includes is an entry file: a program loads it with its includes, and
    all their trees can call each other by ID.

    Args:
        earlier: Earlier symbols, whose results are used again for unchanged documents.

    Attributes:
        documents: The documents by URI.
        registry: The known nodes and enums.
        groups: For each entry file its URI, and the URIs of the files that it includes directly or
            indirectly, each before the file that includes it.
    """

    def __init__(
        self,
        documents: dict[str, SourceDocument],
        registry: Registry,
        earlier: "ProjectSymbols | None" = None,
    ) -> None:
        self.documents = documents
        self.registry = registry
        self._scripts: dict[str, ScriptNames] = {}
        if earlier is not None and earlier.registry is registry and len(earlier._scripts) < MAX_KNOWN_SCRIPTS:
            self._scripts = earlier._scripts
        self._files: dict[str, FileSymbols] | None = None
        # The last symbols whose files were read.
        self._earlier: ProjectSymbols | None = earlier
        if earlier is not None and earlier._files is None:
            self._earlier = earlier._earlier
        self.groups: list[list[str]] = self._find_groups()
        self._groups_of: dict[str, list[list[str]]] = {uri: [] for uri in documents}
        for group in self.groups:
            for uri in group:
                self._groups_of[uri].append(group)

    @property
    def files(self) -> dict[str, FileSymbols]:
        """The symbols of each document, by URI. They are read when they are needed."""
        if self._files is None:
            earlier, self._earlier = self._earlier, None
            uris = dict.fromkeys(uri for group in self.groups for uri in group)
            self._files = {uri: self._read(self.documents[uri], self.format_of(uri), earlier) for uri in uris}
        return self._files

    def entry_of(self, file: str) -> str:
        """Return the first entry file that includes *file*; *file* itself if the project does not know it."""
        groups = self._groups_of.get(file)
        return groups[0][-1] if groups else file

    def format_of(self, file: str) -> int:
        """Return the XML format of a document: that of its entry file."""
        return written_format(self.documents[self.entry_of(file)].scan)

    def _read(self, document: SourceDocument, format: int, earlier: "ProjectSymbols | None") -> FileSymbols:
        known = earlier.files.get(document.uri) if earlier is not None else None
        if (
            earlier is not None
            and known is not None
            and known.format == format
            and earlier.registry is self.registry
            and earlier.documents[document.uri] is document
        ):
            return known
        return read_symbols(document.uri, document.scan, format, self.registry, self._scripts)

    def _find_groups(self) -> list[list[str]]:
        by_path = {document.path: uri for uri, document in self.documents.items()}
        includes: dict[str, list[str]] = {}
        included: set[str] = set()
        for uri, document in self.documents.items():
            paths = [included_path(document, element) for element in _includes(document)]
            targets = [by_path.get(real_path(path)) for path in paths if path is not None]
            includes[uri] = [target for target in targets if target is not None and target != uri]
            included.update(includes[uri])
        groups: list[list[str]] = []
        grouped: set[str] = set()
        # Files that include each other have no entry file: any of them is one.
        for uri in [*(uri for uri in self.documents if uri not in included), *self.documents]:
            if uri not in grouped:
                groups.append(_post_order(uri, includes))
                grouped.update(groups[-1])
        return groups

    # --- nodes

    def node_models(self, id: str) -> list[ModelElement]:
        """Return the models of a node in all files."""
        return self._models.get((id, False), [])

    def file_name(self, file: str) -> str:
        """Return the name of a file, or the URI of a document that is not a file."""
        path = self.documents[file].path
        return path.name if path is not None else file

    def place(self, file: str, offset: int) -> str:
        """Return the name of a file and the line of an offset, for messages."""
        return f"{self.file_name(file)}:{self.documents[file].positions.line(offset) + 1}"

    def nodes(self, id: str) -> Iterator[tuple[str, ScannedElement]]:
        """Yield (file, element) for each node with this ID in the trees of all files."""
        for uri, symbols in self.files.items():
            for tree in symbols.trees:
                yield from ((uri, element) for element in tree.nodes if node_id(element) == id)

    # --- trees

    @cached_property
    def trees(self) -> dict[str, list[TreeSymbol]]:
        """The trees of all files by ID."""
        trees_by_id: dict[str, list[TreeSymbol]] = {}
        for symbols in self.files.values():
            for tree in symbols.trees:
                trees_by_id.setdefault(tree.id, []).append(tree)
        return trees_by_id

    @cached_property
    def _models(self) -> dict[tuple[str, bool], list[ModelElement]]:
        models: dict[tuple[str, bool], list[ModelElement]] = {}
        for symbols in self.files.values():
            for model in symbols.models:
                models.setdefault((model.id, model.is_subtree), []).append(model)
        return models

    def visible_files(self, file: str) -> set[str]:
        """Return the files whose trees *file* can call in one of the entry files that include it."""
        return {file, *(uri for group in self._groups_of.get(file, ()) for uri in group)}

    def tree_ids(self, file: str) -> dict[str, bool]:
        """Return the IDs of all trees, and whether *file* can call a tree with this ID."""
        visible = self.visible_files(file)
        return {id: any(tree.file in visible for tree in trees) for id, trees in self.trees.items() if id}

    def trees_called(self, id: str, file: str) -> list[TreeSymbol]:
        """Return the trees that *id* means in *file*.

        There can be several if several entry files include *file*. If no visible file defines the tree, the
        trees of all other files are returned, because a program can load files without an include.
        """
        candidates = self.trees.get(id, []) if id else []
        if len(candidates) < 2:
            return candidates
        visible: list[TreeSymbol] = []
        for group in self._groups_of.get(file, ()):
            order = {uri: index for index, uri in enumerate(group)}
            defined = [tree for tree in candidates if tree.file in order]
            if defined:
                # The last tree with an ID is used in format 4, and the first in format 3.
                wins = max if self.files[group[-1]].format == 4 else min
                best = wins(defined, key=lambda tree: (order[tree.file], tree.element.start))
                if best not in visible:
                    visible.append(best)
        return visible or candidates

    def files_of_tree(self, id: str, file: str) -> set[str]:
        """Return the files in which *id* means the same tree as in *file*, directly or indirectly."""
        naming = {uri for uri, symbols in self.files.items() if _names_tree(symbols, id)}
        defining = {tree.file for tree in self.trees.get(id, ())}
        # Files that name the tree, but see no definition, mean the trees of all other files.
        blind = {uri for uri in naming if not defining & self.visible_files(uri)}
        files: set[str] = set()
        pending = [file]
        while pending:
            uri = pending.pop()
            if uri in files:
                continue
            files.add(uri)
            pending += self.visible_files(uri) & naming
            if uri in blind or uri in defining:
                pending += defining | blind if blind else ()
        return files & naming

    def models(self, id: str, file: str, of_subtree: bool) -> list[ModelElement]:
        """Return the models of a node or a tree: those that *file* sees, else those of all files."""
        candidates = self._models.get((id, of_subtree), [])
        visible = self.visible_files(file)
        return [model for model in candidates if model.file in visible] or candidates

    def connections_of(self, call: TreeCall) -> tuple[SubtreeCall, list[CallPort]]:
        """Return the connected keys of a SubTree element, with the defaults of the tree's model."""
        models = self.models(call.id, call.caller.file, of_subtree=True)
        defaults = {name: port for model in reversed(models) for name, port in model.ports.items()}
        if not defaults:
            return call.connections, list(call.ports.values())
        own = call.connections
        extended = SubtreeCall(own.element, own.format, {name: port.text for name, port in defaults.items()})
        added = [
            CallPort(defaults[name].name, defaults[name].default)
            for name in extended.port_texts
            if name not in own.port_texts
        ]
        return extended, [*call.ports.values(), *added]

    def places_of_tree(self, id: str, file: str) -> Iterator[tuple[str, ScannedAttribute, bool]]:
        """Yield (file, attribute, whether it is a definition) for each attribute that names the tree."""
        files = self.files_of_tree(id, file)
        for uri in self.files:
            if uri in files:
                for attribute, is_definition in _tree_names(self.files[uri]):
                    if attribute.value == id:
                        yield uri, attribute, is_definition


def _post_order(uri: str, includes: dict[str, list[str]]) -> list[str]:
    """Return *uri* and the files that it includes, each before the file that includes it."""
    order: dict[str, None] = {}
    seen: set[str] = set()
    pending = [(uri, False)]
    while pending:
        file, is_done = pending.pop()
        if is_done:
            order[file] = None
        elif file not in seen:
            seen.add(file)
            pending.append((file, True))
            pending += [(target, False) for target in reversed(includes[file])]
    return list(order)


def _tree_names(symbols: FileSymbols) -> Iterator[tuple[ScannedAttribute, bool]]:
    """Yield the attributes that name trees, and whether each defines the tree."""
    if symbols.main_tree is not None:
        yield symbols.main_tree, False
    for tree in symbols.trees:
        for element in (tree.element, *(call.element for call in tree.calls)):
            attribute = element.attribute("ID")
            if attribute is not None:
                yield attribute, element is tree.element
    for model in symbols.models:
        attribute = model.element.attribute("ID")
        if model.is_subtree and attribute is not None:
            yield attribute, False


def _names_tree(symbols: FileSymbols, id: str) -> bool:
    return any(attribute.value == id for attribute, _ in _tree_names(symbols))
