"""The documents that an operation changes, and the places in them."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property
from typing import Final, NamedTuple

from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Diagnostic
from btcore.registry.manifest import Manifest
from btcore.xml.edit.editor import Edit, EditError, apply_edits
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.scan import ScannedElement, scan
from btcore_studio.edit.text_edits import compose_edits, offset_after
from btcore_studio.edit.tree_editor import TreeEditor
from btcore_studio.language.drawing import child_limits
from btcore_studio.language.element_texts import unindented
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.studio_protocol import Place
from btcore_studio.language.symbols import is_call, node_id
from btcore_studio.language.tree_reading import TreeReading, known_document, read_trees

MAX_NODES: Final = 5_000
"""Maximum number of nodes of an operation."""

FIRST_TREE: Final = "MainTree"
"""The ID of the first tree of a document."""
_EMPTY_DOCUMENT: Final = '<root BTCPP_format="4">\n</root>\n'


class Rules(NamedTuple):
    """How the result of an operation is checked.

    Attributes:
        tolerated: Errors that the operation may add, besides those of a tree that is being built.
        always_warns: Whether the new warnings of a large document are returned, too.
        adds_node: Whether the operation adds a node, which is to be completed in its form.
        is_renaming: Whether other documents get new names, so that a document cannot be checked alone.
        notes: Messages about what the operation leaves out.
    """

    tolerated: frozenset[DiagnosticCode] = frozenset()
    always_warns: bool = False
    adds_node: bool = False
    is_renaming: bool = False
    notes: Sequence[str] = ()


class Draft:
    """A document, to which an operation applies edits in one or several steps.

    Attributes:
        reading: The document before the operation.
        text: The present text without the byte order mark.
        edits: All edits so far, as edits of the document.
        selected: The offsets of the elements to select, in the present text.
    """

    def __init__(self, reading: TreeReading) -> None:
        self.reading = reading
        self.text = reading.source.text[reading.source.mark_length :]
        self.edits: list[Edit] = []
        self.selected: list[int] = []

    @cached_property
    def editor(self) -> TreeEditor:
        """The editor of the present text."""
        is_read = not self.edits and not self.reading.is_empty
        return TreeEditor(self.reading.document.source_map.scan if is_read else scan(self.text))

    @cached_property
    def lines(self) -> LineIndex:
        """The lines of the present text."""
        return LineIndex(self.text)

    @cached_property
    def source(self) -> SourceDocument:
        """The document after the operation."""
        before = self.reading.source
        if not self.edits:
            return before
        return SourceDocument(before.uri, before.text[: before.mark_length] + self.text)

    def element_at(self, start: int) -> ScannedElement:
        """Return the element that begins at an offset of the present text."""
        return self.found(element for element in self.editor.scan.elements if element.start == start)

    def found(self, elements: Iterable[ScannedElement]) -> ScannedElement:
        """Return the first of some elements, of which there is one unless the text is broken."""
        element = next(iter(elements), None)
        if element is None:
            raise self.reading.not_xml_error()
        return element

    @property
    def root(self) -> ScannedElement:
        """The outermost element."""
        root = next(iter(self.editor.scan.roots), None)
        if root is None or root.tag != "root":
            raise EditError("the outermost element of the document is not <root>")
        return root

    @property
    def format(self) -> int:
        """The XML format."""
        return self.reading.definitions.format

    def marks(self, diagnostic: Diagnostic) -> bool:
        """Return whether a diagnostic about the present text marks the tag of an element to select."""
        at = self._offset_of(diagnostic, self.lines)
        return at is not None and any(
            start <= at < self.element_at(start).start_tag_end for start in self.selected
        )

    def new(
        self, found: Sequence[Diagnostic], before: Callable[[], Sequence[Diagnostic]]
    ) -> list[Diagnostic]:
        """Return the diagnostics about the present text that the document does not have.

        The document has a diagnostic with the same message or at the same place: a message may name a line.

        Args:
            found: The diagnostics about the present text.
            before: Returns those about the document; called only if it is needed.
        """
        earlier = before() if found else ()
        messages = {(item.code, item.message) for item in earlier}
        found = [item for item in found if (item.code, item.message) not in messages]
        if not found:
            return []
        index = LineIndex(self.reading.document.text)
        places: set[tuple[object, ...]] = set()
        for item in earlier:
            at = self._offset_of(item, index)
            if at is None:
                places.add((item.code, item.where))
            elif not any(edit.start <= at < edit.end for edit in self.edits):
                places.add((item.code, offset_after(self.edits, at)))
        return [
            item
            for item in found
            if (item.code, self._offset_of(item, self.lines) or item.where) not in places
        ]

    def _offset_of(self, item: Diagnostic, index: LineIndex) -> int | None:
        """Return the offset of a diagnostic in the text of *index*; None if it is about another file."""
        if item.file != self.reading.document.file or not item.line:
            return None
        return index.offset(item.line, max(1, item.column))

    def apply(self, edits: Sequence[Edit]) -> None:
        """Apply edits of the present text. Elements of the earlier text are invalid afterwards."""
        self.selected = [offset_after(edits, offset) for offset in self.selected]
        self.edits = compose_edits(self.edits, edits)
        self.text = apply_edits(self.text, edits)
        for made in ("editor", "lines", "source"):
            self.__dict__.pop(made, None)

    def apply_and_select(self, edits: Sequence[Edit], made: Edit) -> None:
        """Apply edits, and select the elements that *made*, one of the edits, inserts."""
        start = made.start + sum(len(text) - (end - at) for at, end, text in edits if (at, end) < made[:2])
        self.apply(edits)
        self.selected += [start + root.start for root in scan(made.text).roots]

    def select(self, elements: Iterable[ScannedElement]) -> None:
        """Select elements of the present text, which remain."""
        self.selected += [element.start for element in elements]

    def insert(self, parent: ScannedElement, index: int, xml: str) -> None:
        """Insert elements, and select them."""
        edit = self.editor.insert(parent, index, xml)
        self.apply_and_select([edit], edit)

    @property
    def index_of_new_tree(self) -> int:
        """The index after the last tree among the children of the root."""
        children = self.root.children
        trees = [index for index, child in enumerate(children) if child.tag == "BehaviorTree"]
        includes = [index for index, child in enumerate(children) if child.tag == "include"]
        return (trees or includes or [-1])[-1] + 1

    def name_main_tree(self, count: int) -> None:
        """Name the main tree of a document that had one tree, and has *count* trees now."""
        root = self.root
        own = [tree for tree in root.children if tree.tag == "BehaviorTree"]
        if len(own) != count or count < 2 or root.get("main_tree_to_execute") is not None:
            return
        id = own[0].get("ID") or FIRST_TREE
        edits = [self.editor.set_attribute(root, "main_tree_to_execute", id)]
        if not own[0].get("ID"):
            edits.append(self.editor.set_attribute(own[0], "ID", id))
        self.apply(edits)

    def models(self, id: str) -> Iterator[ScannedElement]:
        """Yield the elements of the models of a node or a tree."""
        sections = [child for child in self.root.children if child.tag == "TreeNodesModel"]
        models = (model for section in sections for model in section.children)
        return (model for model in models if model.get("ID") == id)

    def insert_models(self, models: Sequence[str]) -> None:
        """Insert models after all others."""
        root = self.root
        if not any(child.tag == "TreeNodesModel" for child in root.children):
            self.apply([self.editor.insert(root, len(root.children), "<TreeNodesModel/>")])
        section = self.found(child for child in self.root.children if child.tag == "TreeNodesModel")
        self.apply([self.editor.insert(section, len(section.children), "\n".join(models))])


class Target(NamedTuple):
    """A node or a tree in the present text of a document."""

    draft: Draft
    element: ScannedElement

    @property
    def children(self) -> list[ScannedElement]:
        """The elements of the nodes in it."""
        return self.element.node_children()

    @property
    def parent(self) -> "Target":
        """The element around it."""
        assert self.element.parent is not None
        return Target(self.draft, self.element.parent)

    @property
    def is_tree(self) -> bool:
        """Whether it is a tree."""
        return self.element.tag == "BehaviorTree"

    @property
    def id(self) -> str:
        """The ID of the node type, of the called tree, or of the tree."""
        element = self.element
        return (element.get("ID") or "") if self.is_tree or is_call(element) else node_id(element)

    @property
    def label(self) -> str:
        """The name of the node or of the tree in messages."""
        if self.is_tree:
            return f"the tree '{self.id}'"
        return f'<SubTree ID="{self.id}">' if is_call(self.element) else f"<{self.id}>"

    @property
    def manifest(self) -> Manifest | None:
        """The manifest of the node."""
        return self.draft.reading.nodes.get(node_id(self.element), self.draft.format)

    @property
    def limits(self) -> tuple[int, int | None]:
        """The minimum and the maximum number of children."""
        return (
            (1, 1)
            if self.is_tree
            else child_limits(self.draft.reading, self.element.tag, node_id(self.element))
        )

    @property
    def text(self) -> str:
        """The text of the element, without the indentation of its lines."""
        return unindented(self.draft.editor, self.element)


class Drafts:
    """The documents of one operation.

    Attributes:
        project: The project.
        by_uri: The documents that the operation has read, by URI.
    """

    def __init__(self, project: Project) -> None:
        self.project = project
        self.by_uri: dict[str, Draft] = {}

    def draft(self, uri: str) -> Draft:
        """Return a document."""
        draft = self.by_uri.get(uri)
        if draft is None:
            source = known_document(self.project, uri)
            draft = self.by_uri[uri] = Draft(read_trees(self.project, source))
        return draft

    def document(self, uri: str) -> Draft:
        """Return a document with a `<root>`, which an empty document gets."""
        draft = self.draft(uri)
        if not draft.editor.scan.roots:
            if draft.reading.broken:
                raise draft.reading.not_xml_error()
            line_break = "" if draft.text == "" or draft.text.endswith("\n") else "\n"
            at = len(draft.text)
            draft.apply([Edit(at, at, line_break + _EMPTY_DOCUMENT)])
        return draft

    def element(self, place: Place) -> Target:
        """Return a node or a tree."""
        draft = self.draft(place.uri)
        return Target(draft, draft.reading.node_at(place.position))

    def node(self, place: Place) -> Target:
        """Return a node."""
        target = self.element(place)
        if target.is_tree:
            raise EditError(f"{target.label} is not a node")
        return target

    def nodes(self, places: Sequence[Place]) -> list[Target]:
        """Return nodes in the order of the text, each once: a tree that is called twice is drawn twice."""
        if not places:
            raise EditError("no node is selected")
        if len(places) > MAX_NODES:
            raise EditError(f"more than {MAX_NODES:,} nodes are selected")
        nodes = {node.element: node for node in map(self.node, places)}
        return sorted(nodes.values(), key=lambda node: (node.draft.reading.source.uri, node.element.start))

    def outermost(self, places: Sequence[Place]) -> list[Target]:
        """Return the nodes that are not below others of them, in the order of the text."""
        nodes = self.nodes(places)
        chosen = {node.element for node in nodes}
        return [node for node in nodes if chosen.isdisjoint(node.element.ancestors())]

    def parent(self, place: Place) -> Target:
        """Return the new parent of nodes. A document without trees gets a tree."""
        draft = self.document(place.uri)
        if draft.reading.definitions.all or draft.reading.broken:
            return self.element(place)
        root = draft.root
        tree = draft.editor.insert(root, draft.index_of_new_tree, f'<BehaviorTree ID="{FIRST_TREE}"/>')
        draft.apply([tree])
        return Target(draft, draft.found(draft.root.iter("BehaviorTree")))


def index_in(parent: Target, index: int) -> int:
    """Return the index among all child elements of the place after *index* nodes."""
    nodes = parent.children
    index = max(0, index)
    return parent.element.children.index(nodes[index]) if index < len(nodes) else len(parent.element.children)


def by_draft(nodes: Iterable[Target]) -> list[tuple[Draft, list[ScannedElement]]]:
    """Return the elements of the nodes by their document."""
    groups: dict[Draft, list[ScannedElement]] = {}
    for draft, element in nodes:
        groups.setdefault(draft, []).append(element)
    return list(groups.items())
