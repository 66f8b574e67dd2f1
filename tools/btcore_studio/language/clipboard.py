"""Copy nodes as XML with the trees and models that they need, and read such XML again.

The text consists of the elements of the nodes, the `<BehaviorTree>` elements of the trees that they call,
and a `<TreeNodesModel>`. A whole document is read, too: the nodes of its main tree are pasted.
"""

from collections.abc import Sequence
from typing import NamedTuple

from btcore.xml.edit.editor import DocumentEditor, EditError
from btcore.xml.read.scan import ScannedElement, scan
from btcore.xml.read.tags import EXPLICIT_TAGS
from btcore_studio.language.element_texts import unindented
from btcore_studio.language.symbols import is_call, node_id
from btcore_studio.language.tree_reading import TreeReading


class Missing(NamedTuple):
    """The trees and the models that a document needs for pasted nodes, and sentences about what it lacks."""

    trees: list[str]
    models: list[str]
    notes: list[str]


class Clipping(NamedTuple):
    """The parts of a copied text, as texts without indentation.

    Attributes:
        nodes: The elements of the nodes.
        trees: The trees by ID.
        models: The models by tag and ID. The tag of models of trees is `SubTree`, that of others "".
        elements: The elements of *nodes*.
        tree_elements: The elements of *trees*.
    """

    nodes: list[str]
    trees: dict[str, str]
    models: dict[tuple[str, str], str]
    elements: list[ScannedElement]
    tree_elements: dict[str, ScannedElement]

    def missing_in(self, reading: TreeReading) -> Missing:
        """Return what a document needs for the nodes, in so far as it does not have that."""
        definitions = reading.definitions
        missing = Missing([], [], [])
        seen: set[tuple[str, str]] = set()
        pending = list(reversed(self.elements))
        while pending:
            element = pending.pop()
            pending += reversed(element.children)
            key = _needed_key(element)
            tag, id = key
            if key in seen or not id:
                continue
            seen.add(key)
            if tag:
                if id in definitions.by_id:
                    continue
                if id in self.trees:
                    missing.trees.append(self.trees[id])
                    pending += reversed(self.tree_elements[id].children)
                else:
                    missing.notes.append(f"there is no tree '{id}'")
                is_known = id in definitions.subtree_models or key not in self.models
            else:
                is_known = reading.knows(id)
                if not is_known and key not in self.models:
                    missing.notes.append(f"the node '{id}' is unknown: write its model, or load its library")
                    continue
            if not is_known:
                missing.models.append(self.models[key])
        return missing


def read_clipping(xml: str) -> Clipping:
    """Return the parts of a copied text.

    Raises:
        EditError: The text contains no nodes.
    """
    scanned = scan(xml)
    editor = DocumentEditor(scanned)
    parts = [part for root in scanned.roots for part in (root.children if root.tag == "root" else [root])]
    trees = {part.get("ID") or "": part for part in parts if part.tag == "BehaviorTree"}
    sections = [part for part in parts if part.tag == "TreeNodesModel"]
    nodes = [part for part in parts if part.tag not in ("BehaviorTree", "TreeNodesModel", "include")]
    if not nodes and trees:
        main = next((name for root in scanned.roots if (name := root.get("main_tree_to_execute"))), "")
        nodes = (trees.get(main) or next(iter(trees.values()))).children
    if not nodes:
        raise EditError('the text contains no node: copy elements, such as <Sleep msec="5"/>')
    return Clipping(
        [unindented(editor, node) for node in nodes],
        {id: unindented(editor, tree) for id, tree in trees.items()},
        {_model_key(model): unindented(editor, model) for section in sections for model in section.children},
        nodes,
        trees,
    )


def _model_key(model: ScannedElement) -> tuple[str, str]:
    return ("" if model.tag in EXPLICIT_TAGS else model.tag, model.get("ID") or "")


def _needed_key(element: ScannedElement) -> tuple[str, str]:
    """Return the key of the model that a node or a call needs, and of the called tree."""
    return ("SubTree", element.get("ID") or "") if is_call(element) else ("", node_id(element))


def copy_elements(reading: TreeReading, elements: Sequence[ScannedElement]) -> str:
    """Return elements of a document as XML, with the trees and the models that they need.

    Args:
        reading: The document.
        elements: The elements of nodes, of which none is in another.
    """
    editors = {document: DocumentEditor(document.source_map.scan) for document in reading.sources.documents}
    models = {
        _model_key(model): unindented(editor, model)
        for editor in editors.values()
        for section in editor.scan.roots[0].children
        if section.tag == "TreeNodesModel"
        for model in section.children
    }
    texts = [unindented(editors[reading.document], element) for element in elements]
    used: dict[tuple[str, str], None] = {}
    pending = list(reversed(elements))
    while pending:
        element = pending.pop()
        pending += reversed(element.children)
        key = _needed_key(element)
        if key in used:
            continue
        used[key] = None
        tree = reading.definitions.by_id.get(key[1]) if key[0] else None
        if tree is not None:
            called = tree.document.source_map.scanned(tree.element)
            texts.append(unindented(editors[tree.document], called))
            pending += reversed(called.children)
    needed = [models[key] for key in used if key in models]
    if needed:
        lines = "\n".join(needed).replace("\n", "\n  ")
        texts.append(f"<TreeNodesModel>\n  {lines}\n</TreeNodesModel>")
    return "\n".join(text.replace("\r\n", "\n") for text in texts) + "\n"
