"""Infer the results that a node may return, in any tick and in its first tick."""

from typing import Final

from btcore.engine.node import TreeNode
from btcore.engine.node_spec import declared_fields
from btcore.registry.nodes_without_code import is_mock
from btcore.status import FAILURE, SKIPPED, SUCCESS, UNKNOWN_RESULTS, PossibleResults
from btcore.xml.plan.plan import Plans
from btcore.xml.plan.tree_plan import NodePlan

_DECLARATIONS: Final = frozenset({"results", "continue_on", "branch_results"})
# The result of each pre-condition that takes effect before the node itself is ticked.
_EARLY_RESULTS: Final = {"_failureIf": FAILURE, "_successIf": SUCCESS, "_skipIf": SKIPPED, "_while": SKIPPED}


def is_built_in(cls: type) -> bool:
    """Return whether *cls* is a built-in node or a base class of built-in nodes."""
    return cls.__module__.startswith("btcore.nodes.")


def behaviour_of(cls: type[TreeNode]) -> type[TreeNode]:
    """Return the class whose declarations about results apply to *cls*.

    A user's class that derives from a built-in node may override its tick. Unless the user's class
    declares its results, only the base class of its kind (leaf, control, decorator) is trusted.
    """
    parents = cls.__mro__
    first = next((index for index, base in enumerate(parents) if is_built_in(base)), 0)
    if first == 0 or any(
        "possible_results" in vars(base) or _DECLARATIONS & declared_fields(base).keys()
        for base in parents[:first]
    ):
        return cls
    return next(base for base in parents if base.__module__.startswith("btcore.engine."))


def all_children_known(node: NodePlan) -> bool:
    """Return whether all children of *node* are known nodes."""
    return not node.element.children or len(node.children) == len(node.element.node_children())


class ResultAnalysis:
    """The possible results of the nodes of a document, computed on first use."""

    def __init__(self, plans: Plans) -> None:
        self._plans = plans
        self._known: dict[NodePlan, PossibleResults] = {}

    def results_of(self, node: NodePlan) -> PossibleResults:
        """Return the possible results of *node*, including the effect of its pre-conditions."""
        results = self._known.get(node)
        if results is None:
            bare = self._without_conditions(node)
            early = {result for attribute, result in _EARLY_RESULTS.items() if attribute in node.conditions}
            self._known[node] = results = bare._replace(in_first_tick=bare.in_first_tick | early)
        return results

    def _without_conditions(self, node: NodePlan) -> PossibleResults:
        if node.subtree_call is not None:
            inner = self._plans.trees.get(node.subtree_call.tree_id) if self._plans.is_finite else None
            return UNKNOWN_RESULTS if inner is None or inner.root is None else self.results_of(inner.root)
        if is_mock(node.manifest.cls) or not all_children_known(node):
            return UNKNOWN_RESULTS
        cls = behaviour_of(node.manifest.cls)
        if len(node.children) < cls.spec.child_count_at_load[0]:
            return UNKNOWN_RESULTS  # format 3 loads control nodes without children
        literals = {
            binding.name: binding.literal
            for binding in node.bindings
            if binding.key is None and binding.literal is not None
        }
        return cls.possible_results([self.results_of(child) for child in node.children], literals)
