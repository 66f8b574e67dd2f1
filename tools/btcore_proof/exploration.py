"""The exhaustive search over the states of a tree, breadth first, on the ordinary engine.

Within a tick, the search stops at each decision of a leaf: moments with the same future are searched once.
"""

import math
import re
import time
from collections import deque
from collections.abc import Callable, Hashable, Sequence, Set
from typing import Final

from btcore.clock import SimClock
from btcore.engine.node import TreeNode, tick_counts_of
from btcore.errors import BtcoreError, NodeExecutionError, ScriptError
from btcore.status import RUNNING, SKIPPED
from btcore.tree.tree import Tree
from btcore_proof.interrupts import (
    EndlessTickError,
    KnownMomentError,
    LostInterruptError,
    OpaqueStateError,
    UnknownOutcomeError,
)
from btcore_proof.model_leaves import Choices, UnknownValue
from btcore_proof.state_graph import (
    END_OF,
    RAISED,
    UNKNOWN,
    Edge,
    Signals,
    StateGraph,
    StateTable,
    Step,
    TickMoment,
    Violation,
)
from btcore_proof.tick_progress import TickProgress
from btcore_proof.tick_runner import Check, Tick, TickRunner
from btcore_proof.tick_times import TICK_START_NS
from btcore_proof.timer_order import Advance
from btcore_proof.tree_state import StateKeeper, TreeState
from btcore_proof.user_code import UserCode, has_user_code

MAX_DECISIONS: Final = 200_000
"""The number of decisions in the ticks from one state after which the search gives up."""
TICK_LIMIT_S: Final = 2.0
"""The time (s, real time) after which a tick that repeats nodes is stopped with an exception."""
_NAME: Final = re.compile(r"@?[^\W\d]\w*")
"""A name in a script."""


