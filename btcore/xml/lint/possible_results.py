"""Infer the results that a node may return, in any tick and in its first tick."""

from typing import Final

from btcore.engine.node import TreeNode
from btcore.status import FAILURE, SKIPPED, SUCCESS, UNKNOWN_RESULTS, PossibleResults
from btcore.xml.lint.advice import is_builtin_class, is_stub
from btcore.xml.plan.plan import NodePlan

_DECLARATIONS: Final = frozenset({"possible_results", "may_return", "continue_on", "branch_results"})


def behaviour_of(cls: type[TreeNode]) -> type[TreeNode]:
    """Return the class whose declarations about results apply to *cls*.

    A user's class that derives from a built-in node may override its tick. Unless the user's class
    declares its results, only the base class of its kind (leaf, control, decorator) is trusted.
    """
    parents = cls.__mro__
    first = next((index for index, base in enumerate(parents) if is_builtin_class(base)), 0)
    if first == 0 or any(_DECLARATIONS & vars(base).keys() for base in parents[:first]):
        return cls
    return next(base for base in parents if base.__module__.startswith("btcore.engine."))


def infer_results(node: NodePlan, children: list[PossibleResults]) -> PossibleResults:
    """Return the possible results of *node* without its pre-conditions.

    Args:
        node: The node.
        children: The possible results of its children, in order.
    """
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
    """Return the possible results of *node* with its pre-conditions.

    Args:
        node: The node.
        bare: The possible results without pre-conditions.
    """
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
