"""Sequences and fallbacks: rules that the recorded cases do not cover."""

import pytest

from btcore import NodeSpec, Status
from btcore.nodes.sequences_and_fallbacks import OrderedNode, ReactiveNode, ReactiveSequence, Sequence
from tests.btcore.conftest import TreeFactory
from tests.conformance.recorded_cases import CallLog

R, S, F = Status.RUNNING, Status.SUCCESS, Status.FAILURE

LEAVES = '<Act name="a" outcomes="{}"/><Act name="b" outcomes="{}"/>'


@pytest.mark.parametrize("base", [OrderedNode, Sequence, ReactiveNode, ReactiveSequence])
@pytest.mark.parametrize(
    ("letters", "result", "ticked"), [("FS", S, ["a", "b"]), ("SF", S, ["a"]), ("FF", F, ["a", "b"])]
)
def test_subclass_may_continue_after_a_failure(
    base: type, letters: str, result: Status, ticked: list[str], make_tree: TreeFactory, calls: CallLog
) -> None:
    own = type("Own", (base,), {"spec": NodeSpec(continue_on=F)})
    assert make_tree(f"<Own>{LEAVES.format(*letters)}</Own>", own).tick_once() is result
    assert calls == [f"{name}:start" for name in ticked]


@pytest.mark.parametrize(
    ("tag", "outcomes", "first"),
    [
        ("Sequence", "S", "a"),
        ("AsyncSequence", "S", "a"),
        ("ReactiveSequence", "S", "a"),
        ("Fallback", "F", "a"),
        ("AsyncFallback", "F", "a"),
        ("ReactiveFallback", "F", "a"),
        ("SequenceWithMemory", "S", "b"),
    ],
)
def test_first_child_that_is_ticked_after_a_halt(
    tag: str, outcomes: str, first: str, make_tree: TreeFactory, calls: CallLog
) -> None:
    tree = make_tree(f'<{tag}><Act name="a" outcomes="{outcomes}"/><Act name="b" outcomes="RRRR"/></{tag}>')
    while "b:start" not in calls:
        assert tree.tick_once() is R
    tree.halt()
    calls.clear()
    assert tree.tick_once() is R
    assert calls[0].partition(":")[0] == first
