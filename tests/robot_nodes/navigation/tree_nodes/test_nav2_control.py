"""Nav2's control nodes: a test for each sentence of their documentation."""

import pytest

from btcore import BtcoreError, NodeExecutionError, Status


def test_pipeline_ticks_what_comes_before_again_while_the_later_runs(bench, plan, restarting_leaf):
    tree = bench.tree(
        f"<PipelineSequence>{restarting_leaf('a', 'S')}{plan('b', 'R')}{plan('c', 'S')}</PipelineSequence>"
    )
    assert bench.letters(tree, 3) == "RRR"
    assert bench.journal.take() == ["a:start", "b:start", "a:start", "b:running", "a:start", "b:running"]


def test_pipeline_goes_on_past_an_earlier_child_that_runs_again(bench, plan, restarting_leaf):
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


def test_pipeline_waits_for_a_child_that_runs_before_any_later_was_reached(bench, plan):
    tree = bench.tree(f"<PipelineSequence>{plan('a', 'RRS')}{plan('b', 'S')}</PipelineSequence>")
    assert bench.letters(tree, 3) == "RRS"
    assert bench.journal.take() == ["a:start", "a:running", "a:running", "b:start"]


def test_pipeline_fails_and_halts_all_when_any_child_fails(bench, plan, restarting_leaf):
    tree = bench.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|F')}{plan('b', 'R')}</PipelineSequence>")
    assert bench.letters(tree, 2) == "RF"
    assert bench.journal.take() == ["a:start", "b:start", "a:start", "b:halted"]


def test_pipeline_halts_an_earlier_child_that_still_runs_when_the_last_succeeds(bench, plan, restarting_leaf):
    tree = bench.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|R')}{plan('b', 'RS')}</PipelineSequence>")
    assert bench.letters(tree, 2) == "RS"
    assert bench.journal.take()[-2:] == ["b:running", "a:halted"]


def test_pipeline_forgets_how_far_it_came_when_it_is_halted(bench, plan, restarting_leaf):
    tree = bench.tree(f"<PipelineSequence>{restarting_leaf('a', 'S|R')}{plan('b', 'R')}</PipelineSequence>")
    bench.letters(tree, 1)
    tree.halt()
    bench.journal.take()
    assert bench.letters(tree, 1) == "R"
    assert bench.journal.take() == ["a:start"]


def test_pipeline_is_skipped_only_when_all_are(bench, plan):
    assert (
        bench.letters(bench.tree("<PipelineSequence>" + plan("a", "K") * 2 + "</PipelineSequence>"), 1) == "S"
    )
    tree = bench.tree(f"<PipelineSequence>{plan('a', 'K')}{plan('b', 'S')}</PipelineSequence>")
    assert tree.tick_exactly_once() is Status.SUCCESS


def recovery(main: str, recovery: str, retries: str = "") -> str:
    return f"<RecoveryNode {retries}>{main}{recovery}</RecoveryNode>"


def test_recovery_tries_again_in_the_tick_in_which_the_recovery_succeeds(bench, plan):
    tree = bench.tree(recovery(plan("main", "F|S"), plan("help", "S")))
    assert bench.letters(tree, 1) == "S"
    assert bench.journal.take() == ["main:start", "help:start", "main:start"]


def test_recovery_gives_up_after_one_retry_unless_told_otherwise(bench, plan):
    assert bench.letters(bench.tree(recovery(plan("main", "F"), plan("help", "S"))), 1) == "F"
    assert bench.journal.take().count("main:start") == 2
    tree = bench.tree(recovery(plan("main", "F"), plan("help", "S"), 'number_of_retries="4"'))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take().count("main:start") == 5


def test_recovery_with_no_retries_never_recovers(bench, plan):
    tree = bench.tree(recovery(plan("main", "F"), plan("help", "S"), 'number_of_retries="0"'))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take() == ["main:start"]


def test_recovery_fails_when_the_recovery_fails(bench, plan):
    tree = bench.tree(recovery(plan("main", "F"), plan("help", "F"), 'number_of_retries="4"'))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take() == ["main:start", "help:start"]


def test_recovery_leaves_the_first_child_alone_while_the_second_runs(bench, plan):
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


def test_recovery_counts_anew_after_a_success_and_after_a_halt(bench, plan):
    tree = bench.tree(recovery(plan("main", "F|S"), plan("help", "S")))
    assert bench.letters(tree, 3) == "SSS"
    halted = bench.tree(recovery(plan("main", "F|R|F|S"), plan("help", "S")))
    assert bench.letters(halted, 1) == "R"
    halted.halt()
    assert bench.letters(halted, 1) == "S"


def test_recovery_is_skipped_with_its_first_child(bench, plan):
    tree = bench.tree(
        f"<Fallback>{recovery(plan('main', 'K'), plan('help', 'S'))}{plan('next', 'F')}</Fallback>"
    )
    assert tree.tick_exactly_once() is Status.FAILURE
    assert "help:start" not in bench.journal.take()


