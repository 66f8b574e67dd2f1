"""Nav2's control nodes: a test for each sentence of their documentation."""

from collections.abc import Callable

import pytest

from btcore import BtcoreError, NodeExecutionError, Status
from tests.robot_nodes.navigation.nodes.conftest import Bench


def test_pipeline_ticks_earlier_children_again_while_a_later_child_runs(
    bench: Bench, plan: Callable[[str, str], str], restarting_leaf: Callable[[str, str], str]
) -> None:
    tree = bench.tree(
        f"<PipelineSequence>{restarting_leaf('a', 'S')}{plan('b', 'R')}{plan('c', 'S')}</PipelineSequence>"
    )
    assert bench.letters(tree, 3) == "RRR"
    assert bench.journal.take() == ["a:start", "b:start", "a:start", "b:running", "a:start", "b:running"]


def test_pipeline_continues_past_an_earlier_child_that_runs_again(
    bench: Bench, plan: Callable[[str, str], str], restarting_leaf: Callable[[str, str], str]
) -> None:
    tree = bench.tree(
        f"<PipelineSequence>{restarting_leaf('a', 'S|RRS')}{plan('b', 'RRRS')}</PipelineSequence>"
    )
    assert bench.letters(tree, 4) == "RRRS"
    assert [call for call in bench.journal.take() if call.startswith("b")] == [
        "b:start",
        "b:running",
        "b:running",
        "b:running",
    ]


def test_pipeline_waits_for_a_running_child_before_it_starts_the_next_child(
    bench: Bench, plan: Callable[[str, str], str]
) -> None:
    tree = bench.tree(f"<PipelineSequence>{plan('a', 'RRS')}{plan('b', 'S')}</PipelineSequence>")
    assert bench.letters(tree, 3) == "RRS"
    assert bench.journal.take() == ["a:start", "a:running", "a:running", "b:start"]


def test_pipeline_fails_and_halts_all_when_any_child_fails(
    bench: Bench, plan: Callable[[str, str], str], restarting_leaf: Callable[[str, str], str]
) -> None:
    tree = bench.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|F')}{plan('b', 'R')}</PipelineSequence>")
    assert bench.letters(tree, 2) == "RF"
    assert bench.journal.take() == ["a:start", "b:start", "a:start", "b:halted"]


def test_pipeline_halts_a_running_earlier_child_when_the_last_child_succeeds(
    bench: Bench, plan: Callable[[str, str], str], restarting_leaf: Callable[[str, str], str]
) -> None:
    tree = bench.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|R')}{plan('b', 'RS')}</PipelineSequence>")
    assert bench.letters(tree, 2) == "RS"
    assert bench.journal.take()[-2:] == ["b:running", "a:halted"]


def test_pipeline_starts_at_the_first_child_after_a_halt(
    bench: Bench, plan: Callable[[str, str], str], restarting_leaf: Callable[[str, str], str]
) -> None:
    tree = bench.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|R')}{plan('b', 'R')}</PipelineSequence>")
    bench.letters(tree, 1)
    tree.halt()
    bench.journal.take()
    assert bench.letters(tree, 1) == "R"
    assert bench.journal.take() == ["a:start"]


def test_pipeline_is_skipped_only_when_all_children_are(
    bench: Bench, plan: Callable[[str, str], str]
) -> None:
    assert (
        bench.letters(bench.tree("<PipelineSequence>" + plan("a", "K") * 2 + "</PipelineSequence>"), 1) == "S"
    )
    tree = bench.tree(f"<PipelineSequence>{plan('a', 'K')}{plan('b', 'S')}</PipelineSequence>")
    assert tree.tick_exactly_once() is Status.SUCCESS


def recovery(main: str, recovery: str, retries: str = "") -> str:
    return f"<RecoveryNode {retries}>{main}{recovery}</RecoveryNode>"


