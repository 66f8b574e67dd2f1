"""`prove`: answer questions about all runs of a tree."""

from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from functools import partial
from itertools import product
from typing import Final, NamedTuple

from btcore.clock import Clock
from btcore.engine.leaf import Condition
from btcore.engine.node import TreeNode, start_tick_counts, tick_counts_of
from btcore.errors import ConversionError
from btcore.status import FAILURE, RUNNING, SUCCESS
from btcore.suggestions import join_names
from btcore.tree.drawing import draw_results
from btcore.tree.tree import Tree
from btcore_proof.counterexample import Counterexample, RepeatableRun, text_of, times_of
from btcore_proof.exploration import TICK_LIMIT_S, Explorer, clock_for_search
from btcore_proof.fair_cycles import (
    FairCycle,
    Fairness,
    Part,
    cyclic_parts,
    find_fair_cycle,
    states_from,
    steps_back,
)
from btcore_proof.leaf_models import ModelError
from btcore_proof.model_leaves import (
    Choices,
    UnknownValue,
    counted_entries,
    model_leaf_model,
    operands_of,
    unread_keys,
)
from btcore_proof.propositions import ParsedProposition, Question, QuestionError, parse_proposition
from btcore_proof.search import SearchLimits, search
from btcore_proof.standard_questions import (
    ENDS,
    EXCEPTIONS,
    INPUTS,
    LEAVES,
    STANDARD_QUESTIONS,
    endless_nodes,
    state_checks,
    tick_checks,
)
from btcore_proof.state_graph import RAISED, RESULT_OF, StateGraph, Step, WholeTick
from btcore_proof.tick_runner import Tick
from btcore_proof.user_code import texts_in_code

PROVED: Final = "proved"
REFUTED: Final = "refuted"
POSSIBLE: Final = "possible"
UNKNOWN_ANSWER: Final = "unknown"
_ENDS: Final = frozenset({*RESULT_OF, RAISED})
"""The targets of edges with which a run ends."""


class Answer(NamedTuple):
    """The answer to one question.

    Attributes:
        question: The question.
        answer: `proved`, `refuted`, `possible` if a run that shows what is wrong depends on comparisons with
            unknown values, or `unknown`.
        detail: What is wrong, what bounded the search, or under which condition the question is proved; "".
        ticks: The number of ticks of the counterexample, or of the longest run without a repeated state.
        states: The number of states that were searched.
        counterexample: A run that shows what is wrong; None if there is none.
        is_vacuous: Whether the premise of the question never occurs.
    """

    question: str
    answer: str
    detail: str
    ticks: int
    states: int
    counterexample: Counterexample | None = None
    is_vacuous: bool = False


class Report(NamedTuple):
    """The result of a search.

    Attributes:
        answers: The answers to the standard questions, then to the others, in the order of the questions.
        transitions: The number of ticks that the search has run.
    """

    answers: list[Answer]
    transitions: int


class _View(NamedTuple):
    """A part of the state graph, and its parts with cycles."""

    graph: StateGraph
    cyclic_parts: list[Part]


class _Prepared(NamedTuple):
    """A question of the user, with the numbers of its propositions, or why it cannot be understood."""

    question: Question
    first: int = 0
    second: int = 0
    error: str = ""


