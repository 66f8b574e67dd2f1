"""Find all errors and warnings in a document, without building its tree."""

from collections.abc import Collection
from typing import Final

from btcore.diagnostic_codes import (
    AMBIGUOUS_MAIN_TREE,
    FIRST_TICK_REFUSED,
    INCONVERTIBLE_TEXT,
    RECURSIVE_TREES,
    TOO_LARGE,
)
from btcore.errors import Diagnostic
from btcore.registry.registry import Registry
from btcore.tree.tree import MAX_NODES
from btcore.xml.build import pause_gc
from btcore.xml.lint.children import check_child_count, check_reachable_children
from btcore.xml.lint.dry_run import DryRun
from btcore.xml.lint.endless_ticks import EndlessTickCheck
from btcore.xml.lint.entry_types import check_value_types
from btcore.xml.lint.loose_text import check_stray_text
from btcore.xml.lint.ports import (
    check_ignored_attributes,
    check_literals_of_class,
    check_missing_ports,
    check_port_literals,
)
from btcore.xml.lint.possible_results import ResultAnalysis
from btcore.xml.lint.reporter import LintReporter
from btcore.xml.lint.scripts import check_script_results
from btcore.xml.lint.subtree_calls import TreeKeys, check_remappings, check_unused_trees
from btcore.xml.lint.unwritten_keys import check_keys
from btcore.xml.models.tree_nodes_model import subtree_models
from btcore.xml.plan.call_graph import CallGraph
from btcore.xml.plan.document_checks import (
    DocumentAnalysis,
    analyse_document,
    check_scripts,
    nodes_of,
    reachable_plans,
)
from btcore.xml.plan.plan import TreePlanner
from btcore.xml.plan.tree_definitions import TreeDefinition
from btcore.xml.read.diagnostics import DiagnosticCollector, sort_diagnostics
from btcore.xml.read.document import Document

# After these errors each tree can still be dry-run: no main tree is selected, or only a tick raises.
_HARMLESS: Final = frozenset({AMBIGUOUS_MAIN_TREE, FIRST_TICK_REFUSED})
# In format 3 the tree is built; only the node that reads the text raises.
_HARMLESS_IN_FORMAT_3: Final = _HARMLESS | {INCONVERTIBLE_TEXT}
# With these errors, following SubTree calls might not terminate in reasonable time.
_UNBOUNDED: Final = frozenset({RECURSIVE_TREES, TOO_LARGE})

MAX_REPEATED_NODES: Final = MAX_NODES
"""The maximum number of nodes that are dry-run again, because several uncalled trees call the same trees."""


@pause_gc(keeps=False)
def validate_document(
    document: Document,
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
        document: The parsed document.
        nodes: The registered nodes.
        tree: ID of the tree to load; by default the document's main tree.
        format: 3 or 4, overriding the document's `BTCPP_format`.
        given: Keys that the main tree's blackboard holds before the first tick.
    """
    analysis = analyse_document(document, nodes, tree, format)
    planner, main, diagnostics = analysis
    calls = CallGraph(planner, diagnostics)
    used_plans = reachable_plans(planner, main) if main is not None else []
    used = {plan.definition.id for plan in used_plans}
    checked = set(used)
    for definition in planner.definitions.by_id.values():
        if definition.id not in checked:
            calls.is_recursive(definition)
            checked |= {plan.definition.id for plan in reachable_plans(planner, definition, checked)}
        check_scripts(planner.plan(definition), nodes, diagnostics)
    names_main = document.root.get("main_tree_to_execute") is not None
    if tree is None and planner.definitions.all and not names_main:
        # The document is a library: no main tree is needed.
        diagnostics.errors = [error for error in diagnostics.errors if error.code != AMBIGUOUS_MAIN_TREE]
    roots = [root for root in _roots(analysis, used) if _is_bounded(calls, root)]
    models = subtree_models(planner.definitions.documents, planner.dialect, DiagnosticCollector())
    reporter = LintReporter(diagnostics)
    results = _check_nodes(planner, nodes.types.enums, models, reporter)
    EndlessTickCheck(planner, results, reporter).check(roots)
    for parsed in planner.definitions.documents:
        check_stray_text(parsed, diagnostics)
    if main is not None and names_main and tree is None:
        check_unused_trees(planner, main, used, reporter)
    harmless = _HARMLESS_IN_FORMAT_3 if planner.dialect.format == 3 else _HARMLESS
    if all(error.code in harmless for error in diagnostics.errors):
        trees = planner.definitions.by_id.values()
        room = MAX_REPEATED_NODES + sum(planner.plan(tree).size for tree in trees)
        for root in roots:
            if root is not main:
                room -= calls.size_of(root)
                if room < 0:
                    break
            dry_run = DryRun(planner, root, nodes)
            for error in dry_run.run().errors:
                diagnostics.add(error)
            # A subtree model declares ports that callers of the tree provide.
            known = {*given, *models.get(root.id, ())}
            check_keys(dry_run, root is main, known, reporter)
            check_value_types(dry_run, root is main, known, nodes.types.enums, reporter)
    return [*sort_diagnostics(diagnostics.errors), *sort_diagnostics(diagnostics.warnings)]


def _check_nodes(
    planner: TreePlanner,
    enums: dict[str, int],
    models: dict[str, dict[str, str | None]],
    reporter: LintReporter,
) -> ResultAnalysis:
    """Check every node of all trees by itself and with its children. Return the possible results."""
    bounded = not any(error.code in _UNBOUNDED for error in reporter.diagnostics.errors)
    results = ResultAnalysis(planner, bounded)
    tree_keys = TreeKeys(planner, enums, bounded)
    for definition in planner.definitions.by_id.values():
        document = definition.document
        for node in nodes_of(planner.plan(definition)):
            check_child_count(node, document, planner.dialect.format, reporter)
            check_ignored_attributes(node, document, reporter)
            check_port_literals(node, document, planner.dialect.format, reporter)
            check_literals_of_class(node, document, reporter)
            check_missing_ports(node, document, reporter)
            check_script_results(node, document, enums, reporter)
            check_reachable_children(node, document, results, reporter)
            check_remappings(node, document, tree_keys, models, reporter)
    return results


def _roots(analysis: DocumentAnalysis, used: Collection[str]) -> list[TreeDefinition]:
    """Return the main tree and the trees that no other tree calls."""
    planner, main, _ = analysis
    others = [tree for tree in planner.definitions.by_id.values() if tree.id not in used]
    called = {call.tree for tree in others for call in planner.plan(tree).calls}
    return [*([main] if main is not None else []), *(tree for tree in others if tree.id not in called)]


def _is_bounded(calls: CallGraph, root: TreeDefinition) -> bool:
    """Return whether the tree is neither recursive nor too large; otherwise add an error."""
    return not calls.is_recursive(root) and calls.check_size(root)
