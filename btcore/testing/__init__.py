"""For tests of trees: a harness, assertions, coverage, substitution, planned leaves, random trees.

``trees``, ``xml_documents``, ``outcomes``, ``action_plans``, ``sync_plans`` and ``blackboards`` are
strategies of hypothesis, which must be installed for them; nothing else here needs it.
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
from btcore.testing.mock_leaves import MockAction, MockCondition, Outcomes, with_mock_leaves
from btcore.testing.plan_leaves import CallLog, LeafPlanError, PlanAction, PlanCondition, PlanSync
from btcore.testing.substitution_rules import (
    SubstitutionError,
    TestNode,
    TestNodeConfig,
    load_substitution_rules,
)
from btcore.testing.trace import StatusChange, Trace, TraceStep

if TYPE_CHECKING:
    from btcore.testing.strategies import (
        action_plans,
        blackboards,
        outcomes,
        sync_plans,
        trees,
        xml_documents,
    )

__all__ = [
    "CallLog",
    "Coverage",
    "Harness",
    "LeafPlanError",
    "MockAction",
    "MockCondition",
    "Outcomes",
    "PlanAction",
    "PlanCondition",
    "PlanSync",
    "StatusChange",
    "SubstitutionError",
    "TestNode",
    "TestNodeConfig",
    "Trace",
    "TraceStep",
    "action_plans",
    "assert_ended",
    "assert_halted",
    "assert_never_ran",
    "assert_never_running_together",
    "assert_order",
    "assert_ran",
    "assert_results",
    "blackboards",
    "load_substitution_rules",
    "outcomes",
    "sync_plans",
    "trees",
    "with_mock_leaves",
    "xml_documents",
]

_STRATEGIES = frozenset({"action_plans", "blackboards", "outcomes", "sync_plans", "trees", "xml_documents"})


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
