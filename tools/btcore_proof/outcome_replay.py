"""Runs with given outcomes of the leaves: a counterexample is run again, also after the tree was changed."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, Protocol

from btcore import entry_points
from btcore.clock import NS_PER_S, SimClock
from btcore.engine.node import TreeNode
from btcore.errors import BtcoreError
from btcore.registry.outcome_grammar import LETTERS, Outcome, parse_outcomes
from btcore.status import RUNNING
from btcore.suggestions import did_you_mean
from btcore.tree.tree import Tree
from btcore_proof.counterexample import TreeMaker, text_of
from btcore_proof.interrupts import UnknownOutcomeError
from btcore_proof.model_leaves import Choices, ModelOutcome, Writer, counted_entries, model_leaf_model
from btcore_proof.propositions import Question, parse_proposition, parse_question
from btcore_proof.standard_questions import ENDS, LEAVES, STANDARD_QUESTIONS, state_checks, tick_checks
from btcore_proof.tick_runner import Check, Tick, TickRunner
from btcore_proof.tick_times import TickClock

CYCLES: Final = 100
"""How often the ticks of a cycle are run. A tree that is still RUNNING afterwards counts as endless."""

TickOutcomes = tuple[float | Sequence[float], Mapping[str, str]]
"""The time of a tick (s), and the outcomes of each leaf by its name or path, such as `S(goal=3)`.

A leaf has an outcome for each time that it is ticked in this tick.

