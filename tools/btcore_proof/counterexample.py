"""Counterexamples: runs of the ordinary engine that show what is wrong."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from btcore.clock import NS_PER_S, Clock, SimClock
from btcore.status import Status
from btcore.tree.drawing import Fragment
from btcore.tree.tree import Tree
from btcore_proof.exploration import Explorer
from btcore_proof.model_leaves import Choices, LeafEvent, RecordableUnknownValue, UnknownValue
from btcore_proof.state_graph import TickMoment
from btcore_proof.tick_runner import run_tick
from btcore_proof.tick_times import (
    FIRST_PENDING_NS,
    READING_INTERVAL_NS,
    TICK_START_NS,
    Deadline,
    TickClock,
    tick_times,
)

TreeMaker = Callable[[Choices, Clock], Tree]
"""Loads the tree with model leaves, and writes the entries of the run's beginning."""


class LeafTick(NamedTuple):
    """The tick of one leaf, or its halt.

    Attributes:
        path: The leaf's path.
        result: Its result; IDLE if the leaf was halted while RUNNING.
        written: The values that the leaf wrote, as texts by port; `?` = the value is not known.
        name: The leaf's name, or its path if another node has the same name.
    """

    path: str
    result: Status
    written: Mapping[str, str]
    name: str


class RunTick(NamedTuple):
    """One tick of a run.

    Attributes:
        times: The time of the tick (s) since the first tick. If time passes within the tick: the time of each
            reading of the clock; the tick begins at the first.
        leaves: The ticks of the leaves that follow models, in order.
        halted: The paths of the leaves that were halted while RUNNING.
        running: The paths of all nodes that are RUNNING after the tick.
        result: The result of the tree; None if a node raised.
        error: The message of the exception, or "".
        events: The ticks and halts of the leaves, in order; a halt has the result IDLE.
        guesses: The comparisons with unknown values on which the tick depends, as sentences.
    """

    times: Sequence[float]
    leaves: list[LeafTick]
    halted: list[str]
    running: list[str]
    result: Status | None
    error: str
    events: Sequence[LeafTick] = ()
    guesses: Sequence[str] = ()

    @property
    def time(self) -> float:
        """The time (s) at which the tick begins, since the first tick."""
        return self.times[0]


@dataclass(frozen=True)
class RepeatableRun:
    """A run of the ordinary engine with given choices.

    Attributes:
        make: Loads the tree.
        choices_of_ticks: The choices of each tick.
        times: The times of the ticks (ns), from `times_of`.
        domains: The declared values of entries.
    """

    make: TreeMaker = field(compare=False, repr=False)
    choices_of_ticks: Sequence[Sequence[int]]
    times: Sequence[Sequence[int]]
    domains: Mapping[str, tuple[str, ...]]

    def run(self, attach: Callable[[Tree], object]) -> list[RunTick]:
        """Run the ticks; *attach* is called with the tree before its first tick, for example to record it."""
        choices = Choices(self.domains)
        choices.unknown_class = RecordableUnknownValue
        clock = SimClock()
        tree = self.make(choices, clock)
        attach(tree)
        tick_clock = TickClock(tree, clock)
        names = names_of(tree)
        ticks: list[RunTick] = []
        for given, readings in zip(self.choices_of_ticks, self.times, strict=True):
            tick_clock.begin(readings)
            choices.begin(given)
            result, error = run_tick(tree, choices)
            events = [
                LeafTick(
                    event.leaf.config.path,
                    event.result,
                    {port: text_of(value) for port, value in event.written.items()},
                    names[event.leaf.config.uid],
                )
                for event in _shown(choices.events)
            ]
            leaves = [leaf for leaf in events if leaf.result is not Status.IDLE]
            halted = [leaf.path for leaf in events if leaf.result is Status.IDLE]
            running = [node.config.path for node in tree.nodes if node._status is Status.RUNNING]
            shown = readings if readings[0] != readings[-1] else readings[:1]
            seconds = [time / NS_PER_S for time in shown]
            fault, guesses = str(error or ""), list(choices.guesses)
            ticks.append(RunTick(seconds, leaves, halted, running, result, fault, events, guesses))
        tree.flush_observers()
        return ticks


