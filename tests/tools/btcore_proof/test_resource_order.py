"""The use of resources is judged inside of ticks: who starts, uses and ends in which order."""

import pytest

from btcore import Condition, DecoratorNode, NodeSpec, Registry, StatefulAction, Status, SyncAction, loads
from btcore.clock import Clock
from btcore.tree.drawing import to_text
from btcore.tree.tree import Tree
from btcore_proof import ModelError
from btcore_proof.answer_text import lines_of_answer
from btcore_proof.model_leaves import Choices, with_model_leaves
from btcore_proof.prover import PROVED, REFUTED, Answer, Prover
from btcore_proof.standard_questions import RESOURCES


class BatteryLow(Condition):
    """Checks the battery."""

    def tick(self) -> bool:
        """Never called in a proof."""
        raise AssertionError


class Charge(StatefulAction):
    """Drives to the charger."""

    spec = NodeSpec(uses=frozenset({"wheels"}))

    def on_start(self) -> Status:
        """Never called in a proof."""
        raise AssertionError

    on_running = on_start


class Drive(Charge):
    """Drives."""


class Brake(SyncAction):
    """Stops the wheels."""

    spec = NodeSpec(uses=frozenset({"wheels"}))

    def tick(self) -> Status:
        """Never called in a proof."""
        raise AssertionError


def answer_about(body: str, declared: dict[str, dict[str, object]] | None = None) -> Answer:
    nodes = Registry.standard()
    for leaf in (BatteryLow, Charge, Drive, Brake):
        nodes.add(leaf)
    models = with_model_leaves(nodes, declared or {})

    def make(choices: Choices, clock: Clock) -> Tree:
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{body}</BehaviorTree></root>'
        return loads(text, nodes=models, resources=[choices], clock=clock)

    answers = {answer.question: answer for answer in Prover(make).answer().answers}
    return answers[RESOURCES]


HAND_OVER = "<ReactiveFallback><Sequence><BatteryLow/><Charge/></Sequence><Drive/></ReactiveFallback>"
BOTH_RUN = '<Parallel success_count="2" failure_count="1"><Drive/><Charge/></Parallel>'
HANDS_OVER = {"Drive": {"hands_over": True}}


def test_the_reactive_hand_over_is_refuted_and_its_order_is_shown():
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
        (
            '<Parallel><Sequence><Sleep msec="9"/><Brake/></Sequence><Drive/></Parallel>',
            {},
            REFUTED,
        ),
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
):
    answer = answer_about(body, declared)
    assert answer.answer == expected, answer.detail


def test_a_decorator_cannot_use_resources():
    class Keep(DecoratorNode):
        """Ticks its child."""

    nodes = Registry.standard()
    nodes.add(Keep)
    with pytest.raises(ModelError, match="a decorator uses no resources"):
        with_model_leaves(nodes, {"Keep": {"uses": ["wheels"]}})