class Explorer:
    """Searches the states of one tree.

    Args:
        tree: The tree, with model leaves that share *choices*, and a SimClock at `TICK_START_NS`.
        choices: The choices of the leaves.
        checks: The checks of each tick, by name.
        state_checks: The checks that depend only on the tree after a tick, by name.
        propositions: Functions that return whether a proposition holds in a tick; None = not known.
        watched: The nodes whose results and halts the checks or propositions need.
        instant: Whether ticks take no time.
        favourable: The numbers of the propositions that prevent violations where they hold.

    Attributes:
        graph: The result of the search so far.
        signals: The meaning of the bits of the edges.
        waiting: The states from which the ticks were not run yet, in the order in which they were found.
        counted: The nodes whose results are counted.
        users: The nodes with code of users; None if the tree has none. Each tick is then run twice.
    """

    def __init__(
        self,
        tree: Tree,
        choices: Choices,
        checks: dict[str, Check],
        state_checks: dict[str, Check],
        propositions: Sequence[Callable[[Tick], bool | None]] = (),
        watched: Sequence[TreeNode] = (),
        instant: bool = False,
        favourable: Set[int] = frozenset(),
    ) -> None:
        self.tree = tree
        self.choices = choices
        self.graph = StateGraph()
        self.keeper = StateKeeper(tree, instant)
        self.table = StateTable()
        self._runner = TickRunner(tree, choices, watched)
        self._progress = TickProgress(tree, self.keeper)
        self.users: UserCode | None = None
        if any(map(has_user_code, tree.nodes)):
            self.users = UserCode(tree, self.keeper, choices.interrupt)
        # What happens in the tick that is being run, if it will be repeated.
        self._trace: list[Hashable] = []
        self._checks = dict(checks)
        self._state_checks = dict(state_checks)
        self._memories = [check.remember for check in checks.values() if check.remember is not None]
        self._propositions = list(propositions)
        self._favourable = favourable
        # The decisions whether a comparison with an unknown value is true.
        self._guesses: set[int] = set()
        self.signals = Signals(self._runner.leaves, len(self.keeper.timer_slots), len(propositions))
        self.waiting: deque[int] = deque()
        self._open: list[tuple[int, int]] = []
        self.counted = [node for node in tree.nodes if tick_counts_of(node) is not None]
        # The tick that is being run: where it began, and the vertex that it has reached.
        self._moment = TickMoment(0, 0, ())
        self._advance = Advance((), ())
        self._vertex = 0
        self._choice: int | None = None
        self._events = 0
        self._end = math.inf
        self._time_bound = ""

    def start(self) -> bool:
        """Add the present state of the tree to the initial states. Return whether it is new."""
        try:
            number, is_new = self.table.number_of(self.keeper.capture())
        except OpaqueStateError as error:
            self.graph.bounds.setdefault(str(error), None)
            return False
        if is_new:
            self.add_state(number, None)
        return is_new

    def limit_time(self, seconds: float) -> None:
        """End the search after a time (s, real time)."""
        self._end = time.monotonic() + seconds
        self._time_bound = f"the time limit of {seconds:g} s was reached"

    def is_out_of_time(self) -> bool:
        """Return whether the time of the search is over; note this bound."""
        if time.monotonic() < self._end:
            return False
        self.graph.bounds.setdefault(self._time_bound, None)
        return True

    def add_state(self, number: int, parent: Step | None) -> None:
        """Add a new state, which was found by *parent*; None = an initial state."""
        self.graph.add_state(parent)
        self.waiting.append(number)

    def expand(self, number: int) -> None:
        """Run every possible tick from a state."""
        state = self.table.state(number)
        advances = self.keeper.advances(state)
        limit = len(self.graph.decisions) + MAX_DECISIONS
        self.choices.watcher = self._decide
        try:
            for index, advance in enumerate(advances):
                self._run_tick(state, advance, TickMoment(number, index, ()), number, None)
                while self._open:
                    if self.is_out_of_time():
                        self._open.clear()
                        return
                    vertex, choice = self._open.pop()
                    self._run_tick(state, advance, self.graph.decisions[vertex], vertex, choice)
                    if len(self.graph.decisions) > limit:
                        reason = f"the ticks from one state have more than {MAX_DECISIONS:,} decisions"
                        self.graph.bounds.setdefault(reason, None)
                        self._open.clear()
                        return
            if self.users is not None:
                self.users.check_outside()
        finally:
            self.choices.watcher = None
            for reason in self.users.reasons if self.users is not None else ():
                self.graph.bounds.setdefault(reason, None)

    def _run_tick(
        self, state: TreeState, advance: Advance, moment: TickMoment, vertex: int, choice: int | None
    ) -> None:
        """Run a tick that passes a vertex, and record what follows the vertex.

        Args:
            state: The state before the tick.
            advance: The advance of the timers.
            moment: The moment of the vertex.
            choice: The choice at the vertex; None if the tick begins there.
        """
        self._moment, self._advance = moment, advance
        self._vertex, self._choice = vertex, choice
        self._events = 0
        self._progress.begin()
        self.graph.transitions += 1
        self.keeper.restore(state, advance)
        given = moment.choices if choice is None else (*moment.choices, choice)
        self._trace.clear()
        try:
            tick = self._runner.run(given)
        except KnownMomentError:
            self._repeat(state, advance, len(given))
            return
        self._add_end(tick)
        if tick.error is not None and isinstance(tick.error.cause, EndlessTickError):
            # The search is incomplete now, and such a tick may have any number of decisions.
            self._open.clear()
        elif self.users is not None:
            self._trace.append(self._end_of(tick))
            self._repeat(state, advance, len(given))

    def _repeat(self, state: TreeState, advance: Advance, first_new: int) -> None:
        """Run the last tick once more, if it has run code of users, and note a difference.

        Args:
            state: The state before the tick.
            advance: The advance of the timers.
            first_new: The number of choices after which the tick was not known before.
        """
        users, choices = self.users, self.choices
        if users is None:
            return
        users.check_fields()
        first = self._trace
        repeated: list[Hashable] = []
        chosen_before = [chosen for chosen, _ in choices.made]

        def follow(leaf: TreeNode | None, options: int, choice: int) -> None:
            repeated.append((None if leaf is None else leaf.config.uid, options))
            if len(choices.made) >= first_new:
                repeated.extend(self._moment_of(leaf))
            if len(repeated) >= len(first) or repeated != first[: len(repeated)]:
                raise choices.interrupt(KnownMomentError())
            self._progress.add_choice(leaf, choice)

        self._progress.begin()
        self.keeper.restore(state, advance, shift=True)
        choices.watcher = follow
        try:
            repeated.append(self._end_of(self._runner.run(chosen_before)))
        except KnownMomentError:
            pass
        finally:
            choices.watcher = self._decide
        if repeated != first:
            users.note_difference(first, repeated)

    def _end_of(self, tick: Tick) -> Hashable:
        """Return what distinguishes the end of a tick from that of another one."""
        error = tick.error
        if error is not None:
            return error.path, type(error.cause)
        if tick.result is RUNNING:
            try:
                return self.keeper.capture(self._advance.bounds)
            except OpaqueStateError:
                return None
        return tick.result, self._runner.so_far()

    def run_moment(self, moment: TickMoment) -> Tick:
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
            KnownMomentError: The rest of the tick has been searched already.
        """
        choices = self.choices
        count, given = len(choices.made), len(choices.given)
        if self.users is not None:
            self._trace.append((None if leaf is None else leaf.config.uid, options))
        if count == given - 1:
            # The vertex at which the part of the tick begins that is not known.
            self._events = len(choices.events)
        elif count >= given:
            self._add_decision(leaf, options)
        self._progress.add_choice(leaf, choice)

    def _add_decision(self, leaf: TreeNode | None, options: int) -> None:
        state, rest = self._moment_of(leaf)
        if self.users is not None:
            self._trace += (state, rest)
        number, is_new = self.table.number_of(state, rest)
        step = self._add_edge(number)
        if not is_new:
            raise self.choices.interrupt(KnownMomentError())
        self.graph.add_decision(step, self._present())
        if self.choices.guess:
            self._guesses.add(number)
        self._open += [(number, option) for option in range(options - 1, 0, -1)]
        self._vertex, self._choice = number, 0

    def _present(self) -> TickMoment:
        return self._moment._replace(choices=tuple([chosen for chosen, _ in self.choices.made]))

    def _moment_of(self, leaf: TreeNode | None) -> tuple[TreeState, Hashable]:
        """Return the state at a decision of *leaf*, and what else decides the rest of the tick."""
        keeper = self.keeper
        timers: Hashable = ()
        if keeper.timer_slots:
            # A node may set a deadline later by a reading of the clock that it has made already.
            timers = (keeper.clock.readings, keeper.kept_timers(), *keeper.deadlines())
        # Within a script, the search does not know which values have been evaluated already.
        moment = None if self.choices.guess else self._progress.moment(leaf)
        rest = (
            moment or self._present(),
            self._runner.so_far(),
            timers,
            *[remember(self.choices.events) for remember in self._memories],
        )
        return keeper.capture(self._advance.bounds), rest

    def _add_end(self, tick: Tick) -> None:
        """Add the edge that ends a tick, and check the tick."""
        graph = self.graph
        timers = 0
        reason = None
        is_new = False
        if tick.error is not None:
            reason = _what_is_unknown(tick.error, self.tree)
            if isinstance(tick.error.cause, LostInterruptError) and self.users is not None:
                reason = f"{self.users.names} catches an exception with which the search ends a tick"
            target = RAISED if reason is None else UNKNOWN
        elif tick.result is RUNNING:
            timers = self.keeper.kept_timers()
            try:
                target, is_new = self.table.number_of(self.keeper.capture(self._advance.bounds))
            except OpaqueStateError as error:
                target, reason = UNKNOWN, str(error)
        else:
            assert tick.result is not None
            target = END_OF.get(tick.result, END_OF[SKIPPED])
        truths = [proposition(tick) for proposition in self._propositions]
        true = {number for number, truth in enumerate(truths) if truth}
        unsure = {number for number, truth in enumerate(truths) if truth is None}
        end = self.signals.of_end(tick.kept, timers, true | (unsure & self._favourable))
        step = self._add_edge(target, end)
        if unsure:
            # As if all that is not known were as bad as possible for the answers.
            worst = self.signals.of_end(tick.kept, timers, true | (unsure - self._favourable))
            signals = step[1].signals & ~end | worst | self.signals.guessed
            graph.edges[step[0]].append(step[1]._replace(signals=signals))
        if is_new:
            self.add_state(target, step)
        if reason is not None:
            graph.bounds.setdefault(reason, step)
            return
        # A state that was found before has been checked before.
        checks = self._checks if target >= 0 and not is_new else {**self._checks, **self._state_checks}
        is_guessed = bool(self.choices.guesses)
        for name, check in checks.items():
            if graph.lacks_violation(name, is_guessed):
                message = check.find(tick)
                if message is not None:
                    graph.violations[name] = Violation(step, message, is_guessed)

    def _add_edge(self, target: int, signals: int = 0) -> Step:
        """Add the edge from the present vertex to the next one. Return the step."""
        events = self.choices.events
        signals |= self.signals.of_events(events[self._events :])
        if self._vertex in self._guesses:
            signals |= self.signals.guessed
        self._events = len(events)
        edge = Edge(target, signals, self._moment.advance, self._choice)
        self.graph.edges[self._vertex].append(edge)
        return self._vertex, edge


def _what_is_unknown(error: NodeExecutionError, tree: Tree) -> str | None:
    """Return why the outcome of a tick that raised is not known, or None if the exception is real."""
    cause = error.cause
    if isinstance(cause, UnknownOutcomeError):
        return str(cause)
    # A conversion or an operator of a script, for example, fails for an unknown value in its own way.
    node = next((node for node in tree.nodes if node.config.path == error.path), None)
    if node is not None and isinstance(cause, BtcoreError):
        entries = [
            port.blackboard.find(port.key) for port in node.config.inputs.values() if port.key is not None
        ]
        if isinstance(cause, ScriptError):
            entries += [node._blackboard.find(name) for name in _NAME.findall(cause.text)]
        for entry in entries:
            if entry is not None and isinstance(entry.value, UnknownValue):
                return f"the value of {{{entry.value.key}}} is not known: declare its domain"
    return None


def clock_for_search() -> SimClock:
    """Return a clock that shows the time at which every tick of a search begins."""
    return SimClock(TICK_START_NS)
