"""Tools for testing trees: a harness, assertions, coverage, substitution of nodes, and random trees.

The leaves named Mock… and Plan… return results in the order of a plan.

The strategies `trees`, `xml_documents`, `outcomes`, `action_plans`, `sync_plans` and
`blackboards` require hypothesis; all other names do not.
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


def __getattr__(name: str) -> object:
    """Import a strategy on first access, because the strategies require hypothesis, which is optional."""
    # Python calls this function only for names that this module does not define.
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    try:
        from btcore.testing import strategies
    except ModuleNotFoundError as error:
        if error.name != "hypothesis":
            raise
        raise ImportError(f"btcore.testing.{name} requires hypothesis: pip install hypothesis") from error
    return getattr(strategies, name)
