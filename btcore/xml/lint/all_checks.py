"""All the checks, on all the trees of a document."""

from collections.abc import Collection
from typing import Final

from btcore.diagnostic_codes import (
    AMBIGUOUS_MAIN_TREE,
    FIRST_TICK_REFUSED,
    INCONVERTIBLE_TEXT,
    RECURSIVE_TREES,
    TOO_LARGE,
)
from btcore.registry.registry import Registry
from btcore.xml.lint.advice import LintReporter
from btcore.xml.lint.child_counts import check_arity
from btcore.xml.lint.dry_run import DryRun
from btcore.xml.lint.entry_types import check_value_types
from btcore.xml.lint.ignored_attributes import check_ignored
from btcore.xml.lint.loose_text import check_stray_text
from btcore.xml.lint.missing_ports import check_missing_ports
from btcore.xml.lint.port_texts import check_port_literals
from btcore.xml.lint.script_results import check_script_results
from btcore.xml.lint.subtree_remappings import TreeKeys, check_remaps
from btcore.xml.lint.unreachable_children import ResultAnalysis, check_reach
from btcore.xml.lint.unused_trees import check_unused
from btcore.xml.lint.unwritten_keys import check_keys
from btcore.xml.models.tree_nodes_model import subtree_models
from btcore.xml.plan.document_checks import DocumentAnalysis, check_size
from btcore.xml.plan.plan import TreePlanner, topological_order
from btcore.xml.plan.tree_definitions import TreeDefinition
from btcore.xml.read.diagnostics import DiagnosticCollector

# Errors that leave a dry run of each tree possible. The first concerns the selection of the main tree only.
_OF_THE_FILE: Final = frozenset({AMBIGUOUS_MAIN_TREE})
# The tree can be built and the keys of its ports are known; only a tick fails.
_OF_A_TICK: Final = frozenset({FIRST_TICK_REFUSED})
# In format 3 the tree is built; only the node that reads the text raises.
_OF_A_READING: Final = frozenset({INCONVERTIBLE_TEXT})
# With these errors, following SubTree calls might not terminate in reasonable time.
_UNBOUNDED: Final = frozenset({RECURSIVE_TREES, TOO_LARGE})


def run_lint(
    analysis: DocumentAnalysis,
    used: Collection[str],
    registry: Registry,
    given: Collection[str],
    is_tree_requested: bool,
) -> None:
    """Add warnings, and the errors that a dry run finds, to the diagnostics of *analysis*.

    Args:
        analysis: The analysed document.
        used: IDs of the main tree and of the trees that it calls, directly or indirectly.
        registry: The registered nodes.
        given: Keys that the main tree's blackboard holds before the first tick.
        is_tree_requested: Whether the caller selected the main tree, instead of the document.
    """
    planner, main, diagnostics = analysis
    reporter = LintReporter(diagnostics)
    enums = registry.types.enums
    roots = [root for root in _roots(analysis, used) if _is_bounded(planner, root, diagnostics)]
    models = subtree_models(planner.definitions.documents, planner.dialect, DiagnosticCollector())
    bounded = not any(error.code in _UNBOUNDED for error in diagnostics.errors)
    results = ResultAnalysis(planner, bounded)
    tree_keys = TreeKeys(planner, enums, bounded)
    for definition in planner.definitions.by_id.values():
        plan = planner.plan(definition)
        check_arity(plan, reporter)
        check_ignored(plan, reporter)
        check_port_literals(plan, planner.dialect.format, reporter)
        check_missing_ports(plan, reporter)
        check_script_results(plan, enums, reporter)
        check_reach(plan, results, reporter)
        check_remaps(plan, tree_keys, models, reporter)
    for document in planner.definitions.documents:
        check_stray_text(document, diagnostics)
    names_main = planner.definitions.documents[-1].root.get("main_tree_to_execute") is not None
    if main is not None and names_main and not is_tree_requested:
        check_unused(planner, main, used, diagnostics)
    harmless = _OF_THE_FILE | _OF_A_TICK | (_OF_A_READING if planner.dialect.format == 3 else frozenset())
    if any(error.code not in harmless for error in diagnostics.errors):
        return
    for root in roots:
        dry_run = DryRun(planner, root, registry)
        for error in dry_run.run().errors:
            diagnostics.add(error)
        # A subtree model declares ports that callers of the tree provide.
        check_keys(dry_run, root is main, {*given, *models.get(root.id, ())}, reporter)
        check_value_types(dry_run, enums, reporter)


def _roots(analysis: DocumentAnalysis, used: Collection[str]) -> list[TreeDefinition]:
    """Return the main tree and the trees that no other tree calls."""
    planner, main, _ = analysis
    others = [tree for tree in planner.definitions.by_id.values() if tree.id not in used]
    called = {node.call.tree for tree in others for node in planner.plan(tree).calls if node.call is not None}
    return [*([main] if main is not None else []), *(tree for tree in others if tree.id not in called)]


def _is_bounded(planner: TreePlanner, root: TreeDefinition, diagnostics: DiagnosticCollector) -> bool:
    """Return whether the tree is neither recursive nor too large; add an error to *diagnostics* if it is."""
    order = topological_order(planner, root, diagnostics)
    if order is None:
        return False
    before = len(diagnostics.errors)
    check_size(order, root, diagnostics)
    return len(diagnostics.errors) == before
