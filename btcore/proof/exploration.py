"""The exhaustive search over the states of a tree, breadth first, on the ordinary engine."""

import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, NamedTuple

from btcore.clock import SimClock
from btcore.engine.node import TreeNode
from btcore.errors import BtcoreError, NodeExecutionError, ScriptError
from btcore.proof.model_leaves import (
    Choices,
    EndlessTickError,
    LeafEvent,
    UnknownValue,
    UnknownValueError,
    model_leaf_model,
)
from btcore.proof.timer_order import Advance
from btcore.proof.tree_state import NOW, StateKeeper, TreeState
from btcore.status import FAILURE, RUNNING, SKIPPED, SUCCESS, Status
from btcore.tree.tree import Tree

MOST_OUTCOMES: Final = 200_000
"""The number of outcomes of one tick from one state after which the search gives up."""
TICK_LIMIT: Final = 2.0
"""The time (s, real time) after which a tick that repeats nodes is stopped with an exception."""
_NAME: Final = re.compile(r"@?[^\W\d]\w*")
"""A name in a script."""
RAISED: Final = -1
UNKNOWN: Final = -2
_ENDED: Final = {SUCCESS: -3, FAILURE: -4, SKIPPED: -5}
RESULT_OF: Final = {number: status for status, number in _ENDED.items()}
"""The result of the tree, for each target of an edge after which the tree has completed."""


class Edge(NamedTuple):
    """One tick from a state.

    Attributes:
        target: The number of the next state; negative = the tree ended, raised, or used an unknown value.
        signals: What happened in the tick: a bit for each of the search's signals.
        advance: The number of the advance of the timers.
        choices: The choices of the leaves.
    """

    target: int
    signals: int
    advance: int
    choices: tuple[int, ...]


class Tick(NamedTuple):
    """What happened in one tick, for the questions.

    Attributes:
        tree: The tree after the tick.
        kept: The model leaves that remained RUNNING: they neither completed nor were halted in the tick.
        events: The ticks of model leaves, in order.
        halted: The model leaves that were halted while RUNNING.
        result: The result of the tree; None if a node raised.
        error: The exception of a node.
        results: The results of the watched nodes in this tick, by uid.
        halts: The uids of the watched nodes that were halted while RUNNING.
    """

    tree: Tree
    kept: Sequence[TreeNode]
    events: Sequence[LeafEvent]
    halted: Sequence[TreeNode]
    result: Status | None
    error: NodeExecutionError | None
    results: "dict[int, list[Status]]"
    halts: set[int]


Check = Callable[[Tick], str | None]
"""Returns what is wrong in a tick, or None."""


@dataclass
class Violation:
    """The first tick in which a check found something wrong, and the sentence that says what."""

    state: int
    edge: Edge
    message: str


@dataclass
class StateGraph:
    """The states that were found, and the ticks between them.

    Attributes:
        edges: The edges of each state that was expanded, by the number of the state.
        parents: For each state the state and the edge by which it was found first; None for an initial state.
        depths: The number of ticks until each state.
        violations: The first violation of each check, by the name of the check.
        bounds: Why the search is not complete, each reason once; empty at a fixpoint.
        transitions: The number of ticks that were run.
    """

    edges: list[list[Edge]] = field(default_factory=list)
    parents: list[tuple[int, Edge] | None] = field(default_factory=list)
    depths: list[int] = field(default_factory=list)
    violations: dict[str, Violation] = field(default_factory=dict)
    bounds: dict[str, tuple[int, Edge] | None] = field(default_factory=dict)
    transitions: int = 0

    @property
    def is_complete(self) -> bool:
        """Whether every state was found."""
        return not self.bounds

    def edges_of(self, state: int) -> list[Edge]:
        """Return the edges of *state*; none if it was not expanded."""
        return self.edges[state] if state < len(self.edges) else []

    def path_to(self, state: int) -> list[tuple[int, Edge]]:
        """Return the states and edges of a shortest path from an initial state to *state*."""
        steps: list[tuple[int, Edge]] = []
        while (step := self.parents[state]) is not None:
            steps.append(step)
            state = step[0]
        return steps[::-1]


