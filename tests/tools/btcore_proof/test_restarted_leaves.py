"""A leaf that completes and is started again within one tick does not count as a leaf that kept running."""

from btcore import NodeSpec, Registry, Status, loads
from btcore.clock import Clock
from btcore.engine.leaf import StatefulAction, SyncAction
from btcore.tree.tree import Tree
from btcore_proof.model_leaves import Choices, with_model_leaves
from btcore_proof.propositions import parse_question
from btcore_proof.prover import PROVED, REFUTED, Prover
from btcore_proof.standard_questions import RESOURCES


class Drive(StatefulAction):
    """Drives; it lasts at least until the second tick."""

    spec = NodeSpec(uses=frozenset({"base"}), may_complete_on_start=False)

    def on_start(self) -> Status:
        """Never called in a proof."""
        raise AssertionError

    on_running = on_start


class Turn(SyncAction):
    """Turns."""

    spec = NodeSpec(uses=frozenset({"base"}))

    def tick(self) -> Status:
        """Never called in a proof."""
        raise AssertionError


def answers(xml: str, *questions: str) -> dict[str, str]:
    nodes = Registry.standard()
    nodes.add(Drive)
    nodes.add(Turn)
    models = with_model_leaves(nodes, {})

    def make(choices: Choices, clock: Clock) -> Tree:
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{xml}</BehaviorTree></root>'
        return loads(text, nodes=models, resources=[choices], clock=clock)

    prover = Prover(make, [parse_question(question) for question in questions])
    return {answer.question: answer.answer for answer in prover.answer().answers}


def test_a_leaf_that_is_started_again_after_another_leaf_does_not_run_beside_it():
    # In one tick Drive completes, Turn completes, and the loop starts Drive again.
    found = answers('<Repeat num_cycles="3"><Sequence><Drive/><Turn/></Sequence></Repeat>')
    assert found[RESOURCES] == PROVED


def test_two_leaves_that_run_at_once_share_a_resource():
    assert answers("<Parallel><Drive/><Turn/></Parallel>")[RESOURCES] == REFUTED


def test_a_leaf_that_completes_and_starts_again_in_each_tick_is_not_stuck():
    # In the cycle in which Drive succeeds and starts again in every tick, Turn never runs.
    xml = '<Fallback><Repeat num_cycles="-1"><Drive/></Repeat><Turn/></Fallback>'
    question = "Drive leads to Turn ticked"
    assert answers(xml, question)[question] == REFUTED
