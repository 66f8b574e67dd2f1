"""A decorator that needs resources is replaced by a model that may hold its child back, but not forever."""

from typing import Annotated

from btcore import DecoratorNode, In, Out, Status
from btcore_proof.prover import PROVED, REFUTED, UNKNOWN_ANSWER
from btcore_proof.standard_questions import ENDS, INPUTS, LEAVES
from tests.tools.btcore_proof.trees import InstantLeaf, answers_of, prover_of


class Robot:
    """A resource that no proof has."""


class WhenClose(DecoratorNode):
    """Ticks its child near a place."""

    place: Annotated[Out[str], "The place."]

    def __init__(self, robot: Robot) -> None:
        self.robot = robot

    def tick(self) -> Status:
        """Never called in a proof."""
        raise AssertionError


class Grip(InstantLeaf):
    place: Annotated[In[str], "The place."]


def test_a_model_decorator_holds_its_child_back_but_not_forever() -> None:
    answers = answers_of(
        prover_of(
            '<WhenClose place="{place}"><Grip place="{place}"/></WhenClose>',
            "WhenClose leads to Grip ticked",
            "never WhenClose & !Grip ticked",
            leaves=(WhenClose, Grip),
        )
    )
    assert answers[ENDS].answer == PROVED
    assert answers[INPUTS].answer == PROVED  # the decorator has written {place} before its child is ticked
    assert answers["WhenClose leads to Grip ticked"].answer == PROVED
    held = answers["never WhenClose & !Grip ticked"]
    assert held.answer == REFUTED
    assert held.counterexample is not None
    assert [leaf.path for leaf in held.counterexample.ticks[0].leaves] == ["WhenClose::1"]


class IfLonger(DecoratorNode):
    """Ticks its child if a value, which proofs do not know, is long."""

    value: Annotated[In[str], "The value."]

    def tick(self) -> Status:
        """Compare the value; a proof that runs this code must not take it for a short one."""
        is_long = isinstance(self.value, str) and len(self.value) > 3
        return self.child.execute_tick() if is_long else Status.SUCCESS


class Find(InstantLeaf):
    value: Annotated[Out[str], "The value."]


def answers_about(declared: dict[str, dict[str, object]]) -> dict[str, str]:
    body = '<Find value="{v}"/><IfLonger value="{v}"><Grip place="{v}"/></IfLonger>'
    questions = [f"never {text}" for text in ("Grip ticked", "IfLonger is SUCCESS", "IfLonger")]
    prover = prover_of(
        f"<Sequence>{body}</Sequence>", *questions, leaves=(IfLonger, Find, Grip), declared=declared
    )
    return {question: answer.answer for question, answer in answers_of(prover).items()}


def test_code_that_looks_at_an_unknown_value_makes_answers_unknown() -> None:
    assert set(answers_about({}).values()) == {UNKNOWN_ANSWER}


def test_a_declared_decorator_may_return_a_result_without_its_child() -> None:
    answers = answers_about({"IfLonger": {"results": ["SUCCESS"]}})
    assert [answers[LEAVES], answers[INPUTS]] == [PROVED, PROVED]
    assert answers["never Grip ticked"] == answers["never IfLonger is SUCCESS"] == REFUTED
    assert answers["never IfLonger"] == PROVED
    holding = answers_about({"IfLonger": {"results": ["FAILURE", "RUNNING"]}})
    assert holding["never IfLonger"] == REFUTED
