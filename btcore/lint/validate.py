"""Find all errors and warnings in a document: by planning it, and in a dry run of its trees."""

from collections.abc import Collection
from typing import Final

from btcore.diagnostic_codes import FIRST_TICK_REFUSED, INCONVERTIBLE_TEXT, LOOSE_TEXT, UNDETERMINED_MAIN_TREE
from btcore.diagnostics import Diagnostic
from btcore.engine.node_config import MAX_NODES
from btcore.lint.check_context import CheckContext
from btcore.lint.children import check_child_count, check_reachable_children
from btcore.lint.dry_run import DryRun
from btcore.lint.endless_ticks import EndlessTickCheck
from btcore.lint.entry_types import check_value_types
from btcore.lint.ports import (
    check_ignored_attributes,
    check_literals_of_class,
    check_missing_ports,
    check_port_literals,
)
from btcore.lint.possible_results import ResultAnalysis
from btcore.lint.scripts import check_script_results
from btcore.lint.subtree_calls import check_remappings, check_unused_trees
from btcore.lint.unwritten_keys import check_keys
from btcore.registry.registry import Registry
from btcore.suggestions import shortened
from btcore.xml.define import define
from btcore.xml.plan.key_uses import TreeKeys
from btcore.xml.plan.plan import Plans, paused_garbage_collection, plan, root_trees
from btcore.xml.read.document import CollectedDiagnostics, DiagnosticCollector, Document, sort_diagnostics
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.read import Sources, read
from btcore.xml.read.scan import ScannedElement

# In the order in which the problems of a node are reported.
_NODE_CHECKS: Final = (
    check_child_count,
    check_ignored_attributes,
    check_port_literals,
    check_literals_of_class,
    check_missing_ports,
    check_script_results,
    check_reachable_children,
    check_remappings,
)
# After these errors each tree can still be dry-run: no main tree is selected, or only a tick raises.
_HARMLESS: Final = frozenset({UNDETERMINED_MAIN_TREE, FIRST_TICK_REFUSED})
# In format 3 the tree is built; only the node that reads the text raises.
_HARMLESS_IN_FORMAT_3: Final = _HARMLESS | {INCONVERTIBLE_TEXT}

MAX_REPEATED_NODES: Final = MAX_NODES
"""The maximum number of nodes that are dry-run again, because several uncalled trees call the same trees."""


def validate_document(
    document: Document | Sources,
    *,
    nodes: Registry,
    tree: str | None = None,
    format: int | None = None,
    given: Collection[str] = (),
) -> list[Diagnostic]:
    """Return the errors of *document* and its includes, then the warnings, each sorted by position.

    Errors are the reasons why loading the tree fails (except for errors that only the code of leaves
    can detect), and the reasons why a tick certainly raises (E119, and E202 in format 3). Warnings never
    prevent loading. Every tree in the document is checked, called or not, including its scripts. A document
    with several trees and no main tree is a library, which is valid.

    The time is proportional to the size of the document and of the main tree with all its subtrees. If many
    uncalled trees call the same trees, keys and types of entries are checked only in the first uncalled
    trees, until MAX_REPEATED_NODES is reached.

    Args:
        document: The document, or its sources, if its includes were read before.
        nodes: The registered nodes.
        tree: ID of the tree to load; by default the document's main tree.
        format: 3 or 4, overriding the document's `BTCPP_format`.
        given: Keys that the main tree's blackboard holds before the first tick.
    """
    with paused_garbage_collection():
        sources = document if isinstance(document, Sources) else read(document, nodes.documents)
        plans = plan(define(sources, tree, format), nodes, every_tree=True)
        errors, warnings = validate_plans(plans, tree is not None, given)
    return [*sort_diagnostics(errors), *sort_diagnostics(warnings)]


def validate_plans(
    plans: Plans, is_selected: bool = False, given: Collection[str] = ()
) -> CollectedDiagnostics:
    """Return the errors and warnings of a document, whose plans are those of every tree.

    Args:
        is_selected: Whether the main tree was selected by its ID, so that the document need not name it.
        given: Keys that the main tree's blackboard holds before the first tick.
    """
    found = plans.diagnostics
    definitions, main = plans.definitions, plans.main_tree
    names_main = definitions.sources.main_document.root.get("main_tree_to_execute") is not None
    if not is_selected and definitions.all and not names_main:
        # The document is a library: no main tree is needed.
        errors = tuple(error for error in found.errors if error.code != UNDETERMINED_MAIN_TREE)
        found = found._replace(errors=errors)
    collector = DiagnosticCollector(found)
    roots = [root for root in root_trees(plans.trees, main) if root.id in plans.sizes]
    for root in roots:
        plans.sizes[root.id].ensure_recursion_limit()
    context = CheckContext(
        definitions.sources.main_document, plans, ResultAnalysis(plans), TreeKeys(plans), collector
    )
    for tree in plans.trees.values():
        own_context = context._replace(document=tree.definition.document)
        for node in tree.node_plans():
            for check in _NODE_CHECKS:
                check(node, own_context)
    EndlessTickCheck(context).check(roots)
    for document in definitions.sources.documents:
        _check_loose_text(document, collector)
    if main is not None and names_main and not is_selected:
        check_unused_trees(plans, main, collector)
    harmless = _HARMLESS_IN_FORMAT_3 if plans.format == 3 else _HARMLESS
    if all(error.code in harmless for error in collector.errors):
        nodes_left = MAX_REPEATED_NODES + sum(tree.size for tree in plans.trees.values())
        for root in roots:
            if root is not main:
                nodes_left -= plans.sizes[root.id].nodes
                if nodes_left < 0:
                    break
            # A subtree model declares ports that callers of the tree provide.
            known = {*given, *definitions.subtree_models.get(root.id, ())}
            dry_run = DryRun(plans, root, collector, known)
            check_keys(dry_run)
            check_value_types(dry_run)
    return collector.diagnostics


def _check_loose_text(document: Document, collector: DiagnosticCollector) -> None:
    """Warn about each text between the elements of *document*, in its trees and between them."""
    lines = LineIndex(document.text)
    for start, end, parent in document.source_map.scan.iter_text():
        between = document.text[start:end]
        text = " ".join(between.split())
        if text and _is_of_trees(parent):
            message = f"the text {shortened(text, 40)!r} between the elements of a tree is ignored"
            hint = "pass values to a node in its attributes; write comments as <!-- … -->"
            place = lines.span(start + len(between) - len(between.lstrip()), len(text))
            collector.add(place.diagnostic(LOOSE_TEXT, message, document.file, hint))


def _is_of_trees(parent: ScannedElement | None) -> bool:
    """Return whether a text in *parent* is in a tree or between trees. In a model it is a description."""
    around = [] if parent is None else [parent, *parent.ancestors()]
    tags = [element.tag for element in reversed(around)]
    return tags == ["root"] or tags[1:2] == ["BehaviorTree"]
