"""Runs in which the leaves follow a plan: a counterexample is run again, also after the tree was changed."""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

from btcore.clock import NS_PER_S, SimClock
from btcore.engine.node import TreeNode
from btcore.errors import BtcoreError
from btcore.status import RUNNING, Status
from btcore.suggestions import did_you_mean
from btcore.tree.tree import Tree
from btcore_proof.counterexample import Counterexample, LeafTick, TreeMaker, text_of
from btcore_proof.interrupts import UnknownOutcomeError
from btcore_proof.model_leaves import Choices, Outcome, Writer, counted_entries, model_leaf_model
from btcore_proof.propositions import parse_proposition, parse_question
from btcore_proof.standard_questions import ENDS, LEAVES, STANDARD_QUESTIONS, state_checks, tick_checks
from btcore_proof.tick_runner import Tick, TickRunner
from btcore_proof.tick_times import TickClock

CYCLES: Final = 100
"""How often the ticks of a cycle are run. A tree that is still RUNNING afterwards counts as endless."""

PlannedResult = str | tuple[str, Mapping[str, str]]
"""The result of a leaf, such as "SUCCESS"; or the result, and the values that it writes, by port."""
PlannedTick = tuple[float | Sequence[float], Mapping[str, PlannedResult | Sequence[PlannedResult]]]
"""The time of a tick (s), and the result of each leaf by its name or path; a list if it is ticked again.

If time passes within the tick, there are several times: one of each reading of the clock.
"""
_Planned = tuple[str, Mapping[str, str]]


class PlanError(BtcoreError):
    """A plan for the leaves of a tree is invalid."""


def planned_ticks(run: Counterexample) -> list[PlannedTick]:
    """Return the plan with which the leaves repeat a counterexample."""
    plan: list[PlannedTick] = []
    for tick in run.ticks:
        leaves: dict[str, list[PlannedResult]] = {}
        for leaf in tick.leaves:
            leaves.setdefault(leaf.name, []).append(_planned_result(leaf))
        times = tick.times if len(tick.times) > 1 else tick.time
        plan.append((times, {name: many if many[1:] else many[0] for name, many in leaves.items()}))
    return plan


def _planned_result(leaf: LeafTick) -> PlannedResult:
    return (leaf.result.name, dict(leaf.written)) if leaf.written else leaf.result.name


class PlannedChoices(Choices):
    """Choices that give each leaf the results of a plan.

    A leaf takes the result that is planned for the present tick. If there is none, it takes its next planned
    result; after its last planned result, it repeats this result, unless that is RUNNING. In all other cases,
    it takes the first result of its model. An action that is not endless ends at the latest after the plan
    and a further cycle, because a cycle that repeats forever is fair.

    Args:
        plan: The plan.
        cycle: The index of the tick from which the plan is repeated; None = it is not repeated.
        domains: The declared values of entries, as texts, by key.

    Raises:
        PlanError: The plan is invalid.
    """

    def __init__(
        self, plan: Sequence[PlannedTick], cycle: int | None, domains: Mapping[str, tuple[str, ...]]
    ) -> None:
        super().__init__(domains)
        self._cycle = cycle
        self._plan = [
            {name: _results(name, planned) for name, planned in leaves.items()} for _, leaves in plan
        ]
        self._place = -1
        self._names: dict[int, str] = {}
        self._taken: dict[str, int] = {}
        self._kept: dict[int, int] = {}

    def check(self, tree: Tree) -> None:
        """Look up the leaves of the plan, and the entries whose writes are counted, in *tree*.

        Raises:
            PlanError: The tree has no such leaf.
        """
        self.counted = counted_entries(tree)
        leaves = [node for node in tree.nodes if not node.children]
        for name in dict.fromkeys(name for tick in self._plan for name in tick):
            try:
                self._names[tree.node(name).config.uid] = name
            except BtcoreError:
                hint = did_you_mean(name, [leaf.name for leaf in leaves])
                raise PlanError(f"the plan names '{name}', but the tree has no such leaf{hint}") from None

    def begin(self, given: Sequence[int]) -> None:
        """Begin the next tick of the plan."""
        super().begin(given)
        self._taken.clear()
        self._place += 1
        if self._place == len(self._plan) and self._cycle is not None:
            self._place = self._cycle

    def choose_outcome(self, leaf: TreeNode, options: Sequence[Outcome], writers: Sequence[Writer]) -> int:
        """Return the number of the outcome that is planned for *leaf*, or of a similar one."""
        wanted = self._wanted(self._names.get(leaf.config.uid, leaf.config.path))
        if self._runs_too_long(leaf):
            wanted = None
        number = 0
        if wanted is not None:
            result, written = wanted
            number = max(range(len(options)), key=lambda it: _likeness(options[it], writers, result, written))
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
        return kept > 2 * len(self._plan) - self._cycle

    def _wanted(self, name: str) -> _Planned | None:
        count = self._taken.get(name, 0)
        self._taken[name] = count + 1
        now = self._plan[self._place].get(name)
        if now is not None:
            return now[min(count, len(now) - 1)]
        later = self._plan[self._place + 1 :]
        if self._cycle is not None:
            later += self._plan[self._cycle : self._place]
        for leaves in later:
            if name in leaves:
                return leaves[name][0]
        for leaves in reversed(self._plan[: self._place]):
            if name in leaves:
                return leaves[name][-1] if leaves[name][-1][0] != RUNNING.name else None
        return None


