"""Entries that nothing reads are not written in a search; an optional input may be unwritten."""

from typing import Annotated

from btcore import In, Out
from btcore_proof.prover import PROVED, REFUTED, Prover
from btcore_proof.search import SearchLimits, search
from btcore_proof.standard_questions import INPUTS
from tests.tools.btcore_proof.trees import InstantLeaf, LastingLeaf, answers_of, prover_of


class Plan(InstantLeaf):
    """Writes a route, and an error code that no node of the tree reads."""

    route: Annotated[Out[str], "The route."]
    error: Annotated[Out[int], "The error code."]


class Check(InstantLeaf):
    route: Annotated[In[str], "The route."]


class Follow(Check):
    pass


class Search(LastingLeaf):
    route: Annotated[Out[str], "The route."]


def prover_for(xml: str, optional: list[str], *questions: str, early: bool = False) -> Prover:
    declared: dict[str, dict[str, object]] = {"Check": {"optional": optional}, "Search": {"early": early}}
    return prover_of(xml, *questions, leaves=(Plan, Check, Follow, Search), declared=declared)


CHECK_FIRST = (
    '<Fallback><Check route="{route}"/>'
    '<Sequence><Plan route="{route}" error="{error}"/><Follow route="{route}"/></Sequence></Fallback>'
)


def test_an_optional_input_may_be_unwritten_but_then_the_leaf_does_not_succeed() -> None:
    answers = {
        optional: answers_of(prover_for(CHECK_FIRST, [*optional], "never Check is SUCCESS"))
        for optional in ((), ("route",))
    }
    assert answers[()][INPUTS].answer == REFUTED
    assert answers["route",][INPUTS].answer == PROVED
    assert answers["route",]["never Check is SUCCESS"].answer == PROVED


def test_an_optional_input_that_no_other_node_reads_is_searched() -> None:
    xml = '<Fallback><Check route="{route}"/><Plan route="{route}"/></Fallback>'
    question = "never Check is SUCCESS"
    assert answers_of(prover_for(xml, ["route"], question))[question].answer == PROVED


def test_an_entry_is_searched_only_if_something_reads_it() -> None:
    tree = (
        '<Sequence><ForceSuccess><Plan route="{route}" error="{error}"/></ForceSuccess>'
        '<Check route="{route}"/></Sequence>'
    )
    explorer = prover_for(tree, []).explorer
    search(explorer, SearchLimits())
    # After outputs of Plan, with any result, Check succeeds or fails; without a route it raises.
    assert explorer.graph.transitions == 4
    read = tree.replace("<Check ", '<Script code="code := error"/><Check ')
    assert [prover_for(xml, []).explorer.choices.unread for xml in (tree, read)] == [{"error"}, set()]
    prover = prover_for(tree, [], "never {error} == 1")
    assert prover.explorer.choices.unread == set()


def test_a_leaf_that_writes_early_may_be_running_with_its_outputs_written() -> None:
    both = '<Parallel><Search route="{route}"/><Check route="{route}"/></Parallel>'
    xml = f'<Sequence>{both}<Follow route="{{route}}"/></Sequence>'
    question = "never Check is SUCCESS & Search"
    found = [
        answers_of(prover_for(xml, ["route"], question, early=early))[question].answer
        for early in (False, True)
    ]
    assert found == [PROVED, REFUTED]
