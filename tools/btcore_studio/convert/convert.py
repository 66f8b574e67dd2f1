"""Convert a document from format 3 to format 4. Text that needn't change keeps its bytes."""

from collections.abc import Sequence
from typing import NamedTuple

from btcore.diagnostic_codes import (
    FORMAT_SET,
    LAST_TREE_USED,
    MANUAL_STEP,
    NODE_RENAMED,
    NOT_A_ROOT,
    UNDETERMINED_MAIN_TREE,
    UNKNOWN_FORMAT,
)
from btcore.diagnostics import Diagnostic
from btcore.errors import TreeError
from btcore.registry.registry import Registry
from btcore.xml.define import parse_format
from btcore.xml.edit.editor import Edit, apply_edits
from btcore.xml.plan.plan import plan_document
from btcore.xml.read.document import Document, sort_diagnostics
from btcore.xml.read.element import Element
from btcore.xml.read.read import parse_text
from btcore.xml.read.tags import SUBTREE_TAGS
from btcore_studio.convert.changes import ConversionChanges
from btcore_studio.convert.nodes import convert_node
from btcore_studio.convert.subtree import convert_subtree


class Conversion(NamedTuple):
    """A document converted to format 4.

    Attributes:
        text: The converted text.
        edits: The edits of the original text that result in *text*.
        changes: The changes, with their positions in the original document: another spelling with the same
            meaning (codes `C1…`), another meaning (`C2…`), and steps that the user must take (`C3…`).
        remaining: The errors in *text*, except in included files.
    """

    text: str
    edits: Sequence[Edit]
    changes: list[Diagnostic]
    remaining: list[Diagnostic]


def convert(document: Document, registry: Registry) -> Conversion:
    """Convert a document from format 3 to format 4; a document in format 4 is returned unchanged.

    Unknown nodes are converted as far as possible without knowing their ports. Included documents are
    not changed.

    Raises:
        TreeError: The format is unknown, or the outermost element is not `<root>`.
    """
    root = document.root
    if root.tag != "root":
        message = f"the outermost element is <{root.tag}>, not <root>"
        raise TreeError([document.diagnostic(NOT_A_ROOT, message, root)])
    format = parse_format(root.get("BTCPP_format"))
    if format is None:
        message = f"unknown BTCPP_format '{root.get('BTCPP_format')}'"
        raise TreeError([document.diagnostic(UNKNOWN_FORMAT, message, root, attribute="BTCPP_format")])
    if format == 4:
        return Conversion(document.text, (), [], _errors(document, registry))
    changes = ConversionChanges(document, registry)
    _convert_root(changes, root)
    _convert_trees(changes)
    text = apply_edits(document.text, changes.edits)
    remaining = _errors(parse_text(text, document.file), registry)
    return Conversion(text, changes.edits, sort_diagnostics(changes.diagnostics), remaining)


def _convert_root(changes: ConversionChanges, root: Element) -> None:
    if root.get("BTCPP_format") is None:
        changes.insert_attribute(root, "BTCPP_format", "4")
    else:
        changes.set_attribute(root, "BTCPP_format", "4")
    changes.note(FORMAT_SET, 'BTCPP_format is set to "4"', root)
    for models in root.iterchildren("TreeNodesModel"):
        for model in models.iterchildren("SubTreePlus"):
            changes.rename_element(model, "SubTree")
            changes.note(NODE_RENAMED, "the model of a <SubTreePlus> becomes one of a <SubTree>", model)
    for include in root.iterchildren("include"):
        message = "the included file is read in the format of this document: convert it too"
        changes.note(MANUAL_STEP, message, include, "path")


def _convert_trees(changes: ConversionChanges) -> None:
    seen: set[str] = set()
    for tree in changes.document.root.iterchildren("BehaviorTree"):
        id = tree.get("ID") or ""
        if id in seen:
            message = f"duplicate tree '{id}': format 4 uses the last tree, format 3 the first"
            changes.note(LAST_TREE_USED, message, tree, "ID", hint="remove the tree that is not needed")
        seen.add(id)
        # Names of SubTree elements are unique within a tree in format 4.
        names: set[str] = set()
        pending = [(child, tree) for child in reversed(tree.children)]
        while pending:
            element, parent = pending.pop()
            if element.tag == "Root":
                continue
            if element.tag in SUBTREE_TAGS[3]:
                convert_subtree(changes, element, names)
            else:
                convert_node(changes, element, parent)
            pending += [(child, element) for child in reversed(element.children)]


def _errors(document: Document, registry: Registry) -> list[Diagnostic]:
    """Return the errors of *document*."""
    plans = plan_document(document, registry, every_tree=True)
    # Only this file is converted, so its main tree may be in another file.
    return sort_diagnostics(
        [
            error
            for error in plans.diagnostics.errors
            if error.file == document.file and error.code != UNDETERMINED_MAIN_TREE
        ]
    )
