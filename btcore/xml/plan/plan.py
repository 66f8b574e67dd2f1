"""Plan trees: make a plan of each node, and check it against the registered nodes, before nodes exist.

This is the third stage of loading.
"""

import gc
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any, Final, NamedTuple

from btcore.diagnostic_codes import RECURSIVE_TREES, SCRIPT_SYNTAX, TREE_TOO_LARGE, UNKNOWN_FORMAT
from btcore.engine.node_config import MAX_NODES
from btcore.errors import ScriptError
from btcore.fixes import SetFormat
from btcore.registry.registry import Registry
from btcore.script.program import compile_script
from btcore.suggestions import counted
from btcore.xml.define import Definitions, TreeDefinition, define
from btcore.xml.plan.tree_plan import NodePlan, SubtreeCall, TreePlan
from btcore.xml.plan.tree_planner import PlanningContext, TreePlanner
from btcore.xml.read.document import MAX_COMPARISONS, CollectedDiagnostics, DiagnosticCollector, Document
from btcore.xml.read.read import PackageResolver, read

MAX_DEPTH: Final = 10_000
"""The maximum number of levels of a tree with all its subtrees, each of which may have fewer levels.

Ticking needs a few hundred bytes of the C stack for each level.
"""
_MAX_SHOWN_CYCLE: Final = 20


class TreeSize(NamedTuple):
    """The number of nodes and of levels of a tree with all its subtrees."""

    nodes: int
    depth: int

    def ensure_recursion_limit(self) -> None:
        """Raise Python's recursion limit, if the tree needs it."""
        # Nodes are created, checked and ticked recursively, with at most six Python calls per level.
        sys.setrecursionlimit(max(sys.getrecursionlimit(), 6 * self.depth + 1000))


class Plans(NamedTuple):
    """The plans of the trees of a document.

    Attributes:
        definitions: The definitions of the trees.
        registry: The registered nodes with which they were planned.
        trees: The plans by the IDs of the trees: of the main tree and of the trees that it calls, directly or
            indirectly, or of every tree.
        main_tree: The plan of the main tree; None if it is missing or ambiguous.
        sizes: The sizes of the planned trees, by ID, except for trees that are recursive or too large.
        diagnostics: What was found in this stage and before.
    """

    definitions: Definitions
    registry: Registry
    trees: Mapping[str, TreePlan]
    main_tree: TreePlan | None
    sizes: Mapping[str, TreeSize]
    diagnostics: CollectedDiagnostics

    @property
    def format(self) -> int:
        """The XML format, 3 or 4."""
        return self.definitions.format

    @property
    def is_finite(self) -> bool:
        """Whether no tree is recursive or too large, so that calls of trees can be followed to their end."""
        return len(self.sizes) == len(self.trees)

    def required_resources(self) -> list[Any]:
        """Return the types of the resources that the leaves of the main tree need, each once."""
        trees = () if self.main_tree is None else reachable_trees(self.trees, self.main_tree)
        node_plans = (node_plan for tree in trees for node_plan in tree.node_plans())
        manifests = {node_plan.id: node_plan.manifest for node_plan in node_plans}
        types: list[Any] = []
        for manifest in manifests.values():
            types += (resource for resource in manifest.required_resources if resource not in types)
        return types


@contextmanager
def paused_garbage_collection() -> Iterator[None]:
    """Disable the garbage collector. What is created meanwhile skips its young generations.

    The collector would scan the growing plans and trees again and again, although no part of them is garbage.
    """
    was_enabled = gc.isenabled()
    gc.disable()
    # A new tree goes to the oldest generation at once: scanning it on its way there takes a fifth of the time
    # of loading. Only freeze() moves objects there, and it moves all young objects of the process; therefore
    # the other young objects are collected first. An application's frozen objects stay frozen.
    freezes = was_enabled and not gc.get_freeze_count()
    if freezes:
        gc.collect(1)
    try:
        yield
    finally:
        if freezes:
            gc.freeze()
            gc.unfreeze()
        if was_enabled:
            gc.enable()


