"""Move a branch into a tree of its own, or a called tree into the place of its call. Nothing else changes."""

import re
from collections.abc import Iterable, Iterator, Mapping

from btcore.blackboard.ports import SCRIPT_ROLES, remapped_key
from btcore.names import port_name_error
from btcore.script import lexer
from btcore.xml.edit.editor import DocumentEditor, Edit, EditError, apply_edits, escape_value
from btcore.xml.plan.key_uses import TreeKeys, find_name_uses, port_uses
from btcore.xml.plan.plan import Plans
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.read.element import Element


def extract_subtree(plans: Plans, element: Element, id: str) -> list[Edit]:
    """Make a branch a tree of its own, which a SubTree element calls with all keys that the branch uses.

    Args:
        plans: The plans of every tree of the documents.
        element: The element of the branch.
        id: The ID of the new tree.

    Returns:
        The edits of the document that contains the branch.

    Raises:
        EditError: The format is 3, there is a tree *id*, or a key of the branch is unknown, or cannot be an
            attribute.
    """
    tree, node = _find(plans, element)
    if plans.format != 4:
        raise EditError("in format 3, a SubTree element changes when the nodes of its tree are halted")
    if id in plans.definitions.by_id:
        raise EditError(f"there is a tree '{id}' already")
    connections = "".join(f' {key}="{{{key}}}"' for key in _keys_to_connect(plans, node))
    source = tree.definition.document.source_map
    editor = DocumentEditor(source.scan)
    branch, tree_element = source.scanned(element), source.scanned(tree.definition.element)
    call = Edit(branch.start, branch.end, f'<SubTree ID="{escape_value(id)}"{connections}/>')
    tree_indent, line_break, step = editor.indent(tree_element), editor.line_break, editor.step()
    if tree_indent is None:
        separator, body = "", editor.text[branch.start : branch.end]
    else:
        moved = editor.reindent(branch.start, branch.end, editor.indent(branch) or "", tree_indent + step)
        xml = _edited_part(editor.text, branch.start, branch.end, moved)
        separator = line_break + tree_indent
        body = f"{separator}{step}{xml}{separator}"
    new_tree = f'{separator}<BehaviorTree ID="{escape_value(id)}">{body}</BehaviorTree>'
    edits = [call, Edit(tree_element.end, tree_element.end, new_tree)]
    root = source.scan.roots[0]
    if len(plans.definitions.all) == 1 and root.get("main_tree_to_execute") is None:
        if not tree_element.get("ID"):
            raise EditError("the tree has no ID, and a document with two trees must name the main tree")
        edits.append(editor.set_attribute(root, "main_tree_to_execute", tree_element.get("ID") or ""))
    return edits


def inline_subtree(plans: Plans, element: Element) -> Edit:
    """Put the nodes of a called tree in the place of the SubTree element, with the keys of the calling tree.

    Keys that only the called tree uses get the ID of the tree as a prefix. The called tree remains.

    Args:
        plans: The plans of every tree of the documents.
        element: The SubTree element, in format 4.

    Returns:
        The edit of the document that contains the element.

    Raises:
        EditError: The element does not call a tree of format 4, it sets a key to a constant, both have
            conditions, or a key of the called tree is unknown, or has no place in the calling tree.
    """
    tree, node = _find(plans, element)
    call = node.subtree_call
    if call is None or call.tree_id not in plans.trees or plans.format != 4:
        raise EditError(f"<{element.tag}> does not call a tree of a document in format 4")
    called = plans.trees[call.tree_id]
    if called.root is None:
        raise EditError(f"the tree '{called.id}' has no nodes")
    if node.conditions and called.root.conditions:
        raise EditError(f"the SubTree element and the root of '{called.id}' have conditions")
    tree_keys = TreeKeys(plans)
    names = _names_in_caller(tree_keys, tree, call)
    editor = DocumentEditor(called.definition.document.source_map.scan)
    root_element = called.definition.document.source_map.scanned(called.root.element)
    enums = plans.registry.types.enums
    edits = [
        edit
        for called_node in called.node_plans()
        for edit in _rename_keys(called_node, names, enums, tree_keys, editor, called)
    ]
    for attribute, text in node.conditions.items():
        at = root_element.attributes[-1].end if root_element.attributes else root_element.tag_end
        edits.append(Edit(at, at, f' {attribute}="{escape_value(text)}"'))
    source = tree.definition.document.source_map
    call_element = source.scanned(element)
    call_indent = DocumentEditor(source.scan).indent(call_element)
    if call_indent is not None:
        changed = {(edit.start, edit.end) for edit in edits}
        root_indent = editor.indent(root_element) or ""
        lines = editor.reindent(root_element.start, root_element.end, root_indent, call_indent)
        edits += [edit for edit in lines if (edit.start, edit.end) not in changed]
    nodes = _edited_part(editor.text, root_element.start, root_element.end, edits)
    return Edit(call_element.start, call_element.end, nodes)


