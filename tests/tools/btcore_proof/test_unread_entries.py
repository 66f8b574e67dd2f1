"""Entries that nothing reads are not written in a search; an optional input may be unwritten."""

from typing import Annotated

from btcore import In, Out, Registry, StatefulAction, Status, SyncAction, loads
from btcore.clock import Clock
from btcore.tree.tree import Tree
from btcore_proof.model_leaves import Choices, with_model_leaves
from btcore_proof.propositions import parse_question
from btcore_proof.prover import PROVED, REFUTED, Prover
from btcore_proof.search import search
from btcore_proof.standard_questions import INPUTS


class Plan(SyncAction):
    """Writes a route, and an error code that no node of the tree reads."""

    route: Annotated[Out[str], "The route."]
    error: Annotated[Out[int], "The error code."]

    def tick(self) -> bool:
        """Never called in a proof."""
        raise AssertionError


class Check(SyncAction):
    """Reads the route."""

    route: Annotated[In[str], "The route."]

    def tick(self) -> bool:
        """Never called in a proof."""
        raise AssertionError


class Follow(Check):
    """Reads the route, which is written whenever the tree ticks it."""


class Search(StatefulAction):
    """Writes a route, and goes on."""

    route: Annotated[Out[str], "The route."]

    def on_start(self) -> Status:
        """Never called in a proof."""
        raise AssertionError

    on_running = on_start


def prover_of(xml: str, optional: list[str], *questions: str, early: bool = False) -> Prover:
    nodes = Registry.standard()
    nodes.add(Plan)
    nodes.add(Check)
    nodes.add(Follow)
    nodes.add(Search)
    models = with_model_leaves(nodes, {"Check": {"optional": optional}, "Search": {"early": early}})

    def make(choices: Choices, clock: Clock) -> Tree:
        text = f'<root BTCPP_format="4"><BehaviorTree ID="T">{xml}</BehaviorTree></root>'
        return loads(text, nodes=models, resources=[choices], clock=clock)

    return Prover(make, [parse_question(question) for question in questions])


CHECK_FIRST = (
    '<Fallback><Check route="{route}"/>'
    '<Sequence><Plan route="{route}" error="{error}"/><Follow route="{route}"/></Sequence></Fallback>'
)


def test_an_optional_input_may_be_unwritten_but_then_the_leaf_does_not_succeed():
    answers = {
        optional: {
            answer.question: answer.answer
            for answer in prover_of(CHECK_FIRST, [*optional], "never Check is SUCCESS").answer().answers
        }
        for optional in ((), ("route",))
    }
    assert answers[()][INPUTS] == REFUTED
    assert answers["route",][INPUTS] == PROVED
    assert answers["route",]["never Check is SUCCESS"] == PROVED


def test_an_optional_input_that_no_other_node_reads_is_searched():
    xml = '<Fallback><Check route="{route}"/><Plan route="{route}"/></Fallback>'
    question = "never Check is SUCCESS"
    answers = {each.question: each.answer for each in prover_of(xml, ["route"], question).answer().answers}
    assert answers[question] == PROVED


def test_an_entry_is_searched_only_if_something_reads_it():
    tree = (
        '<Sequence><ForceSuccess><Plan route="{route}" error="{error}"/></ForceSuccess>'
        '<Check route="{route}"/></Sequence>'
    )
    explorer = prover_of(tree, []).explorer
    search(explorer)
    # After outputs of Plan, with any result, Check succeeds or fails; without a route it raises.
    assert explorer.graph.transitions == 4
    read = tree.replace("<Check ", '<Script code="code := error"/><Check ')
    assert [prover_of(xml, []).explorer.choices.unread for xml in (tree, read)] == [{"error"}, set()]
    asked = prover_of(tree, [], "never {error} == 1")
    assert asked.explorer.choices.unread == set()


def test_a_leaf_that_writes_early_may_be_running_with_its_outputs_written():
    both = '<Parallel><Search route="{route}"/><Check route="{route}"/></Parallel>'
    xml = f'<Sequence>{both}<Follow route="{{route}}"/></Sequence>'
    question = "never Check is SUCCESS & Search"
    found = [
        {answer.question: answer.answer for answer in prover.answer().answers}[question]
        for prover in (prover_of(xml, ["route"], question, early=early) for early in (False, True))
    ]
    assert found == [PROVED, REFUTED]
