"""Properties of trees with subtrees, scripts, conditions and time, drawn by the public test kit."""

from hypothesis import assume, event, given
from hypothesis import strategies as st

import btcore
from btcore import NodeType, SimClock, Status, Tree
from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import Format3Blackboard
from btcore.loading.tree_xml import tree_to_xml
from btcore.nodes.sequences_and_fallbacks import ReactiveNode
from btcore.testing import Harness, Outcomes, TraceStep, outcomes, trees
from btcore.testing.tree_generator import BUILTIN_MANIFESTS

DONE = (Status.SUCCESS, Status.FAILURE)
LEAVES = (NodeType.ACTION, NodeType.CONDITION)
INNER = {
    node.id for format in (3, 4) for node in BUILTIN_MANIFESTS[format].values() if node.type not in LEAVES
}
CLEAN = INNER - {"IfThenElse", "RunOnce", "SequenceWithMemory", "SequenceStar"}

everything = trees(max_nodes=30, timed=True, subtrees=2, conditions=True, scripts=True)
with_reactive = trees(timed=True, subtrees=2, conditions=True, tags=INNER)
format_3 = trees(max_nodes=30, timed=True, subtrees=2, format=3)


def running_leaves(tree: Tree) -> list[str]:
    return [node.path for node in tree if node.type in LEAVES and node.status is Status.RUNNING]


def steps(tree: Tree, plan: Outcomes, ticks: int) -> list[TraceStep]:
    """Return the trace of *ticks* ticks."""
    harness = Harness(tree)
    plan.drive(tree, ticks)
    return harness.trace.steps


@given(
    st.one_of(st.tuples(everything, outcomes(skipped=True)), st.tuples(format_3, outcomes())),
    st.integers(1, 12),
)
def test_completed_tree_is_idle_and_has_no_running_leaves(planned: tuple[Tree, Outcomes], ticks: int) -> None:
    tree, plan = planned
    plan.attach(tree)
    for _ in range(ticks):
        status = tree.tick_exactly_once()
        assert status is not Status.IDLE
        if status in DONE:
            event("completed")
            assert tree.root.status is Status.IDLE
            assert running_leaves(tree) == []
        tree.sleep(0.01)


@given(
    st.one_of(
        trees(skipped=False, tags=CLEAN, subtrees=2, conditions=True), trees(tags=CLEAN, subtrees=2, format=3)
    ),
    outcomes(),
    st.integers(1, 10),
)
def test_nodes_are_idle_after_end_without_memory_and_skips(tree: Tree, plan: Outcomes, ticks: int) -> None:
    plan.attach(tree)
    for _ in range(ticks):
        if tree.tick_exactly_once() in DONE:
            event("completed")
            assert {node.path: node.status for node in tree if node.status is not Status.IDLE} == {}
        tree.sleep(0.01)


@given(with_reactive, outcomes(skipped=True), st.integers(1, 12))
def test_reactive_node_never_has_two_running_children(tree: Tree, plan: Outcomes, ticks: int) -> None:
    reactive = [node for node in tree if isinstance(node, ReactiveNode)]
    assume(reactive)
    plan.attach(tree)
    for _ in range(ticks):
        tree.tick_exactly_once()
        tree.sleep(0.01)
        for node in reactive:
            assert [child.status for child in node.children].count(Status.RUNNING) <= 1


@given(everything, outcomes(skipped=True), st.integers(1, 10))
def test_observed_tree_does_the_same_as_an_unobserved_tree(tree: Tree, plan: Outcomes, ticks: int) -> None:
    alone = reload_tree(tree)
    plan.attach(alone)
    happened = []
    for _ in range(ticks):
        happened.append((alone.tick_exactly_once(), [node.status for node in alone]))
        alone.sleep(0.01)
    assert [(step.status, list(step.statuses.values())) for step in steps(tree, plan, ticks)] == happened
    assert entries_of(tree.blackboard) == entries_of(alone.blackboard)


@given(st.one_of(everything, format_3), outcomes(), st.integers(1, 10))
def test_tree_written_to_xml_and_read_again_ticks_the_same(tree: Tree, plan: Outcomes, ticks: int) -> None:
    other = reload_tree(tree)
    assert [(node.uid, node.id) for node in other] == [(node.uid, node.id) for node in tree]
    for step, same in zip(steps(tree, plan, ticks), steps(other, plan, ticks), strict=True):
        assert (step.tick, step.stamp, step.status) == (same.tick, same.stamp, same.status)
        assert [(change.previous, change.status) for change in step.changes] == [
            (change.previous, change.status) for change in same.changes
        ]
        assert list(step.statuses.values()) == list(same.statuses.values())
        assert list(step.results.values()) == list(same.results.values())
        assert list(step.written.values()) == list(same.written.values())


def reload_tree(tree: Tree) -> Tree:
    """Return a new tree from the XML of *tree*, which has not been ticked."""
    clock = SimClock()
    board = Blackboard(clock=clock) if tree.format == 4 else Format3Blackboard(clock=clock)
    for key, value in entries_of(tree.blackboard).items():
        board[key] = value
    text = tree_to_xml(tree, metadata=False, builtin_models=False)
    return btcore.loads(
        text, nodes=tree.registry, tree=tree.id, format=tree.format, blackboard=board, clock=clock
    )


def entries_of(board: Blackboard) -> dict[str, object]:
    return {key: board[key] for key in board}
