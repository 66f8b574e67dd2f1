"""The operations on nodes."""

import re
from collections.abc import Iterator, Sequence
from typing import Final

from btcore.diagnostic_codes import (
    CONTROL_CHARACTER_IN_NAME,
    INCONVERTIBLE_TEXT,
    MISSING_ID,
    NOT_A_BOOLEAN,
    SCRIPT_SYNTAX,
    UNEXPECTED_ID,
    UNKNOWN_NODE,
    UNKNOWN_PORT,
    UNKNOWN_TREE,
)
from btcore.names import is_port_name
from btcore.suggestions import child_count_text, with_article
from btcore.xml.edit.editor import Edit, EditError
from btcore.xml.models.tree_nodes_model import TAG_OF
from btcore.xml.read.scan import scan
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore_studio.edit.text_edits import offset_after
from btcore_studio.edit.tree_editor import is_disabled
from btcore_studio.language.clipboard import read_clipping
from btcore_studio.language.drawing import child_limits
from btcore_studio.language.edit_drafts import Draft, Drafts, Rules, Target, by_draft, index_in
from btcore_studio.language.element_texts import NewElement, new_element
from btcore_studio.language.studio_protocol import Add, Move, Paste
from btcore_studio.language.symbols import is_call

_OF_TEXTS: Final = frozenset(
    {CONTROL_CHARACTER_IN_NAME, INCONVERTIBLE_TEXT, NOT_A_BOOLEAN, SCRIPT_SYNTAX, UNKNOWN_PORT}
)
"""Errors in texts that a user is writing."""
OF_PASTED_NODES: Final = frozenset({UNKNOWN_NODE, UNKNOWN_TREE, MISSING_ID, UNEXPECTED_ID})
"""Errors of nodes from documents with other node types and trees."""
# XML parsers other than tinyxml2 reject these characters, and no file can contain a lone surrogate.
_FORBIDDEN_CHARACTER: Final = re.compile("[\0-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")
_ATTRIBUTE_NAME: Final = re.compile(r"[^\W\d][\w.:-]*")


def add(drafts: Drafts, command: Add) -> Rules:
    """Add a node."""
    parent = drafts.parent(command.parent)
    _check_room(parent, 1)
    new = new_element(parent.draft.reading, command.id)
    xml = f"<{new.tag}{new.attribute_text}/>"
    parent.draft.insert(parent.element, index_in(parent, command.index), xml)
    return Rules(adds_node=True)


def paste(drafts: Drafts, command: Paste) -> Rules:
    """Insert copied nodes, with the trees and the models that the document lacks."""
    parent = drafts.parent(command.parent)
    draft = parent.draft
    clipping = read_clipping(command.xml)
    _check_room(parent, len(clipping.nodes))
    draft.insert(parent.element, index_in(parent, command.index), "\n".join(clipping.nodes))
    trees, models, notes = clipping.missing_in(draft.reading)
    if trees:
        draft.apply([draft.editor.insert(draft.root, draft.index_of_new_tree, "\n".join(trees))])
        draft.name_main_tree(len(trees) + 1)
    if models:
        draft.insert_models(models)
    return Rules(tolerated=_OF_TEXTS | OF_PASTED_NODES, always_warns=True, notes=notes)


def remove(nodes: Sequence[Target]) -> None:
    """Remove nodes."""
    neighbour = _neighbour(nodes)
    if neighbour is not None:
        neighbour.draft.select([neighbour.element])
    for draft, elements in by_draft(nodes):
        draft.apply([draft.editor.remove(element) for element in elements])


def move(drafts: Drafts, command: Move) -> None:
    """Move nodes to a parent."""
    nodes = drafts.outermost(command.nodes)
    parent = drafts.parent(command.parent)
    for node in nodes:
        if node.element is parent.element or node.element in parent.element.ancestors():
            raise EditError(f"{node.label} cannot be moved into itself")
    siblings = parent.children
    at = min(max(0, command.index), len(siblings))
    moved = [siblings.index(node.element) for node in nodes if node.element in siblings]
    _check_room(parent, len(nodes), len(moved))
    first = moved[0] if moved else 0
    if moved == list(range(first, first + len(nodes))) and first <= at <= first + len(nodes):
        parent.draft.select(node.element for node in nodes)
        return  # the nodes are there already
    xml = "\n".join(node.text for node in nodes)
    draft, start = parent.draft, parent.element.start
    for changed, elements in by_draft(nodes):
        removals = [changed.editor.remove(element) for element in elements]
        if changed is draft:
            start = offset_after(removals, start)
        changed.apply(removals)
    # The new place may begin with a removed node, so the nodes are inserted into the text without them.
    there = draft.element_at(start)
    index = at - sum(position < at for position in moved)
    draft.insert(there, index_in(Target(draft, there), index), xml)


