"""Tree coverage: the nodes that ran, and the results that they returned."""

from collections.abc import Callable

import pytest

from btcore import NodeExecutionError, Status, Tree
from btcore.testing import Coverage, Harness, Outcomes

Patrol = Callable[..., Harness]


@pytest.fixture
def tree(patrol: Patrol) -> Tree:
    return patrol("S").tree


def tick(tree: Tree, outcomes: str, times: int = 1) -> None:
    Outcomes(outcomes).attach(tree)
    for _ in range(times):
        tree.tick_exactly_once()
    tree.halt()


def test_nothing_ran_before_a_tick(tree: Tree) -> None:
    coverage = Coverage()
    coverage.watch(tree)
    assert (coverage.nodes, coverage.results) == (0, 0)
    assert not any(node.ran for node in coverage.all_nodes)


def test_report_shows_every_node_with_its_results(tree: Tree) -> None:
    coverage = Coverage()
    coverage.watch(tree)
    tick(tree, "F")
    tick(tree, "S|RF|S", times=2)
    assert coverage.report().splitlines() == [
        "Main: 5 of 7 nodes ran",
        "  R·F   ReactiveSequence 'patrol'",
        "   SF     BatteryOk",
        "  R·F     SubTree 'round'",
        "  R·F       Sequence 'way'",
        "  R·F         Drive 'out'",
        "   ·          Script 'note'  (never ran)",
        "   ··         Drive 'back'  (never ran)",
        "nodes 71%, results 46%",
    ]


def test_coverage_adds_up_over_several_trees(patrol: Patrol) -> None:
    coverage = Coverage()
    for outcomes in ("F", "S", "S|F", "S|S|F"):
        tree = patrol(outcomes).tree
        coverage.watch(tree)
        tree.tick_exactly_once()
    coverage.require(nodes=1.0, results=1.0)
    assert list(coverage.trees) == ["Main"]
    assert len(coverage.all_nodes) == 7


def test_node_with_a_single_possible_result_misses_no_other(tree: Tree) -> None:
    coverage = Coverage()
    coverage.watch(tree)
    tick(tree, "S")
    seen = coverage.trees["Main"]
    assert seen["round/note"].missing_results == []
    assert seen["round/out"].missing_results == [Status.FAILURE]


def test_insufficient_coverage_fails_with_the_report(tree: Tree) -> None:
    coverage = Coverage()
    coverage.watch(tree)
    tick(tree, "S|F")
    coverage.require(nodes=0.7)
    with pytest.raises(AssertionError) as failed:
        coverage.require(nodes=0.9, results=0.5)
    message = str(failed.value)
    assert message.startswith(
        "tree coverage: 71% of the nodes ran, 90% are required; "
        "38% of the results were returned, 50% are required\n"
    )
    assert message.endswith(coverage.report())


def test_node_that_raised_has_no_result(tree: Tree) -> None:
    coverage = Coverage()
    coverage.watch(tree)
    with pytest.raises(NodeExecutionError):
        tick(tree, "S|X")
    assert coverage.trees["Main"]["round/out"].results == set()
    assert coverage.trees["Main"]["BatteryOk::2"].results == {Status.SUCCESS}


def test_a_node_that_was_only_skipped_did_not_run() -> None:
    harness = Harness.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        '<AlwaysSuccess name="a" _skipIf="true"/></BehaviorTree></root>'
    )
    coverage = Coverage()
    coverage.watch(harness.tree)
    harness.tick()
    assert coverage.nodes == 0
    assert coverage.report().splitlines()[1] == "   · K  AlwaysSuccess 'a'  (never ran)"


def test_coverage_without_a_tree_is_complete() -> None:
    coverage = Coverage()
    coverage.require(nodes=1.0, results=1.0)
    assert coverage.report() == "nodes 100%, results 100%"
