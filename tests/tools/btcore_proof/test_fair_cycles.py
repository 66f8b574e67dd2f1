"""The search for fair cycles, against all sets of edges of small random graphs."""

import random
from collections.abc import Sequence
from itertools import combinations

import pytest

from btcore_proof.fair_cycles import Fairness, cyclic_parts, find_fair_cycle
from btcore_proof.state_graph import Edge, StateGraph
from btcore_proof.state_graph import Step as GraphStep

STATES, EDGES, BITS = 4, 8, 4


def random_graph(chance: random.Random) -> StateGraph:
    edges: list[list[Edge]] = [[] for _ in range(STATES)]
    for _ in range(EDGES):
        # Target -3: the tree has succeeded.
        target = chance.choice([*range(STATES), -3])
        edges[chance.randrange(STATES)].append(Edge(target, chance.getrandbits(BITS), 0, None))
    return StateGraph(edges)


def random_condition(chance: random.Random) -> Fairness:
    cause = chance.choice([0, 1 << chance.randrange(BITS)])
    return Fairness(cause, 1 << chance.randrange(BITS))


def meets(steps: Sequence[GraphStep], conditions: Sequence[Fairness]) -> bool:
    """Return whether a run through exactly *steps* again and again meets the conditions."""
    for cause, effect in conditions:
        caused = not cause or any(edge.signals & cause for _, edge in steps)
        if caused and not any(edge.signals & effect for _, edge in steps):
            return False
    return True


def is_connected(steps: Sequence[GraphStep]) -> bool:
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
    chance = random.Random(seed)
    graph = random_graph(chance)
    conditions = [random_condition(chance) for _ in range(chance.randint(0, 3))]
    forbidden = chance.choice([0, 1 << chance.randrange(BITS)])
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
    found = find_fair_cycle(graph, cyclic_parts(graph), conditions, lambda edge: not edge.signals & forbidden)
    assert (found is not None) == exists
    if found is not None:
        assert all(step in steps for step in found.steps)
        assert [edge.target for _, edge in found.steps] == [
            *(state for state, _ in found.steps[1:]),
            found.start,
        ]
        assert meets(found.steps, conditions)