class Prover:
    """Answers questions about one tree.

    Args:
        make: Loads the tree with model leaves for these choices and this clock.
        domains: The declared values of entries, as texts, by key.
        given: The keys that the program sets before the first tick.
        instant_leaves: Whether leaves take no time, so that all deadlines of a tick are set at the same time.

    Attributes:
        explorer: The search.
        tree: The tree that the search runs.
        errors: Why questions cannot be understood, for example because the tree has no such node.
    """

    def __init__(
        self,
        make: Callable[[Choices, Clock], Tree],
        questions: Sequence[Question] = (),
        domains: Mapping[str, tuple[str, ...]] | None = None,
        given: Sequence[str] = (),
        instant_leaves: bool = False,
    ) -> None:
        texts = " ".join([*given, *(question.text for question in questions)])

        def limited(choices: Choices, clock: Clock) -> Tree:
            tree = make(choices, clock)
            tree.tick_limit = TICK_LIMIT_S
            choices.unread = unread_keys(tree, choices, f"{texts} {texts_in_code(tree)}")
            choices.counted = counted_entries(tree)
            return tree

        self._make = limited
        self._domains = dict(domains or {})
        choices = Choices(self._domains)
        self.tree = tree = limited(choices, clock_for_search())
        parsed: list[ParsedProposition] = []
        self._questions = [_prepare(question, tree, parsed) for question in questions]
        favourable = {
            each.second if each.question.kind == "leads to" else each.first
            for each in self._questions
            if each.question.kind != "never" and not each.error
        }
        self.errors = [prepared.error for prepared in self._questions if prepared.error]
        self._endless = endless_nodes(tree)
        self._first_endless = len(parsed)
        watched = {node.config.uid: node for proposition in parsed for node in proposition.nodes}
        for node in tree.nodes:
            if not node.children:
                start_tick_counts(node)
        self.explorer = Explorer(
            tree,
            choices,
            tick_checks(tree),
            state_checks(tree),
            [
                *(proposition.holds for proposition in parsed),
                *map(_runs, self._endless),
                self._runs_endless_node,
            ],
            list(watched.values()),
            instant_leaves,
            favourable,
        )
        # Without timers, it does not matter how long leaves take.
        self._assumed = (
            "if leaves take no time" if instant_leaves and self.explorer.keeper.timer_slots else ""
        )
        self._beginnings: list[dict[str, object]] = []
        for beginning in beginnings_of(tree, choices, self._domains, given):
            write_entries(tree, beginning)
            if self.explorer.start():
                self._beginnings.append(beginning)

    def answer(
        self,
        limits: SearchLimits | None = None,
        progress: Callable[[StateGraph], object] | None = None,
    ) -> Report:
        """Search, and answer the standard questions and the given ones."""
        users = self.explorer.users
        with nullcontext() if users is None else users.guarded():
            search(self.explorer, limits or SearchLimits(), progress)
        graph = self.explorer.graph
        views = [_View(graph, cyclic_parts(graph))]
        guessed = self.explorer.signals.guessed
        if any(edge.signals & guessed for edges in graph.edges for edge in edges):
            certain = graph.without(guessed)
            views.insert(0, _View(certain, cyclic_parts(certain)))
        asked: list[Callable[[_View], Answer]] = [
            partial(self._answer_standard_question, name) for name in STANDARD_QUESTIONS
        ]
        asked += [partial(self._answer_own_question, prepared) for prepared in self._questions]
        return Report([self._answer_in(views, ask) for ask in asked], graph.transitions)

    def _answer_in(self, views: Sequence[_View], ask: Callable[[_View], Answer]) -> Answer:
        """Return the answer to a question: refuted if a run without guesses shows it, else by the last view.

        Args:
            views: The whole graph; before it, if there are guesses, the part that does not depend on them.
            ask: Answers the question by a view.
        """
        for view in views:
            answer = ask(view)
            if answer.answer == REFUTED and (view is views[0] or answer.counterexample is None):
                return answer
        if view is views[0]:
            return answer
        if answer.answer == REFUTED:
            return answer._replace(answer=POSSIBLE)
        if answer.question is LEAVES and answer.answer == PROVED:
            reason = "some of it depends on comparisons with values that are not known"
            return answer._replace(answer=UNKNOWN_ANSWER, detail=reason)
        return answer

    # --- the standard questions

    def _answer_standard_question(self, question: str, view: _View) -> Answer:
        if question is ENDS:
            return self._answer_ends(view)
        if question is LEAVES:
            return self._answer_leaves(view.graph)
        violation = view.graph.violations.get(question)
        if violation is not None:
            return self._refuted_answer(view.graph, question, violation.message, [violation.step])
        return self._proved_answer(view.graph, question)

    def _answer_ends(self, view: _View) -> Answer:
        graph, signals, endless = view.graph, self.explorer.signals, self._endless
        ends = any(edge.target in RESULT_OF for edges in graph.edges for edge in edges)
        runs = [signals.holds(self._first_endless + number) for number in range(len(endless))]
        runs_none = signals.fails(self._first_endless + len(endless))
        fairness = self._fairness()
        # Again and again, no node runs that is meant to run forever.
        pauses = Fairness(0, runs_none)
        failing_conditions = 0
        actions_succeed: list[Fairness] = []
        for number, leaf in enumerate(signals.leaves):
            if isinstance(leaf, Condition):
                failing_conditions |= signals.failed(number)
            else:
                actions_succeed.append(Fairness(signals.failed(number), signals.succeeded(number)))
        cycle = _find_cycle(view, [*fairness, pauses, *actions_succeed], avoided=failing_conditions)
        if cycle is not None and (ends or not endless):
            return self._refuted_answer(
                graph, ENDS, "it can go on forever although no leaf fails forever", [], cycle
            )
        if _limits(graph):
            return self._proved_answer(graph, ENDS)
        if endless and not ends:
            return self._proved_answer(
                graph, ENDS, f"never by itself, because of {join_names(_quoted(endless), 'and')}"
            )
        reasons = [
            f"'{node.config.path}' runs forever"
            for node, its in zip(endless, runs, strict=True)
            if _find_cycle(view, [*fairness, Fairness(0, its)], avoided=runs_none)
        ]
        for number, leaf in enumerate(signals.leaves):
            succeeds, fails = signals.succeeded(number), signals.failed(number)
            sometimes_fails = [*fairness, pauses, Fairness(0, fails)]
            if _find_cycle(view, sometimes_fails, avoided=succeeds):
                reasons.append(f"'{leaf.config.path}' fails forever")
            elif isinstance(leaf, Condition) and _find_cycle(view, [*sometimes_fails, Fairness(0, succeeds)]):
                reasons.append(f"'{leaf.config.path}' changes its result forever")
        detail = f"unless {join_names(reasons, 'or')}" if reasons else ""
        return self._proved_answer(graph, ENDS, detail)

    def _runs_endless_node(self, tick: Tick) -> bool:
        return any(node._status is RUNNING for node in self._endless)

    def _fairness(self) -> list[Fairness]:
        """Return the conditions that an action that is not endless ends, and that every timer expires."""
        signals = self.explorer.signals
        conditions = [
            Fairness(signals.ticked(number), signals.released(number))
            for number, leaf in enumerate(signals.leaves)
            if (model := model_leaf_model(leaf)) is not None and model.lasts and not model.endless
        ]
        return conditions + [Fairness(0, signals.stopped(number)) for number in range(signals.timers)]

    def _answer_leaves(self, graph: StateGraph) -> Answer:
        problems: list[str] = []
        for node in self.tree.nodes:
            counts = tick_counts_of(node)
            if node.children or counts is None:
                continue
            model = model_leaf_model(node)
            if not counts.ticks - counts.skipped:
                problems.append(f"'{node.config.path}' is never ticked")
            elif model is not None:
                if SUCCESS in model.results and not counts.success:
                    problems.append(f"'{node.config.path}' never succeeds")
                if FAILURE in model.results and not counts.failure:
                    problems.append(f"'{node.config.path}' never fails")
        if not problems or _limits(graph):
            return self._proved_answer(graph, LEAVES)
        return self._answer(LEAVES, REFUTED, "; ".join(problems))

    # --- questions of the user

    def _answer_own_question(self, prepared: _Prepared, view: _View) -> Answer:
        graph, signals = view.graph, self.explorer.signals
        question = prepared.question
        if prepared.error:
            return self._answer(question.text, UNKNOWN_ANSWER, prepared.error)
        first = signals.holds(prepared.first)
        second = signals.holds(prepared.second)
        occurs = [
            (state, edge) for state, edges in enumerate(graph.edges) for edge in edges if edge.signals & first
        ]
        if question.kind == "never":
            if occurs:
                first_step = min(occurs, key=lambda step: graph.depths[step[0]])
                return self._refuted_answer(graph, question.text, "", [first_step])
            return self._proved_answer(graph, question.text)
        if question.kind == "before":
            return self._answer_before(graph, question, first, second)
        counterexample = self._find_counterexample(view, occurs, second, question.within)
        if counterexample is not None:
            steps, cycle = counterexample
            outcome = "not within this number of ticks" if question.within is not None else "never follows"
            return self._refuted_answer(graph, question.text, f"'{question.second}' {outcome}", steps, cycle)
        answer = self._proved_answer(graph, question.text)
        if answer.answer == PROVED and not occurs:
            return answer._replace(is_vacuous=True, detail=f"'{question.first}' never occurs")
        return answer

    def _answer_before(self, graph: StateGraph, question: Question, first: int, second: int) -> Answer:
        starts = [state for state, parent in enumerate(graph.parents) if parent is None]
        steps_to = states_from(graph, starts, lambda edge: not edge.signals & first)
        for state in steps_to:
            for edge in graph.edges[state]:
                if edge.signals & second and not edge.signals & first:
                    steps = [*steps_back(steps_to, state), (state, edge)]
                    return self._refuted_answer(graph, question.text, "", steps)
        answer = self._proved_answer(graph, question.text)
        occurs = any(edge.signals & second for edges in graph.edges for edge in edges)
        if answer.answer == PROVED and not occurs:
            return answer._replace(is_vacuous=True, detail=f"'{question.second}' never occurs")
        return answer

    def _find_counterexample(
        self, view: _View, occurs: Sequence[Step], second: int, within: int | None
    ) -> tuple[list[Step], FairCycle | None] | None:
        """Return a run in which *second* does not follow: steps from a state, and the cycle at its end."""
        graph = view.graph
        pending = [step for step in occurs if not step[1].signals & second]
        if within is not None:
            return _find_late_counterexample(graph, pending, second, within)
        for step in pending:
            if step[1].target in _ENDS:
                return [step], None
        if not pending:
            return None
        entered: dict[int, Step] = {}
        for step in pending:
            if step[1].target >= 0:
                entered.setdefault(step[1].target, step)
        steps_to = states_from(graph, entered, lambda edge: not edge.signals & second)
        for state in steps_to:
            for edge in graph.edges[state]:
                if edge.target in _ENDS and not edge.signals & second:
                    steps = steps_back(steps_to, state)
                    origin = steps[0][0] if steps else state
                    return [entered[origin], *steps, (state, edge)], None
        parts = [
            {vertex: edges for vertex, edges in part.items() if vertex in steps_to}
            for part in view.cyclic_parts
        ]
        cycle = find_fair_cycle(graph, parts, self._fairness(), lambda edge: not edge.signals & second)
        if cycle is None:
            return None
        steps = steps_back(steps_to, cycle.start)
        origin = steps[0][0] if steps else cycle.start
        return [entered[origin], *steps], cycle

    # --- answers

    def _answer(
        self, question: str, answer: str, detail: str = "", shown: Counterexample | None = None
    ) -> Answer:
        graph = self.explorer.graph
        ticks = len(shown.ticks) if shown is not None else max(graph.depths, default=0) + 1
        return Answer(question, answer, detail, ticks, graph.states, shown)

    def _proved_answer(self, graph: StateGraph, question: str, detail: str = "") -> Answer:
        """Return that *question* is proved, or unknown if not everything was searched."""
        limits = _limits(graph)
        if limits:
            return self._answer(question, UNKNOWN_ANSWER, "; ".join(limits))
        keys = [f"{{{key}}}" for key in sorted(self.explorer.choices.assumed)]
        compared = f"if scripts can compare the values of {join_names(keys, 'and')}" if keys else ""
        return self._answer(question, PROVED, ", ".join(filter(None, [self._assumed, compared, detail])))

    def _refuted_answer(
        self,
        graph: StateGraph,
        question: str,
        message: str,
        steps: Sequence[Step],
        cycle: FairCycle | None = None,
    ) -> Answer:
        """Return that *question* is refuted, if the ordinary engine reproduces the run.

        Args:
            graph: The graph of the view.
            question: The question.
            message: What is wrong.
            steps: The end of the run, from a state.
            cycle: The cycle that follows.
        """
        cycle_steps = cycle.steps if cycle is not None else []
        origin = [*steps, *cycle_steps][0][0]
        before = [*graph.path_to(origin), *steps]
        # The cycle twice: the normal run must be able to begin it again.
        run = graph.whole_ticks(before + cycle_steps * 2)
        prefix = len(graph.whole_ticks(before))
        length = (len(run) - prefix) // 2
        times, results = times_of(self.explorer, [tick.moment for tick in run])
        if times is None:
            return self._answer(
                question, UNKNOWN_ANSWER, f"{message}, but no times of ticks were found for it"
            )
        start = self._start_of(run[0].moment.state)
        beginning = self._beginnings[start]

        def make(choices: Choices, clock: Clock) -> Tree:
            tree = self._make(choices, clock)
            own = {
                key: choices.unknown(value.key, value.operands) if isinstance(value, UnknownValue) else value
                for key, value in beginning.items()
            }
            write_entries(tree, own)
            return tree

        trees: list[Tree] = []
        repeatable = RepeatableRun(make, [tick.moment.choices for tick in run], times, self._domains)
        ticks = repeatable.run(trees.append)
        is_confirmed = all(
            _agrees(whole_tick, tick.result)
            and expected == [(leaf.path, leaf.result) for leaf in tick.events]
            for whole_tick, tick, expected in zip(run, ticks, results, strict=True)
        )
        if not is_confirmed:
            return self._answer(question, UNKNOWN_ANSWER, f"{message}, but a normal run does not show it")
        period = ticks[prefix + length].time - ticks[prefix].time if cycle_steps else 0.0
        ticks = ticks[: prefix + length]
        shown = Counterexample(
            ticks,
            prefix if cycle_steps else None,
            period,
            {key: text_of(value) for key, value in beginning.items()},
            draw_results(trees[0].id, len(ticks), trees[0].root),
            repeatable,
        )
        return self._answer(question, REFUTED, message, shown)

    def _start_of(self, state: int) -> int:
        """Return the number of the beginning whose state is *state*."""
        starts = [number for number, parent in enumerate(self.explorer.graph.parents) if parent is None]
        return starts.index(state)


