"""Checking a document with all that it includes, before any node is made."""

import sys
from typing import NamedTuple

from btcore.errors import Diagnostic, ScriptFault
from btcore.manifest import Manifest
from btcore.ports import pointer
from btcore.registry import Registry
from btcore.script.program import compile_script
from btcore.xml.faults import Faults
from btcore.xml.forest import Definition, Forest, dialect_of
from btcore.xml.includes import PackageResolver, with_includes
from btcore.xml.models import subtree_models
from btcore.xml.palette import Palette
from btcore.xml.plan import NodePlan, Planner, TreePlan, calling_order
from btcore.xml.shape import Shape
from btcore.xml.source import Document

MOST_NODES = 65_535
"""How many nodes a tree may have: their numbers have 16 bits on Groot's wire."""
MOST_LEVELS = 10_000
"""How deep a tree may be: ticking a level takes a few hundred bytes of the machine's stack."""


class Examined(NamedTuple):
    """What was found in a document: *main* is None where no tree can be told to be the main one."""

    planner: Planner
    main: Definition | None
    faults: Faults

    def used(self) -> list[Manifest]:
        """The manifests of the nodes in the main tree, each once, in the order in which they are met."""
        found: dict[str, Manifest] = {}
        for plan in reachable(self.planner, self.main) if self.main is not None else ():
            for node in nodes_of(plan):
                if node.manifest is not None:
                    found.setdefault(node.id, node.manifest)
        return list(found.values())


def examine(
    document: Document,
    registry: Registry,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
) -> Examined:
    """Find what is wrong with *document* and with what it includes.

    *tree* is the ID of the tree to make (default: the document's main one), *format* (3 or 4)
    overrides the document's ``BTCPP_format``, *packages* finds the folders of ROS packages.
    """
    faults = Faults()
    documents = with_includes(document, faults, packages)
    for one in documents:
        for warning in one.warnings:
            faults.add(warning)
    dialect = dialect_of(documents, format, faults)
    forest = Forest(documents, dialect, faults)
    palette = Palette(
        registry.manifests_of(dialect.format), registry.manifests_of(7 - dialect.format), dialect.format
    )
    outlines = Shape(forest, palette, faults).check()
    main = forest.main(tree, faults) if documents[-1].root.tag == "root" else None
    planner = Planner(forest, palette, outlines, subtree_models(documents, dialect, faults), faults)
    if main is None:
        return Examined(planner, None, faults)
    order = calling_order(planner, main, faults)
    if order is not None:
        check_size(order, main, faults)
    if faults.errors:
        # No node is made of a tree with faults; its scripts are checked all the same.
        for plan in reachable(planner, main):
            check_scripts(plan, registry, faults)
    return Examined(planner, main, faults)


def reachable(planner: Planner, main: Definition) -> list[TreePlan]:
    """The plan of *main* and of every tree that it leads to, each once."""
    found: dict[str, TreePlan] = {}
    pending = [main.id]
    while pending:
        id = pending.pop()
        if id in found or id not in planner.forest.by_id:
            continue
        found[id] = plan = planner.plan(planner.forest.by_id[id])
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


def check_size(plans: list[TreePlan], main: Definition, faults: Faults) -> None:
    """Refuse a tree that is too large or too deep: trees that call trees grow fast.

    *plans* are in calling order.
    """
    sizes: dict[str, int] = {}
    depths: dict[str, int] = {}
    for plan in plans:
        called = [node.call.tree for node in plan.calls if node.call is not None]
        size = plan.size + sum(sizes.get(tree, 0) for tree in called)
        sizes[plan.definition.id] = min(MOST_NODES + 1, size)
        deepest = max((depths.get(tree, 0) for tree in called), default=0)
        depths[plan.definition.id] = plan.depth + deepest
    said, hint = "", ""
    if sizes[main.id] > MOST_NODES:
        said = f"with all its subtrees the tree has more than {MOST_NODES:,} nodes"
        hint = "nodes are numbered with 16 bits; look for subtrees that call others twice"
    elif depths[main.id] > MOST_LEVELS:
        said = f"with all its subtrees the tree is more than {MOST_LEVELS:,} levels deep"
    else:
        # Nodes are made and ticked by recursion: six calls a level at the most.
        sys.setrecursionlimit(max(sys.getrecursionlimit(), 6 * depths[main.id] + 1000))
        return
    faults.add(main.document.diagnostic("E117", said, main.element, "ID", hint=hint))


def check_scripts(plan: TreePlan, registry: Registry, faults: Faults) -> None:
    """Note the scripts of *plan* that can't be parsed."""
    document = plan.definition.document
    for node in nodes_of(plan):
        texts = dict(node.scripts)
        if node.id in ("Script", "ScriptCondition", "Precondition"):
            texts.update(
                (port.name, text)
                for port, text, _ in node.ports
                if port.name in ("code", "if") and pointer(text, port.name) is None
            )
        for key, text in texts.items():
            try:
                compile_script(text, registry.types.enums)
            except ScriptFault as fault:
                faults.add(script_diagnostic(document, node, key, fault))


def script_diagnostic(document: Document, node: NodePlan, key: str, fault: ScriptFault) -> Diagnostic:
    """The diagnostic of a script in attribute *key* that can't be parsed."""
    said = f"the script in '{key}' of <{node.id}>: {fault.message}"
    return document.diagnostic("E206", said, node.element, key, within=fault.column)
