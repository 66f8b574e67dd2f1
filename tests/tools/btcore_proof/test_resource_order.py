"""The use of resources is judged inside of ticks: who starts, uses and ends in which order."""

import pytest

from btcore import DecoratorNode, NodeSpec
from btcore.tree.drawing import to_text
from btcore_proof import ModelError
from btcore_proof.answer_text import lines_of_answer
from btcore_proof.prover import PROVED, REFUTED, Answer
from btcore_proof.standard_questions import RESOURCES
from tests.tools.btcore_proof.trees import ConditionLeaf, InstantLeaf, LastingLeaf, answers_of, prover_of


class BatteryLow(ConditionLeaf):
    pass


class Charge(LastingLeaf):
    spec = NodeSpec(uses=frozenset({"wheels"}))


class Drive(Charge):
    pass


class Brake(InstantLeaf):
    spec = NodeSpec(uses=frozenset({"wheels"}))


def answer_about(body: str, declared: dict[str, dict[str, object]] | None = None) -> Answer:
    prover = prover_of(body, leaves=(BatteryLow, Charge, Drive, Brake), declared=declared)
    return answers_of(prover)[RESOURCES]


HAND_OVER = "<ReactiveFallback><Sequence><BatteryLow/><Charge/></Sequence><Drive/></ReactiveFallback>"
BOTH_RUN = '<Parallel success_count="2" failure_count="1"><Drive/><Charge/></Parallel>'
HANDS_OVER = {"Drive": {"hands_over": True}}


def test_the_reactive_hand_over_is_refuted_and_its_order_is_shown() -> None:
    answer = answer_about(HAND_OVER)
    assert answer.answer == REFUTED
    assert answer.detail == "'Charge::4' starts before 'Drive::5' is halted, and both use wheels"
    assert answer.counterexample is not None
    last = answer.counterexample.ticks[-1]
    order = [(leaf.name, leaf.result.name) for leaf in last.events]
    assert order[-2:] == [("Charge", "SUCCESS"), ("Drive", "IDLE")]
    assert last.halted == ["Drive::5"]
    assert "Charge SUCCESS, Drive halted" in to_text(lines_of_answer(answer))


@pytest.mark.parametrize(
    ("body", "declared", "expected"),
    [
        ("<Sequence><Drive/><Charge/><Brake/></Sequence>", {}, PROVED),
        # An action of one tick uses the wheels while another drives.
        ('<Parallel><Sequence><Sleep msec="9"/><Brake/></Sequence><Drive/></Parallel>', {}, REFUTED),
        # The second action starts before the first one completes, later in the same tick.
        (
            '<Parallel><Sequence><Sleep msec="9"/><Charge/></Sequence>'
            '<Sequence><Drive/><Sleep msec="9"/></Sequence></Parallel>',
            {},
            REFUTED,
        ),
        (HAND_OVER, HANDS_OVER, PROVED),
        # What hands over is not halted, but runs on beside the other; or it is ticked again before its halt.
        (BOTH_RUN, HANDS_OVER, REFUTED),
        (
            "<ReactiveFallback><Sequence><BatteryLow/><Charge/></Sequence>"
            '<Parallel success_count="2"><Sequence><Sleep msec="9"/><Brake/></Sequence><Drive/></Parallel>'
            "</ReactiveFallback>",
            HANDS_OVER,
            REFUTED,
        ),
    ],
)
def test_leaves_use_resources_from_their_start_to_their_end(
    body: str, declared: dict[str, dict[str, object]], expected: str
) -> None:
    answer = answer_about(body, declared)
    assert answer.answer == expected, answer.detail


def test_a_decorator_cannot_use_resources() -> None:
    keep = type("Keep", (DecoratorNode,), {})
    with pytest.raises(ModelError, match="a decorator uses no resources"):
        prover_of("<AlwaysSuccess/>", leaves=[keep], declared={"Keep": {"uses": ["wheels"]}})