def test_a_skipped_recovery_is_a_failure_that_counts_as_no_retry(bench, plan):
    tree = bench.tree(recovery(plan("main", "F|F|S"), plan("help", "K|S")))
    assert bench.letters(tree, 1) == "F"
    assert bench.letters(tree, 1) == "S"


def test_recovery_needs_two_children(bench, plan):
    with pytest.raises(BtcoreError, match="two children"):
        bench.tree(f"<RecoveryNode>{plan('main', 'S')}</RecoveryNode>")


def robin(*children: str, wrap: bool = True) -> str:
    return f'<RoundRobin wrap_around="{str(wrap).lower()}">{"".join(children)}</RoundRobin>'


def test_round_robin_gives_the_next_child_its_turn_after_a_success(bench, plan):
    tree = bench.tree(robin(plan("a", "S"), plan("b", "S"), plan("c", "S")))
    assert bench.letters(tree, 4) == "SSSS"
    assert bench.journal.take() == ["a:start", "b:start", "c:start", "a:start"]


def test_round_robin_stays_with_a_child_that_runs(bench, plan):
    tree = bench.tree(robin(plan("a", "RS"), plan("b", "S")))
    assert bench.letters(tree, 3) == "RSS"
    assert bench.journal.take() == ["a:start", "a:running", "b:start"]


def test_round_robin_passes_a_failure_on_within_the_tick(bench, plan):
    tree = bench.tree(robin(plan("a", "F"), plan("b", "S"), plan("c", "S")))
    assert bench.letters(tree, 1) == "S"
    assert bench.journal.take() == ["a:start", "b:start"]


def test_round_robin_fails_when_all_have_failed(bench, plan):
    tree = bench.tree(robin(plan("a", "F"), plan("b", "F")))
    assert bench.letters(tree, 1) == "F"
    assert bench.journal.take() == ["a:start", "b:start"]


def test_round_robin_that_does_not_wrap_fails_with_the_result_of_its_last_child(bench, plan):
    tree = bench.tree(robin(plan("a", "S"), plan("b", "S"), wrap=False))
    assert bench.letters(tree, 3) == "SFS"
    assert bench.journal.take() == ["a:start", "b:start", "a:start"]


def test_round_robin_does_not_wrap_unless_told_to(bench, plan):
    tree = bench.tree(f"<RoundRobin>{plan('a', 'S')}{plan('b', 'S')}</RoundRobin>")
    assert bench.letters(tree, 2) == "SF"


def test_round_robin_begins_with_the_first_child_after_a_halt(bench, plan):
    tree = bench.tree(robin(plan("a", "S"), plan("b", "R")))
    bench.letters(tree, 2)
    tree.halt()
    bench.journal.take()
    bench.letters(tree, 1)
    assert bench.journal.take() == ["a:start"]


def test_nonblocking_sequence_ticks_every_child_whatever_the_others_do(bench, plan):
    tree = bench.tree(f"<NonblockingSequence>{plan('a', 'R')}{plan('b', 'R')}</NonblockingSequence>")
    assert bench.letters(tree, 2) == "RR"
    assert bench.journal.take() == ["a:start", "b:start", "a:running", "b:running"]


def test_nonblocking_sequence_succeeds_only_when_all_do_in_one_tick(bench, plan, restarting_leaf):
    text = f"<NonblockingSequence>{restarting_leaf('a', 'S|RS')}{plan('b', 'RS')}</NonblockingSequence>"
    assert bench.letters(bench.tree(text), 3) == "RRS"


def test_nonblocking_sequence_fails_and_halts_all_when_one_fails(bench, plan):
    tree = bench.tree(f"<NonblockingSequence>{plan('a', 'R')}{plan('b', 'RF')}</NonblockingSequence>")
    assert bench.letters(tree, 2) == "RF"
    assert bench.journal.take()[-1] == "a:halted"


PERSISTENT = '<PersistentSequence current_child_idx="{at}">{a}{b}</PersistentSequence>'


def test_persistent_sequence_goes_on_after_a_halt_where_it_was(bench, plan):
    text = PERSISTENT.replace("{a}", plan("a", "S")).replace("{b}", plan("b", "R|S"))
    tree = bench.tree(text, at=0)
    assert bench.letters(tree, 1) == "R"
    tree.halt()
    bench.journal.take()
    assert tree.blackboard["at"] == 1
    assert bench.letters(tree, 1) == "S"
    assert bench.journal.take() == ["b:start"]
    assert tree.blackboard["at"] == 0


def test_persistent_sequence_begins_anew_after_a_failure(bench, plan):
    text = PERSISTENT.replace("{a}", plan("a", "S")).replace("{b}", plan("b", "F"))
    tree = bench.tree(text, at=0)
    assert bench.letters(tree, 1) == "F"
    assert tree.blackboard["at"] == 0


def test_persistent_sequence_wants_its_place_to_be_there(bench, plan):
    text = PERSISTENT.replace("{a}", plan("a", "S")).replace("{b}", plan("b", "S"))
    with pytest.raises(NodeExecutionError, match="current_child_idx"):
        bench.tree(text).tick_exactly_once()