class Signals:
    """The meaning of the bits of `Edge.signals`.

    For each model leaf: it was ticked; it was RUNNING before and after the tick without a halt; it succeeded;
    it failed. For each time field: its timer was pending before and after the tick. Then a bit for each of
    the questions' propositions.
    """

    def __init__(self, leaves: Sequence[TreeNode], timers: int, propositions: int) -> None:
        self.leaves = list(leaves)
        self.numbers = {leaf.uid: number for number, leaf in enumerate(leaves)}
        self.timers = timers
        self._first_timer = 4 * len(leaves)
        self._first_proposition = self._first_timer + timers
        self.count = self._first_proposition + propositions

    def ticked(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* was ticked."""
        return 1 << 4 * leaf

    def kept(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* remained RUNNING."""
        return 2 << 4 * leaf

    def succeeded(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* succeeded."""
        return 4 << 4 * leaf

    def failed(self, leaf: int) -> int:
        """Return the bit that is set if leaf number *leaf* failed."""
        return 8 << 4 * leaf

    def pending(self, timer: int) -> int:
        """Return the bit that is set if timer number *timer* remained pending."""
        return 1 << self._first_timer + timer

    def proposition(self, number: int) -> int:
        """Return the bit that is set if proposition *number* holds in the tick."""
        return 1 << self._first_proposition + number


class StateTable:
    """All states that were found, each with a number. Parts that states have in common are stored once."""

    def __init__(self) -> None:
        self._parts: list[Any] = []
        self._numbers: dict[Any, int] = {}
        self._states: dict[tuple[int, ...], int] = {}
        self._keys: list[tuple[int, ...]] = []

    def __len__(self) -> int:
        return len(self._keys)

    def number_of(self, state: TreeState) -> tuple[int, bool]:
        """Return the number of *state*, and whether it is new."""
        numbers = self._numbers
        key: list[int] = []
        for part in (*state.fields, state.statuses, *state[2:]):
            number = numbers.get(part)
            if number is None:
                number = numbers[part] = len(self._parts)
                self._parts.append(part)
            key.append(number)
        found = tuple(key)
        known = self._states.get(found)
        if known is not None:
            return known, False
        number = self._states[found] = len(self._keys)
        self._keys.append(found)
        return number, True

    def state(self, number: int) -> TreeState:
        """Return the state with this number."""
        parts = [self._parts[part] for part in self._keys[number]]
        fields = len(parts) - len(TreeState._fields) + 1
        return TreeState(parts[fields], tuple(parts[:fields]), *parts[fields + 1 :])


class Explorer:
    """Searches the states of one tree.

    Args:
        tree: The tree, with model leaves that share *choices*, and a SimClock at `NOW`.
        choices: The choices of the leaves.
        checks: The checks of each tick, by name.
        state_checks: The checks that depend only on the tree after a tick, by name.
        propositions: Functions that return whether a proposition holds in a tick.
        watched: The nodes whose results and halts the checks or propositions need.

    Attributes:
        graph: The result of the search so far.
        signals: The meaning of the bits of the edges.
    """

    def __init__(
        self,
        tree: Tree,
        choices: Choices,
        checks: dict[str, Check],
        state_checks: dict[str, Check],
        propositions: Sequence[Callable[[Tick], bool]] = (),
        watched: Sequence[TreeNode] = (),
    ) -> None:
        self.tree = tree
        self.choices = choices
        self.graph = StateGraph()
        self.keeper = StateKeeper(tree)
        self.table = StateTable()
        self._checks = dict(checks)
        self._state_checks = dict(state_checks)
        self._propositions = list(propositions)
        self._leaves: list[TreeNode] = [node for node in tree.nodes if model_leaf_model(node) is not None]
        self.signals = Signals(self._leaves, len(self.keeper.timer_slots), len(propositions))
        self._results: dict[int, list[Status]] = {}
        self._watched = list(watched)
        for node in watched:
            node.set_post_tick_function(self._record)
            node.count_ticks()

    def _record(self, node: TreeNode, status: Status) -> Status:
        self._results.setdefault(node.uid, []).append(status)
        return status

    def start(self) -> bool:
        """Add the present state of the tree to the initial states. Return whether it is new."""
        _, is_new = self.table.number_of(self.keeper.capture())
        if is_new:
            self.graph.parents.append(None)
            self.graph.depths.append(0)
        return is_new

    def run(
        self,
        most_ticks: int | None = None,
        memory: int | None = None,
        progress: Callable[[StateGraph], object] | None = None,
    ) -> None:
        """Search until every state is known, or a bound is reached.

        Args:
            most_ticks: The greatest number of ticks of a run; None = no limit.
            memory: The memory (bytes) that the process may use; None = no limit.
            progress: Called from time to time.
        """
        graph = self.graph
        try:
            while len(graph.edges) < len(self.table):
                number = len(graph.edges)
                if most_ticks is not None and graph.depths[number] >= most_ticks:
                    graph.bounds.setdefault(f"runs of more than {most_ticks} ticks were not searched", None)
                    break
                if number % 256 == 0:
                    if memory is not None and _memory_used() > memory:
                        graph.bounds.setdefault(f"the memory limit of {memory >> 20} MB was reached", None)
                        break
                    if progress is not None:
                        progress(graph)
                graph.edges.append(self._expand(number))
        except KeyboardInterrupt:
            graph.bounds.setdefault("the search was interrupted", None)

    def _expand(self, number: int) -> list[Edge]:
        """Run every possible tick from a state. Return its edges."""
        state = self.table.state(number)
        found: dict[tuple[int, int], Edge] = {}
        outcomes = 0
        for index, advance in enumerate(self.keeper.advances(state)):
            given: list[int] | None = []
            while given is not None:
                self.keeper.restore(state, advance)
                tick = self.tick(given)
                given = self.choices.next_given()
                self._add(number, tick, index, advance, found)
                outcomes += 1
                if tick.error is not None and isinstance(tick.error.cause, EndlessTickError):
                    # The search is incomplete now, and such a tick may have any number of outcomes.
                    return list(found.values())
                if outcomes > MOST_OUTCOMES:
                    reason = f"a tick has more than {MOST_OUTCOMES:,} outcomes"
                    self.graph.bounds.setdefault(reason, None)
                    return list(found.values())
        return list(found.values())

    def run_tick(self, state: TreeState, advance: Advance, given: Sequence[int]) -> Tick:
        """Run one tick again."""
        self.keeper.restore(state, advance)
        return self.tick(given)

    def tick(self, given: Sequence[int]) -> Tick:
        """Run one tick from the present state of the tree."""
        self.choices.begin(given)
        self._results.clear()
        tree = self.tree
        running = [leaf for leaf in self._leaves if leaf._status is RUNNING]
        before = {}
        for node in self._watched:
            counts = node.tick_counts
            assert counts is not None
            before[node.uid] = counts.halted
        error: NodeExecutionError | None = None
        result: Status | None = None
        try:
            result = tree.tick_exactly_once()
        except NodeExecutionError as raised:
            error = raised
        self.graph.transitions += 1
        halts = {
            node.uid
            for node in self._watched
            if node.tick_counts is not None and node.tick_counts.halted > before[node.uid]
        }
        events, halted = self.choices.events, self.choices.halted
        if running:
            ended = {event.leaf.uid for event in events if event.result is not RUNNING}
            ended.update(leaf.uid for leaf in halted)
            running = [leaf for leaf in running if leaf._status is RUNNING and leaf.uid not in ended]
        return Tick(tree, running, events, halted, result, error, self._results, halts)

    def _add(
        self,
        number: int,
        tick: Tick,
        index: int,
        advance: Advance,
        found: dict[tuple[int, int], Edge],
    ) -> None:
        """Add the edge of a tick to *found*, unless an equal edge is there already, and check the tick."""
        graph = self.graph
        timers = 0
        reason = None
        if tick.error is not None:
            reason = _what_is_unknown(tick.error, self.tree)
            target = RAISED if reason is None else UNKNOWN
            is_new = False
        elif tick.result is RUNNING:
            timers = self.keeper.kept_timers()
            target, is_new = self.table.number_of(self.keeper.capture(advance.bounds))
        else:
            assert tick.result is not None
            target, is_new = _ENDED.get(tick.result, _ENDED[SKIPPED]), False
        signals = self._signals(tick, timers)
        if (target, signals) in found and not is_new:
            edge = found[target, signals]
        else:
            edge = found[target, signals] = self._edge(target, signals, index)
        if is_new:
            graph.parents.append((number, edge))
            graph.depths.append(graph.depths[number] + 1)
        if reason is not None:
            graph.bounds.setdefault(reason, (number, edge))
            return
        # A state that was found before has been checked before.
        checks = self._checks if target >= 0 and not is_new else {**self._checks, **self._state_checks}
        for name, check in checks.items():
            if name not in graph.violations:
                message = check(tick)
                if message is not None:
                    own = self._edge(target, signals, index)
                    graph.violations[name] = Violation(number, own, message)

    def _edge(self, target: int, signals: int, advance: int) -> Edge:
        """Return the edge of the last tick."""
        return Edge(target, signals, advance, tuple([chosen for chosen, _ in self.choices.made]))

    def _signals(self, tick: Tick, timers: int) -> int:
        signals = self.signals
        numbers = signals.numbers
        bits = 0
        for leaf, _, result, _ in tick.events:
            shift = 4 * numbers[leaf.uid]
            bits |= 1 << shift
            if result is SUCCESS:
                bits |= 4 << shift
            elif result is FAILURE:
                bits |= 8 << shift
        for leaf in tick.kept:
            bits |= 2 << 4 * numbers[leaf.uid]
        bits |= timers << 4 * len(numbers)
        for number, proposition in enumerate(self._propositions):
            try:
                if proposition(tick):
                    bits |= signals.proposition(number)
            except UnknownValueError as error:
                self.graph.bounds.setdefault(str(error), None)
        return bits


def _what_is_unknown(error: NodeExecutionError, tree: Tree) -> str | None:
    """Return why the outcome of a tick that raised is not known, or None if the exception is real."""
    cause = error.cause
    if isinstance(cause, UnknownValueError):
        return str(cause)
    if isinstance(cause, EndlessTickError):
        return f"'{error.path}': {cause}"
    # A conversion or an operator of a script, for example, fails for an unknown value in its own way.
    node = next((node for node in tree.nodes if node.path == error.path), None)
    if node is not None and isinstance(cause, BtcoreError):
        entries = [
            port.blackboard.find(port.key) for port in node.config.inputs.values() if port.key is not None
        ]
        if isinstance(cause, ScriptError):
            entries += [node.blackboard.find(name) for name in _NAME.findall(cause.text)]
        for entry in entries:
            if entry is not None and isinstance(entry.value, UnknownValue):
                return f"the value of {{{entry.value.key}}} is not known: declare its domain"
    return None


def _memory_used() -> int:
    """Return the greatest memory (bytes) that this process has used; 0 on Windows, which is not supported."""
    if sys.platform == "win32":
        return 0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used if sys.platform == "darwin" else used * 1024


def clock_for_search() -> SimClock:
    """Return a clock that shows the time of every tick of a search."""
    return SimClock(NOW)
