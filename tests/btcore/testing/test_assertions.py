"""Assertions about traces: what they check, and the message of a failed assertion."""

from collections.abc import Callable

import pytest

from btcore import BtcoreError, Status
from btcore.testing import (
    Harness,
    assert_ended,
    assert_halted,
    assert_never_ran,
    assert_never_running_together,
    assert_order,
    assert_ran,
    assert_results,
)

Patrol = Callable[..., Harness]


def message(failed: pytest.ExceptionInfo[AssertionError]) -> list[str]:
    return str(failed.value).splitlines()


def test_ticked_node_ran(patrol: Patrol) -> None:
    harness = patrol("S|RS")
    harness.tick()
    assert_ran(harness, "BatteryOk", "out")
    assert_ran(harness.trace, "round/out")
    assert_never_ran(harness, "note", "back")


def test_the_message_shows_the_ticks_and_the_tree(patrol: Patrol) -> None:
    harness = patrol("S|RS")
    harness.tick()
    with pytest.raises(AssertionError) as failed:
        assert_ran(harness, "out", "back")
    assert message(failed) == [
        "'back' never ran in 1 tick",
        "tick 1, at 0 s: RUNNING",
        "    patrol: IDLE → RUNNING",
        "    BatteryOk::2: IDLE → SUCCESS",
        "    round: IDLE → RUNNING",
        "    round/way: IDLE → RUNNING",
        "    round/out: IDLE → RUNNING",
        "    BatteryOk::2: SUCCESS → IDLE",
        "↻ patrol  ReactiveSequence  ▶ RUNNING  returned RUNNING",
        "├── ◦ BatteryOk  ○ IDLE  returned SUCCESS",
        "└── ▣ round  SubTree  ▶ RUNNING  returned RUNNING",
        "    └── → way  Sequence  ▶ RUNNING  returned RUNNING",
        "        ├── ▪ out  Drive  ▶ RUNNING  returned RUNNING",
        "        ├── § note  Script  ○ IDLE",
        "        └── ▪ back  Drive  ○ IDLE",
    ]


def test_long_trace_is_cut_to_its_last_steps(patrol: Patrol) -> None:
    harness = patrol("S|" + "R" * 20 + "S")
    harness.tick(9)
    with pytest.raises(AssertionError, match="never ran in 9 ticks\n4 steps before\ntick 5"):
        assert_ran(harness, "back")


def test_a_node_that_was_only_skipped_did_not_run() -> None:
    harness = Harness.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main">'
        '<AlwaysSuccess name="a" _skipIf="true"/></BehaviorTree></root>'
    )
    harness.tick()
    assert_never_ran(harness, "a")
    with pytest.raises(AssertionError, match="'a' never ran"):
        assert_ran(harness, "a")


def test_unexpected_node_is_shown_at_its_first_tick(patrol: Patrol) -> None:
    harness = patrol("F|S|RRRS")
    harness.tick(3)
    with pytest.raises(AssertionError) as failed:
        assert_never_ran(harness, "out")
    assert message(failed)[:2] == ["'out' ran, first in tick 2", "tick 2, at 0 s: RUNNING"]


def test_assert_order_compares_the_order_of_starts(patrol: Patrol) -> None:
    harness = patrol("S")
    harness.tick()
    assert_order(harness, "BatteryOk", "out", "note", "back")
    with pytest.raises(
        AssertionError, match=r"order 'round/out', 'round/back', not 'round/back', 'round/out'"
    ):
        assert_order(harness, "back", "out")


def test_assert_order_fails_for_a_node_that_never_ran(patrol: Patrol) -> None:
    harness = patrol("S|F")
    harness.tick()
    with pytest.raises(AssertionError, match="'round/back' never ran"):
        assert_order(harness, "out", "back")


def test_assert_results_compares_the_results_of_all_ticks(patrol: Patrol) -> None:
    harness = patrol("S|RS|S|F")
    harness.tick(2)
    assert_results(harness, "out", [Status.RUNNING, Status.SUCCESS])
    with pytest.raises(AssertionError, match="'out' returned RUNNING, SUCCESS, not nothing"):
        assert_results(harness, "out", [])


def test_assert_halted_requires_a_halted_running_node(patrol: Patrol) -> None:
    harness = patrol("S|RRRS|F")
    harness.tick()
    with pytest.raises(AssertionError, match="'out' was never halted in 1 tick"):
        assert_halted(harness, "out")
    harness.tick()
    assert_halted(harness, "out", "round")
    with pytest.raises(AssertionError, match="'back' was never halted"):
        assert_halted(harness, "back")


def test_a_halt_by_the_test_counts_without_another_tick(patrol: Patrol) -> None:
    harness = patrol("S|RRRS")
    harness.tick()
    harness.tree.halt()
    assert_halted(harness, "out")


def test_assert_never_running_together_names_the_nodes_and_the_tick() -> None:
    harness = Harness.loads(
        '<root BTCPP_format="4"><BehaviorTree ID="Main"><Parallel>'
        '<Sleep name="a" msec="50"/><Sleep name="b" msec="20"/><AlwaysSuccess/>'
        "</Parallel></BehaviorTree></root>"
    )
    harness.run()
    assert_never_running_together(harness, "a", "AlwaysSuccess")
    with pytest.raises(AssertionError, match="'a', 'b' were RUNNING together after tick 1"):
        assert_never_running_together(harness, "a", "b")


def test_assert_ended_compares_the_last_status(patrol: Patrol) -> None:
    harness = patrol("S|F")
    with pytest.raises(AssertionError, match="was never ticked"):
        assert_ended(harness, Status.FAILURE)
    harness.tick()
    assert_ended(harness, Status.FAILURE)
    harness.halt()
    with pytest.raises(AssertionError, match="the tree ended with FAILURE, not SUCCESS"):
        assert_ended(harness, Status.SUCCESS)


def test_unknown_node_name_is_an_error_in_the_test(patrol: Patrol) -> None:
    harness = patrol("S")
    with pytest.raises(BtcoreError, match="no node 'bak'; did you mean 'back'"):
        assert_ran(harness, "bak")
