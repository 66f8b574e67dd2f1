"""Sets of agents as integers: masks, counters and timers."""

import random

import pytest

np = pytest.importorskip("numpy")
from btcore_batch.agent_sets import AgentSets, Counters, Timer, UnaryCounters  # noqa: E402

RNG = random.Random(5)


@pytest.mark.parametrize("count", [1, 7, 8, 9, 1000])
def test_a_set_becomes_a_mask_and_back(count: int) -> None:
    agent_sets = AgentSets(count)
    for agents in (0, 1, agent_sets.all_agents, RNG.getrandbits(count)):
        mask = agent_sets.mask(agents)
        assert mask.dtype == np.bool_
        assert mask.tolist() == [bool(agents >> index & 1) for index in range(count)]
        assert agent_sets.from_mask(mask) == agents
        assert agent_sets.indices(agents).tolist() == [index for index in range(count) if agents >> index & 1]


def test_masks_are_read_only() -> None:
    agent_sets = AgentSets(3)
    for agents in (0b111, 0b101):
        with pytest.raises(ValueError, match="read-only"):
            agent_sets.mask(agents)[0] = False


def test_counters_count_as_integers_do() -> None:
    agent_sets, counters, counts = AgentSets(50), Counters(), [0] * 50
    for _ in range(200):
        agents = RNG.getrandbits(50)
        if RNG.random() < 0.9:
            counters.add(agents)
            counts = [count + (agents >> index & 1) for index, count in enumerate(counts)]
        else:
            agents &= RNG.getrandbits(50)
            counters.clear(agents)
            counts = [0 if agents >> index & 1 else count for index, count in enumerate(counts)]
        limit, group = RNG.randrange(-2, 40), RNG.getrandbits(50)
        below = {index for index in range(50) if group >> index & 1 and counts[index] < limit}
        equal = {index for index in range(50) if group >> index & 1 and counts[index] == max(limit, 0)}
        assert set(agent_sets.indices(counters.below(limit, group)).tolist()) == below
        assert set(agent_sets.indices(counters.equal(max(limit, 0), group)).tolist()) == equal
        assert counters.numbers(agent_sets).tolist() == counts


def test_unary_counters_count_up_to_their_maximum() -> None:
    counters = UnaryCounters(3)
    counters.add(0b011)
    copy = counters.copy()
    counters.add(0b001)
    assert [counters.at_least(number) for number in (0, 1, 2, 3, 4)] == [-1, 0b011, 0b001, 0, 0]
    counters.clear(0b001)
    assert counters.at_least(1) == 0b010
    assert copy.at_least(1) == 0b011


def test_each_agent_waits_for_its_own_deadline() -> None:
    timer = Timer(AgentSets(3))
    timer.start(0b001, 0, 20)
    timer.start(0b010, 0, 10)
    assert timer.due(0b111, 9_999_999) == 0
    assert timer.due(0b111, 10_000_000) == 0b010
    assert timer.take_due_wake_ups(10_000_000) == 0b010
    assert timer.take_due_wake_ups(10_000_000) == 0
    timer.stop(0b001)
    assert timer.due(0b111, 99_000_000) == 0b010