def plan(definitions: Definitions, registry: Registry, every_tree: bool = False) -> Plans:
    """Return the plans of the main tree and of the trees that it calls.

    If no format is stated, and format 4 would avoid errors, the first error says so.

    Args:
        every_tree: Whether all other trees are planned, too, and all scripts checked. Otherwise the scripts
            are checked only after errors: without errors they are compiled when the nodes are created.
    """
    with paused_garbage_collection():
        plans = _plan_trees(definitions, registry, every_tree)
        is_unsure = definitions.is_format_assumed and plans.diagnostics.errors
        return _compare_with_format_4(plans, every_tree) if is_unsure else plans


def plan_document(
    document: Document,
    registry: Registry,
    tree_id: str | None = None,
    format: int | None = None,
    shared_documents: Sequence[Document] = (),
    packages: PackageResolver | None = None,
    every_tree: bool = False,
) -> Plans:
    """Return the plans of the trees of a document: `read`, `define` and `plan` in one call.

    The main *document* may call the trees of *registry* and of the *shared_documents*. `read`, `define` and
    `plan` describe the other parameters.
    """
    sources = read(document, [*registry.documents, *shared_documents], packages)
    return plan(define(sources, tree_id, format), registry, every_tree)


def _compare_with_format_4(plans: Plans, every_tree: bool) -> Plans:
    """Return *plans*, whose first error says so if format 4 would avoid errors."""
    errors, definitions = plans.diagnostics.errors, plans.definitions
    sources = definitions.sources
    in_format_4 = define(sources, definitions.requested_tree, 4)
    # Of these plans only the errors are counted, so they need no hints.
    as_format_4 = _plan_trees(in_format_4, plans.registry, every_tree, max_comparisons=0)
    avoided = len(errors) - len(as_format_4.diagnostics.errors)
    if avoided <= 0:
        return plans
    count = counted(avoided, "error")
    message = f"missing BTCPP_format: the document is read as format 3; format 4 avoids {count}"
    hint = 'write <root BTCPP_format="4">'
    document = sources.main_document
    cause = document.diagnostic(UNKNOWN_FORMAT, message, document.root, hint=hint, fixes=[SetFormat(4)])
    return plans._replace(diagnostics=plans.diagnostics._replace(errors=(cause, *errors)))


def _plan_trees(
    definitions: Definitions, registry: Registry, every_tree: bool, max_comparisons: int = MAX_COMPARISONS
) -> Plans:
    collector = DiagnosticCollector(definitions.diagnostics, max_comparisons)
    context = PlanningContext(definitions, registry, collector)
    planners = {definition: TreePlanner(definition, context) for definition in definitions.all}
    for planner in planners.values():
        planner.outline()
    trees: dict[str, TreePlan] = {}
    by_id, main = definitions.by_id, definitions.main_tree
    pending: list[TreeDefinition] = [*by_id.values()][::-1] if every_tree else []
    if main is not None:
        pending.append(main)
    while pending:
        definition = pending.pop()
        if definition.id not in trees:
            trees[definition.id] = tree = planners[definition].plan()
            pending += [by_id[call.tree_id] for call in reversed(tree.calls) if call.tree_id in by_id]
    main_tree = None if main is None else trees[main.id]
    sizes = _measure(trees, main_tree, collector)
    if every_tree or collector.errors:
        for tree in trees.values():
            for node_plan in tree.node_plans():
                report_invalid_scripts(node_plan, tree.definition.document, registry.types.enums, collector)
    return Plans(definitions, registry, trees, main_tree, sizes, collector.diagnostics)


def reachable_trees(trees: Mapping[str, TreePlan], tree: TreePlan) -> list[TreePlan]:
    """Return *tree* and all of *trees* that it calls, directly or indirectly, each once."""
    reached: dict[str, TreePlan] = {}
    pending = [tree.id]
    while pending:
        id = pending.pop()
        if id not in reached and id in trees:
            reached[id] = trees[id]
            pending += [call.tree_id for call in reversed(trees[id].calls)]
    return list(reached.values())


def root_trees(trees: Mapping[str, TreePlan], main_tree: TreePlan | None) -> list[TreePlan]:
    """Return the main tree, if there is one, and those of *trees* that no other tree calls."""
    used = set() if main_tree is None else {tree.id for tree in reachable_trees(trees, main_tree)}
    unreached = [tree for tree in trees.values() if tree.id not in used]
    called = {call.tree_id for tree in unreached for call in tree.calls}
    roots = [tree for tree in unreached if tree.id not in called]
    return roots if main_tree is None else [main_tree, *roots]


