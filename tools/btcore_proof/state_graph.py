"""The graph that a search finds: states between ticks, decisions within ticks, and the edges between them."""

from collections import deque
from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

from btcore.engine.node import TreeNode
from btcore.status import FAILURE, IDLE, SKIPPED, SUCCESS
from btcore_proof.model_leaves import LeafEvent
from btcore_proof.tree_state import TreeState

RAISED: Final = -1
UNKNOWN: Final = -2
END_OF: Final = {SUCCESS: -3, FAILURE: -4, SKIPPED: -5}
"""The target of an edge after which the tree has completed, by the result of the tree."""
RESULT_OF: Final = {number: status for status, number in END_OF.items()}
"""The result of the tree, for each target of an edge after which the tree has completed."""
_LEAF_BITS: Final = 4
"""The number of signals of a leaf, which are the bits that follow."""
_TICKED, _SUCCEEDED, _FAILED, _RELEASED = 1, 2, 4, 8


class Edge(NamedTuple):
    """A tick, or the part of a tick that begins or ends with a decision of a leaf.

    Attributes:
        target: The number of the next vertex; negative = the tree ended, raised, or used an unknown value.
        signals: What happened: a bit for each of the search's signals.
        advance: The number of the advance of the timers, at the start of a tick.
        choice: The option that was chosen in the decision at which the edge begins; None = a tick begins.
    """

    target: int
    signals: int
    advance: int
    choice: int | None


Step = tuple[int, Edge]
"""A vertex and one of its edges."""


class TickMoment(NamedTuple):
    """A moment within a tick.

    Attributes:
        state: The number of the state before the tick.
        advance: The number of the advance of the timers.
        choices: The choices so far.
    """

    state: int
    advance: int
    choices: tuple[int, ...]


class WholeTick(NamedTuple):
    """A tick of a run: the moment before its end, and the target of its last edge."""

    moment: TickMoment
    target: int


Outcome = tuple[int, int]
"""The target and the signals of a tick, or of the rest of a tick."""


@dataclass
class Violation:
    """A tick in which a check found something wrong.

    Attributes:
        step: The last step of the tick.
        message: The sentence that says what is wrong.
        is_guessed: Whether it depends on comparisons with unknown values in this tick.
    """

    step: Step
    message: str
    is_guessed: bool = False


