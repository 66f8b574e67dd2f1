"""The exhaustive search over the states of a tree, breadth first, on the ordinary engine.

Within a tick, the search stops at each decision of a leaf: moments with the same future are searched once.
"""

import re
import sys
from collections import deque
from collections.abc import Callable, Hashable, Sequence
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
from btcore.proof.state_graph import (
    END_OF,
    RAISED,
    UNKNOWN,
    Edge,
    Moment,
    Signals,
    StateGraph,
    Step,
    Violation,
)
from btcore.proof.tick_progress import TickProgress
from btcore.proof.timer_order import Advance
from btcore.proof.tree_state import NOW, StateKeeper, TreeState
from btcore.status import RUNNING, SKIPPED, Status
from btcore.tree.tree import Tree

MOST_DECISIONS: Final = 200_000
"""The number of decisions in the ticks from one state after which the search gives up."""
TICK_LIMIT: Final = 2.0
"""The time (s, real time) after which a tick that repeats nodes is stopped with an exception."""
_NAME: Final = re.compile(r"@?[^\W\d]\w*")
"""A name in a script."""


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


class Check(NamedTuple):
    """A check of ticks.

    Attributes:
        find: Returns what is wrong in a tick, or None.
        remember: Returns what *find* must know of the first part of a tick; None = nothing.
    """

    find: Callable[[Tick], str | None]
    remember: Callable[[Sequence[LeafEvent]], Hashable] | None = None


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
            state: The state of the tree.
            moment: What else decides the rest of the tick; None = a state between two ticks.
        """
        parts = (*state.fields, state.statuses, *state[2:], moment)
        return self.number_of_key(tuple([self.part_number(part) for part in parts]))

    def state(self, number: int) -> TreeState:
        """Return the state of the tree at the vertex with this number."""
        parts = [self._parts[part] for part in self._keys[number][:-1]]
        fields = len(parts) - len(TreeState._fields) + 1
        return TreeState(parts[fields], tuple(parts[:fields]), *parts[fields + 1 :])


class TickRunner:
    """Runs single ticks of a tree with model leaves.

    Args:
        tree: The tree.
        choices: The choices that its leaves share.
        watched: The nodes whose results and halts are recorded.

    Attributes:
        leaves: The model leaves of the tree.
    """

    def __init__(self, tree: Tree, choices: Choices, watched: Sequence[TreeNode] = ()) -> None:
        self.tree = tree
        self.choices = choices
        self.leaves: list[TreeNode] = [node for node in tree.nodes if model_leaf_model(node) is not None]
        self._watched = list(watched)
        self._results: dict[int, list[Status]] = {}
        self._halts_before: dict[int, int] = {}
        self._running: list[TreeNode] = []
        for node in watched:
            node.set_post_tick_function(self._record)
            node.count_ticks()

    def _record(self, node: TreeNode, status: Status) -> Status:
        self._results.setdefault(node.uid, []).append(status)
        return status

    def run(self, given: Sequence[int]) -> Tick:
        """Run one tick from the present state of the tree, with the choices *given*."""
        self.choices.begin(given)
        self._results.clear()
        self._running = [leaf for leaf in self.leaves if leaf._status is RUNNING]
        self._halts_before = {node.uid: _halts_of(node) for node in self._watched}
        error: NodeExecutionError | None = None
        result: Status | None = None
        try:
            result = self.tree.tick_exactly_once()
        except NodeExecutionError as raised:
            error = raised
        return Tick(
            self.tree,
            self._kept(),
            self.choices.events,
            self.choices.halted,
            result,
            error,
            self._results,
            self._halts(),
        )

    def so_far(self) -> tuple[Hashable, ...]:
        """Return what the end of the present tick depends on, of what has happened in it."""
        return (
            tuple([leaf.uid for leaf in self._kept()]),
            tuple([(uid, frozenset(found)) for uid, found in sorted(self._results.items())]),
            frozenset(self._halts()),
        )

    def _kept(self) -> Sequence[TreeNode]:
        if not self._running:
            return ()
        ended = {event.leaf.uid for event in self.choices.events if event.result is not RUNNING}
        ended.update(leaf.uid for leaf in self.choices.halted)
        return [leaf for leaf in self._running if leaf._status is RUNNING and leaf.uid not in ended]

    def _halts(self) -> set[int]:
        before = self._halts_before
        return {node.uid for node in self._watched if _halts_of(node) > before[node.uid]}


def _halts_of(node: TreeNode) -> int:
    counts = node.tick_counts
    return 0 if counts is None else counts.halted


class _KnownMomentError(KeyboardInterrupt):
    """The rest of the tick has been searched before. The engine passes on only interrupts as they are."""


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
        waiting: The states from which the ticks were not run yet, in the order in which they were found.
        counted: The nodes whose results are counted.
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
        self._runner = TickRunner(tree, choices, watched)
        self._progress = TickProgress(tree, self.keeper)
        self._checks = dict(checks)
        self._state_checks = dict(state_checks)
        self._memories = [check.remember for check in checks.values() if check.remember is not None]
        self._propositions = list(propositions)
        self.signals = Signals(self._runner.leaves, len(self.keeper.timer_slots), len(propositions))
        self.waiting: deque[int] = deque()
        self._open: list[tuple[int, int]] = []
        self.counted = [node for node in tree.nodes if node.tick_counts is not None]
        # The tick that is being run: where it began, and the vertex that it has reached.
        self._state: TreeState | None = None
        self._moment = Moment(0, 0, ())
        self._bounds: Advance = Advance((), ())
        self._vertex = 0
        self._choice: int | None = None
        self._events = 0

    def start(self) -> bool:
        """Add the present state of the tree to the initial states. Return whether it is new."""
        number, is_new = self.table.number_of(self.keeper.capture())
        if is_new:
            self.add_state(number, None)
        return is_new

    def add_state(self, number: int, parent: Step | None) -> None:
        """Add a new state, which was found by *parent*; None = an initial state."""
        self.graph.add_state(parent)
        self.waiting.append(number)

    def expand(self, number: int) -> None:
        """Run every possible tick from a state."""
        state = self.table.state(number)
        advances = self.keeper.advances(state)
        limit = len(self.graph.decisions) + MOST_DECISIONS
        self.choices.watcher = self._decide
        try:
            for index, advance in enumerate(advances):
                self._run_tick(state, advance, Moment(number, index, ()), number, None)
                while self._open:
                    vertex, choice = self._open.pop()
                    self._run_tick(state, advance, self.graph.decisions[vertex], vertex, choice)
                    if len(self.graph.decisions) > limit:
                        reason = f"the ticks from one state have more than {MOST_DECISIONS:,} decisions"
                        self.graph.bounds.setdefault(reason, None)
                        self._open.clear()
                        return
        finally:
            self.choices.watcher = None

    def _run_tick(
        self, state: TreeState, advance: Advance, moment: Moment, vertex: int, choice: int | None
    ) -> None:
        """Run a tick that passes a vertex, and record what follows the vertex.

        Args:
            state: The state before the tick.
            advance: The advance of the timers.
            moment: The moment of the vertex.
            vertex: The vertex.
            choice: The choice at the vertex; None if the tick begins there.
        """
        self._state, self._moment, self._bounds = state, moment, advance
        self._vertex, self._choice = vertex, choice
        self._events = 0
        self._progress.begin()
        self.graph.transitions += 1
        self.keeper.restore(state, advance)
        given = moment.choices if choice is None else (*moment.choices, choice)
        try:
            tick = self._runner.run(given)
        except _KnownMomentError:
            return
        self._add_end(tick, advance)
        if tick.error is not None and isinstance(tick.error.cause, EndlessTickError):
            # The search is incomplete now, and such a tick may have any number of decisions.
            self._open.clear()

    def run_moment(self, moment: Moment) -> Tick:
        """Run a whole tick again."""
        state = self.table.state(moment.state)
        self.keeper.restore(state, self.keeper.advances(state)[moment.advance])
        self._progress.begin()
        return self._runner.run(moment.choices)

    def _decide(self, leaf: TreeNode | None, options: int, choice: int) -> None:
        """Follow the decision of a leaf in the present tick, and add it to the graph if it is new.

        Args:
            leaf: The leaf; None = the innermost node that is being ticked.
            options: The number of its options.
            choice: The option that it will take.

        Raises:
            _KnownMomentError: The rest of the tick has been searched already.
        """
        choices = self.choices
        count, given = len(choices.made), len(choices.given)
        if count == given - 1:
            # The vertex at which the part of the tick begins that is not known.
            self._events = len(choices.events)
        elif count >= given:
            self._add_decision(leaf, options)
        self._progress.add_choice(leaf, choice)

    def _add_decision(self, leaf: TreeNode | None, options: int) -> None:
        keeper, graph, choices = self.keeper, self.graph, self.choices
        made = tuple([chosen for chosen, _ in choices.made])
        moment = self._moment._replace(choices=made)
        timers = (keeper.kept_timers(), *keeper.deadlines()) if keeper.timer_slots else ()
        rest = (
            self._progress.moment(leaf) or (self._state, moment.advance, made),
            self._runner.so_far(),
            timers,
            *[remember(choices.events) for remember in self._memories],
        )
        number, is_new = self.table.number_of(keeper.capture(self._bounds.bounds), rest)
        step = self._add_edge(number)
        if not is_new:
            raise _KnownMomentError
        graph.add_decision(step, moment)
        self._open += [(number, option) for option in range(options - 1, 0, -1)]
        self._vertex, self._choice = number, 0

    def _add_end(self, tick: Tick, advance: Advance) -> None:
        """Add the edge that ends a tick, and check the tick."""
        graph = self.graph
        timers = 0
        reason = None
        is_new = False
        if tick.error is not None:
            reason = _what_is_unknown(tick.error, self.tree)
            target = RAISED if reason is None else UNKNOWN
        elif tick.result is RUNNING:
            timers = self.keeper.kept_timers()
            target, is_new = self.table.number_of(self.keeper.capture(advance.bounds))
        else:
            assert tick.result is not None
            target = END_OF.get(tick.result, END_OF[SKIPPED])
        true: list[int] = []
        for number, proposition in enumerate(self._propositions):
            try:
                if proposition(tick):
                    true.append(number)
            except UnknownValueError as error:
                graph.bounds.setdefault(str(error), None)
        signals = self.signals.of_end(tick.kept, timers, true)
        step = self._add_edge(target, signals)
        if is_new:
            self.add_state(target, step)

        if reason is not None:
            graph.bounds.setdefault(reason, step)
            return
        # A state that was found before has been checked before.
        checks = self._checks if target >= 0 and not is_new else {**self._checks, **self._state_checks}
        for name, check in checks.items():
            if name not in graph.violations:
                message = check.find(tick)
                if message is not None:
                    graph.violations[name] = Violation(step, message)

    def _add_edge(self, target: int, signals: int = 0) -> Step:
        """Add the edge from the present vertex to the next one. Return the step."""
        events = self.choices.events
        signals |= self.signals.of_events(events[self._events :])
        self._events = len(events)
        edge = Edge(target, signals, self._moment.advance, self._choice)
        self.graph.edges[self._vertex].append(edge)
        return self._vertex, edge


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


def memory_used() -> int:
    """Return the greatest memory (bytes) that this process has used; 0 on Windows, which is not supported."""
    if sys.platform == "win32":
        return 0
    import resource

    used = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return used if sys.platform == "darwin" else used * 1024


def clock_for_search() -> SimClock:
    """Return a clock that shows the time of every tick of a search."""
    return SimClock(NOW)