def duplicate(nodes: Sequence[Target]) -> None:
    """Insert copies after the nodes."""
    copies: dict[Draft, list[Edit]] = {}
    for run in _runs(nodes):
        parent = run[-1].parent
        _check_room(parent, len(run))
        index = parent.element.children.index(run[-1].element) + 1
        xml = "\n".join(node.text for node in run)
        copies.setdefault(parent.draft, []).append(parent.draft.editor.insert(parent.element, index, xml))
    for draft, edits in copies.items():
        starts = [offset_after(edits[:number], edit.start) for number, edit in enumerate(edits)]
        draft.apply(edits)
        for start, edit in zip(starts, edits, strict=True):
            draft.selected += [start + root.start for root in scan(edit.text).roots]


def wrap(nodes: Sequence[Target], id: str) -> None:
    """Wrap nodes in a new node."""
    if len(list(_runs(nodes))) != 1:
        raise EditError("only nodes that follow each other in the same parent can be wrapped together")
    draft = nodes[0].draft
    new = new_element(draft.reading, id)
    _check_children(draft, new, id, len(nodes))
    edits = draft.editor.wrap([node.element for node in nodes], new.tag, new.attribute_text)
    draft.apply_and_select(edits, edits[0])


def unwrap(node: Target) -> None:
    """Replace a node by its children."""
    _check_room(node.parent, len(node.children), 1)
    draft = node.draft
    draft.select(node.children)
    draft.apply(draft.editor.unwrap(node.element))


def change_type(node: Target, id: str) -> None:
    """Change the type of a node."""
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


def set_attribute(target: Target, name: str, text: str | None) -> Rules:
    """Set the text of an attribute; None removes the attribute."""
    draft, element = target
    draft.select([element])
    if _ATTRIBUTE_NAME.fullmatch(name) is None:
        raise EditError(f"'{name}' cannot be the name of an attribute: use letters, digits and '_'")
    forbidden = _FORBIDDEN_CHARACTER.search(text or "")
    if forbidden is not None:
        raise EditError(f"the text contains the character U+{ord(forbidden[0]):04X}, which XML forbids")
    if text is not None and text != element.get(name):
        draft.apply([draft.editor.set_attribute(element, name, text)])
    elif text is None and element.attribute(name) is not None:
        draft.apply([draft.editor.remove_attribute(element, name)])
    return Rules(tolerated=_OF_TEXTS)


def toggle(nodes: Sequence[Target], disables: bool) -> None:
    """Disable or enable nodes."""
    changed = [node for node in nodes if is_disabled(node.element.get("_skipIf")) is not disables]
    for draft, elements in by_draft(nodes):
        if draft.reading.definitions.format != 4:
            raise EditError("format 3 has no condition `_skipIf`: convert the document to format 4 first")
        draft.select(elements)
    for draft, elements in by_draft(changed or nodes):
        change = draft.editor.disable if disables else draft.editor.enable
        draft.apply([change(element) for element in elements])


def _check_room(parent: Target, added: int, removed: int = 0) -> None:
    """Refuse more children than a parent may have.

    Args:
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


def _check_children(draft: Draft, new: NewElement, id: str, count: int, way_out: str = "") -> None:
    """Refuse *count* children of a new node.

    Args:
        draft: The document.
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


def _runs(nodes: Sequence[Target]) -> Iterator[list[Target]]:
    """Yield the nodes in groups that follow each other in the same parent."""
    run: list[Target] = []
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


def _neighbour(nodes: Sequence[Target]) -> Target | None:
    """Return the node to select when nodes are removed: the next sibling, the one before, or the parent."""
    removed = {node.element for node in nodes}
    last = nodes[-1]
    siblings = last.parent.children
    at = siblings.index(last.element)
    for sibling in (*siblings[at + 1 :], *reversed(siblings[:at])):
        if sibling not in removed:
            return Target(last.draft, sibling)
    return None if last.parent.is_tree else last.parent