def _results(name: str, planned: PlannedResult | Sequence[PlannedResult]) -> list[_Planned]:
    many = [planned] if isinstance(planned, (str, tuple)) else list(planned)
    results: list[_Planned] = [(it, {}) if isinstance(it, str) else (it[0], it[1]) for it in many]
    for result, _ in results:
        if result not in Status.__members__:
            raise PlanError(f"the plan of '{name}': '{result}' is not a result")
    if not results:
        raise PlanError(f"the plan of '{name}' is empty")
    return results


def _likeness(
    option: Outcome, writers: Sequence[Writer], result: str, written: Mapping[str, str]
) -> tuple[bool, int]:
    """Return how well an outcome agrees with a planned result; the better, the greater."""
    status, picks = option
    values: dict[str, str] = {}
    for writer, pick in zip(writers, picks, strict=False):
        if pick >= 0:
            values[writer.output.name] = text_of(writer.values[pick]) if writer.values else "?"
    different = sum(values.get(port) != written.get(port) for port in {*values, *written})
    return status.name == result, -different


def run_plan(
    make: TreeMaker,
    choices: PlannedChoices,
    plan: Sequence[PlannedTick],
    question: str,
    cycle: tuple[int, float] | None = None,
    attach: Callable[[Tree], object] | None = None,
    cycles: int = CYCLES,
) -> str | None:
    """Run a tree with a plan, on the ordinary engine. Return what is wrong, or None.

    The run ends when the fault occurs, when the tree ends, or after the plan. A cycle is run *cycles* times.

    Args:
        make: Loads the tree.
        choices: The choices with the same plan.
        plan: The plan.
        question: The question that the run may violate.
        cycle: The index of the tick at which a cycle begins, and the duration of the cycle (s).
        attach: Called with the tree before its first tick.
        cycles: How often the cycle is run.

    Raises:
        PlanError: The plan names a leaf that the tree does not have, or the question has no runs or compares
            a value that is not known.
        QuestionError: The question is invalid.
    """
    clock = SimClock()
    tree = make(choices, clock)
    choices.check(tree)
    fault = _Fault(tree, question)
    runner = TickRunner(tree, choices, fault.watched)
    if attach is not None:
        attach(tree)
    tick_clock = TickClock(tree, clock)
    try:
        for times in _times(plan, cycle, cycles):
            tick_clock.begin(times)
            tick = runner.run(())
            message = fault.after(tick)
            if message is not None or tick.result is not RUNNING:
                return message
        return fault.at_end(cycle is not None)
    except UnknownOutcomeError as error:
        raise PlanError(str(error)) from error
    finally:
        tree.flush_observers()


def _times(plan: Sequence[PlannedTick], cycle: tuple[int, float] | None, cycles: int) -> list[list[int]]:
    """Return the times (ns) of all ticks."""
    planned = [times if isinstance(times, Sequence) else [times] for times, _ in plan]
    ticks = [[round(time * NS_PER_S) for time in times] for times in planned]
    if cycle is not None:
        start, duration = cycle
        repeated = ticks[start:]
        for number in range(1, cycles):
            later = round(number * duration * NS_PER_S)
            ticks += [[time + later for time in times] for times in repeated]
    return ticks


class _Fault:
    """Checks, tick by tick, whether a run violates a question."""

    def __init__(self, tree: Tree, question: str) -> None:
        self._check = None
        self._ends = question == ENDS
        self._question = None
        self._pending: int | None = None
        self._occurred = False
        self.watched = []
        if question == LEAVES:
            raise PlanError(f"'{question}' is not a question about a single run")
        if question in STANDARD_QUESTIONS:
            self._check = {**tick_checks(tree), **state_checks(tree)}.get(question)
            return
        self._question = parse_question(question)
        first = parse_proposition(self._question.first, tree)
        second = parse_proposition(self._question.second, tree) if self._question.second else first
        self._first, self._second = first.holds, second.holds
        self.watched = [*{node.config.uid: node for node in (*first.nodes, *second.nodes)}.values()]

    def after(self, tick: Tick) -> str | None:
        """Return what is wrong after a tick, or None."""
        if self._check is not None:
            return self._check.find(tick)
        question = self._question
        if question is None:
            return None
        first, second = self._first(tick), self._second(tick)
        if first is None or second is None:
            raise PlanError(f"'{question.text}' compares a value that is not known")
        if question.kind == "never":
            return f"'{question.first}' holds" if first else None
        if question.kind == "before":
            self._occurred = self._occurred or first
            return (
                f"'{question.second}' holds before '{question.first}'"
                if second and not self._occurred
                else None
            )
        if second:
            self._pending = None
        elif self._pending is not None:
            self._pending += 1
        elif first:
            self._pending = 0
        if self._pending is None:
            return None
        if question.within is not None and self._pending >= question.within:
            return f"'{question.second}' does not hold within {question.within} ticks"
        has_ended = tick.result is not RUNNING and tick.error is None
        return f"'{question.second}' does not follow" if has_ended else None

    def at_end(self, is_endless: bool) -> str | None:
        """Return what is wrong with a run in which the tree has not ended, or None."""
        if self._ends and is_endless:
            return "the tree is still RUNNING although no leaf fails forever"
        if self._pending is not None and is_endless and self._question is not None:
            return f"'{self._question.second}' does not follow"
        return None
