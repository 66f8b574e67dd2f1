"""Checking a document with all that it includes, before any node is made."""

import sys
from typing import NamedTuple

from btcore.blackboard.ports import SCRIPT_ROLES
from btcore.diagnostic_codes import SCRIPT_SYNTAX, TOO_LARGE
from btcore.errors import Diagnostic, ScriptError
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.script.program import compile_script
from btcore.tree.tree import MAX_NODES
from btcore.xml.models.tree_nodes_model import subtree_models
from btcore.xml.plan.palette import NodePalette
from btcore.xml.plan.plan import (
    NodePlan,
    TreePlan,
    TreePlanner,
    topological_order,
)
from btcore.xml.plan.structure_checks import StructureChecker
from btcore.xml.plan.tree_definitions import TreeDefinition, TreeDefinitions, select_dialect
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document
from btcore.xml.read.includes import PackageResolver, resolve_includes

MAX_DEPTH = 10_000
"""How deep a tree may be: ticking a level takes a few hundred bytes of the machine's stack."""


class DocumentAnalysis(NamedTuple):
    """What was found in a document: *main* is None where no tree can be told to be the main one."""

    planner: TreePlanner
    main: TreeDefinition | None
    diagnostics: DiagnosticCollector

    def used_manifests(self) -> list[Manifest]:
        """The manifests of the nodes in the main tree, each once, in the order in which they are met."""
        found: dict[str, Manifest] = {}
        for plan in reachable_plans(self.planner, self.main) if self.main is not None else ():
            for node in nodes_of(plan):
                if node.manifest is not None:
                    found.setdefault(node.id, node.manifest)
        return list(found.values())


def analyse_document(
    document: Document,
    registry: Registry,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
) -> DocumentAnalysis:
    """Find what is wrong with *document* and with what it includes.

    *tree* is the ID of the tree to make (default: the document's main one), *format* (3 or 4)
    overrides the document's ``BTCPP_format``, *packages* finds the folders of ROS packages.
    """
    diagnostics = DiagnosticCollector()
    documents = resolve_includes(document, diagnostics, packages)
    for one in documents:
        for warning in one.warnings:
            diagnostics.add(warning)
    dialect = select_dialect(documents, format, diagnostics)
    definitions = TreeDefinitions(documents, dialect, diagnostics)
    palette = NodePalette(
        registry.manifests_of(dialect.format), registry.manifests_of(7 - dialect.format), dialect.format
    )
    outlines = StructureChecker(definitions, palette, diagnostics).check()
    main = definitions.select_main(tree, diagnostics) if documents[-1].root.tag == "root" else None
    planner = TreePlanner(
        definitions, palette, outlines, subtree_models(documents, dialect, diagnostics), diagnostics
    )
    if main is None:
        return DocumentAnalysis(planner, None, diagnostics)
    order = topological_order(planner, main, diagnostics)
    if order is not None:
        check_size(order, main, diagnostics)
    if diagnostics.errors:
        # No node is made of a tree with faults; its scripts are checked all the same.
        for plan in reachable_plans(planner, main):
            check_scripts(plan, registry, diagnostics)
    return DocumentAnalysis(planner, main, diagnostics)


def reachable_plans(planner: TreePlanner, main: TreeDefinition) -> list[TreePlan]:
    """The plan of *main* and of every tree that it leads to, each once."""
    found: dict[str, TreePlan] = {}
    pending = [main.id]
    while pending:
        id = pending.pop()
        if id in found or id not in planner.definitions.by_id:
            continue
        found[id] = plan = planner.plan(planner.definitions.by_id[id])
        pending += [node.call.tree for node in reversed(plan.calls) if node.call is not None]
    return list(found.values())


def nodes_of(plan: TreePlan) -> list[NodePlan]:
    """The nodes of *plan* in pre-order, without those of the trees that it calls."""
    found: list[NodePlan] = []
    pending = [plan.root] if plan.root is not None else []
    while pending:
        node = pending.pop()
        found.append(node)
        pending += reversed(node.children)
    return found


def check_size(plans: list[TreePlan], main: TreeDefinition, diagnostics: DiagnosticCollector) -> None:
    """Refuse a tree that is too large or too deep: trees that call trees grow fast.

    *plans* are in calling order.
    """
    sizes: dict[str, int] = {}
    depths: dict[str, int] = {}
    for plan in plans:
        called = [node.call.tree for node in plan.calls if node.call is not None]
        size = plan.size + sum(sizes.get(tree, 0) for tree in called)
        sizes[plan.definition.id] = min(MAX_NODES + 1, size)
        deepest = max((depths.get(tree, 0) for tree in called), default=0)
        depths[plan.definition.id] = plan.depth + deepest
    message, hint = "", ""
    if sizes[main.id] > MAX_NODES:
        message = f"with all its subtrees the tree has more than {MAX_NODES:,} nodes"
        hint = "nodes are numbered with 16 bits; look for subtrees that call others twice"
    elif depths[main.id] > MAX_DEPTH:
        message = f"with all its subtrees the tree is more than {MAX_DEPTH:,} levels deep"
    else:
        # Nodes are made and ticked by recursion: six calls a level at the most.
        sys.setrecursionlimit(max(sys.getrecursionlimit(), 6 * depths[main.id] + 1000))
        return
    diagnostics.add(main.document.diagnostic(TOO_LARGE, message, main.element, "ID", hint=hint))


def check_scripts(plan: TreePlan, registry: Registry, diagnostics: DiagnosticCollector) -> None:
    """Note the scripts of *plan* that can't be parsed."""
    document = plan.definition.document
    for node in nodes_of(plan):
        texts = dict(node.scripts)
        texts.update(
            (bound.name, bound.text)
            for bound in node.bindings
            if bound.port.role in SCRIPT_ROLES and bound.key is None
        )
        for key, text in texts.items():
            try:
                compile_script(text, registry.types.enums)
            except ScriptError as error:
                diagnostics.add(script_diagnostic(document, node, key, error))


def script_diagnostic(document: Document, node: NodePlan, key: str, error: ScriptError) -> Diagnostic:
    """The diagnostic of a script in attribute *key* that can't be parsed."""
    message = f"the script in '{key}' of <{node.id}>: {error.message}"
    return document.diagnostic(SCRIPT_SYNTAX, message, node.element, key, within=error.column)
