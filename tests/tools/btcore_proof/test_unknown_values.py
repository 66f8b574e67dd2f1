"""Comparisons with values that are not known: both results are searched."""

import pytest

import btcore
import btcore_proof.search
from btcore.blackboard.ports import Direction, Port
from btcore.values import INT64
from btcore_proof.answer_text import lines_of_answer
from btcore_proof.prover import POSSIBLE, PROVED, REFUTED, UNKNOWN_ANSWER, Answer
from btcore_proof.search_processes import CAN_FORK
from btcore_proof.standard_questions import ENDS, EXCEPTIONS, LEAVES
from tests.tools.btcore_proof.trees import ConditionLeaf, InstantLeaf, answers_of, prover_of


class Measure(InstantLeaf):
    level: btcore.Out[float]


class Count(InstantLeaf):
    @classmethod
    def provided_ports(cls) -> list[Port]:
        return [Port("count", Direction.OUT, type=INT64)]


class Listen(InstantLeaf):
    word: btcore.Out[str]


class Left(ConditionLeaf):
    pass


class Right(ConditionLeaf):
    pass


def answers(body: str, *questions: str, jobs: int = 1) -> dict[str, Answer]:
    """Return the answers about the tree *body*, by question."""
    declared = {id: {"results": ["SUCCESS"]} for id in ("Measure", "Count", "Listen")}
    leaves = (Measure, Count, Listen, Left, Right)
    return answers_of(prover_of(body, *questions, leaves=leaves, declared=declared), jobs)


@pytest.mark.parametrize(
    "jobs", [1, pytest.param(2, marks=pytest.mark.skipif(not CAN_FORK, reason="needs fork()"))]
)
def test_comparison_with_unknown_value_has_both_results(jobs: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(btcore_proof.search, "_FEW_STATES", 0)
    found = answers(
        '<Sequence><Measure level="{level}"/><IfThenElse><ScriptCondition code="level &lt; 20"/><Left/>'
        "<Right/></IfThenElse></Sequence>",
        "never Left ticked & Right ticked",
        "never Left ticked",
        "never Right ticked",
        "Measure is SUCCESS leads to Left ticked",
        "Measure is SUCCESS leads to Left ticked | Right ticked within 0 ticks",
        jobs=jobs,
    )
    assert found["never Left ticked & Right ticked"].answer == PROVED
    assert [found[f"never {name} ticked"].answer for name in ("Left", "Right")] == [POSSIBLE] * 2
    assert found["Measure is SUCCESS leads to Left ticked"].answer == POSSIBLE
    assert found["Measure is SUCCESS leads to Left ticked | Right ticked within 0 ticks"].answer == PROVED
    assert found[EXCEPTIONS] == found[EXCEPTIONS]._replace(answer=PROVED, detail="")
    assert found[LEAVES].answer == UNKNOWN_ANSWER
    text = "".join(part for line in lines_of_answer(found["never Right ticked"]) for part, _ in line)
    assert "(if {level} < 20 is false)" in text


def test_what_does_not_depend_on_an_unknown_value_is_refuted() -> None:
    # The exception is found first after a comparison, but it needs none.
    found = answers(
        '<Sequence><Measure level="{level}"/><ScriptCondition code="level &lt; 20 || 1 == 1"/>'
        '<ForceSuccess><Left/></ForceSuccess><Script code="b := missing"/></Sequence>',
        "never Left is FAILURE",
    )
    assert found["never Left is FAILURE"].answer == POSSIBLE
    found = answers(
        '<Parallel><Left/><Sequence><Measure level="{level}"/><ScriptCondition code="level &lt; 20"/>'
        "</Sequence></Parallel>",
        "never Left is FAILURE",
    )
    assert found["never Left is FAILURE"].answer == REFUTED


@pytest.mark.parametrize(
    ("write", "code", "detail"),
    [
        ('<Measure level="{x}"/>', "x > 3", ""),
        ('<Listen word="{x}"/>', "x == 'go'", ""),
        ('<Count count="{x}"/>', "x > 3", "if scripts can compare the values of {x}"),
        ('<Listen word="{x}"/>', "x > 3", "if scripts can compare the values of {x}"),
        ('<Sequence><Measure level="{x}"/><Listen word="{y}"/></Sequence>', "x == y", "… {x} and {y}"),
    ],
)
def test_a_comparison_that_may_be_impossible_is_named(write: str, code: str, detail: str) -> None:
    script = f'<ScriptCondition code="{code.replace(">", "&gt;")}"/>'
    answer = answers(f"<Sequence><ForceSuccess>{write}</ForceSuccess>{script}</Sequence>")[ENDS]
    assert answer.answer == PROVED
    assert answer.detail.endswith(detail.removeprefix("…"))
    assert bool(answer.detail) == bool(detail)


def test_a_comparison_with_an_entry_that_was_never_written_raises() -> None:
    found = answers(
        '<Sequence><Measure level="{x}"/><Script code="y := 1"/><UnsetBlackboard key="y"/>'
        '<ScriptCondition code="x &lt; y"/></Sequence>'
    )
    assert found[EXCEPTIONS].answer != PROVED


def test_other_uses_of_an_unknown_value_make_the_answers_unknown() -> None:
    found = answers('<Sequence><Measure level="{x}"/><ScriptCondition code="x + 1 &lt; 3"/></Sequence>')
    assert found[ENDS].answer == UNKNOWN_ANSWER
    assert found[ENDS].detail == "the value of {x} is not known: declare its domain"


def test_a_switch_selects_every_child_for_an_unknown_value() -> None:
    found = answers(
        '<Sequence><Listen word="{word}"/><Switch2 variable="{word}" case_1="left" case_2="right">'
        '<Left/><Right/><AlwaysSuccess name="Else"/></Switch2></Sequence>',
        *(f"never {name} ticked" for name in ("Left", "Right", "Else")),
        "Listen is SUCCESS leads to Left ticked | Right ticked | Else ticked within 0 ticks",
    )
    assert [answer.answer for question, answer in found.items() if "never" in question] == [POSSIBLE] * 3
    assert [answer.answer for question, answer in found.items() if "leads" in question] == [PROVED]


def test_decisions_of_two_scripts_in_a_tick_are_kept_apart() -> None:
    # Left and its two scripts decide at the same place: after Measure, before Left has ended.
    found = answers(
        '<Sequence><Measure level="{x}"/><ForceSuccess>'
        '<Left _onSuccess="a := x &gt; 3" _onFailure="b := x &gt; 4"/></ForceSuccess><Right/></Sequence>',
        "never Right ticked & {a} == 1",
        "never Right ticked & {a} == 0",
        "never Right ticked & {b} == 1",
        "never Right ticked & {b} == 0",
    )
    assert {answer.answer for question, answer in found.items() if "never" in question} == {POSSIBLE}


def test_questions_about_an_unknown_value_are_not_refuted() -> None:
    found = answers(
        '<Sequence><Measure level="{x}"/><Left/></Sequence>',
        "never {x} < 5 & Left is SUCCESS",
        "never {x} < 5 & Measure is SUCCESS",
        "Left is SUCCESS before {x} < 5",
        "Measure is SUCCESS leads to {x} < 5 within 2 ticks",
        "never !({x} < 5) & Left is FAILURE & Left is SUCCESS",
        "never Left is SUCCESS",
    )
    expected = [POSSIBLE, POSSIBLE, POSSIBLE, POSSIBLE, PROVED, REFUTED]
    assert [answer.answer for answer in found.values()][-len(expected) :] == expected
