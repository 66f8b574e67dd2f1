"""Tools for testing trees: a harness, assertions, coverage, substitution of nodes, and random trees.

Mock leaves return results in the order of their `Outcomes`.

The strategies `trees`, `xml_documents`, `outcomes` and `blackboards` require hypothesis; all other
names do not.
"""

from typing import TYPE_CHECKING

from btcore.registry.mock_leaves import MockAction, MockCondition, MockLeafError, Outcomes
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
from btcore.testing.leaf_replacement import with_mock_leaves
from btcore.testing.substitution_rules import (
    SubstitutionError,
    TestNode,
    TestNodeConfig,
    load_substitution_rules,
)
from btcore.testing.trace import StatusChange, Trace, TraceStep

if TYPE_CHECKING:
    from btcore.testing.strategies import blackboards, outcomes, trees, xml_documents

__all__ = [
    "Coverage", "Harness", "MockAction", "MockCondition", "MockLeafError", "Outcomes", "StatusChange",
    "SubstitutionError", "TestNode", "TestNodeConfig", "Trace", "TraceStep", "assert_ended",
    "assert_halted", "assert_never_ran", "assert_never_running_together", "assert_order", "assert_ran",
    "assert_results", "blackboards", "load_substitution_rules", "outcomes", "trees", "with_mock_leaves",
    "xml_documents",
]  # fmt: skip


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
