"""The answers of the prover about small trees, each of which shows one rule of the search."""

from typing import Any

import pytest

import btcore
from btcore import NodeSpec
from btcore_proof.prover import PROVED, REFUTED, UNKNOWN_ANSWER, Answer
from btcore_proof.standard_questions import ENDS, EXCEPTIONS, INPUTS, LEAVES, RESOURCES
from tests.tools.btcore_proof.trees import ConditionLeaf, InstantLeaf, LastingLeaf, answers_of, prover_of


class Check(ConditionLeaf):
    pass


class Act(LastingLeaf):
    pass


class Move(Act):
    spec = NodeSpec(uses=frozenset({"base"}))


class Turn(Act):
    spec = NodeSpec(uses=frozenset({"base"}))


class Use(InstantLeaf):
    value: btcore.In[int]


def answers(body: str, *questions: str, **options: Any) -> dict[str, Answer]:
    """Return the answers about the tree *body*, by question."""
    declared: dict[str, dict[str, object]] = {"Act": {"at_once": False}, "Turn": {"results": ["SUCCESS"]}}
    leaves = (Check, Act, Move, Turn, Use)
    return answers_of(prover_of(body, *questions, leaves=leaves, declared=declared, **options))


def test_a_status_and_an_equal_number_are_different_states() -> None:
    # Status.IDLE == 0: RunOnce remembers a status, Repeat a number.
    found = answers(
        '<Sequence><Act/><Repeat num_cycles="1"><Act/></Repeat><RunOnce><Check/></RunOnce></Sequence>'
    )
    assert found[LEAVES].answer == PROVED


def test_an_exception_ends_a_run() -> None:
    found = answers(
        '<Sequence><Act/><Use value="{never_written}"/></Sequence>',
        "Act is SUCCESS leads to Use is SUCCESS",
        "Act is SUCCESS leads to Use is SUCCESS within 3 ticks",
    )
    refuted = {question for question, answer in found.items() if answer.answer == REFUTED}
    assert sum("leads to" in question for question in refuted) == 2


@pytest.mark.parametrize(
    ("body", "refuted", "error"),
    [
        (
            '<KeepRunningUntilFailure><Use value="{goal}"/></KeepRunningUntilFailure>',
            INPUTS,
            "'Use::2' reads {goal}, which is not written; "
            "if the program sets it before the first tick, use --given goal",
        ),
        (
            '<SubTree ID="Sub" inner="{goal}"/></BehaviorTree><BehaviorTree ID="Sub"><Use value="{inner}"/>',
            INPUTS,
            "'Sub::1/Use::2' reads {inner}, which is not written; "
            "if the program sets it before the first tick, use --given goal",
        ),
        (
            '<SubTree ID="Sub"/></BehaviorTree><BehaviorTree ID="Sub"><Use value="{inner}"/>',
            INPUTS,
            "'Sub::1/Use::2' reads {inner}, which is not written",
        ),
        (
            '<Sequence><Check/><Script code="n := 1 + missing"/></Sequence>',
            EXCEPTIONS,
            "'Script::3' raises ScriptError: ",
        ),
    ],
    ids=["input", "input of a subtree", "input that the program cannot set", "exception"],
)
def test_nothing_is_proved_beyond_an_error(body: str, refuted: str, error: str) -> None:
    found = answers(body, "never {goal} == 'kitchen'")
    assert found.pop(refuted).answer == REFUTED
    assert {answer.answer for answer in found.values()} == {UNKNOWN_ANSWER}
    details = {answer.detail for answer in found.values()}
    assert len(details) == 1
    assert details.pop().startswith(f"not searched beyond this error: {error}")


def test_the_shortest_run_refutes_a_limit_of_ticks() -> None:
    # The run ends in the second tick if `a` fails, and only in the third if the check fails.
    question = "a | Check is FAILURE leads to Check is SUCCESS within 5 ticks"
    answer = answers('<Sequence><Act name="a"/><Act name="b"/><Check/></Sequence>', question)[question]
    assert (answer.answer, answer.ticks) == (REFUTED, 2)