@dataclass
class StateGraph:
    """The vertices that were found, and the edges between them.

    A vertex is a state between two ticks, or a decision: a moment within a tick at which a leaf has several
    options.

    Attributes:
        edges: The edges of each vertex, by its number.
        parents: For each vertex the step by which it was found first; None for an initial state.
        depths: The number of ticks that were completed before each vertex.
        decisions: One of the moments that each decision stands for, by the number of the vertex.
        violations: The first violation of each check, by the name of the check, preferably without guesses.
        bounds: Why the search is not complete, each reason once; empty at a fixpoint.
        expanded: The number of states from which every tick was run.
        transitions: The number of ticks that were run, whole or in part.
    """

    edges: list[list[Edge]] = field(default_factory=list)
    parents: list[Step | None] = field(default_factory=list)
    depths: list[int] = field(default_factory=list)
    decisions: dict[int, TickMoment] = field(default_factory=dict)
    violations: dict[str, Violation] = field(default_factory=dict)
    bounds: dict[str, Step | None] = field(default_factory=dict)
    expanded: int = 0
    transitions: int = 0

    @property
    def is_complete(self) -> bool:
        """Whether every state was found."""
        return not self.bounds

    @property
    def states(self) -> int:
        """The number of states between two ticks."""
        return len(self.edges) - len(self.decisions)

    def add_state(self, parent: Step | None) -> None:
        """Add a state between two ticks, which was found by *parent*; None = an initial state."""
        self.edges.append([])
        self.parents.append(parent)
        self.depths.append(0 if parent is None else self.depths[parent[0]] + 1)

    def add_decision(self, parent: Step, moment: TickMoment) -> None:
        """Add a decision, which was found by *parent*."""
        self.decisions[len(self.edges)] = moment
        self.edges.append([])
        self.parents.append(parent)
        self.depths.append(self.depths[parent[0]])

    def path_to(self, vertex: int) -> list[Step]:
        """Return the steps of a shortest path from an initial state to *vertex*."""
        steps: list[Step] = []
        while (step := self.parents[vertex]) is not None:
            steps.append(step)
            vertex = step[0]
        return steps[::-1]

    def without(self, signals: int) -> "StateGraph":
        """Return the part of the graph that can be reached without edges that have one of *signals*."""
        edges: list[list[Edge]] = [[] for _ in self.edges]
        parents: list[Step | None] = [None] * len(edges)
        depths = [0] * len(edges)
        reached = {vertex for vertex, parent in enumerate(self.parents) if parent is None}
        waiting = deque(reached)
        while waiting:
            vertex = waiting.popleft()
            edges[vertex] = [edge for edge in self.edges[vertex] if not edge.signals & signals]
            # The vertices of a tick before those of the next one.
            for edge in edges[vertex]:
                target = edge.target
                if target >= 0 and target not in reached:
                    reached.add(target)
                    parents[target] = vertex, edge
                    if target in self.decisions:
                        depths[target] = depths[vertex]
                        waiting.appendleft(target)
                    else:
                        depths[target] = depths[vertex] + 1
                        waiting.append(target)
        violations = {
            name: violation
            for name, violation in self.violations.items()
            if violation.step[0] in reached and not violation.step[1].signals & signals
        }
        return replace(self, edges=edges, parents=parents, depths=depths, violations=violations)

    def lacks_violation(self, name: str, is_guessed: bool) -> bool:
        """Return whether a violation of a check is new, or depends on no guess as the known one does."""
        known = self.violations.get(name)
        return known is None or (known.is_guessed and not is_guessed)

    def ends_tick(self, edge: Edge) -> bool:
        """Return whether a tick ends with *edge*."""
        return edge.target not in self.decisions

    def outcomes_of(self, vertex: int, known: dict[int, set[Outcome]]) -> set[Outcome]:
        """Return the outcomes of all ticks, or rests of ticks, that begin at a vertex.

        Args:
            known: The outcomes of other vertices, to which those of this vertex are added.
        """
        outcomes = known.get(vertex)
        if outcomes is None:
            outcomes = known[vertex] = set()
            for target, signals, _, _ in self.edges[vertex]:
                if target in self.decisions:
                    outcomes |= {
                        (end, signals | later_signals)
                        for end, later_signals in self.outcomes_of(target, known)
                    }
                else:
                    outcomes.add((target, signals))
        return outcomes

    def whole_ticks(self, steps: Sequence[Step]) -> list[WholeTick]:
        """Return the ticks that *steps* consist of; the first step begins a tick, and the last ends one."""
        ticks: list[WholeTick] = []
        moment = TickMoment(0, 0, ())
        for vertex, edge in steps:
            if edge.choice is None:
                moment = TickMoment(vertex, edge.advance, ())
            else:
                moment = moment._replace(choices=(*moment.choices, edge.choice))
            if self.ends_tick(edge):
                ticks.append(WholeTick(moment, edge.target))
        return ticks


