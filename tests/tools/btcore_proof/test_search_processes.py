"""A search by several processes finds the same states and gives the same answers as one process."""

import multiprocessing
import os
import signal
from typing import Annotated

import pytest

import btcore_proof.search
from btcore import In, Out
from btcore.values import ValueType
from btcore_proof.prover import Prover
from btcore_proof.search import SearchLimits
from btcore_proof.search_processes import CAN_FORK, SearchProcesses
from btcore_proof.state_graph import StateGraph
from btcore_proof.tree_state import TreeState
from tests.tools.btcore_proof.trees import ConditionLeaf, InstantLeaf, LastingLeaf, prover_of

pytestmark = pytest.mark.skipif(not CAN_FORK, reason="a search has one process on this system")

QUESTIONS = (
    "never Dock is SUCCESS",
    "Move leads to Dock ticked within 2 ticks",
    "Move leads to Dock ticked",
    "Check is FAILURE before Dock",
)
TREE = """<Parallel failure_count="2">
  <RetryUntilSuccessful num_attempts="3">
    <Sequence><Check/><Timeout msec="100"><Move/></Timeout><Write number="{n}"/></Sequence>
  </RetryUntilSuccessful>
  <Repeat num_cycles="4"><Fallback><Dock/><Move name="Call" _skipIf="n == 1"/></Fallback></Repeat>
</Parallel>"""


class Check(ConditionLeaf):
    pass


class Move(LastingLeaf):
    pass


class Dock(LastingLeaf):
    pass


class Write(InstantLeaf):
    number: Annotated[Out[int], "The number."]


class Handle:
    """A value that is equal only to itself."""


class HandleType(ValueType):
    """The type of handles."""

    def __init__(self) -> None:
        super().__init__("Handle", Handle)

    def from_text(self, text: str, format: int = 4) -> Handle:
        """Return a new handle."""
        return Handle()


class Connect(InstantLeaf):
    handle: Out[Annotated[Handle, HandleType()]]


class Use(LastingLeaf):
    handle: In[Annotated[Handle, HandleType()]]


@pytest.fixture(autouse=True)
def _processes_from_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(btcore_proof.search, "_FEW_STATES", 1)


def prover_for(xml: str = TREE, *questions: str) -> Prover:
    entries = {"n": 0} if "{n}" in xml else {}
    domains = {"n": ("0", "1"), "h": ("first", "second")}
    leaves = (Check, Move, Dock, Write, Connect, Use)
    return prover_of(xml, *questions, leaves=leaves, entries=entries, domains=domains)


def states_of(prover: Prover) -> set[TreeState]:
    explorer = prover.explorer
    vertices = range(len(explorer.graph.edges))
    return {explorer.table.state(each) for each in vertices if each not in explorer.graph.decisions}


@pytest.mark.parametrize("jobs", [2, 3])
def test_answers_do_not_depend_on_the_number_of_processes(jobs: int) -> None:
    first, second = prover_for(TREE, *QUESTIONS), prover_for(TREE, *QUESTIONS)
    alone, together = first.answer(), second.answer(SearchLimits(jobs=jobs))
    assert len(states_of(first)) > 150
    assert states_of(second) == states_of(first)
    assert together.answers == alone.answers
    assert {answer.answer for answer in alone.answers} == {"proved", "refuted"}


def test_bounds_apply_to_all_processes() -> None:
    alone = prover_for().answer(SearchLimits(ticks=3))
    together = prover_for().answer(SearchLimits(ticks=3, jobs=2))
    assert together.answers == alone.answers
    assert together.answers[0].detail == "runs of more than 3 ticks were not searched"
    detail = prover_for().answer(SearchLimits(memory=1, jobs=2)).answers[0].detail
    assert detail == "the memory limit of 1 MB was reached"


def test_one_process_ends_search_if_values_equal_only_themselves(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    waiting: list[int] = []
    close = SearchProcesses.close

    def record(processes: SearchProcesses) -> None:
        waiting.append(len(processes._explorer.waiting))
        close(processes)

    monkeypatch.setattr(SearchProcesses, "close", record)
    later = '<Delay delay_msec="10"><Connect handle="{h}"/></Delay>'
    tree = f'<Sequence>{later}{later}<Use handle="{{h}}"/></Sequence>'
    alone, together = prover_for(tree).answer(), prover_for(tree).answer(SearchLimits(jobs=2))
    assert together.answers == alone.answers
    assert {answer.answer for answer in alone.answers} == {"proved"}
    assert len(waiting) == 1
    assert waiting[0] > 0


def children() -> list[int]:
    return [process.pid or 0 for process in multiprocessing.active_children()]


def test_an_interrupted_search_ends_its_processes() -> None:
    def interrupt(graph: StateGraph) -> None:
        if graph.expanded > 2:
            assert len(children()) == 2
            raise KeyboardInterrupt

    answers = prover_for().answer(SearchLimits(jobs=2), interrupt).answers
    assert {answer.detail for answer in answers} == {"the search was interrupted"}
    assert not children()


def test_a_process_that_is_killed_makes_the_answers_unknown() -> None:
    def kill(graph: StateGraph) -> None:
        for process in children():
            os.kill(process, signal.SIGKILL)

    answers = prover_for().answer(SearchLimits(jobs=2), kill).answers
    assert {answer.answer for answer in answers} == {"unknown"}
    assert answers[0].detail == "a process of the search has ended, perhaps for lack of memory"
    assert not children()
