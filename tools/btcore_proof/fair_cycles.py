"""Search for infinite runs that are fair: cycles of a state graph, in its strongly connected components.

The conditions of fairness are Streett conditions: if one thing happens infinitely often, another does too. A
component that violates a condition may contain smaller components that meet it, so the search continues in
them (E. A. Emerson, C.-L. Lei, "Modalities for Model Checking", 1987).
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

from btcore_proof.state_graph import Edge, StateGraph, Step

Part = dict[int, list[Edge]]
"""Some vertices of a graph, with some of the edges between them."""


class Fairness(NamedTuple):
    """A condition of fairness: if a bit of the cause is set infinitely often, one of the effect is, too.

    Attributes:
        cause: The bits of the cause; 0 = the effect must happen in any case.
        effect: The bits of the effect, of which one must be set.
    """

    cause: int
    effect: int

    def is_caused_by(self, edge: Edge) -> bool:
        """Return whether the cause happens on an edge."""
        return not self.cause or bool(edge.signals & self.cause)

    def is_met_by(self, edge: Edge) -> bool:
        """Return whether the effect happens on an edge."""
        return bool(edge.signals & self.effect)


class FairCycle(NamedTuple):
    """A fair infinite run from a state: *steps* lead back to the state of the first step."""

    steps: list[Step]

    @property
    def start(self) -> int:
        """The state at which the cycle begins."""
        return self.steps[0][0]


def cyclic_parts(graph: StateGraph) -> list[Part]:
    """Return the strongly connected components of a graph that have an edge."""
    return _components(
        {vertex: [edge for edge in edges if edge.target >= 0] for vertex, edges in enumerate(graph.edges)}
    )


def find_fair_cycle(
    graph: StateGraph,
    parts: Iterable[Part],
    conditions: Sequence[Fairness],
    allowed: Callable[[Edge], bool] = lambda edge: True,
) -> FairCycle | None:
    """Return a cycle that meets all conditions, or None if there is none.

    Args:
        parts: The parts of the graph that may contain the cycle.
        conditions: The conditions of fairness.
        allowed: Returns whether an edge may be part of the cycle.
    """
    pending: list[Part] = []
    for part in parts:
        signals = 0
        kept: Part = {}
        for vertex, edges in part.items():
            kept[vertex] = allowed_edges = [edge for edge in edges if allowed(edge)]
            for edge in allowed_edges:
                signals |= edge.signals
        if all(condition.cause or signals & condition.effect for condition in conditions):
            pending += _components(kept)
    while pending:
        part = pending.pop()
        violated = [condition for condition in conditions if not _holds(part, condition)]
        if not violated:
            return _cycle_through(graph, part, conditions)
        kept = {
            state: [edge for edge in edges if not any(condition.is_caused_by(edge) for condition in violated)]
            for state, edges in part.items()
        }
        pending += _components(kept)
    return None


def states_from(
    graph: StateGraph, start: Iterable[int], allowed: Callable[[Edge], bool]
) -> dict[int, Step | None]:
    """Return the vertices that allowed edges reach from *start*, each with the step that leads to it.

    Those that fewer ticks reach come first.
    """
    steps_to: dict[int, Step | None] = dict.fromkeys(start)
    queue = deque(steps_to)
    while queue:
        vertex = queue.popleft()
        # Vertices stay in the order of this loop.
        steps_to[vertex] = steps_to.pop(vertex)
        for edge in graph.edges[vertex]:
            if edge.target >= 0 and edge.target not in steps_to and allowed(edge):
                steps_to[edge.target] = (vertex, edge)
                if graph.ends_tick(edge):
                    queue.append(edge.target)
                else:
                    queue.appendleft(edge.target)
    return steps_to


def steps_back(steps_to: dict[int, Step | None], state: int) -> list[Step]:
    """Return the steps by which `states_from` reached *state*, in order."""
    steps: list[Step] = []
    while (step := steps_to[state]) is not None:
        steps.append(step)
        state = step[0]
    return steps[::-1]


def _holds(part: Part, condition: Fairness) -> bool:
    """Return whether a run through all edges of *part* again and again meets *condition*."""
    is_caused = False
    for edges in part.values():
        for edge in edges:
            if condition.is_met_by(edge):
                return True
            is_caused = is_caused or condition.is_caused_by(edge)
    return not is_caused


def _components(part: Part) -> list[Part]:
    """Return the strongly connected components of *part* that have an edge, with their inner edges."""
    # Tarjan's algorithm without recursion.
    index: dict[int, int] = {}
    low: dict[int, int] = {}
    stack: list[int] = []
    on_stack: set[int] = set()
    components: list[Part] = []
    for root in part:
        if root in index:
            continue
        index[root] = low[root] = len(index)
        stack.append(root)
        on_stack.add(root)
        work = [(root, iter(part[root]))]
        while work:
            state, edges = work[-1]
            for edge in edges:
                target = edge.target
                if target not in part:
                    continue
                if target not in index:
                    index[target] = low[target] = len(index)
                    stack.append(target)
                    on_stack.add(target)
                    work.append((target, iter(part[target])))
                    break
                if target in on_stack:
                    low[state] = min(low[state], index[target])
            else:
                work.pop()
                if work:
                    parent = work[-1][0]
                    low[parent] = min(low[parent], low[state])
                if low[state] == index[state]:
                    members: set[int] = set()
                    while state not in members:
                        members.add(stack.pop())
                    on_stack -= members
                    inner = {
                        member: [edge for edge in part[member] if edge.target in members]
                        for member in sorted(members)
                    }
                    if any(inner.values()):
                        components.append(inner)
    return components


def _cycle_through(graph: StateGraph, part: Part, conditions: Sequence[Fairness]) -> FairCycle:
    """Return a cycle in a component on which all conditions hold. It begins between two ticks."""
    start = min(vertex for vertex in part if vertex not in graph.decisions)
    steps: list[Step] = []
    state = start

    def go(accepts: Callable[[Edge], bool]) -> None:
        nonlocal state
        steps_to: dict[int, Step | None] = {state: None}
        queue = deque([state])
        while queue:
            vertex = queue.popleft()
            for edge in part[vertex]:
                if accepts(edge):
                    steps.extend(steps_back(steps_to, vertex))
                    steps.append((vertex, edge))
                    state = edge.target
                    return
                if edge.target not in steps_to:
                    steps_to[edge.target] = (vertex, edge)
                    queue.append(edge.target)

    for condition in conditions:
        # A condition whose cause never happens on the cycle is met; another needs its effect.
        caused = any(condition.is_caused_by(edge) for edges in part.values() for edge in edges)
        met = any(condition.is_met_by(edge) for _, edge in steps)
        if caused and not met:
            go(condition.is_met_by)
    if state != start or not steps:
        go(lambda edge: edge.target == start)
    return FairCycle(steps)
