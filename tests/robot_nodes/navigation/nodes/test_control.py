"""Nav2's control nodes: a test for each sentence of their documentation."""

import pytest

from btcore import BtcoreError, NodeExecutionError, Status
from tests.robot_nodes.navigation.nodes.conftest import NodeRig, act, restarting_leaf


def test_pipeline_ticks_earlier_children_again_while_a_later_child_runs(rig: NodeRig) -> None:
    tree = rig.tree(
        f"<PipelineSequence>{restarting_leaf('a', 'S')}{act('b', 'R')}{act('c', 'S')}</PipelineSequence>"
    )
    assert rig.letters(tree, 3) == "RRR"
    assert rig.calls.take() == ["a:start", "b:start", "a:start", "b:running", "a:start", "b:running"]


def test_pipeline_continues_past_an_earlier_child_that_runs_again(rig: NodeRig) -> None:
    tree = rig.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|RRS')}{act('b', 'RRRS')}</PipelineSequence>")
    assert rig.letters(tree, 4) == "RRRS"
    assert [call for call in rig.calls.take() if call.startswith("b")] == [
        "b:start",
        "b:running",
        "b:running",
        "b:running",
    ]


def test_pipeline_waits_for_a_running_child_before_it_starts_the_next_child(rig: NodeRig) -> None:
    tree = rig.tree(f"<PipelineSequence>{act('a', 'RRS')}{act('b', 'S')}</PipelineSequence>")
    assert rig.letters(tree, 3) == "RRS"
    assert rig.calls.take() == ["a:start", "a:running", "a:running", "b:start"]


def test_pipeline_fails_and_halts_all_when_any_child_fails(rig: NodeRig) -> None:
    tree = rig.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|F')}{act('b', 'R')}</PipelineSequence>")
    assert rig.letters(tree, 2) == "RF"
    assert rig.calls.take() == ["a:start", "b:start", "a:start", "b:halted"]


def test_pipeline_halts_a_running_earlier_child_when_the_last_child_succeeds(rig: NodeRig) -> None:
    tree = rig.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|R')}{act('b', 'RS')}</PipelineSequence>")
    assert rig.letters(tree, 2) == "RS"
    assert rig.calls.take()[-2:] == ["b:running", "a:halted"]


def test_pipeline_starts_at_the_first_child_after_a_halt(rig: NodeRig) -> None:
    tree = rig.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|R')}{act('b', 'R')}</PipelineSequence>")
    rig.letters(tree, 1)
    tree.halt()
    rig.calls.take()
    assert rig.letters(tree, 1) == "R"
    assert rig.calls.take() == ["a:start"]


def test_pipeline_is_skipped_only_with_all_children(rig: NodeRig) -> None:
    assert rig.letters(rig.tree("<PipelineSequence>" + act("a", "K") * 2 + "</PipelineSequence>"), 1) == "K"
    tree = rig.tree(f"<PipelineSequence>{act('a', 'K')}{act('b', 'S')}</PipelineSequence>")
    assert tree.tick_exactly_once() is Status.SUCCESS


def recovery(main: str, recovery: str, retries: str = "") -> str:
    return f"<RecoveryNode {retries}>{main}{recovery}</RecoveryNode>"


def test_recovery_retries_in_the_tick_of_the_recovery(rig: NodeRig) -> None:
    tree = rig.tree(recovery(act("main", "F|S"), act("help", "S")))
    assert rig.letters(tree, 1) == "S"
    assert rig.calls.take() == ["main:start", "help:start", "main:start"]


def test_recovery_fails_after_single_retry_by_default(rig: NodeRig) -> None:
    assert rig.letters(rig.tree(recovery(act("main", "F"), act("help", "S"))), 1) == "F"
    assert rig.calls.take().count("main:start") == 2
    tree = rig.tree(recovery(act("main", "F"), act("help", "S"), 'number_of_retries="4"'))
    assert rig.letters(tree, 1) == "F"
    assert rig.calls.take().count("main:start") == 5


def test_recovery_with_no_retries_never_recovers(rig: NodeRig) -> None:
    tree = rig.tree(recovery(act("main", "F"), act("help", "S"), 'number_of_retries="0"'))
    assert rig.letters(tree, 1) == "F"
    assert rig.calls.take() == ["main:start"]


def test_recovery_fails_when_the_second_child_fails(rig: NodeRig) -> None:
    tree = rig.tree(recovery(act("main", "F"), act("help", "F"), 'number_of_retries="4"'))
    assert rig.letters(tree, 1) == "F"
    assert rig.calls.take() == ["main:start", "help:start"]


def test_recovery_skips_first_child_while_second_runs(rig: NodeRig) -> None:
    tree = rig.tree(recovery(act("main", "RF|S"), act("help", "RRS")))
    assert rig.letters(tree, 4) == "RRRS"
    assert rig.calls.take() == [
        "main:start",
        "main:running",
        "help:start",
        "help:running",
        "help:running",
        "main:start",
    ]


def test_recovery_resets_count_after_success_and_halt(rig: NodeRig) -> None:
    tree = rig.tree(recovery(act("main", "F|S"), act("help", "S")))
    assert rig.letters(tree, 3) == "SSS"
    halted = rig.tree(recovery(act("main", "F|R|F|S"), act("help", "S")))
    assert rig.letters(halted, 1) == "R"
    halted.halt()
    assert rig.letters(halted, 1) == "S"


