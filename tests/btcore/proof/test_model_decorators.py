"""A decorator that needs resources is replaced by a model that may hold its child back, but not forever."""

from typing import Annotated

from btcore import DecoratorNode, In, Out, Registry, Status, SyncAction, loads
from btcore.clock import Clock
from btcore.proof.model_leaves import Choices, with_model_leaves
from btcore.proof.propositions import parse_question
from btcore.proof.prover import PROVED, REFUTED, Prover
from btcore.proof.standard_questions import ENDS, INPUTS
from btcore.tree.tree import Tree


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


class Grip(SyncAction):
    """Closes the gripper."""

    place: Annotated[In[str], "The place."]

    def tick(self) -> bool:
        """Never called in a proof."""
        raise AssertionError


XML = """<root BTCPP_format="4"><BehaviorTree ID="T">
  <WhenClose place="{place}"><Grip place="{place}"/></WhenClose>
</BehaviorTree></root>"""


def test_a_model_decorator_holds_its_child_back_but_not_forever():
    nodes = Registry.standard()
    nodes.add(WhenClose)
    nodes.add(Grip)
    models = with_model_leaves(nodes, {})

    def make(choices: Choices, clock: Clock) -> Tree:
        return loads(XML, nodes=models, resources=[choices], clock=clock)

    questions = [
        parse_question("WhenClose leads to Grip ticked"),
        parse_question("never WhenClose & !Grip ticked"),
    ]
    answers = {answer.question: answer for answer in Prover(make, questions).answer().answers}
    assert answers[ENDS].answer == PROVED
    assert answers[INPUTS].answer == PROVED  # the decorator has written {place} before its child is ticked
    assert answers["WhenClose leads to Grip ticked"].answer == PROVED
    held = answers["never WhenClose & !Grip ticked"]
    assert held.answer == REFUTED
    assert held.counterexample is not None
    assert [leaf.path for leaf in held.counterexample.ticks[0].leaves] == ["WhenClose::1"]
