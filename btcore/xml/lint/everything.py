"""All the checks, on all the trees of a document."""

from collections.abc import Collection
from typing import Final

from btcore.registry import Registry
from btcore.xml.check import Examined, check_size
from btcore.xml.faults import Faults
from btcore.xml.forest import Definition
from btcore.xml.lint.advice import Advice
from btcore.xml.lint.arity import check_arity
from btcore.xml.lint.ignored import check_ignored
from btcore.xml.lint.keys import check_keys
from btcore.xml.lint.kinds import check_kinds
from btcore.xml.lint.loose import check_loose_text
from btcore.xml.lint.missing import check_missing_ports
from btcore.xml.lint.reach import Outlooks, check_reach
from btcore.xml.lint.rehearsal import Rehearsal
from btcore.xml.lint.remaps import Vocabulary, check_remaps
from btcore.xml.lint.script_results import check_script_results
from btcore.xml.lint.texts import check_texts
from btcore.xml.lint.unused import check_unused
from btcore.xml.models import subtree_models
from btcore.xml.plan import Planner, calling_order

# Which trees there are, and which is to be made, is no matter of a single tree.
_OF_THE_FILE: Final = frozenset({"E108"})
# The tree can be made, and the keys of its ports told.
_OF_A_TICK: Final = frozenset({"E119"})
# Format 3 makes the tree: only the node that reads the text refuses it.
_OF_A_READING: Final = frozenset({"E202"})
_ENDLESS: Final = frozenset({"E110", "E117"})


def advise(
    examined: Examined, used: Collection[str], registry: Registry, given: Collection[str], asked: bool
) -> None:
    """Add warnings to the faults of *examined*, and what the builder would refuse beyond them.

    *used* are the trees that the main one leads to, *given* the keys that its blackboard comes with;
    *asked* tells that the main tree was asked for, and isn't what the document itself says.
    """
    planner, main, faults = examined
    advice = Advice(faults)
    enums = registry.types.enums
    roots = [one for one in _roots(examined, used) if _has_an_end(planner, one, faults)]
    models = subtree_models(planner.forest.documents, planner.dialect, Faults())
    bounded = not any(one.code in _ENDLESS for one in faults.errors)
    outlooks = Outlooks(planner, bounded)
    vocabulary = Vocabulary(planner, enums, bounded)
    for definition in planner.forest.by_id.values():
        plan = planner.plan(definition)
        check_arity(plan, advice)
        check_ignored(plan, advice)
        check_texts(plan, planner.dialect.format, advice)
        check_missing_ports(plan, advice)
        check_script_results(plan, enums, advice)
        check_reach(plan, outlooks, advice)
        check_remaps(plan, vocabulary, models, advice)
    for document in planner.forest.documents:
        check_loose_text(document, faults)
    names_main = planner.forest.documents[-1].root.get("main_tree_to_execute") is not None
    if main is not None and names_main and not asked:
        check_unused(planner, main, used, faults)
    harmless = _OF_THE_FILE | _OF_A_TICK | (_OF_A_READING if planner.dialect.format == 3 else frozenset())
    if any(one.code not in harmless for one in faults.errors):
        return
    for root in roots:
        rehearsal = Rehearsal(planner, root, registry)
        for one in rehearsal.run().errors:
            faults.add(one)
        # A tree that says which ports it has is handed them by those that call it.
        check_keys(rehearsal, root is main, {*given, *models.get(root.id, ())}, advice)
        check_kinds(rehearsal, enums, advice)


def _roots(examined: Examined, used: Collection[str]) -> list[Definition]:
    """The main tree, and those that no other leads to."""
    planner, main, _ = examined
    others = [one for one in planner.forest.by_id.values() if one.id not in used]
    called = {node.call.tree for one in others for node in planner.plan(one).calls if node.call is not None}
    return [*([main] if main is not None else []), *(one for one in others if one.id not in called)]


def _has_an_end(planner: Planner, root: Definition, faults: Faults) -> bool:
    """Whether the tree is neither a circle nor too large, which goes to *faults*."""
    order = calling_order(planner, root, faults)
    if order is None:
        return False
    before = len(faults.errors)
    check_size(order, root, faults)
    return len(faults.errors) == before