def _measure(
    trees: Mapping[str, TreePlan], main_tree: TreePlan | None, collector: DiagnosticCollector
) -> dict[str, TreeSize]:
    """Return the sizes of the trees. Those of trees that are recursive or too large are missing: errors."""
    sizes: dict[str, TreeSize] = {}
    visited: set[str] = set()
    # Trees that call each other may have no root among them.
    for root in (*root_trees(trees, main_tree), *trees.values()):
        if root.id not in visited:
            _measure_from(root, trees, sizes, visited, collector)
            size = sizes.get(root.id)
            if size is not None and (size.nodes > MAX_NODES or size.depth > MAX_DEPTH):
                _report_too_large(root, size, collector)
                del sizes[root.id]
    return sizes


def _measure_from(
    root: TreePlan,
    trees: Mapping[str, TreePlan],
    sizes: dict[str, TreeSize],
    visited: set[str],
    collector: DiagnosticCollector,
) -> None:
    """Add the sizes of *root* and of the trees that it calls, unless they call each other."""
    path: dict[str, None] = {}  # the trees from the root to the visited tree
    pending: list[tuple[TreePlan, bool]] = [(root, False)]
    while pending:
        tree, leaving = pending.pop()
        called = [trees[call.tree_id] for call in tree.calls if call.tree_id in trees]
        if leaving:
            del path[tree.id]
            below = [sizes[inner.id] for inner in called if inner.id in sizes]
            if len(below) == len(called):  # else one of them is recursive
                count = min(MAX_NODES + 1, tree.size + sum(size.nodes for size in below))
                sizes[tree.id] = TreeSize(count, tree.depth + max((size.depth for size in below), default=0))
        elif tree.id not in visited:
            visited.add(tree.id)
            path[tree.id] = None
            pending.append((tree, True))
            for call in tree.calls:
                if call.tree_id in path:
                    _report_cycle(list(path), tree, call, collector)
            pending += [(inner, False) for inner in called if inner.id not in visited]


def _report_too_large(tree: TreePlan, size: TreeSize, collector: DiagnosticCollector) -> None:
    message, hint = f"with all its subtrees the tree is more than {MAX_DEPTH:,} levels deep", ""
    if size.nodes > MAX_NODES:
        message = f"with all its subtrees the tree has more than {MAX_NODES:,} nodes"
        hint = "nodes are numbered with 16 bits; look for trees that call other trees several times"
    document, element = tree.definition.document, tree.definition.element
    collector.report(document, TREE_TOO_LARGE, message, element, attribute="ID", hint=hint)


def _report_cycle(path: list[str], tree: TreePlan, call: SubtreeCall, collector: DiagnosticCollector) -> None:
    """Report *call* in *tree*, the last tree of *path*: it calls another tree of the path."""
    cycle = path[path.index(call.tree_id) :]
    if len(cycle) >= _MAX_SHOWN_CYCLE:
        half = _MAX_SHOWN_CYCLE // 2
        cycle = [*cycle[:half], "…", *cycle[1 - half :]]
    message = f"the trees call each other recursively: {' → '.join([*cycle, call.tree_id])}"
    document = tree.definition.document
    hint = "a tree can't contain itself"
    collector.report(document, RECURSIVE_TREES, message, call.element, attribute="ID", hint=hint)


def report_invalid_scripts(
    node: NodePlan, document: Document, enums: Mapping[str, int], collector: DiagnosticCollector
) -> bool:
    """Report the invalid scripts of a node in *document*; return whether there are any.

    Args:
        enums: The enum names that scripts may use, with their numbers.
    """
    has_errors = False
    for attribute, text, _ in node.iter_scripts():
        if not text and attribute not in node.conditions:
            continue  # BehaviorTree.CPP accepts an empty port of a Script, and checks it only in ticks
        try:
            compile_script(text, enums)
        except ScriptError as error:
            has_errors = True
            message = f"invalid script in '{attribute}' of <{node.id}>: {error.message}"
            collector.report(
                document, SCRIPT_SYNTAX, message, node.element, attribute=attribute, column=error.column
            )
    return has_errors
