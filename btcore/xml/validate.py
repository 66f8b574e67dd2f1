"""Every fault of a file, errors and warnings, without making its tree."""

import os
from collections.abc import Collection

from btcore.errors import Diagnostic, TreeError
from btcore.registry import Registry
from btcore.xml.check import check_scripts, examine, reachable
from btcore.xml.faults import in_order
from btcore.xml.includes import PackageResolver
from btcore.xml.lint.everything import advise
from btcore.xml.plan import calling_order
from btcore.xml.source import Document, read_file


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
        document = read_file(path)
    except TreeError as fault:
        return list(fault.diagnostics)
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
    examined = examine(document, nodes, tree, format, packages)
    planner, faults = examined.planner, examined.faults
    reached = reachable(planner, examined.main) if examined.main is not None else []
    ids = {plan.definition.id for plan in reached}
    looked_at = set(ids)
    for definition in planner.forest.by_id.values():
        if definition.id not in looked_at:
            calling_order(planner, definition, faults)
            looked_at |= {plan.definition.id for plan in reachable(planner, definition)}
        check_scripts(planner.plan(definition), nodes, faults)
    if tree is None and planner.forest.all and document.root.get("main_tree_to_execute") is None:
        faults.errors = [one for one in faults.errors if one.code != "E108"]
    advise(examined, ids, nodes, given, asked=tree is not None)
    return [*in_order(faults.errors), *in_order(faults.warnings)]