def test_recovery_retries_in_the_tick_of_the_recovery(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(recovery(plan("main", "F|S"), plan("help", "S")))
    assert bench.letters(tree, 1) == "S"
    assert bench.journal.take() == ["main:start", "help:start", "main:start"]


def test_recovery_fails_after_single_retry_by_default(bench: Bench, plan: Callable[[str, str], str]) -> None:
    assert bench.letters(bench.tree(recovery(plan("main", "F"), plan("help", "S"))), 1) == "F"
    assert bench.journal.take().count("main:start") == 2
    tree = bench.tree(recovery(plan("main", "F"), plan("help", "S"), 'number_of_retries="4"'))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take().count("main:start") == 5


def test_recovery_with_no_retries_never_recovers(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(recovery(plan("main", "F"), plan("help", "S"), 'number_of_retries="0"'))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take() == ["main:start"]


def test_recovery_fails_when_the_second_child_fails(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(recovery(plan("main", "F"), plan("help", "F"), 'number_of_retries="4"'))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take() == ["main:start", "help:start"]


def test_recovery_skips_first_child_while_second_runs(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(recovery(plan("main", "RF|S"), plan("help", "RRS")))
    assert bench.letters(tree, 4) == "RRRS"
    assert bench.journal.take() == [
        "main:start",
        "main:running",
        "help:start",
        "help:running",
        "help:running",
        "main:start",
    ]


def test_recovery_resets_count_after_success_and_halt(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(recovery(plan("main", "F|S"), plan("help", "S")))
    assert bench.letters(tree, 3) == "SSS"
    halted = bench.tree(recovery(plan("main", "F|R|F|S"), plan("help", "S")))
    assert bench.letters(halted, 1) == "R"
    halted.halt()
    assert bench.letters(halted, 1) == "S"


def test_recovery_is_skipped_with_its_first_child(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(
        f"<Fallback>{recovery(plan('main', 'K'), plan('help', 'S'))}{plan('next', 'F')}</Fallback>"
    )
    assert tree.tick_exactly_once() is Status.FAILURE
    assert "help:start" not in bench.journal.take()


def test_skipped_second_child_is_failure_and_not_retry(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(recovery(plan("main", "F|F|S"), plan("help", "K|S")))
    assert bench.letters(tree, 1) == "F"
    assert bench.letters(tree, 1) == "S"


def test_recovery_needs_two_children(bench: Bench, plan: Callable[[str, str], str]) -> None:
    with pytest.raises(BtcoreError, match="two children"):
        bench.tree(f"<RecoveryNode>{plan('main', 'S')}</RecoveryNode>")


def robin(*children: str, wrap: bool = True) -> str:
    return f'<RoundRobin wrap_around="{str(wrap).lower()}">{"".join(children)}</RoundRobin>'


def test_round_robin_ticks_next_child_after_success(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(robin(plan("a", "S"), plan("b", "S"), plan("c", "S")))
    assert bench.letters(tree, 4) == "SSSS"
    assert bench.journal.take() == ["a:start", "b:start", "c:start", "a:start"]


def test_round_robin_stays_with_a_child_that_runs(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(robin(plan("a", "RS"), plan("b", "S")))
    assert bench.letters(tree, 3) == "RSS"
    assert bench.journal.take() == ["a:start", "a:running", "b:start"]


def test_round_robin_ticks_the_next_child_in_the_same_tick_after_a_failure(
    bench: Bench, plan: Callable[[str, str], str]
) -> None:
    tree = bench.tree(robin(plan("a", "F"), plan("b", "S"), plan("c", "S")))
    assert bench.letters(tree, 1) == "S"
    assert bench.journal.take() == ["a:start", "b:start"]


def test_round_robin_fails_when_all_have_failed(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(robin(plan("a", "F"), plan("b", "F")))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take() == ["a:start", "b:start"]


def test_round_robin_forgets_failures_after_success(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(robin(plan("a", "F"), plan("b", "S|F"), plan("c", "F")))
    assert bench.letters(tree, 2) == "SF"
    assert bench.journal.take() == ["a:start", "b:start", "c:start", "a:start", "b:start"]


def test_round_robin_without_wrapping_fails_at_end(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(robin(plan("a", "S"), plan("b", "S"), wrap=False))
    assert bench.letters(tree, 3) == "SFS"
    assert bench.journal.take() == ["a:start", "b:start", "a:start"]


def test_round_robin_does_not_wrap_by_default(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(f"<RoundRobin>{plan('a', 'S')}{plan('b', 'S')}</RoundRobin>")
    assert bench.letters(tree, 2) == "SF"


def test_round_robin_begins_with_the_first_child_after_a_halt(
    bench: Bench, plan: Callable[[str, str], str]
) -> None:
    tree = bench.tree(robin(plan("a", "S"), plan("b", "R")))
    bench.letters(tree, 2)
    tree.halt()
    bench.journal.take()
    bench.letters(tree, 1)
    assert bench.journal.take() == ["a:start"]


def test_nonblocking_sequence_ticks_all_in_each_tick(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(f"<NonblockingSequence>{plan('a', 'R')}{plan('b', 'R')}</NonblockingSequence>")
    assert bench.letters(tree, 2) == "RR"
    assert bench.journal.take() == ["a:start", "b:start", "a:running", "b:running"]


def test_nonblocking_sequence_succeeds_only_when_all_succeed_in_one_tick(
    bench: Bench, plan: Callable[[str, str], str], restarting_leaf: Callable[[str, str], str]
) -> None:
    text = f"<NonblockingSequence>{restarting_leaf('a', 'S|RS')}{plan('b', 'RS')}</NonblockingSequence>"
    assert bench.letters(bench.tree(text), 3) == "RRS"


def test_nonblocking_sequence_halts_all_when_one_fails(bench: Bench, plan: Callable[[str, str], str]) -> None:
    tree = bench.tree(f"<NonblockingSequence>{plan('a', 'R')}{plan('b', 'RF')}</NonblockingSequence>")
    assert bench.letters(tree, 2) == "RF"
    assert bench.journal.take()[-1] == "a:halted"


PERSISTENT = '<PersistentSequence current_child_idx="{at}">{a}{b}</PersistentSequence>'


def test_persistent_sequence_continues_at_its_child_after_a_halt(
    bench: Bench, plan: Callable[[str, str], str]
) -> None:
    text = PERSISTENT.replace("{a}", plan("a", "S")).replace("{b}", plan("b", "R|S"))
    tree = bench.tree(text, at=0)
    assert bench.letters(tree, 1) == "R"
    tree.halt()
    bench.journal.take()
    assert tree.blackboard["at"] == 1
    assert bench.letters(tree, 1) == "S"
    assert bench.journal.take() == ["b:start"]
    assert tree.blackboard["at"] == 0


def test_persistent_sequence_restarts_after_failure(bench: Bench, plan: Callable[[str, str], str]) -> None:
    text = PERSISTENT.replace("{a}", plan("a", "S")).replace("{b}", plan("b", "F"))
    tree = bench.tree(text, at=0)
    assert bench.letters(tree, 1) == "F"
    assert tree.blackboard["at"] == 0


def test_persistent_sequence_requires_entry_with_index(bench: Bench, plan: Callable[[str, str], str]) -> None:
    text = PERSISTENT.replace("{a}", plan("a", "S")).replace("{b}", plan("b", "S"))
    with pytest.raises(NodeExecutionError, match="current_child_idx"):
        bench.tree(text).tick_exactly_once()
