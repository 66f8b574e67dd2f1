"""Compute the edits of the operations of a page, and refuse what the rules of the language forbid.

An operation is refused with a reason and a way out. A document that has errors already stays editable: only
errors that the operation would add are reasons, and a node may lack children while a tree is being built.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cached_property, partial
from typing import Final, NamedTuple
from weakref import WeakKeyDictionary

from msgspec.structs import replace

from btcore.blackboard.ports import Port
from btcore.diagnostic_codes import (
    CONTROL_CHARACTER_IN_NAME,
    FIRST_TICK_REFUSED,
    INCONVERTIBLE_TEXT,
    MISSING_ID,
    MISSING_PORT,
    MISSING_SUBTREE_PORT,
    NOT_A_BOOLEAN,
    SCRIPT_SYNTAX,
    UNDETERMINED_MAIN_TREE,
    UNEXPECTED_ID,
    UNKNOWN_NODE,
    UNKNOWN_PORT,
    UNKNOWN_TREE,
    WRONG_CHILD_COUNT,
    DiagnosticCode,
)
from btcore.diagnostics import Diagnostic
from btcore.names import FORBIDDEN, RESERVED_IDS, is_port_name, port_name_error
from btcore.registry.manifest import Manifest
from btcore.registry.nodes_without_code import is_mock
from btcore.registry.registration_checks import default_value_error
from btcore.suggestions import child_count_text, did_you_mean, with_article
from btcore.xml.edit.editor import Edit, EditError, apply_edits, escape_value
from btcore.xml.models.tree_nodes_model import TAG_OF
from btcore.xml.read.dialect import EXPLICIT_TAGS, PORT_TAGS
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.scan import ScannedElement, scan
from btcore_studio.edit.subtrees import extract_subtree, inline_subtree
from btcore_studio.edit.text_edits import compose_edits, offset_after
from btcore_studio.edit.tree_editor import TreeEditor, is_disabled
from btcore_studio.language.clipboard import copy_elements, read_clipping
from btcore_studio.language.diagnostics import report_of
from btcore_studio.language.drawing import child_limits, draw_document
from btcore_studio.language.element_texts import (
    DIRECTIONS,
    NewElement,
    is_port,
    new_element,
    port_text,
    unindented,
)
from btcore_studio.language.node_models import type_named
from btcore_studio.language.project import Project, SourceDocument
from btcore_studio.language.project_symbols import symbols_of
from btcore_studio.language.rename import XML_NAME, RenameError, rename_node_type
from btcore_studio.language.studio_protocol import (
    Add,
    AddTree,
    AnyCommand,
    ChangeType,
    Disable,
    DrawingParams,
    Duplicate,
    EditResult,
    Enable,
    Extract,
    Inline,
    Move,
    NewWarnings,
    Paste,
    Place,
    Preview,
    Problem,
    Range,
    Remove,
    RemoveModel,
    RemoveTree,
    SetAttribute,
    SetMainTree,
    SetModel,
    TextEdit,
    Unwrap,
    WorkspaceEdit,
    Wrap,
)
from btcore_studio.language.symbols import is_call, node_id
from btcore_studio.language.tree_reading import TreeReading, known_document, read_trees

MAX_NODES: Final = 5_000
"""Maximum number of nodes of an operation."""

MAX_CHECKED: Final = 300
"""Number of elements of a document up to which each operation returns its new warnings: about 10 ms."""
MAX_PREVIEWED: Final = 1_000
"""Number of elements of a document up to which a preview has new warnings: about 50 ms."""
_MAX_WARNINGS: Final = 10
_EMPTY_DOCUMENT: Final = '<root BTCPP_format="4">\n</root>\n'
_FIRST_TREE: Final = "MainTree"
_UNFINISHED: Final = frozenset({WRONG_CHILD_COUNT, FIRST_TICK_REFUSED, MISSING_PORT, MISSING_SUBTREE_PORT})
"""Errors of a tree that is being built."""
_OF_TEXTS: Final = frozenset(
    {CONTROL_CHARACTER_IN_NAME, INCONVERTIBLE_TEXT, NOT_A_BOOLEAN, SCRIPT_SYNTAX, UNKNOWN_PORT}
)
"""Errors in texts that a user is writing."""
_OF_PASTED_NODES: Final = frozenset({UNKNOWN_NODE, UNKNOWN_TREE, MISSING_ID, UNEXPECTED_ID})
# XML parsers other than tinyxml2 reject these characters, and no file can contain a lone surrogate.
_FORBIDDEN_CHARACTER: Final = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_ATTRIBUTE_NAME: Final = re.compile(r"[^\W\d][\w.:-]*")
# The last operations whose warnings may be requested.
_LAST: Final["WeakKeyDictionary[Project, _Operation]"] = WeakKeyDictionary()


class FieldError(EditError):
    """A text in the form of a node type cannot be written.

    Args:
        message: The reason.
        field: "id", or "ports", the index of the port and the name of the member, such as "ports/0/name".
    """

    def __init__(self, message: str, field: str) -> None:
        super().__init__(message)
        self.field = field


def compute_edit(project: Project, command: AnyCommand, drawing: DrawingParams | None = None) -> EditResult:
    """Return the edit of an operation on the documents of a project. The documents remain.

    Args:
        project: The project.
        command: The operation.
        drawing: What to draw after the edit, or None. With a drawing, the result lacks the new warnings:
            `last_warnings` returns them, because the search takes as long as the drawing.

    Raises:
        EditError: The operation cannot be applied; the message is the reason.
    """
    operation = _Operation(project)
    operation.apply(command)
    result = operation.result()
    if drawing is None or [*result.edit.changes] != [drawing.text_document.uri]:
        return replace(result, notes=list(dict.fromkeys([*result.notes, *operation.warnings()])))
    _LAST[project] = operation
    return replace(
        result, drawing=draw_document(project, operation.edited(drawing.text_document.uri), drawing)
    )


def last_warnings(project: Project) -> NewWarnings:
    """Return the new warnings of the last edit that was returned with a drawing."""
    operation = _LAST.pop(project, None)
    return NewWarnings(operation.warnings() if operation is not None else [])


def copy_nodes(project: Project, places: Sequence[Place]) -> str:
    """Return nodes as XML, with the trees and the models that they need.

    Args:
        project: The project.
        places: The nodes. Nodes below other nodes are copied with them.

    Raises:
        EditError: A place is not that of a node.
    """
    nodes = _Operation(project).outermost(places)
    return "".join(copy_elements(draft.reading, elements) for draft, elements in _by_draft(nodes))


def preview_edit(project: Project, command: AnyCommand) -> Preview:
    """Return the problems that an operation would add. The documents remain.

    Args:
        project: The project.
        command: The operation.

    Raises:
        EditError: The operation cannot be applied; the message is the reason.
    """
    operation = _Operation(project)
    operation.apply(command)
    operation.result()
    return Preview(operation.problems(command))


class _Draft:
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


class _Target(NamedTuple):
    """A node or a tree in the present text of a document."""

    draft: _Draft
    element: ScannedElement

    @property
    def children(self) -> list[ScannedElement]:
        """The elements of the nodes in it."""
        return self.element.node_children()

    @property
    def parent(self) -> "_Target":
        """The element around it."""
        assert self.element.parent is not None
        return _Target(self.draft, self.element.parent)

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


class _Operation:
    """Computes one operation."""

    def __init__(self, project: Project) -> None:
        self._project = project
        self._drafts: dict[str, _Draft] = {}
        self._notes: list[str] = []
        self._tolerated: frozenset[DiagnosticCode] = _UNFINISHED
        self._always_warns = False
        self._adds_node = False
        self._is_renaming = False

    def apply(self, command: AnyCommand) -> None:
        """Compute the edits."""
        match command:
            case Add():
                self._add(command)
            case Paste():
                self._paste(command)
            case Move():
                self._move(command)
            case Remove():
                self._remove(self.outermost(command.nodes))
            case Duplicate():
                self._duplicate(self.outermost(command.nodes))
            case Wrap():
                self._wrap(self.outermost(command.nodes), command.id)
            case Unwrap():
                self._unwrap(self._node(command.node))
            case ChangeType():
                self._change_type(self._node(command.node), command.id)
            case SetAttribute():
                self._set(self._element(command.node), command.name, command.text)
            case Disable() | Enable():
                self._toggle(self._nodes(command.nodes), isinstance(command, Disable))
            case Extract():
                self._extract(self._node(command.node), command.id)
            case Inline():
                self._inline(self._node(command.node))
            case AddTree():
                self._add_tree(self._document(command.uri), command.id)
            case RemoveTree():
                self._remove_tree(self._draft(command.uri), command.id)
            case SetMainTree():
                self._set_main_tree(self._draft(command.uri), command.id)
            case SetModel():
                self._set_model(self._document(command.uri), command)
            case RemoveModel():
                self._remove_model(self._draft(command.uri), command.id)

    # --- places

    def _draft(self, uri: str) -> _Draft:
        draft = self._drafts.get(uri)
        if draft is None:
            source = known_document(self._project, uri)
            draft = self._drafts[uri] = _Draft(read_trees(self._project, source))
        return draft

    def _document(self, uri: str) -> _Draft:
        """Return a document with a `<root>`, which an empty document gets."""
        draft = self._draft(uri)
        if not draft.editor.scan.roots:
            if draft.reading.broken:
                raise draft.reading.not_xml_error()
            line_break = "" if draft.text == "" or draft.text.endswith("\n") else "\n"
            at = len(draft.text)
            draft.apply([Edit(at, at, line_break + _EMPTY_DOCUMENT)])
        return draft

    def _element(self, place: Place) -> _Target:
        """Return a node or a tree."""
        draft = self._draft(place.uri)
        return _Target(draft, draft.reading.node_at(place.position))

    def _node(self, place: Place) -> _Target:
        target = self._element(place)
        if target.is_tree:
            raise EditError(f"{target.label} is not a node")
        return target

    def _nodes(self, places: Sequence[Place]) -> list[_Target]:
        """Return nodes in the order of the text, each once: a tree that is called twice is drawn twice."""
        if not places:
            raise EditError("no node is selected")
        if len(places) > MAX_NODES:
            raise EditError(f"more than {MAX_NODES:,} nodes are selected")
        nodes = {node.element: node for node in map(self._node, places)}
        return sorted(nodes.values(), key=lambda node: (node.draft.reading.source.uri, node.element.start))

    def outermost(self, places: Sequence[Place]) -> list[_Target]:
        """Return the nodes that are not below others of them, in the order of the text."""
        nodes = self._nodes(places)
        chosen = {node.element for node in nodes}
        return [node for node in nodes if chosen.isdisjoint(node.element.ancestors())]

    def _parent(self, place: Place) -> _Target:
        """Return the new parent of nodes. A document without trees gets a tree."""
        draft = self._document(place.uri)
        if draft.reading.definitions.all or draft.reading.broken:
            return self._element(place)
        root = draft.root
        tree = draft.editor.insert(root, _index_of_new_tree(root), f'<BehaviorTree ID="{_FIRST_TREE}"/>')
        draft.apply([tree])
        return _Target(draft, draft.found(draft.root.iter("BehaviorTree")))

    # --- rules

    def _check_room(self, parent: _Target, added: int, removed: int = 0) -> None:
        """Refuse more children than a parent may have.

        Args:
            parent: The parent.
            added: The number of new children.
            removed: The number of children that are removed at the same time.
        """
        before = len(parent.children)
        least, most = parent.limits
        if most is None or before - removed + added <= max(most, before):
            return
        label = parent.label
        if parent.is_tree:
            reason = f"{label} has exactly one root: wrap it in a <Sequence> first, and add the node there"
        elif is_call(parent.element):
            reason = f"{label} has no children: open the tree '{parent.id}', and add the node there"
        elif not most:
            node_type = parent.manifest.type.name.lower() if parent.manifest is not None else "leaf"
            way_out = f"add the node beside it, or wrap {label} in a <Sequence> first"
            reason = f"{label} is {with_article(node_type)}, which has no children: {way_out}"
        elif most == 1:
            reason = f"{label} has exactly one child: wrap that in a <Sequence> first, and add the node there"
        else:
            roles = parent.manifest.spec.child_roles if parent.manifest is not None else ""
            count = str(most) if least == most else f"at most {most}"
            reason = f"{label} has {count} children{roles and f' ({roles})'}: wrap some in a <Sequence> first"
        raise EditError(reason)

    # --- nodes

    def _add(self, command: Add) -> None:
        parent = self._parent(command.parent)
        self._check_room(parent, 1)
        self._adds_node = True
        new = new_element(parent.draft.reading, command.id)
        xml = f"<{new.tag}{new.attribute_text}/>"
        parent.draft.insert(parent.element, _index_in(parent, command.index), xml)

    def _paste(self, command: Paste) -> None:
        parent = self._parent(command.parent)
        draft = parent.draft
        clipping = read_clipping(command.xml)
        self._check_room(parent, len(clipping.nodes))
        draft.insert(parent.element, _index_in(parent, command.index), "\n".join(clipping.nodes))
        trees, models, notes = clipping.missing_in(draft.reading)
        if trees:
            root = draft.root
            draft.apply([draft.editor.insert(root, _index_of_new_tree(root), "\n".join(trees))])
            self._name_main_tree(draft, len(trees) + 1)
        if models:
            self._insert_models(draft, models)
        self._notes += notes
        self._always_warns = True
        self._tolerated |= _OF_TEXTS | _OF_PASTED_NODES

    def _remove(self, nodes: Sequence[_Target]) -> None:
        neighbour = _neighbour(nodes)
        if neighbour is not None:
            neighbour.draft.select([neighbour.element])
        for draft, elements in _by_draft(nodes):
            draft.apply([draft.editor.remove(element) for element in elements])

    def _move(self, command: Move) -> None:
        nodes = self.outermost(command.nodes)
        parent = self._parent(command.parent)
        for node in nodes:
            if node.element is parent.element or node.element in parent.element.ancestors():
                raise EditError(f"{node.label} cannot be moved into itself")
        siblings = parent.children
        at = min(max(0, command.index), len(siblings))
        moved = [siblings.index(node.element) for node in nodes if node.element in siblings]
        self._check_room(parent, len(nodes), len(moved))
        first = moved[0] if moved else 0
        if moved == list(range(first, first + len(nodes))) and first <= at <= first + len(nodes):
            parent.draft.select(node.element for node in nodes)
            return  # the nodes are there already
        xml = "\n".join(node.text for node in nodes)
        draft, start = parent.draft, parent.element.start
        for changed, elements in _by_draft(nodes):
            removals = [changed.editor.remove(element) for element in elements]
            if changed is draft:
                start = offset_after(removals, start)
            changed.apply(removals)
        # The new place may begin with a removed node, so the nodes are inserted into the text without them.
        there = draft.element_at(start)
        index = at - sum(position < at for position in moved)
        draft.insert(there, _index_in(_Target(draft, there), index), xml)

    def _duplicate(self, nodes: Sequence[_Target]) -> None:
        copies: dict[_Draft, list[Edit]] = {}
        for run in _runs(nodes):
            parent = run[-1].parent
            self._check_room(parent, len(run))
            index = parent.element.children.index(run[-1].element) + 1
            xml = "\n".join(node.text for node in run)
            copies.setdefault(parent.draft, []).append(parent.draft.editor.insert(parent.element, index, xml))
        for draft, edits in copies.items():
            starts = [offset_after(edits[:number], edit.start) for number, edit in enumerate(edits)]
            draft.apply(edits)
            for start, edit in zip(starts, edits, strict=True):
                draft.selected += [start + root.start for root in scan(edit.text).roots]

    def _wrap(self, nodes: Sequence[_Target], id: str) -> None:
        if len(list(_runs(nodes))) != 1:
            raise EditError("only nodes that follow each other in the same parent can be wrapped together")
        draft = nodes[0].draft
        new = new_element(draft.reading, id)
        _check_children(draft, new, id, len(nodes))
        edits = draft.editor.wrap([node.element for node in nodes], new.tag, new.attribute_text)
        draft.apply_and_select(edits, edits[0])

    def _unwrap(self, node: _Target) -> None:
        self._check_room(node.parent, len(node.children), 1)
        draft = node.draft
        draft.select(node.children)
        draft.apply(draft.editor.unwrap(node.element))

    def _change_type(self, node: _Target, id: str) -> None:
        draft, element = node
        draft.select([element])
        if node.id == id:
            return
        new = new_element(draft.reading, id)
        has = f"move the {child_count_text(len(node.children))} of {node.label} first"
        _check_children(draft, new, id, len(node.children), has)
        editor, start = draft.editor, element.start
        manifest = draft.reading.nodes.get(id, draft.format)
        if new.tag == "SubTree" or manifest is None:
            names = dict.fromkeys(item.name for item in element.attributes)
            edits = [editor.remove_attribute(element, name) for name in names if is_port_name(name)]
            edits += editor.rename_element(element, "SubTree")
        else:
            edits = editor.change_type(element, id, manifest.ports)
            if element.tag in EXPLICIT_TAGS:
                edits += editor.rename_element(element, TAG_OF[manifest.type])
        draft.apply(edits)
        element = draft.element_at(start)
        attributes = {
            name: text
            for name, text in new.attributes.items()
            if (new.tag == "SubTree" if name == "ID" else element.attribute(name) is None)
        }
        draft.apply([draft.editor.set_attribute(element, name, text) for name, text in attributes.items()])

    def _set(self, target: _Target, name: str, text: str | None) -> None:
        draft, element = target
        draft.select([element])
        self._tolerated |= _OF_TEXTS
        if _ATTRIBUTE_NAME.fullmatch(name) is None:
            raise EditError(f"'{name}' cannot be the name of an attribute: use letters, digits and '_'")
        forbidden = _FORBIDDEN_CHARACTER.search(text or "")
        if forbidden is not None:
            raise EditError(f"the text contains the character U+{ord(forbidden[0]):04X}, which XML forbids")
        if text is not None and text != element.get(name):
            draft.apply([draft.editor.set_attribute(element, name, text)])
        elif text is None and element.attribute(name) is not None:
            draft.apply([draft.editor.remove_attribute(element, name)])

    def _toggle(self, nodes: Sequence[_Target], disables: bool) -> None:
        changed = [node for node in nodes if is_disabled(node.element.get("_skipIf")) is not disables]
        for draft, elements in _by_draft(nodes):
            if draft.reading.definitions.format != 4:
                raise EditError("format 3 has no condition `_skipIf`: convert the document to format 4 first")
            draft.select(elements)
        for draft, elements in _by_draft(changed or nodes):
            toggle = draft.editor.disable if disables else draft.editor.enable
            draft.apply([toggle(element) for element in elements])

    # --- trees

    def _extract(self, node: _Target, id: str) -> None:
        reading = node.draft.reading
        edits = extract_subtree(reading.plans, reading.parsed(node.element), id)
        node.draft.apply_and_select(edits, edits[0])

    def _inline(self, node: _Target) -> None:
        draft = node.draft
        edit = inline_subtree(draft.reading.plans, draft.reading.parsed(node.element))
        draft.apply_and_select([edit], edit)

    def _callers(self, draft: _Draft, id: str) -> list[str]:
        """Return the trees with a call of a tree, once for each call, in all files of the project."""
        symbols, uri = symbols_of(self._project), draft.reading.source.uri
        known = (symbols.files.get(file) for file in symbols.files_of_tree(id, uri) | {uri})
        trees = [tree for file in known if file is not None for tree in file.trees]
        return [tree.id for tree in trees for call in tree.calls if call.id == id]

    def _add_tree(self, draft: _Draft, id: str) -> None:
        if id in draft.reading.definitions.by_id:
            raise EditError(f"there is a tree '{id}' already")
        root = draft.root
        xml = f'<BehaviorTree ID="{escape_value(id)}"/>'
        draft.insert(root, _index_of_new_tree(root), xml)
        self._name_main_tree(draft, 2)

    def _name_main_tree(self, draft: _Draft, count: int) -> None:
        """Name the main tree of a document that had one tree, and has *count* trees now."""
        root = draft.root
        own = [tree for tree in root.children if tree.tag == "BehaviorTree"]
        if len(own) != count or count < 2 or root.get("main_tree_to_execute") is not None:
            return
        id = own[0].get("ID") or _FIRST_TREE
        edits = [draft.editor.set_attribute(root, "main_tree_to_execute", id)]
        if not own[0].get("ID"):
            edits.append(draft.editor.set_attribute(own[0], "ID", id))
        draft.apply(edits)

    def _remove_tree(self, draft: _Draft, id: str) -> None:
        trees = [tree for tree in draft.root.children if tree.tag == "BehaviorTree"]
        tree = next((tree for tree in trees if tree.get("ID") == id), None)
        if tree is None:
            raise EditError(f"there is no tree '{id}' in this document")
        callers = [caller for caller in self._callers(draft, id) if caller != id]
        if callers:
            raise EditError(f"the tree '{callers[0]}' calls '{id}': remove the call first, or inline it")
        edits = [draft.editor.remove(tree)]
        if draft.root.get("main_tree_to_execute") == id:
            if len(trees) > 1:
                raise EditError(f"'{id}' is the main tree: choose another main tree first")
            edits.append(draft.editor.remove_attribute(draft.root, "main_tree_to_execute"))
        draft.apply(edits)
        self._tolerated |= {UNDETERMINED_MAIN_TREE}

    def _set_main_tree(self, draft: _Draft, id: str) -> None:
        known = draft.reading.definitions.by_id
        if id not in known:
            raise EditError(f"there is no tree '{id}'{did_you_mean(id, known)}")
        if draft.root.get("main_tree_to_execute") != id:
            draft.apply([draft.editor.set_attribute(draft.root, "main_tree_to_execute", id)])

    # --- models

    def _set_model(self, draft: _Draft, command: SetModel) -> None:
        names = [port.name for port in command.ports]
        for number, port in enumerate(command.ports):
            if port.name in names[:number]:
                raise FieldError(
                    f"two ports have the name '{port.name}': rename one of them", f"ports/{number}/name"
                )
            if error := port_name_error(port.name, draft.format):
                raise FieldError(
                    f"'{port.name}' cannot be the name of a port: {error}", f"ports/{number}/name"
                )
        old = command.before or command.id
        before = next(_models_in(draft, old), None)
        is_name = XML_NAME.fullmatch(command.id) is not None or (before is not None and old == command.id)
        if not is_name or not FORBIDDEN.isdisjoint(command.id) or command.id in RESERVED_IDS:
            way_out = "use letters, digits, '_' and '-', and begin with a letter"
            raise FieldError(f"'{command.id}' cannot be the ID of a node: {way_out}", "id")
        if command.type != "SubTree":
            known = draft.reading.nodes.get(command.id, draft.format)
            if known is not None and not is_mock(known.cls):
                reason = f"the node '{command.id}' has code, which declares its ports: choose another ID"
                raise FieldError(reason, "id")
            self._check_defaults(draft, command, before)
            self._check_removed_ports(old, before, {*names, *command.renamed})
            self._rename_type(old, command)
        before = next(_models_in(draft, command.id), None)
        if before is None:
            self._insert_models(draft, [f'<{command.type} ID="{escape_value(command.id)}"/>'])
        elif before.tag != command.type:
            draft.apply(draft.editor.rename_element(before, command.type))
        self._set_ports(draft, command)

    def _check_defaults(self, draft: _Draft, command: SetModel, before: ScannedElement | None) -> None:
        """Refuse a new default that is not a value of its port's type."""
        nodes = draft.reading.nodes
        directions = {name: direction for direction, name in DIRECTIONS.items()}
        written = before.children if before is not None else []
        for number, port in enumerate(command.ports):
            is_written = any(
                item.get("name") == port.name and is_port(item, port, draft.text) for item in written
            )
            if not port.default or not port.type or is_written:
                continue
            declared = Port(
                port.name or "port", directions[port.direction], type_named(nodes, port.type), port.default
            )
            if error := default_value_error(declared):
                raise FieldError(
                    f"'{port.default}' cannot be the default of the type {port.type}: {error}",
                    f"ports/{number}/default",
                )

    def _check_removed_ports(self, id: str, before: ScannedElement | None, kept: set[str]) -> None:
        """Refuse to remove a port that a tree uses."""
        declared = before.children if before is not None else []
        removed = {child.get("name") or "" for child in declared if child.tag in PORT_TAGS} - kept
        symbols = symbols_of(self._project)
        for uri, element in symbols.nodes(id) if removed else ():
            used = next((item.name for item in element.attributes if item.name in removed), None)
            if used is not None:
                place = symbols.place(uri, element.start)
                raise EditError(
                    f"<{id}> in {place} uses the port '{used}': remove this attribute, or rename the port"
                )

    def _rename_type(self, id: str, command: SetModel) -> None:
        """Rename a node type and its ports in all files."""
        ports = {name: new for name, new in command.renamed.items() if name != new}
        if id == command.id and not ports:
            return
        try:
            changes = rename_node_type(self._project, id, command.id, ports)
        except RenameError as error:
            raise FieldError(str(error), "id") from None
        for uri, edits in changes.items():
            draft = self._draft(uri)
            shift = draft.reading.source.mark_length
            draft.apply([Edit(start - shift, end - shift, text) for start, end, text in edits])
        self._is_renaming = True

    def _remove_model(self, draft: _Draft, id: str) -> None:
        symbols = symbols_of(self._project)
        used = next(symbols.nodes(id), None)
        if used is not None:
            place = symbols.place(used[0], used[1].start)
            raise EditError(f"<{id}> is used in {place}: remove these nodes first, or change their type")
        models = list(_models_in(draft, id))
        if not models:
            raise EditError(f"there is no model of '{id}' in this document")
        draft.apply([draft.editor.remove(model) for model in models])

    def _set_ports(self, draft: _Draft, command: SetModel) -> None:
        """Write the ports of a model. Ports that do not change keep their text."""
        model = draft.found(_models_in(draft, command.id))
        declared = [child for child in model.children if child.tag in PORT_TAGS]
        ports = {child.get("name") or "": child for child in declared}
        wanted = {port.name: port for port in command.ports}
        if [name for name in ports if name in wanted] != [name for name in wanted if name in ports]:
            kept = set()  # their order changes
        else:
            kept = ports.keys() & wanted.keys()
        editor = draft.editor
        edits: list[Edit] = []
        for child in declared:
            name = child.get("name") or ""
            if name not in kept or child is not ports[name]:
                edits.append(editor.remove(child))
            elif not is_port(child, wanted[name], draft.text):
                edits.append(Edit(child.start, child.end, port_text(wanted[name])))
        draft.apply(edits)
        added = [port_text(port) for name, port in wanted.items() if name not in kept]
        if added:
            model = draft.found(_models_in(draft, command.id))
            places = [index for index, child in enumerate(model.children, 1) if child.tag in PORT_TAGS]
            draft.apply([draft.editor.insert(model, places[-1] if places else 0, "\n".join(added))])

    def _insert_models(self, draft: _Draft, models: Sequence[str]) -> None:
        root = draft.root
        if not any(child.tag == "TreeNodesModel" for child in root.children):
            draft.apply([draft.editor.insert(root, len(root.children), "<TreeNodesModel/>")])
        section = draft.found(child for child in draft.root.children if child.tag == "TreeNodesModel")
        draft.apply([draft.editor.insert(section, len(section.children), "\n".join(models))])

    # --- the result

    def edited(self, uri: str) -> SourceDocument:
        """Return a document after the operation."""
        return self._drafts[uri].source

    def result(self) -> EditResult:
        """Return the edits, if they add no error that prevents the operation.

        Raises:
            EditError: The result has an error that the documents have not.
        """
        changes: dict[str, list[TextEdit]] = {}
        selected: list[Place] = []
        for uri, draft in self._drafts.items():
            source, before = draft.source, draft.reading.source
            if source.text != before.text:
                self._check(draft)
                changes[uri] = [
                    TextEdit(Range(before.position(start), before.position(end)), text)
                    for start, end, text in draft.edits
                ]
            for offset in dict.fromkeys(draft.selected):
                selected.append(Place(uri, source.position(offset)))
        return EditResult(WorkspaceEdit(changes), selected, list(dict.fromkeys(self._notes)))

    def _check(self, draft: _Draft) -> None:
        before = draft.reading
        if before.broken:
            if any(edit.end > before.fault for edit in draft.edits):
                raise before.not_xml_error()
            return
        after = read_trees(self._project, draft.source)
        if after.broken:
            raise EditError(f"the result would not be XML ({after.broken})")
        if self._is_renaming:
            return  # the other documents of the project have the old names
        for error in draft.new(after.plans.diagnostics.errors, lambda: before.plans.diagnostics.errors):
            if error.code not in self._tolerated:
                raise EditError(f"{error.message}: {error.hint}" if error.hint else error.message)
            if error.code not in _OF_PASTED_NODES and not self._is_to_be_completed(draft, error):
                self._notes.append(error.message)

    def warnings(self) -> list[str]:
        """Return the warnings that the edits of the operation add. Call `result` first."""
        return [message for draft in self._drafts.values() for message in self._warnings_about(draft)]

    def _warnings_about(self, draft: _Draft) -> Iterator[str]:
        before = draft.reading
        if before.broken or not draft.edits or self._is_renaming:
            return
        after = read_trees(self._project, draft.source)
        if self._always_warns or after.size <= MAX_CHECKED:
            new = draft.new(after.diagnostics.warnings, lambda: before.diagnostics.warnings)
            if before.plans.diagnostics.errors:
                # Not all warnings of a document with errors are known: elsewhere, a warning may be old.
                new = [item for item in new if draft.marks(item)]
            yield from (item.message for item in new[:_MAX_WARNINGS])

    def _is_to_be_completed(self, draft: _Draft, item: Diagnostic) -> bool:
        """Return whether a diagnostic is about the attributes or missing children of a new node."""
        is_missing = bool(item.attributes) or item.code in _UNFINISHED
        return self._adds_node and is_missing and draft.marks(item)

    def problems(self, command: AnyCommand) -> list[Problem]:
        """Return the problems that the edits of the operation add.

        A new node is to be completed, in its form. The text of an attribute keeps the problems that it has.
        """
        attribute = command.name if isinstance(command, SetAttribute) else ""
        problems: dict[str, Problem] = {}
        for draft in self._drafts.values():
            if draft.reading.broken or not draft.edits:
                continue
            after = read_trees(self._project, draft.source)
            is_large = after.size > MAX_PREVIEWED
            found = _found_in(after, is_large)
            new = draft.new(found, partial(_found_in, draft.reading, is_large))
            kept = [item for item in found if attribute in item.attributes and draft.marks(item)]
            shown = [*kept, *(item for item in new if not self._is_to_be_completed(draft, item))]
            reports = [report_of(item) for item in shown[:_MAX_WARNINGS]]
            problems |= {report.message: report.problem() for report in reports}
        return sorted(problems.values(), key=lambda problem: problem.severity)