def _limits(graph: StateGraph) -> list[str]:
    """Return why the search has not seen everything: its bounds, and an error that ends runs."""
    errors = [graph.violations[name] for name in (INPUTS, EXCEPTIONS) if name in graph.violations]
    return [*graph.bounds, *(f"not searched beyond this error: {error.message}" for error in errors[:1])]


def _find_cycle(view: _View, conditions: Sequence[Fairness], avoided: int = 0) -> FairCycle | None:
    """Return a fair cycle without the signals *avoided*, or None."""
    return find_fair_cycle(view.graph, view.cyclic_parts, conditions, lambda edge: not edge.signals & avoided)


def _find_late_counterexample(
    graph: StateGraph, pending: Sequence[Step], second: int, within: int
) -> tuple[list[Step], FairCycle | None] | None:
    """Return a shortest run in which *second* does not follow in time: steps from a vertex."""
    begun: dict[int, list[Step]] = {}
    for step in pending:
        begun.setdefault(graph.depths[step[0]], []).append(step)
    # For each vertex the path to it with the fewest ticks left, and their number: no other ends sooner.
    waiting: dict[int, tuple[list[Step], int]] = {}
    depth = min(begun, default=0)
    while waiting or depth <= max(begun, default=-1):
        steps = [([step], within) for step in begun.get(depth, ())]
        within_tick = deque(waiting.items())
        passed: dict[int, int] = {}
        while within_tick:
            vertex, (path, left) = within_tick.popleft()
            for edge in graph.edges[vertex]:
                if edge.signals & second:
                    continue
                longer = [*path, (vertex, edge)]
                if graph.ends_tick(edge):
                    steps.append((longer, left - 1))
                elif left < passed.get(edge.target, within + 1):
                    passed[edge.target] = left
                    within_tick.append((edge.target, (longer, left)))
        waiting = {}
        for path, left in steps:
            target = path[-1][1].target
            if left == 0 or target in _ENDS:
                return path, None
            if target >= 0 and (target not in waiting or left < waiting[target][1]):
                waiting[target] = path, left
        depth += 1
    return None


