"""Sets of agents as integers: masks, counters, and moments."""

import random

import pytest

np = pytest.importorskip("numpy")
from btcore.batch.agent_sets import AgentSets  # noqa: E402
from btcore.batch.counters import Counters  # noqa: E402
from btcore.batch.parallel import UnaryCounters  # noqa: E402
from btcore.batch.timer import Timer  # noqa: E402

DRAW = random.Random(5)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 1000])
def test_a_set_becomes_a_mask_and_back(count: int) -> None:
    crowd = AgentSets(count)
    for agents in (0, 1, crowd.all_agents, DRAW.getrandbits(count)):
        mask = crowd.mask(agents)
        assert mask.dtype == np.bool_
        assert mask.tolist() == [bool(agents >> at & 1) for at in range(count)]
        assert crowd.from_mask(mask) == agents
        assert crowd.indices(agents).tolist() == [at for at in range(count) if agents >> at & 1]


def test_a_mask_is_not_to_be_written() -> None:
    crowd = AgentSets(3)
    for agents in (0b111, 0b101):
        with pytest.raises(ValueError, match="read-only"):
            crowd.mask(agents)[0] = False


def test_counters_count_as_numbers_do() -> None:
    crowd, counters, counts = AgentSets(50), Counters(), [0] * 50
    for _ in range(200):
        agents = DRAW.getrandbits(50)
        if DRAW.random() < 0.9:
            counters.add(agents)
            counts = [one + (agents >> at & 1) for at, one in enumerate(counts)]
        else:
            agents &= DRAW.getrandbits(50)
            counters.clear(agents)
            counts = [0 if agents >> at & 1 else one for at, one in enumerate(counts)]
        limit, some = DRAW.randrange(-2, 40), DRAW.getrandbits(50)
        below = {at for at in range(50) if some >> at & 1 and counts[at] < limit}
        equal = {at for at in range(50) if some >> at & 1 and counts[at] == max(limit, 0)}
        assert set(crowd.indices(counters.below(limit, some)).tolist()) == below
        assert set(crowd.indices(counters.equal(max(limit, 0), some)).tolist()) == equal
        assert counters.numbers(crowd).tolist() == counts


def test_tallies_count_up_to_their_end() -> None:
    tallies = UnaryCounters(3)
    tallies.add(0b011)
    tallies.add(0b001)
    assert [tallies.at_least(number) for number in (0, 1, 2, 3, 4)] == [-1, 0b011, 0b001, 0, 0]
    assert [tallies.exactly(number, 0b111) for number in (0, 1, 2)] == [0b100, 0b010, 0b001]
    tallies.clear(0b001)
    assert tallies.at_least(1) == 0b010


def test_each_agent_waits_for_its_own_moment() -> None:
    timer = Timer(AgentSets(3))
    timer.start(0b001, 0, 20)
    timer.start(0b010, 0, 10)
    assert timer.due(0b111, 9_999_999) == 0
    assert timer.due(0b111, 10_000_000) == 0b010
    assert timer.take_due_wake_ups(0b111, 10_000_000) == 0b010
    assert timer.take_due_wake_ups(0b111, 10_000_000) == 0
    timer.stop(0b001)
    assert timer.due(0b111, 99_000_000) == 0b010