def _found_in(reading: TreeReading, is_large: bool) -> list[Diagnostic]:
    """Return the errors and warnings about a document; without warnings, if it is large."""
    if is_large:
        return list(reading.plans.diagnostics.errors)
    return [*reading.diagnostics.errors, *reading.diagnostics.warnings]


def _models_in(draft: _Draft, id: str) -> Iterator[ScannedElement]:
    """Yield the elements of the models of a node or a tree."""
    sections = [child for child in draft.root.children if child.tag == "TreeNodesModel"]
    models = (model for section in sections for model in section.children)
    return (model for model in models if model.get("ID") == id)


def _index_in(parent: _Target, index: int) -> int:
    """Return the index among all child elements of the place after *index* nodes."""
    nodes = parent.children
    index = max(0, index)
    return parent.element.children.index(nodes[index]) if index < len(nodes) else len(parent.element.children)


def _index_of_new_tree(root: ScannedElement) -> int:
    """Return the index after the last tree."""
    trees = [index for index, child in enumerate(root.children) if child.tag == "BehaviorTree"]
    includes = [index for index, child in enumerate(root.children) if child.tag == "include"]
    return (trees or includes or [-1])[-1] + 1


def _check_children(draft: _Draft, new: NewElement, id: str, count: int, way_out: str = "") -> None:
    """Refuse *count* children of a new node.

    Args:
        draft: The document.
        new: The node.
        id: The ID of the node, or of the called tree.
        count: The number of its children.
        way_out: What to do instead.
    """
    _, most = child_limits(draft.reading, new.tag, id)
    if most is None or count <= most:
        return
    if new.tag == "SubTree":
        reason = f"the call of the tree '{id}' has no children"
        way_out = way_out or "extract the nodes as a tree instead"
    elif not most:
        reason = f"<{id}> is a leaf, which has no children"
        way_out = way_out or "use a control, such as <Sequence>"
    else:
        reason = f"<{id}> has {'exactly one child' if most == 1 else f'at most {most} children'}"
        way_out = way_out or "wrap the nodes in a <Sequence> first"
    raise EditError(f"{reason}: {way_out}")