def test_recovery_is_skipped_with_its_first_child(rig: NodeRig) -> None:
    tree = rig.tree(f"<Fallback>{recovery(act('main', 'K'), act('help', 'S'))}{act('next', 'F')}</Fallback>")
    assert tree.tick_exactly_once() is Status.FAILURE
    assert "help:start" not in rig.calls.take()


def test_skipped_second_child_is_failure_and_not_retry(rig: NodeRig) -> None:
    tree = rig.tree(recovery(act("main", "F|F|S"), act("help", "K|S")))
    assert rig.letters(tree, 1) == "F"
    assert rig.letters(tree, 1) == "S"


def test_recovery_needs_two_children(rig: NodeRig) -> None:
    with pytest.raises(BtcoreError, match="two children"):
        rig.tree(f"<RecoveryNode>{act('main', 'S')}</RecoveryNode>")


def robin(*children: str, wrap: bool = True) -> str:
    return f'<RoundRobin wrap_around="{str(wrap).lower()}">{"".join(children)}</RoundRobin>'


def test_round_robin_ticks_next_child_after_success(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "S"), act("b", "S"), act("c", "S")))
    assert rig.letters(tree, 4) == "SSSS"
    assert rig.calls.take() == ["a:start", "b:start", "c:start", "a:start"]


def test_round_robin_stays_with_a_child_that_runs(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "RS"), act("b", "S")))
    assert rig.letters(tree, 3) == "RSS"
    assert rig.calls.take() == ["a:start", "a:running", "b:start"]


def test_round_robin_ticks_the_next_child_in_the_same_tick_after_a_failure(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "F"), act("b", "S"), act("c", "S")))
    assert rig.letters(tree, 1) == "S"
    assert rig.calls.take() == ["a:start", "b:start"]


def test_round_robin_fails_when_all_have_failed(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "F"), act("b", "F")))
    assert rig.letters(tree, 1) == "F"
    assert rig.calls.take() == ["a:start", "b:start"]


def test_round_robin_forgets_failures_after_success(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "F"), act("b", "S|F"), act("c", "F")))
    assert rig.letters(tree, 2) == "SF"
    assert rig.calls.take() == ["a:start", "b:start", "c:start", "a:start", "b:start"]


def test_round_robin_without_wrapping_fails_at_end(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "S"), act("b", "S"), wrap=False))
    assert rig.letters(tree, 3) == "SFS"
    assert rig.calls.take() == ["a:start", "b:start", "a:start"]


def test_round_robin_does_not_wrap_by_default(rig: NodeRig) -> None:
    tree = rig.tree(f"<RoundRobin>{act('a', 'S')}{act('b', 'S')}</RoundRobin>")
    assert rig.letters(tree, 2) == "SF"


def test_round_robin_begins_with_the_first_child_after_a_halt(rig: NodeRig) -> None:
    tree = rig.tree(robin(act("a", "S"), act("b", "R")))
    rig.letters(tree, 2)
    tree.halt()
    rig.calls.take()
    rig.letters(tree, 1)
    assert rig.calls.take() == ["a:start"]


def test_nonblocking_sequence_ticks_all_in_each_tick(rig: NodeRig) -> None:
    tree = rig.tree(f"<NonblockingSequence>{act('a', 'R')}{act('b', 'R')}</NonblockingSequence>")
    assert rig.letters(tree, 2) == "RR"
    assert rig.calls.take() == ["a:start", "b:start", "a:running", "b:running"]


def test_nonblocking_sequence_succeeds_only_when_all_succeed_in_one_tick(rig: NodeRig) -> None:
    text = f"<NonblockingSequence>{restarting_leaf('a', 'S|RS')}{act('b', 'RS')}</NonblockingSequence>"
    assert rig.letters(rig.tree(text), 3) == "RRS"


def test_nonblocking_sequence_halts_all_when_one_fails(rig: NodeRig) -> None:
    tree = rig.tree(f"<NonblockingSequence>{act('a', 'R')}{act('b', 'RF')}</NonblockingSequence>")
    assert rig.letters(tree, 2) == "RF"
    assert rig.calls.take()[-1] == "a:halted"


PERSISTENT = '<PersistentSequence current_child_idx="{at}">{a}{b}</PersistentSequence>'


def test_persistent_sequence_continues_at_its_child_after_a_halt(rig: NodeRig) -> None:
    text = PERSISTENT.replace("{a}", act("a", "S")).replace("{b}", act("b", "R|S"))
    tree = rig.tree(text, at=0)
    assert rig.letters(tree, 1) == "R"
    tree.halt()
    rig.calls.take()
    assert tree.blackboard["at"] == 1
    assert rig.letters(tree, 1) == "S"
    assert rig.calls.take() == ["b:start"]
    assert tree.blackboard["at"] == 0


def test_persistent_sequence_restarts_after_failure(rig: NodeRig) -> None:
    text = PERSISTENT.replace("{a}", act("a", "S")).replace("{b}", act("b", "F"))
    tree = rig.tree(text, at=0)
    assert rig.letters(tree, 1) == "F"
    assert tree.blackboard["at"] == 0


def test_persistent_sequence_requires_entry_with_index(rig: NodeRig) -> None:
    text = PERSISTENT.replace("{a}", act("a", "S")).replace("{b}", act("b", "S"))
    with pytest.raises(NodeExecutionError, match="current_child_idx"):
        rig.tree(text).tick_exactly_once()
