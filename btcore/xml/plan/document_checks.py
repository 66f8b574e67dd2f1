"""Check a document and everything that it includes, before any node is created."""

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

from btcore.blackboard.ports import SCRIPT_ROLES, PortRole
from btcore.diagnostic_codes import SCRIPT_SYNTAX, UNKNOWN_FORMAT
from btcore.errors import Diagnostic, ScriptError
from btcore.registry.manifest import Manifest
from btcore.registry.registry import Registry
from btcore.script.program import compile_script
from btcore.xml.models.tree_nodes_model import subtree_models
from btcore.xml.plan.call_graph import CallGraph
from btcore.xml.plan.palette import NodePalette
from btcore.xml.plan.plan import NodePlan, TreePlan, TreePlanner
from btcore.xml.plan.structure_checks import StructureChecker
from btcore.xml.plan.tree_definitions import TreeDefinition, TreeDefinitions, select_dialect
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.dialect import DIALECTS, PRECONDITION_ATTRIBUTES, Dialect
from btcore.xml.read.document import Document
from btcore.xml.read.includes import PackageResolver, resolve_includes


class DocumentAnalysis(NamedTuple):
    """The result of checking a document; *main* is None if the main tree is missing or ambiguous."""

    planner: TreePlanner
    main: TreeDefinition | None
    diagnostics: DiagnosticCollector

    def used_manifests(self) -> list[Manifest]:
        """Return the manifests of the nodes in the main tree and its subtrees, each once."""
        manifests: dict[str, Manifest] = {}
        for plan in reachable_plans(self.planner, self.main) if self.main is not None else ():
            for node in nodes_of(plan):
                if node.manifest is not None:
                    manifests.setdefault(node.id, node.manifest)
        return list(manifests.values())


def analyse_document(
    document: Document,
    registry: Registry,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    libraries: Sequence[Document] = (),
) -> DocumentAnalysis:
    """Check *document*, its includes and the trees of the registry, and plan the trees.

    Args:
        document: The parsed document.
        registry: The registered nodes.
        tree: ID of the tree to build; by default the document's main tree.
        format: 3 or 4, overriding the document's `BTCPP_format`.
        packages: Finds the share directory of a ROS package.
        libraries: Further documents, whose trees *document* may call without an include.

    Returns:
        The planned trees with all errors and warnings.
    """
    diagnostics = DiagnosticCollector()
    libraries = [*registry.documents, *libraries]
    documents = resolve_includes(document, diagnostics, packages, libraries)
    for parsed in documents:
        for warning in parsed.warnings:
            diagnostics.add(warning)
    dialect = select_dialect(documents, format, diagnostics)
    as_format_4 = DiagnosticCollector(comparisons=0)
    as_format_4.errors += diagnostics.errors  # of the includes
    analysis = _analyse(documents, dialect, registry, tree, libraries, diagnostics)
    if diagnostics.errors and format is None and document.root.get("BTCPP_format") is None:
        _analyse(documents, DIALECTS[4], registry, tree, libraries, as_format_4)
        avoided = len(diagnostics.errors) - len(as_format_4.errors)
        if avoided > 0:
            errors = "1 error" if avoided == 1 else f"{avoided} errors"
            message = f"missing BTCPP_format: the document is read as format 3; format 4 avoids {errors}"
            hint = 'write <root BTCPP_format="4">'
            diagnostics.put_first(document.diagnostic(UNKNOWN_FORMAT, message, document.root, hint=hint))
    return analysis


def _analyse(
    documents: list[Document],
    dialect: Dialect,
    registry: Registry,
    tree: str | None,
    libraries: Sequence[Document],
    diagnostics: DiagnosticCollector,
) -> DocumentAnalysis:
    """Check and plan the trees of *documents* by the rules of *dialect*."""
    definitions = TreeDefinitions(documents, dialect, diagnostics, libraries)
    palette = NodePalette(registry, dialect.format)
    outlines = StructureChecker(definitions, palette, diagnostics).check()
    main = definitions.select_main(tree, diagnostics) if documents[-1].root.tag == "root" else None
    planner = TreePlanner(
        definitions, palette, outlines, subtree_models(documents, dialect, diagnostics), diagnostics
    )
    if main is None:
        return DocumentAnalysis(planner, None, diagnostics)
    calls = CallGraph(planner, diagnostics)
    if not calls.is_recursive(main):
        calls.check_size(main)
    if diagnostics.errors:
        # Without errors, the scripts are compiled when the nodes are created. After an error no node is
        # created, so the scripts are checked here.
        for plan in reachable_plans(planner, main):
            check_scripts(plan, registry, diagnostics)
    return DocumentAnalysis(planner, main, diagnostics)


def reachable_plans(
    planner: TreePlanner, main: TreeDefinition, known: Collection[str] = ()
) -> list[TreePlan]:
    """Return the plans of *main* and of every tree that it calls, directly or indirectly, each once.

    Args:
        planner: Plans the trees.
        main: The tree to start with.
        known: IDs of trees that are left out, with the trees that they call.
    """
    plans: dict[str, TreePlan] = {}
    pending = [main.id]
    while pending:
        id = pending.pop()
        if id in plans or id in known or id not in planner.definitions.by_id:
            continue
        plans[id] = plan = planner.plan(planner.definitions.by_id[id])
        pending += [call.tree for call in reversed(plan.calls)]
    return list(plans.values())


def nodes_of(plan: TreePlan) -> list[NodePlan]:
    """Return the nodes of *plan* in pre-order, without the nodes of the trees that it calls."""
    nodes: list[NodePlan] = []
    pending = [plan.root] if plan.root is not None else []
    while pending:
        node = pending.pop()
        nodes.append(node)
        pending += reversed(node.children)
    return nodes


def scripts_of(node: NodePlan) -> Iterator[tuple[str, str, bool]]:
    """Yield (attribute, text, whether the script is a condition) for each script of *node*."""
    for attribute, text in node.scripts.items():
        yield attribute, text, attribute in PRECONDITION_ATTRIBUTES
    for bound in node.bindings:
        if bound.port.role in SCRIPT_ROLES and bound.key is None:
            yield bound.name, bound.text, bound.port.role is PortRole.CONDITION


def check_scripts(plan: TreePlan, registry: Registry, diagnostics: DiagnosticCollector) -> None:
    """Add an error for each invalid script of *plan*.

    Args:
        plan: The tree to check.
        registry: The registered nodes and enums.
        diagnostics: Collects the errors.
    """
    document = plan.definition.document
    for node in nodes_of(plan):
        for key, text, _ in scripts_of(node):
            if not text and key not in node.scripts:
                continue  # BehaviorTree.CPP accepts an empty port of a Script, and checks it only in ticks
            try:
                compile_script(text, registry.types.enums)
            except ScriptError as error:
                diagnostics.add(script_diagnostic(document, node, key, error))


def script_diagnostic(document: Document, node: NodePlan, key: str, error: ScriptError) -> Diagnostic:
    """Return the diagnostic of an invalid script.

    Args:
        document: The document that contains the script.
        node: The node of the script.
        key: The attribute that holds the script.
        error: The error of the parser.
    """
    message = f"invalid script in '{key}' of <{node.id}>: {error.message}"
    return document.diagnostic(SCRIPT_SYNTAX, message, node.element, key, within=error.column)
