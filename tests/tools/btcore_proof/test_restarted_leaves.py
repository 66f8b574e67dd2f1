"""A leaf that completes and is started again within one tick does not count as a leaf that kept running."""

from btcore import NodeSpec
from btcore_proof.prover import PROVED, REFUTED
from btcore_proof.standard_questions import RESOURCES
from tests.tools.btcore_proof.trees import InstantLeaf, LastingLeaf, answers_of, prover_of


class Drive(LastingLeaf):
    spec = NodeSpec(uses=frozenset({"base"}), may_complete_on_start=False)


class Turn(InstantLeaf):
    spec = NodeSpec(uses=frozenset({"base"}))


def answers(xml: str, *questions: str) -> dict[str, str]:
    found = answers_of(prover_of(xml, *questions, leaves=(Drive, Turn)))
    return {question: answer.answer for question, answer in found.items()}


def test_a_leaf_that_is_started_again_after_another_leaf_does_not_run_beside_it() -> None:
    # In one tick Drive completes, Turn completes, and the loop starts Drive again.
    found = answers('<Repeat num_cycles="3"><Sequence><Drive/><Turn/></Sequence></Repeat>')
    assert found[RESOURCES] == PROVED


def test_two_leaves_that_run_at_once_share_a_resource() -> None:
    assert answers("<Parallel><Drive/><Turn/></Parallel>")[RESOURCES] == REFUTED


def test_a_leaf_that_completes_and_starts_again_in_each_tick_is_not_stuck() -> None:
    # In the cycle in which Drive succeeds and starts again in every tick, Turn never runs.
    xml = '<Fallback><Repeat num_cycles="-1"><Drive/></Repeat><Turn/></Fallback>'
    question = "Drive leads to Turn ticked"
    assert answers(xml, question)[question] == REFUTED