class StateTable:
    """All vertices that were found, each with a number. Parts that they have in common are stored once."""

    def __init__(self) -> None:
        self._parts: list[Any] = []
        self._numbers: dict[Any, int] = {}
        self._vertices: dict[tuple[int, ...], int] = {}
        self._keys: list[tuple[int, ...]] = []

    def __len__(self) -> int:
        return len(self._keys)

    @property
    def part_count(self) -> int:
        """The number of parts."""
        return len(self._parts)

    def part_number(self, part: Hashable) -> int:
        """Return the number of a part."""
        number = self._numbers.get(part)
        if number is None:
            number = self._numbers[part] = len(self._parts)
            self._parts.append(part)
        return number

    def part(self, number: int) -> Any:
        """Return the part with this number."""
        return self._parts[number]

    def key(self, number: int) -> tuple[int, ...]:
        """Return the numbers of the parts of a vertex."""
        return self._keys[number]

    def number_of_key(self, key: tuple[int, ...]) -> tuple[int, bool]:
        """Return the number of a vertex with these parts, and whether it is new."""
        known = self._vertices.get(key)
        if known is not None:
            return known, False
        number = self._vertices[key] = len(self._keys)
        self._keys.append(key)
        return number, True

    def add_without_key(self) -> int:
        """Add a vertex that need not be found again. Return its number."""
        self._keys.append(())
        return len(self._keys) - 1

    def number_of(self, state: TreeState, moment: Hashable = None) -> tuple[int, bool]:
        """Return the number of a vertex, and whether it is new.

        Args:
            moment: What else decides the rest of the tick; None = a state between two ticks.
        """
        parts = (*state.fields, state.statuses, *state[2:], moment)
        return self.number_of_key(tuple([self.part_number(part) for part in parts]))

    def state(self, number: int) -> TreeState:
        """Return the state of the tree at the vertex with this number."""
        parts = [self._parts[part] for part in self._keys[number][:-1]]
        fields = len(parts) - len(TreeState._fields) + 1
        return TreeState(parts[fields], tuple(parts[:fields]), *parts[fields + 1 :])


class Signals:
    """The meaning of the bits of `Edge.signals`.

    For each model leaf: it was ticked; it succeeded; it failed. At the end of a tick, for each model leaf: it
    did not remain RUNNING; for each time field: its timer did not remain pending; for each of the questions'
    propositions: it holds; it does not hold. Last: a comparison with an unknown value had this result.

    Attributes:
        guessed: The last bit.
    """

    def __init__(self, leaves: Sequence[TreeNode], timers: int, propositions: int) -> None:
        self.leaves = list(leaves)
        self.numbers = {leaf.config.uid: number for number, leaf in enumerate(leaves)}
        self.timers = timers
        self._first_timer = _LEAF_BITS * len(leaves)
        self._first_proposition = self._first_timer + timers
        self.guessed = 1 << self._first_proposition + 2 * propositions
        self._all_released = sum(self.released(leaf) for leaf in range(len(leaves)))
        self._all_fail = sum(self.fails(proposition) for proposition in range(propositions))

    def ticked(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* was ticked."""
        return _TICKED << _LEAF_BITS * leaf

    def succeeded(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* succeeded."""
        return _SUCCEEDED << _LEAF_BITS * leaf

    def failed(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* failed."""
        return _FAILED << _LEAF_BITS * leaf

    def released(self, leaf: int) -> int:
        """Return the bit that is set at the end of a tick unless leaf number *leaf* remained RUNNING."""
        return _RELEASED << _LEAF_BITS * leaf

    def stopped(self, timer: int) -> int:
        """Return the bit that is set at the end of a tick unless timer number *timer* remained pending."""
        return 1 << self._first_timer + timer

    def holds(self, proposition: int) -> int:
        """Return the bit that is set at the end of a tick if a proposition holds in it."""
        return 1 << self._first_proposition + 2 * proposition

    def fails(self, proposition: int) -> int:
        """Return the bit that is set at the end of a tick unless a proposition holds in it."""
        return 2 << self._first_proposition + 2 * proposition

    def of_events(self, events: Iterable[LeafEvent]) -> int:
        """Return the bits of ticks of leaves."""
        bits = 0
        for leaf, _, result, _ in events:
            if result is IDLE:
                continue
            signals = _TICKED
            if result is SUCCESS:
                signals |= _SUCCEEDED
            elif result is FAILURE:
                signals |= _FAILED
            bits |= signals << _LEAF_BITS * self.numbers[leaf.config.uid]
        return bits

    def of_end(self, kept: Iterable[TreeNode], timers: int, true: Iterable[int]) -> int:
        """Return the bits of the end of a tick.

        Args:
            kept: The leaves that remained RUNNING.
            timers: A bit for each time field whose timer remained pending.
            true: The numbers of the propositions that hold.
        """
        bits = self._all_released
        for leaf in kept:
            bits &= ~self.released(self.numbers[leaf.config.uid])
        bits |= ((1 << self.timers) - 1 & ~timers) << self._first_timer
        propositions = self._all_fail
        for number in true:
            propositions ^= self.holds(number) | self.fails(number)
        return bits | propositions
