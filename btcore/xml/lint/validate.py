"""Find all errors and warnings in a file, without building its tree."""

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
    """Return the errors, then the warnings, of the file *path* and its includes, each in text order.

    Errors are the reasons why loading the tree fails (except for errors that only the code of leaves
    can detect), and the reasons why a tick certainly raises (E119, and E202 in format 3). Warnings never
    prevent loading. Every tree in the file is checked, called or not, including its scripts. A file with
    several trees and no main tree is a library, which is valid.

    Args:
        path: The XML file.
        nodes: The registered nodes.
        tree: ID of the tree to load; by default the document's main tree.
        format: 3 or 4, overriding the document's ``BTCPP_format``.
        packages: Finds the share directory of a ROS package.
        given: Keys that the main tree's blackboard holds before the first tick.
    """
    try:
        document = parse_file(path)
    except TreeError as error:  # not XML: without elements there is nothing more to check
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
    """Return the errors, then the warnings, of a parsed *document* and its includes.

    Args:
        document: The parsed document.
        nodes: The registered nodes.
        tree: ID of the tree to load; by default the document's main tree.
        format: 3 or 4, overriding the document's ``BTCPP_format``.
        packages: Finds the share directory of a ROS package.
        given: Keys that the main tree's blackboard holds before the first tick.
    """
    analysis = analyse_document(document, nodes, tree, format, packages)
    planner, diagnostics = analysis.planner, analysis.diagnostics
    used_plans = reachable_plans(planner, analysis.main) if analysis.main is not None else []
    used = {plan.definition.id for plan in used_plans}
    checked = set(used)
    for definition in planner.definitions.by_id.values():
        if definition.id not in checked:
            topological_order(planner, definition, diagnostics)
            checked |= {plan.definition.id for plan in reachable_plans(planner, definition)}
        check_scripts(planner.plan(definition), nodes, diagnostics)
    if tree is None and planner.definitions.all and document.root.get("main_tree_to_execute") is None:
        # The file is a library: no main tree is needed.
        diagnostics.errors = [error for error in diagnostics.errors if error.code != AMBIGUOUS_MAIN_TREE]
    run_lint(analysis, used, nodes, given, is_tree_requested=tree is not None)
    return [*sort_diagnostics(diagnostics.errors), *sort_diagnostics(diagnostics.warnings)]