def _edited_part(text: str, start: int, end: int, edits: Iterable[Edit]) -> str:
    """Return the part of *text* from *start* to *end* after *edits* inside of it."""
    shifted = (Edit(edit.start - start, edit.end - start, edit.text) for edit in edits)
    return apply_edits(text[start:end], shifted)


def _find(plans: Plans, element: Element) -> tuple[TreePlan, NodePlan]:
    for tree in plans.trees.values():
        for node in tree.node_plans():
            if node.element is element:
                return tree, node
    raise EditError(f"<{element.tag}> is not a known node of a tree")


def _branch(node: NodePlan) -> Iterator[NodePlan]:
    yield node
    for child in node.children:
        yield from _branch(child)


def _keys_to_connect(plans: Plans, branch: NodePlan) -> list[str]:
    """Return the keys that a SubTree element in the place of a branch connects."""
    nodes = [*_branch(branch)]
    keys = TreeKeys(plans).keys_in(nodes)
    if keys is None:
        raise EditError("a node of the branch may use any key, or is unknown")
    calls = [node.subtree_call for node in nodes if node.subtree_call is not None]
    if any(outer.startswith("@") for call in calls for outer in call.remaps.values()):
        raise EditError("a SubTree element of the branch connects a key with a key of the main tree ('@')")
    # A key with "@" is the key of the main tree, in every tree.
    connected = sorted(key for key in keys if not key.startswith("@"))
    for key in connected:
        if error := port_name_error(key):
            raise EditError(f"the key '{key}' cannot be an attribute of a SubTree element: {error}")
    return connected


def _names_in_caller(tree_keys: TreeKeys, tree: TreePlan, call: SubtreeCall) -> dict[str, str]:
    """Return a key of the calling *tree* for each key of the called tree."""
    if any(outer.startswith("@") for outer in call.remaps.values()):
        raise EditError("the SubTree element connects a key with a key of the main tree ('@')")
    if call.constants:
        raise EditError(f"the SubTree element sets '{next(iter(call.constants))}' to a constant")
    inner, outer = tree_keys.keys_of(call.tree_id), tree_keys.keys_of(tree.id)
    if inner is None or outer is None:
        raise EditError("a node of one of the trees may use any key, or is unknown")
    names: dict[str, str] = {}
    for key in sorted(inner):
        outer_key = key if key.startswith("@") else call.outer_key(key)
        names[key] = outer_key or _free_name(call.tree_id, key, outer)
    return names


def _free_name(tree_id: str, key: str, taken: set[str]) -> str:
    """Return a key for an entry that only the called tree uses, and add it to *taken*."""
    name = re.sub(r"\W", "_", f"{tree_id}_{key}")
    while name in taken:
        name += "_"
    taken.add(name)
    return name


def _rename_keys(
    node: NodePlan,
    names: Mapping[str, str],
    enums: Mapping[str, int],
    tree_keys: TreeKeys,
    editor: DocumentEditor,
    tree: TreePlan,
) -> Iterator[Edit]:
    """Yield the edits that give the keys of a node the new *names*."""
    scanned = tree.definition.document.source_map.scanned(node.element)
    texts: dict[str, str] = {}
    for binding in node.bindings:
        port, text = binding.port, binding.text
        key, _ = port_uses(port, text, binding.is_explicit, 4)
        if key is not None and names[key] != key:
            is_braced = remapped_key(text, port.name) is not None
            texts[port.name] = f"{{{names[key]}}}" if is_braced else names[key]
        elif port.role in SCRIPT_ROLES:
            texts[port.name] = _renamed_script(text, enums, names)
    for attribute, text in node.conditions.items():
        texts[attribute] = _renamed_script(text, enums, names)
    call = node.subtree_call
    if call is not None:
        texts |= {
            inner: f"{{{names[outer]}}}" for inner, outer in call.remaps.items() if names[outer] != outer
        }
        if call.autoremap:
            nested = tree_keys.keys_of(call.tree_id) or set()
            for key in sorted(nested - call.remaps.keys()):
                if call.outer_key(key) is not None and names.get(key, key) != key:
                    texts[key] = f"{{{names[key]}}}"
    for name, text in texts.items():
        if node.element.get(name) != text:
            yield editor.set_attribute(scanned, name, text)


def _renamed_script(script: str, enums: Mapping[str, int], names: Mapping[str, str]) -> str:
    for use in sorted(find_name_uses(script, enums), key=lambda use: -use.column):
        new = names[use.name]
        tokens = lexer.tokenize(new)
        if new in enums or tokens[0].type != lexer.NAME or tokens[0].width != len(new):
            raise EditError(f"a script uses the key '{use.name}', and '{new}' is not a name in scripts")
        start = use.column - 1
        script = script[:start] + new + script[start + len(use.name) :]
    return script