class Counterexample(NamedTuple):
    """A run that shows what is wrong.

    Attributes:
        ticks: The ticks, from the start of the tree.
        cycle: The index of the tick at which a cycle begins that repeats forever; None without a cycle.
        period: The duration of the cycle (s).
        given: The values of the entries that the program sets before the first tick, as texts by key;
            `?` = the value is not known.
        drawing: The tree after the last tick, as lines of texts with their styles.
        run: The run that can be repeated, with two repetitions of the cycle.
    """

    ticks: list[RunTick]
    cycle: int | None = None
    period: float = 0.0
    given: Mapping[str, str] = {}
    drawing: Sequence[Sequence[Fragment]] = ()
    run: RepeatableRun | None = None

    @property
    def recorded_cycle(self) -> tuple[int, float] | None:
        """The index of the tick at which a cycle begins in a recording of `run`, and its duration (s)."""
        return None if self.cycle is None else (len(self.ticks), self.period)


LeafResults = list[tuple[str, Status]]
"""The path and the result of each tick and halt of a model leaf, in order."""


def times_of(
    explorer: Explorer, moments: Sequence[TickMoment]
) -> tuple[list[list[int]] | None, list[LeafResults]]:
    """Return times (ns) at which the timers expire as in these ticks, and what the leaves do in each tick.

    The times are those of `tick_times`, or None.
    """
    results: list[LeafResults] = []
    try:
        return tick_times(len(moments), _deadlines_of(explorer, moments, results)), results
    except IndexError:
        # A node with hidden state does not repeat its timers.
        return None, results


def _deadlines_of(
    explorer: Explorer, moments: Sequence[TickMoment], results: list[LeafResults]
) -> list[Deadline]:
    """Return the deadlines that are set in these ticks, and add what the leaves do in each tick to *results*.

    Raises:
        IndexError: A tick refers to a timer that the ticks before it have not set.
    """
    keeper, table = explorer.keeper, explorer.table
    open_timers: list[int] = []
    deadlines: list[Deadline] = []
    for number, moment in enumerate(moments):
        advance = keeper.advances(table.state(moment.state))[moment.advance]
        for index in advance.expired:
            timer = open_timers[index]
            deadlines[timer] = deadlines[timer]._replace(expired_in=number)
        kept = [timer for index, timer in enumerate(open_timers) if index not in advance.expired]
        for timer in kept:
            deadlines[timer] = deadlines[timer]._replace(last_pending=number)
        tick = explorer.run_moment(moment)
        results.append([(event.leaf.config.path, event.result) for event in _shown(tick.events)])
        open_timers = []
        for value in keeper.deadlines():
            if value >= FIRST_PENDING_NS:
                open_timers.append(kept[value - FIRST_PENDING_NS])
            else:
                open_timers.append(len(deadlines))
                deadlines.append(
                    Deadline(number, *divmod(value - TICK_START_NS, READING_INTERVAL_NS), None, number)
                )
    return deadlines


def _shown(events: Sequence[LeafEvent]) -> list[LeafEvent]:
    """Return the events of leaves, and those of decorators that hold their child back."""
    return [event for event in events if event.result is Status.RUNNING or not event.leaf.children]


def names_of(tree: Tree) -> dict[int, str]:
    """Return the name of each node, or the path if another node has the same name, by uid."""
    counts = Counter(node.name for node in tree.nodes)
    return {
        node.config.uid: node.name if counts[node.name] == 1 else key
        for key, node in tree.nodes_by_path().items()
    }


def text_of(value: object) -> str:
    """Return the text that stands for a value in a counterexample."""
    if isinstance(value, UnknownValue):
        return "?"
    return str(value).lower() if isinstance(value, bool) else str(value)