If time passes within the tick, there are several times: one of each reading of the clock.
"""


class OutcomesReader(Protocol):
    """Reads a recording, under the entry point group `btcore.outcomes`."""

    def __call__(self, file: Path, /) -> tuple[Sequence[TickOutcomes], Mapping[str, str]]:
        """Return the outcomes in each tick, and the entries before the first tick, as texts by key."""
        ...


class OutcomesError(BtcoreError):
    """The outcomes of the leaves of a tree are invalid."""


def recorded_outcomes(file: Path) -> tuple[Sequence[TickOutcomes], Mapping[str, str]]:
    """Return the outcomes in each tick of a recording, and the entries before the first tick.

    Raises:
        LogError: The recording cannot be read.
    """
    loaded, _ = entry_points.load("btcore.outcomes")
    if not loaded:
        raise OutcomesError(f"{file}: recordings cannot be read: install btcore_recorder")
    read: OutcomesReader = loaded[0].value
    return read(file)


class ReplayChoices(Choices):
    """Choices that give each leaf its outcomes.

    A leaf takes its outcome of the present tick. If there is none, it takes its next outcome; after its last
    outcome, it repeats this outcome, unless that is RUNNING. In all other cases, it takes the first result of
    its model. An action that is not endless ends at the latest after all ticks and a further cycle, because a
    cycle that repeats forever is fair.

    Args:
        cycle: The index of the tick from which the ticks are repeated; None = they are not repeated.
        domains: The declared values of entries, as texts, by key.

    Raises:
        OutcomesError: The outcomes of a leaf are invalid.
    """

    def __init__(
        self, ticks: Sequence[TickOutcomes], cycle: int | None, domains: Mapping[str, tuple[str, ...]]
    ) -> None:
        super().__init__(domains)
        self._cycle = cycle
        self._ticks = [{name: _parse(name, text) for name, text in leaves.items()} for _, leaves in ticks]
        self._place = -1
        self._names: dict[int, str] = {}
        self._taken: dict[str, int] = {}
        self._kept: dict[int, int] = {}

    def check(self, tree: Tree) -> None:
        """Look up the leaves that have outcomes, and the entries whose writes are counted, in *tree*.

        Raises:
            OutcomesError: The tree has no such leaf.
        """
        self.counted = counted_entries(tree)
        leaves = [node for node in tree.nodes if not node.children]
        for name in dict.fromkeys(name for tick in self._ticks for name in tick):
            try:
                self._names[tree.node(name).config.uid] = name
            except BtcoreError:
                hint = did_you_mean(name, [leaf.name for leaf in leaves])
                raise OutcomesError(f"the tree has no leaf '{name}'{hint}") from None

    def begin(self, given: Sequence[int]) -> None:
        """Begin the next tick."""
        super().begin(given)
        self._taken.clear()
        self._place += 1
        if self._place == len(self._ticks) and self._cycle is not None:
            self._place = self._cycle

    def choose_outcome(
        self, leaf: TreeNode, options: Sequence[ModelOutcome], writers: Sequence[Writer]
    ) -> int:
        """Return the number of the option that is most like the outcome of *leaf*."""
        recorded = self._recorded_outcome(self._names.get(leaf.config.uid, leaf.config.path))
        if self._runs_too_long(leaf):
            recorded = None
        number = 0
        if recorded is not None:
            number = max(range(len(options)), key=lambda index: _likeness(options[index], writers, recorded))
        # The choice is also counted, so that a tick without an end is found.
        self.given = [*(chosen for chosen, _ in self.made), number]
        return self.choose(len(options))

    def _runs_too_long(self, leaf: TreeNode) -> bool:
        """Return whether an action has been RUNNING for longer than a fair cycle lets it."""
        kept = self._kept.get(leaf.config.uid, 0) + 1 if leaf._status is RUNNING else 0
        self._kept[leaf.config.uid] = kept
        model = model_leaf_model(leaf)
        if self._cycle is None or model is None or model.endless:
            return False
        return kept > 2 * len(self._ticks) - self._cycle

    def _recorded_outcome(self, name: str) -> Outcome | None:
        count = self._taken.get(name, 0)
        self._taken[name] = count + 1
        now = self._ticks[self._place].get(name)
        if now is not None:
            return now[min(count, len(now) - 1)]
        later = self._ticks[self._place + 1 :]
        if self._cycle is not None:
            later += self._ticks[self._cycle : self._place]
        for leaves in later:
            if name in leaves:
                return leaves[name][0]
        for leaves in reversed(self._ticks[: self._place]):
            if name in leaves:
                return leaves[name][-1] if leaves[name][-1].letter != "R" else None
        return None


def _parse(name: str, text: str) -> list[Outcome]:
    try:
        outcomes = [outcome for start in parse_outcomes(text) for outcome in start]
    except ValueError as error:
        raise OutcomesError(f"'{name}': {error}") from None
    if any(outcome.letter not in LETTERS for outcome in outcomes):
        raise OutcomesError(f"'{name}': the outcomes '{text}' contain X, but leaves of proofs do not raise")
    return outcomes


def _likeness(option: ModelOutcome, writers: Sequence[Writer], outcome: Outcome) -> tuple[bool, int]:
    """Return how well an option of a model agrees with an outcome; the better, the greater."""
    status, picks = option
    values: dict[str, str] = {}
    for writer, pick in zip(writers, picks, strict=False):
        if pick >= 0:
            values[writer.output.name] = text_of(writer.values[pick]) if writer.values else "?"
    written = dict(outcome.outputs)
    different = sum(values.get(port) != written.get(port) for port in {*values, *written})
    return status is LETTERS[outcome.letter], -different


def replay_outcomes(
    make: TreeMaker,
    choices: ReplayChoices,
    ticks: Sequence[TickOutcomes],
    question: str,
    cycle: tuple[int, float] | None = None,
) -> str | None:
    """Run a tree with given outcomes, on the ordinary engine. Return what is wrong, or None.

    The run ends when the fault occurs, when the tree ends, or after the ticks.

    Args:
        make: Loads the tree.
        choices: The choices with the same outcomes.
        question: The question that the run may violate.
        cycle: The index of the tick at which a cycle begins, and the duration of the cycle (s).

    Raises:
        OutcomesError: A leaf is not in the tree, or the question has no runs or compares a value that is not
            known.
        QuestionError: The question is invalid.
    """
    clock = SimClock()
    tree = make(choices, clock)
    choices.check(tree)
    check = _run_check(tree, question)
    runner = TickRunner(tree, choices, check.watched)
    tick_clock = TickClock(tree, clock)
    try:
        for times in _times(ticks, cycle):
            tick_clock.begin(times)
            tick = runner.run(())
            message = check.after(tick)
            if message is not None or tick.result is not RUNNING:
                return message
        return check.at_end(cycle is not None)
    except UnknownOutcomeError as error:
        raise OutcomesError(str(error)) from error
    finally:
        tree.flush_observers()


def _times(replayed: Sequence[TickOutcomes], cycle: tuple[int, float] | None) -> list[list[int]]:
    """Return the times (ns) of all ticks."""
    times_of_ticks = [times if isinstance(times, Sequence) else [times] for times, _ in replayed]
    ticks = [[round(time * NS_PER_S) for time in times] for times in times_of_ticks]
    if cycle is not None:
        start, duration = cycle
        repeated = ticks[start:]
        for number in range(1, CYCLES):
            later = round(number * duration * NS_PER_S)
            ticks += [[time + later for time in times] for times in repeated]
    return ticks


class _RunCheck:
    """A check, tick by tick, whether a run violates a question. This base class finds nothing.

    Attributes:
        watched: The nodes whose results and halts must be recorded.
    """

    watched: Sequence[TreeNode] = ()

    def after(self, tick: Tick) -> str | None:
        """Return what is wrong after a tick, or None."""
        return None

    def at_end(self, is_endless: bool) -> str | None:
        """Return what is wrong with a run in which the tree has not ended, or None."""
        return None


class _TickCheck(_RunCheck):
    def __init__(self, check: Check) -> None:
        self._check = check

    def after(self, tick: Tick) -> str | None:
        return self._check.find(tick)


class _EndCheck(_RunCheck):
    def at_end(self, is_endless: bool) -> str | None:
        return "the tree is still RUNNING although no leaf fails forever" if is_endless else None


class _PropositionCheck(_RunCheck):
    """The base class of checks of the user's questions: `judge` gets the values of the propositions."""

    def __init__(self, question: Question, tree: Tree) -> None:
        self._question = question
        self._first = parse_proposition(question.first, tree)
        self._second = parse_proposition(question.second, tree) if question.second else self._first
        nodes = (*self._first.nodes, *self._second.nodes)
        self.watched = [*{node.config.uid: node for node in nodes}.values()]

    def after(self, tick: Tick) -> str | None:
        first, second = self._first.holds(tick), self._second.holds(tick)
        if first is None or second is None:
            raise OutcomesError(f"'{self._question.text}' compares a value that is not known")
        return self.judge(first, second, tick.result is not RUNNING and tick.error is None)

    def judge(self, first: bool, second: bool, has_ended: bool) -> str | None:
        """Return what is wrong after a tick, or None."""
        raise NotImplementedError


