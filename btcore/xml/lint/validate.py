"""Every fault of a file, errors and warnings, without making its tree."""

import os
from collections.abc import Collection

from btcore.diagnostic_codes import AMBIGUOUS_MAIN_TREE
from btcore.errors import Diagnostic, TreeError
from btcore.registry.registry import Registry
from btcore.xml.lint.all_checks import run_lint
from btcore.xml.plan.document_checks import analyse_document, check_scripts, reachable_plans
from btcore.xml.plan.plan import topological_order
from btcore.xml.read.diagnostics import sort_diagnostics
from btcore.xml.read.document import Document, parse_file
from btcore.xml.read.includes import PackageResolver


def validate(
    path: str | os.PathLike[str],
    *,
    nodes: Registry,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    given: Collection[str] = (),
) -> list[Diagnostic]:
    """What is wrong with the file *path* and its includes: errors first, both in the order of the text.

    Errors are what refuses the tree when it is loaded (but for what only the code of leaves can tell),
    and what a tick can't but raise for (E119, and in format 3 E202); warnings never do. *given* are the
    keys that the main tree's blackboard comes with. Every tree in the file is looked at, called or not,
    down to its scripts; a file of several trees, none of them the main one, is a library, and good.
    """
    try:
        document = parse_file(path)
    except TreeError as error:
        return list(error.diagnostics)
    return validate_document(document, nodes=nodes, tree=tree, format=format, packages=packages, given=given)


def validate_document(
    document: Document,
    *,
    nodes: Registry,
    tree: str | None = None,
    format: int | None = None,
    packages: PackageResolver | None = None,
    given: Collection[str] = (),
) -> list[Diagnostic]:
    """The same for a document that has been read."""
    analysis = analyse_document(document, nodes, tree, format, packages)
    planner, diagnostics = analysis.planner, analysis.diagnostics
    reached = reachable_plans(planner, analysis.main) if analysis.main is not None else []
    ids = {plan.definition.id for plan in reached}
    looked_at = set(ids)
    for definition in planner.definitions.by_id.values():
        if definition.id not in looked_at:
            topological_order(planner, definition, diagnostics)
            looked_at |= {plan.definition.id for plan in reachable_plans(planner, definition)}
        check_scripts(planner.plan(definition), nodes, diagnostics)
    if tree is None and planner.definitions.all and document.root.get("main_tree_to_execute") is None:
        diagnostics.errors = [one for one in diagnostics.errors if one.code != AMBIGUOUS_MAIN_TREE]
    run_lint(analysis, ids, nodes, given, asked=tree is not None)
    return [*sort_diagnostics(diagnostics.errors), *sort_diagnostics(diagnostics.warnings)]
