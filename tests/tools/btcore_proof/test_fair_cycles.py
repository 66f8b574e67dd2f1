"""The search for fair cycles, against all sets of edges of small random graphs."""

import random
from collections.abc import Sequence
from itertools import combinations

import pytest

from btcore.status import SUCCESS
from btcore_proof.fair_cycles import Fairness, cyclic_parts, find_fair_cycle
from btcore_proof.state_graph import END_OF, Edge, StateGraph, Step

STATES, EDGES = 4, 8
BITS = 4  # in the signals of an edge


def random_graph(rng: random.Random) -> StateGraph:
    edges: list[list[Edge]] = [[] for _ in range(STATES)]
    for _ in range(EDGES):
        target = rng.choice([*range(STATES), END_OF[SUCCESS]])
        edges[rng.randrange(STATES)].append(Edge(target, rng.getrandbits(BITS), 0, None))
    return StateGraph(edges)


def random_condition(rng: random.Random) -> Fairness:
    cause = rng.choice([0, 1 << rng.randrange(BITS)])
    return Fairness(cause, 1 << rng.randrange(BITS))


def meets(steps: Sequence[Step], conditions: Sequence[Fairness]) -> bool:
    """Return whether a run through exactly *steps* again and again meets the conditions."""
    for cause, effect in conditions:
        caused = not cause or any(edge.signals & cause for _, edge in steps)
        if caused and not any(edge.signals & effect for _, edge in steps):
            return False
    return True


def is_connected(steps: Sequence[Step]) -> bool:
    """Return whether a run can pass all of *steps* again and again."""
    for _, first in steps:
        reached = {first.target}
        for _ in steps:
            reached |= {edge.target for state, edge in steps if state in reached}
        if not all(state in reached and edge.target in reached for state, edge in steps):
            return False
    return True


@pytest.mark.parametrize("seed", range(120))
def test_a_fair_cycle_is_found_if_there_is_one(seed: int) -> None:
    rng = random.Random(seed)
    graph = random_graph(rng)
    conditions = [random_condition(rng) for _ in range(rng.randint(0, 3))]
    forbidden = rng.choice([0, 1 << rng.randrange(BITS)])
    steps = [
        (state, edge)
        for state, edges in enumerate(graph.edges)
        for edge in edges
        if edge.target >= 0 and not edge.signals & forbidden
    ]
    exists = any(
        meets(chosen, conditions) and is_connected(chosen)
        for count in range(1, len(steps) + 1)
        for chosen in combinations(steps, count)
    )
    cycle = find_fair_cycle(graph, cyclic_parts(graph), conditions, lambda edge: not edge.signals & forbidden)
    assert (cycle is not None) == exists
    if cycle is not None:
        assert all(step in steps for step in cycle.steps)
        assert [edge.target for _, edge in cycle.steps] == [
            *(state for state, _ in cycle.steps[1:]),
            cycle.start,
        ]
        assert meets(cycle.steps, conditions)
