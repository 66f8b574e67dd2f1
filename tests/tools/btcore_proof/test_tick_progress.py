"""A search that recognises equal moments within ticks finds the same ticks as one that does not."""

from collections.abc import Hashable
from typing import Annotated

import pytest

from btcore import ControlNode, DecoratorNode, In, InOut, NodeSpec, Out, Status
from btcore_proof.search import SearchLimits, search
from btcore_proof.state_graph import Outcome
from btcore_proof.tick_progress import TickProgress
from tests.tools.btcore_proof.trees import ConditionLeaf, InstantLeaf, LastingLeaf, prover_of


class Check(ConditionLeaf):
    pass


class Do(InstantLeaf):
    pass


class Count(InstantLeaf):
    number: Annotated[Out[int], "The number."]


class Act(LastingLeaf):
    pass


class CountFailures(ControlNode):
    """Ticks all children, and fails if at least *limit* failed; both numbers are local variables."""

    limit: Annotated[In[int], "The limit."]

    def tick(self) -> bool:
        """Tick all children."""
        limit = self.limit
        failures = 0
        for index, child in enumerate(self.children):
            failures += child.execute_tick() is Status.FAILURE
            self.halt_child(index)
        return failures < limit


class AgainIfIdle(DecoratorNode):
    """Ticks its child again if the child was IDLE before."""

    def tick(self) -> Status:
        """Tick the child."""
        was_idle = self.child.status is Status.IDLE
        status = self.child.execute_tick()
        if status is Status.RUNNING:
            return status
        self.reset_child()
        return self.child.execute_tick() if was_idle else Status.RUNNING


class ThirdTime(DecoratorNode):
    """Ticks its child three times; during the child's tick, only a local variable knows how often."""

    spec = NodeSpec(state_fields=("count",))

    def __init__(self) -> None:
        self.count = 0

    def tick(self) -> Status:
        """Tick the child."""
        count, self.count = self.count, 0
        status = self.child.execute_tick()
        self.reset_child()
        if count == 2:
            return status
        self.count = count + 1
        return Status.RUNNING


class ThirdTimeByEntry(DecoratorNode):
    """As ThirdTime, with an entry."""

    count: Annotated[InOut[int], "How often the child was ticked."]

    def tick(self) -> Status:
        """Tick the child."""
        count, self.count = self.count, 0
        status = self.child.execute_tick()
        self.reset_child()
        if count == 2:
            return status
        self.count = count + 1
        return Status.RUNNING


TREES = {
    "retries": """<RetryUntilSuccessful num_attempts="3">
        <Sequence><Check/><Act/><Do/></Sequence>
    </RetryUntilSuccessful>""",
    "statuses of children": """<AgainIfIdle>
        <KeepRunningUntilFailure><Do/></KeepRunningUntilFailure>
    </AgainIfIdle>""",
    "fields": "<ThirdTime><Fallback><Check/><Do/></Fallback></ThirdTime>",
    "entries": """<Sequence>
        <Script code="count := 0"/>
        <ThirdTimeByEntry count="{count}"><Fallback><Check/><Do/></Fallback></ThirdTimeByEntry>
    </Sequence>""",
    "local variables": """<Sequence>
        <Count number="{n}"/>
        <CountFailures limit="{n}"><Check/><Count number="{n}"/><Do/></CountFailures>
    </Sequence>""",
    "scripts": """<Fallback>
        <Count number="{n}"/>
        <ReactiveSequence _while="n == 1"><Check _onFailure="n := 0"/><Act/></ReactiveSequence>
        <Do _skipIf="n == 0"/>
    </Fallback>""",
    "parallel": """<Parallel success_count="2" failure_count="2">
        <Act/>
        <Sequence><Check/><Do/></Sequence>
        <Act/>
    </Parallel>""",
    "timers": """<ReactiveFallback>
        <Timeout msec="100"><Act/></Timeout>
        <Sequence><Check/><Delay delay_msec="50"><Do/></Delay></Sequence>
    </ReactiveFallback>""",
    "halts": """<ReactiveSequence>
        <Check/>
        <TryCatch catch_on_halt="true"><Act/><Fallback><Do/><Check/></Fallback></TryCatch>
    </ReactiveSequence>""",
}


def ticks_of(xml: str) -> set[tuple[Hashable, Hashable, int]]:
    """Return all ticks of a tree: the state before, the state after or the result, and what happened."""
    leaves = (Check, Do, Count, Act, CountFailures, AgainIfIdle, ThirdTime, ThirdTimeByEntry)
    entries = {"m": 0, "n": 1}
    explorer = prover_of(xml, leaves=leaves, entries=entries, domains={"n": ("0", "1", "2")}).explorer
    explorer.start()
    search(explorer, SearchLimits())
    graph, known = explorer.graph, dict[int, set[Outcome]]()
    assert graph.is_complete
    return {
        (explorer.table.state(vertex), explorer.table.state(end) if end >= 0 else end, signals)
        for vertex in range(len(graph.edges))
        if vertex not in graph.decisions
        for end, signals in graph.outcomes_of(vertex, known)
    }


@pytest.mark.parametrize("name", TREES)
def test_equal_moments_are_searched_once_with_all_ticks(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    found = ticks_of(TREES[name])
    monkeypatch.setattr(TickProgress, "moment", lambda self, node: None)
    every = ticks_of(TREES[name])
    assert len(every) > 3
    assert found == every
