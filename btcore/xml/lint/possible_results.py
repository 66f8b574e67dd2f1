"""What a node may result in, as far as that is certain, and whether it may do so in its first tick."""

from typing import Final

from btcore.engine.node import TreeNode
from btcore.status import FAILURE, SKIPPED, SUCCESS, UNKNOWN_RESULTS, PossibleResults
from btcore.xml.lint.advice import is_builtin_class, is_stub
from btcore.xml.plan.plan import NodePlan

_DECLARATIONS: Final = frozenset({"possible_results", "may_return", "continue_on", "branch_results"})


def behaviour_of(cls: type[TreeNode]) -> type[TreeNode]:
    """The class whose declarations about results hold for *cls*.

    A user's class derived from a built-in node may do something else in its ticks: unless it declares its
    results, it is taken for any node of its kind.
    """
    parents = cls.__mro__
    first = next((index for index, base in enumerate(parents) if is_builtin_class(base)), 0)
    if first == 0 or any(_DECLARATIONS & vars(base).keys() for base in parents[:first]):
        return cls
    return next(base for base in parents if base.__module__.startswith("btcore.engine."))


def infer_results(node: NodePlan, children: list[PossibleResults]) -> PossibleResults:
    """What *node* may result in without its conditions; *children* are the results of its children."""
    manifest = node.manifest
    if manifest is None or is_stub(manifest):
        return UNKNOWN_RESULTS
    cls = behaviour_of(manifest.cls)
    if len(children) < cls.child_count_at_load[0]:
        return UNKNOWN_RESULTS  # format 3 loads control nodes without children
    literals = {
        bound.name: bound.literal
        for bound in node.bindings
        if bound.key is None and bound.literal is not None
    }
    return cls.possible_results(children, literals)


def with_conditions(node: NodePlan, bare: PossibleResults) -> PossibleResults:
    """*bare* with what the conditions of *node* may make of it."""
    early = {
        result
        for attribute, result in (
            ("_failureIf", FAILURE),
            ("_successIf", SUCCESS),
            ("_skipIf", SKIPPED),
            ("_while", SKIPPED),
        )
        if attribute in node.scripts
    }
    return bare._replace(in_first_tick=bare.in_first_tick | early)