def test_an_action_that_is_started_again_in_a_tick_has_ended() -> None:
    found = answers(
        '<Repeat num_cycles="2"><Sequence><Turn name="turn"/><Move/></Sequence></Repeat>',
        "never Move & turn",
        format=3,
    )
    assert found[RESOURCES].answer == PROVED
    assert found[ENDS].answer == PROVED


def test_a_user_may_select_every_child() -> None:
    found = answers("<ManualSelector><Act/><Check/></ManualSelector>", "never Check is FAILURE", format=3)
    assert found[LEAVES].answer == PROVED
    assert found["never Check is FAILURE"].answer == REFUTED
    assert found[ENDS].answer == REFUTED  # the user selects RUNNING again and again


def test_a_tick_without_end_is_an_exception(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("btcore_proof.prover.TICK_LIMIT_S", 0.05)
    body = '<RetryUntilSuccessful num_attempts="-1"><AlwaysFailure/></RetryUntilSuccessful>'
    answer = answers(body, format=3)[EXCEPTIONS]
    assert answer.answer == REFUTED
    assert "tick limit" in answer.detail


def test_a_tree_goes_on_if_a_node_that_runs_forever_alternates_with_another() -> None:
    body = """<WhileDoElse><Check/>
        <KeepRunningUntilFailure name="patrol"><Act name="a"/></KeepRunningUntilFailure> <Act name="b"/>
    </WhileDoElse>"""
    ends = answers(body)[ENDS]
    assert ends.answer == PROVED
    assert ends.detail == "unless 'patrol' runs forever or 'Check::2' changes its result forever"


def test_time_passes_between_the_deadlines_that_a_tick_sets() -> None:
    tree = """<Parallel success_count="2">
        <Sequence> <Sleep msec="1001"/> <Act name="right"/> </Sequence>
        <Sequence> <ForceSuccess> <Check/> </ForceSuccess> <Sleep msec="1000"/> <Act name="left"/> </Sequence>
    </Parallel>"""
    question = "left before right"
    refuted = answers(tree, question)[question]
    assert refuted.answer == REFUTED
    assert refuted.counterexample is not None
    # The check takes so long that the second sleep ends after the first.
    assert refuted.counterexample.ticks[0].times[-1] > 0.001
    assumed = answers(tree, question, instant_leaves=True)[question]
    assert (assumed.answer, assumed.detail) == (PROVED, "if leaves take no time")
    # Deadlines are ordered as they were set.
    shorter_first = tree.replace("1001", "999")
    proved = answers(shorter_first, "right before left")["right before left"]
    assert (proved.answer, proved.detail) == (PROVED, "")


def test_a_deadline_that_was_pending_ends_before_a_longer_one_that_is_set_later() -> None:
    # However long the tick takes that sets the second deadline.
    tree = """<Parallel success_count="2">
        <Sequence> <Sleep msec="1000"/> <Act name="first"/> </Sequence>
        <Sequence> <Act name="slow"/> <Sleep msec="1000"/> <Act name="second"/> </Sequence>
    </Parallel>"""
    found = answers(tree, "first before second")
    assert found["first before second"].answer == PROVED


def test_a_negative_zero_and_a_zero_are_different_states() -> None:
    question = "never turn"
    body = """<Sequence>
        <Fallback>
            <Sequence> <Check/> <Script code="x := 0.0"/> </Sequence>
            <Script code="x := 0.0 * -1"/>
        </Fallback>
        <Act/>
        <IfThenElse> <ScriptCondition code="1 / x &lt; 0"/> <Turn name="turn"/> <AlwaysSuccess/> </IfThenElse>
    </Sequence>"""
    assert answers(body, question)[question].answer == REFUTED


def test_a_value_that_is_not_a_number_is_the_same_state_in_each_tick() -> None:
    body = """<KeepRunningUntilFailure>
        <ForceSuccess> <Sequence> <Script code="x := 0.0 / 0.0"/> <Act/> </Sequence> </ForceSuccess>
    </KeepRunningUntilFailure>"""
    found = answers(body)[EXCEPTIONS]
    assert (found.answer, found.states) == (PROVED, 3)