def _runs(nodes: Sequence[_Target]) -> Iterator[list[_Target]]:
    """Yield the nodes in groups that follow each other in the same parent."""
    run: list[_Target] = []
    for node in nodes:
        if run and run[-1].element.parent is node.element.parent:
            siblings = node.parent.children
            if siblings.index(node.element) == siblings.index(run[-1].element) + 1:
                run.append(node)
                continue
        if run:
            yield run
        run = [node]
    if run:
        yield run


def _by_draft(nodes: Iterable[_Target]) -> list[tuple[_Draft, list[ScannedElement]]]:
    """Return the elements of the nodes by their document."""
    groups: dict[_Draft, list[ScannedElement]] = {}
    for draft, element in nodes:
        groups.setdefault(draft, []).append(element)
    return list(groups.items())


def _neighbour(nodes: Sequence[_Target]) -> _Target | None:
    """Return the node to select when nodes are removed: the next sibling, the one before, or the parent."""
    removed = {node.element for node in nodes}
    last = nodes[-1]
    siblings = last.parent.children
    at = siblings.index(last.element)
    for sibling in (*siblings[at + 1 :], *reversed(siblings[:at])):
        if sibling not in removed:
            return _Target(last.draft, sibling)
    return None if last.parent.is_tree else last.parent
