"""The operations on trees."""

from btcore.diagnostic_codes import UNDETERMINED_MAIN_TREE
from btcore.suggestions import did_you_mean
from btcore.xml.edit.editor import EditError, escape_value
from btcore_studio.edit.subtrees import extract_subtree, inline_subtree
from btcore_studio.language.edit_drafts import Draft, Rules, Target
from btcore_studio.language.project import Project
from btcore_studio.language.project_symbols import symbols_of


def extract(node: Target, id: str) -> None:
    """Make a tree of a node, and call the tree there."""
    reading = node.draft.reading
    edits = extract_subtree(reading.plans, reading.parsed(node.element), id)
    node.draft.apply_and_select(edits, edits[0])


def inline(node: Target) -> None:
    """Replace the call of a tree by the tree."""
    draft = node.draft
    edit = inline_subtree(draft.reading.plans, draft.reading.parsed(node.element))
    draft.apply_and_select([edit], edit)


def add_tree(draft: Draft, id: str) -> None:
    """Add a tree."""
    if id in draft.reading.definitions.by_id:
        raise EditError(f"there is a tree '{id}' already")
    xml = f'<BehaviorTree ID="{escape_value(id)}"/>'
    draft.insert(draft.root, draft.index_of_new_tree, xml)
    draft.name_main_tree(2)


def remove_tree(project: Project, draft: Draft, id: str) -> Rules:
    """Remove a tree that no other tree calls."""
    trees = [tree for tree in draft.root.children if tree.tag == "BehaviorTree"]
    tree = next((tree for tree in trees if tree.get("ID") == id), None)
    if tree is None:
        raise EditError(f"there is no tree '{id}' in this document")
    callers = [caller for caller in _callers(project, draft, id) if caller != id]
    if callers:
        raise EditError(f"the tree '{callers[0]}' calls '{id}': remove the call first, or inline it")
    edits = [draft.editor.remove(tree)]
    if draft.root.get("main_tree_to_execute") == id:
        if len(trees) > 1:
            raise EditError(f"'{id}' is the main tree: choose another main tree first")
        edits.append(draft.editor.remove_attribute(draft.root, "main_tree_to_execute"))
    draft.apply(edits)
    return Rules(tolerated=frozenset({UNDETERMINED_MAIN_TREE}))


def set_main_tree(draft: Draft, id: str) -> None:
    """Choose the main tree."""
    known = draft.reading.definitions.by_id
    if id not in known:
        raise EditError(f"there is no tree '{id}'{did_you_mean(id, known)}")
    if draft.root.get("main_tree_to_execute") != id:
        draft.apply([draft.editor.set_attribute(draft.root, "main_tree_to_execute", id)])


def _callers(project: Project, draft: Draft, id: str) -> list[str]:
    """Return the trees with a call of a tree, once for each call, in all files of the project."""
    symbols, uri = symbols_of(project), draft.reading.source.uri
    known = (symbols.files.get(file) for file in symbols.files_of_tree(id, uri) | {uri})
    trees = [tree for file in known if file is not None for tree in file.trees]
    return [tree.id for tree in trees for call in tree.calls if call.id == id]
