"""For tests of trees: a harness, assertions, coverage, substitution, planned leaves, random trees.

``trees``, ``documents``, ``outcomes``, ``plans``, ``letters`` and ``blackboards`` are hypothesis strategies,
and need it to be installed; nothing else here does.
"""

from typing import TYPE_CHECKING

from btcore.testing.assertions import (
    assert_ended,
    assert_halted,
    assert_never_ran,
    assert_never_running_together,
    assert_order,
    assert_ran,
    assert_results,
)
from btcore.testing.coverage import Coverage
from btcore.testing.harness import Harness
from btcore.testing.leaf_plans import Outcomes, PlannedAction, PlannedCondition, with_planned_leaves
from btcore.testing.planned import Journal, PlanAction, PlanCondition, PlanFault, PlanSync
from btcore.testing.substitution import (
    SubstitutionFault,
    TestNode,
    TestNodeConfig,
    load_substitution_rules,
)
from btcore.testing.trace import Change, Step, Trace

if TYPE_CHECKING:
    from btcore.testing.strategies import blackboards, documents, letters, outcomes, plans, trees

__all__ = [
    "Change",
    "Coverage",
    "Harness",
    "Journal",
    "Outcomes",
    "PlanAction",
    "PlanCondition",
    "PlanFault",
    "PlanSync",
    "PlannedAction",
    "PlannedCondition",
    "Step",
    "SubstitutionFault",
    "TestNode",
    "TestNodeConfig",
    "Trace",
    "assert_ended",
    "assert_halted",
    "assert_never_ran",
    "assert_never_running_together",
    "assert_order",
    "assert_ran",
    "assert_results",
    "blackboards",
    "documents",
    "letters",
    "load_substitution_rules",
    "outcomes",
    "plans",
    "trees",
    "with_planned_leaves",
]

_STRATEGIES = frozenset({"blackboards", "documents", "letters", "outcomes", "plans", "trees"})


def __getattr__(name: str) -> object:
    """The strategies, when they are asked for."""
    if name not in _STRATEGIES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from btcore.testing import strategies
    except ModuleNotFoundError as fault:
        if fault.name != "hypothesis":
            raise
        raise ImportError(f"btcore.testing.{name} draws with hypothesis: pip install hypothesis") from fault
    return getattr(strategies, name)