def _prepare(question: Question, tree: Tree, parsed: list[ParsedProposition]) -> _Prepared:
    """Add the propositions of a question to *parsed*."""
    texts = [question.first, question.second] if question.second else [question.first]
    try:
        parts = [parse_proposition(text, tree) for text in texts]
    except QuestionError as error:
        return _Prepared(question, error=str(error))
    parsed += parts
    return _Prepared(question, len(parsed) - len(parts), len(parsed) - 1)


def _runs(node: TreeNode) -> Callable[[Tick], bool]:
    return lambda tick: node._status is RUNNING


def _quoted(nodes: Sequence[TreeNode]) -> list[str]:
    return [f"'{node.config.path}'" for node in nodes]


def _agrees(tick: WholeTick, result: object) -> bool:
    """Return whether a tick of a normal run has the result that the search found."""
    if tick.target >= 0:
        return result is RUNNING
    return result is RESULT_OF.get(tick.target)


def beginnings_of(
    tree: Tree, choices: Choices, domains: Mapping[str, tuple[str, ...]], given: Sequence[str]
) -> list[dict[str, object]]:
    """Return the possible values of the entries *given* before the first tick."""
    options: list[list[object]] = []
    for key in given:
        entry = tree.blackboard.find(key)
        texts = domains.get(key)
        if texts is None:
            operands = operands_of(entry.declared) if entry is not None else ""
            options.append([choices.unknown(key, operands)])
            continue
        try:
            strong = entry is not None and entry.declared.strong
            options.append([entry.declared.from_text(text) if strong and entry else text for text in texts])
        except ConversionError as error:
            raise ModelError(f"[entries] {key}: {error}") from error
    return [dict(zip(given, values, strict=True)) for values in product(*options)]


def write_entries(tree: Tree, values: Mapping[str, object]) -> None:
    """Write entries of the main tree's blackboard before the first tick."""
    board = tree.blackboard
    for key, value in values.items():
        board.declare(key).put(value, 0)