class _NeverCheck(_PropositionCheck):
    def judge(self, first: bool, second: bool, has_ended: bool) -> str | None:
        return f"'{self._question.first}' holds" if first else None


class _BeforeCheck(_PropositionCheck):
    _has_occurred = False

    def judge(self, first: bool, second: bool, has_ended: bool) -> str | None:
        self._has_occurred = self._has_occurred or first
        if second and not self._has_occurred:
            return f"'{self._question.second}' holds before '{self._question.first}'"
        return None


class _LeadsToCheck(_PropositionCheck):
    _pending: int | None = None
    """The number of ticks since the first proposition held; None = the second need not hold."""

    def judge(self, first: bool, second: bool, has_ended: bool) -> str | None:
        if second:
            self._pending = None
        elif self._pending is not None:
            self._pending += 1
        elif first:
            self._pending = 0
        if self._pending is None:
            return None
        question = self._question
        if question.within is not None and self._pending >= question.within:
            return f"'{question.second}' does not hold within {question.within} ticks"
        return f"'{question.second}' does not follow" if has_ended else None

    def at_end(self, is_endless: bool) -> str | None:
        has_to_follow = self._pending is not None and is_endless
        return f"'{self._question.second}' does not follow" if has_to_follow else None


_CHECKS: Final = {"never": _NeverCheck, "before": _BeforeCheck, "leads to": _LeadsToCheck}


def _run_check(tree: Tree, question: str) -> _RunCheck:
    """Return the check whether a run violates a question."""
    if question == LEAVES:
        raise OutcomesError(f"'{question}' is not a question about a single run")
    if question == ENDS:
        return _EndCheck()
    if question in STANDARD_QUESTIONS:
        return _TickCheck({**tick_checks(tree), **state_checks(tree)}[question])
    parsed = parse_question(question)
    return _CHECKS[parsed.kind](parsed, tree)
