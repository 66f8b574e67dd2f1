"""A run of a tree with mock leaves, whose user steps through the ticks and answers for the leaves.

The run is a recording that grows. It waits nowhere: a tick is run with the answers that are known. If a leaf
is ticked that has none, the tick is interrupted, and the state before it is restored later; with one more
answer, the tick is run again from its beginning. A moment within a tick is reached in the same way: the tick
is run up to it. The time is simulated.
"""

import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import Any, Final, Literal, NamedTuple

from btcore.blackboard.ports import Output
from btcore.clock import NS_PER_S, SimClock
from btcore.engine.node import TreeNode
from btcore.engine.recorded_events import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    ExternalHaltEnded,
    Raised,
    RecordedError,
    StatusSet,
    Written,
)
from btcore.errors import BtcoreError, ConversionError, NodeExecutionError, TickInterrupt
from btcore.loading.instantiate import instantiate
from btcore.logs.moments import Explanation, Moment, Values
from btcore.registry.outcome_grammar import LETTERS, Outcome, parse_outcomes
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, NodeType
from btcore.suggestions import did_you_mean
from btcore.xml.plan.plan import Plans
from btcore_recorder.inputs import UNKNOWN_CHECKSUM, Input, Result, RunRecording, Step, TreeState, is_external
from btcore_recorder.mock_leaves import (
    Answer,
    LeafAsked,
    LeafPlan,
    MockLeaf,
    StopCondition,
    TickCursor,
    TickImpossible,
    TickStopped,
    ticks_its_children,
)
from btcore_recorder.moments import MAX_TESTED_TICKS, Moments, input_values
from btcore_recorder.recorder import Recorder, RecorderOptions
from btcore_recorder.values import Encoder

DEFAULT_PERIOD_S: Final = 0.1
MAX_TICKS: Final = 10_000
MAX_ANSWERS: Final = 200_000
"""Maximum number of answers in a run."""
MAX_OUTPUT: Final = 10_000
"""Maximum number of characters of an output."""
_STATE_INTERVAL: Final = 50
"""The number of steps between two states that are kept of a run."""

Target = Literal["tick", "into", "over", "out"]
"""Where `MockRun.advance` goes: to the end of a tick, or to a moment within it."""


class Question(NamedTuple):
    """A leaf that is ticked, and has no answer.

    Attributes:
        uid: The number of the leaf.
        path: The path of the leaf.
        inputs: The values of its inputs.
        outputs: Its output ports: the name, the type and the key of each.
        can_run: Whether RUNNING is a valid answer.
    """

    uid: int
    path: str
    inputs: Values
    outputs: Sequence[tuple[str, str, str]]
    can_run: bool


class MockRun(Moments):
    """A run of a tree with mock leaves.

    It satisfies the protocol of the entry point group `btcore.runs`, which the studio declares.

    Args:
        plans: The plans of the tree. The code of its leaves is not used.
        period_s: The simulated time between two ticks (s).

    Attributes:
        event: The number of begins and ends of nodes in the step up to the present moment; 0 if it is between
            two steps.
        question: The leaf that is ticked now and has no answer, or None.
        problem: Why the tick cannot be run further, or "".

    Raises:
        TreeError: The tree cannot be loaded.

    Examples:
        >>> import btcore
        >>> from btcore.xml.models.model_file import add_document_models
        >>> from btcore.xml.plan.plan import plan_document
        >>> from btcore.xml.read.read import parse_text
        >>> from btcore_recorder.mock_run import MockRun
        >>> text = '''<root BTCPP_format="4">
        ...   <BehaviorTree ID="Door"> <Sequence> <IsClosed/> <Open/> </Sequence> </BehaviorTree>
        ...   <TreeNodesModel> <Condition ID="IsClosed"/> <Action ID="Open"/> </TreeNodesModel>
        ... </root>'''
        >>> nodes, document = btcore.Registry.standard(), parse_text(text)
        >>> _ = add_document_models(nodes, document)
        >>> run = MockRun(plan_document(document, nodes))
        >>> run.advance("tick").tick, run.question.path
        (1, 'IsClosed::2')
        >>> run.answer("S", {}).statuses[1].name, run.question.path
        ('SUCCESS', 'Open::3')
        >>> run.answer("F", {}).root.name, run.count
        ('FAILURE', 1)
    """

    def __init__(self, plans: Plans, period_s: float = DEFAULT_PERIOD_S) -> None:
        self._source = tree = instantiate(plans, (), None, SimClock())
        types: dict[str, Any] = {}
        recorder = Recorder(tree, lambda step: None, types.__setitem__, RecorderOptions())
        recorder.close()
        self._growing: list[Step] = []
        super().__init__(RunRecording(recorder.head._replace(types=types), self._growing))
        self.event = 0
        self.question: Question | None = None
        self.problem = ""
        self._period = max(1, round(period_s * NS_PER_S))
        self._output_encoder = Encoder(types.__setitem__)
        self._cursor = TickCursor(self.tree)
        self._leaves = {
            node.config.uid: MockLeaf(path, node.type is NodeType.CONDITION)
            for path, node in self.tree.nodes_by_path().items()
            if is_external(type(node)) and not ticks_its_children(node)
        }
        self._before: tuple[TreeState, int] | None = None  # before a step that was run in part
        self._log: list[Input] | None = None  # of a new step, while it is run
        self._given: list[Answer] = []  # of the tick that has not ended
        self._used = 0  # the number of those that were used, while the tick is run
        self._answer_count = 0
        self._is_wanted: StopCondition | None = None

    # --- the recording so far

    @property
    def stopped_at(self) -> int:
        """The node that has begun or ended last within the step; 0 between two steps."""
        return self._cursor.events[self.event - 1][0] if self.event else 0

    @property
    def leaves(self) -> Mapping[int, LeafPlan]:
        """How each mock leaf answers, by its number."""
        return {uid: leaf.plan for uid, leaf in self._leaves.items()}

    @property
    def answers(self) -> Mapping[int, Sequence[Outcome]]:
        """The answers of each mock leaf so far, by its number."""
        return {uid: [each.outcome for each in leaf.answers] for uid, leaf in self._leaves.items()}

    def why(self, uid: int, position: int, limit_s: float = math.inf) -> Explanation:
        """Explain what a node did, as `Moments.why`.

        Raises:
            BtcoreError: There is no such tick, or it has too many ticks before it.
        """
        if position > MAX_TESTED_TICKS:
            raise BtcoreError(f"only the first {MAX_TESTED_TICKS:,} ticks of a run are explained")
        return super().why(uid, position, limit_s)

    # --- going to a moment

    def at(self, position: int, limit: float = 1.0, event: int = 0) -> Moment:
        """Go to the moment after a number of steps, and of begins and ends of nodes in the next step.

        Args:
            position: The number of steps.
            limit: The time (s) after which the moment that was reached is returned instead.
            event: The number of begins and ends; the moment is the end of the step if it has fewer.
        """
        position = max(0, min(position, self.count))
        if event > 0:
            self.seek(position)
            return self._go_on(lambda count, uid, is_end: count >= event)
        self.event, self.question, self.problem = 0, None, ""
        return super().at(position, limit)

    def advance(self, target: Target, breakpoints: Collection[int] = ()) -> Moment:
        """Go on to the end of a tick, or to a moment within it, or to the next question or breakpoint.

        Args:
            target: "tick" for the end of the tick; "into" for the next begin or end of a node; "over" for the
                end of the node that has begun; "out" for the end of its parent.
            breakpoints: The numbers of the nodes at whose begin it stops.
        """
        is_target, now = self._find_target(target), self.event
        if not breakpoints:
            return self._go_on(is_target)

        def is_wanted(count: int, uid: int, is_end: bool) -> bool:
            is_breakpoint = count > now and not is_end and uid in breakpoints
            return is_breakpoint or (is_target is not None and is_target(count, uid, is_end))

        return self._go_on(is_wanted)

    def _find_target(self, target: Target) -> StopCondition | None:
        """Return whether an event is the wanted moment, or None for the end of the tick."""
        now = self.event
        if target == "tick" or (not now and target != "into"):
            return None
        uid, result = self._cursor.events[now - 1] if now else (0, None)
        if target == "into" or (target == "over" and result is not None):
            return lambda count, _, is_end: count > now
        end = uid if target == "over" else self._parent_of(uid)
        return None if not end else lambda count, uid, is_end: count > now and uid == end and is_end

    def _parent_of(self, uid: int) -> int:
        """Return the number of the parent of a node; 0 for the root."""
        nodes = self.tree.nodes
        parents = {child.config.uid: node.config.uid for node in nodes for child in node.children}
        return parents.get(uid, 0)

    def answer(self, letter: str, outputs: Mapping[str, str]) -> Moment:
        """Answer the question, and go on to the moment that was wanted before it.

        Args:
            letter: The letter of the outcome, as in `parse_outcomes`.
            outputs: The texts of output ports that the leaf writes.

        Raises:
            BtcoreError: There is no question, or the answer is invalid.
        """
        question = self.question
        if question is None:
            raise BtcoreError("no leaf waits for an answer")
        if letter not in (*LETTERS, "X") or (letter == "R" and not question.can_run):
            raise BtcoreError(f"'{letter}' is not a possible result of '{question.path}'")
        names = [name for name, _, _ in question.outputs]
        for name, text in outputs.items():
            if name not in names:
                raise BtcoreError(f"'{question.path}' has no output port '{name}'{did_you_mean(name, names)}")
            if len(text) > MAX_OUTPUT:
                raise BtcoreError(f"port [{name}]: a value has at most {MAX_OUTPUT:,} characters")
        node = self.tree.nodes[question.uid - 1]
        outcome = Outcome(letter, tuple(outputs.items()))
        list(self._events(node, outcome))  # converts the texts
        self._give(node, outcome)
        moment = self._go_on(self._is_wanted)
        if self.problem and self._used == len(self._given) and self._given[-1].outcome is outcome:
            # An entry does not take the value.
            problem = self.problem
            self._take_back()
            self._go_on(self._is_wanted)
            raise BtcoreError(problem)
        return moment

    def set_plan(self, uid: int, outcomes: str = "", chance: float | None = None, seed: int = 0) -> None:
        """Let a leaf follow a plan from its next tick on; see `LeafPlan`.

        Raises:
            BtcoreError: The node is not a mock leaf, or the plan is invalid.
        """
        leaf = self._leaves.get(uid)
        if leaf is None:
            raise BtcoreError("this node is no mock leaf, so it cannot be planned")
        if chance is not None and not 0 <= chance <= 1:  # also raises for NaN
            raise BtcoreError(f"the probability {chance:g} is not between 0 and 1")
        try:
            starts = parse_outcomes(outcomes) if outcomes else ()
        except ValueError as error:
            raise BtcoreError(str(error)) from None
        node = self.tree.nodes[uid - 1]
        manifest = self._source.registry.get(node.config.id, self.recording.head.format)
        known = [] if manifest is None else [name for name, port in manifest.ports.items() if port.writes]
        for outcome in (outcome for start in starts for outcome in start):
            for name, _ in outcome.outputs:
                if name not in known:
                    raise BtcoreError(f"'{leaf.path}' has no output port '{name}'{did_you_mean(name, known)}")
            list(self._events(node, outcome))
        leaf.set_plan(LeafPlan(outcomes, chance, seed))

    def repeat(self, uid: int, answers: Sequence[Outcome]) -> None:
        """Let a leaf do next what it did in another run, before it follows its plan."""
        self._leaves[uid].repeated.extend(answers)

    def forget_later_steps(self) -> None:
        """Forget what follows the last step before the present moment, so that leaves can do otherwise."""
        self.seek(self.position)
        del self._growing[self.position :]
        self._states = {at: state for at, state in self._states.items() if at <= self.position}
        self._given.clear()
        for leaf in self._leaves.values():
            leaf.repeated.clear()
            leaf.keep(sum(answer.position < self.position for answer in leaf.answers))
        self._answer_count = sum(len(leaf.answers) for leaf in self._leaves.values())

    # --- running a step

    def seek(self, position: int | None = None, **others: Any) -> bool:
        """Go to a moment, also from within a step; see `Replay.seek`."""
        if self._before is not None:
            self._go_back(self.position, *self._before)
            self._before = None
        return super().seek(position, **others)

    def _go_on(self, is_wanted: StopCondition | None) -> Moment:
        """Run the step after `position` up to the wanted moment, or to a question."""
        self._is_wanted = is_wanted
        self.question, self.problem = None, ""
        self.seek(self.position)
        is_new = self.position == self.count
        if is_wanted is None and not is_new:
            return self.at(self.position + 1)
        if self.position >= MAX_TICKS:
            self.event = 0
            self.problem = f"a run has at most {MAX_TICKS:,} ticks"
            return self.current()
        step = self._next_step() if is_new else self._growing[self.position]
        self._before = self._states.get(self.position) or (self._capture(), self._checksum.value)
        if self.position % _STATE_INTERVAL == 0:
            self._states[self.position] = self._before
        self._cursor.begin(is_wanted)
        self._used = 0
        self._is_observing = True
        log: list[Input] = []
        self._log = log if is_new else None
        status = IDLE
        try:
            status = self.run_step(step)
        except NodeExecutionError:
            pass
        except TickInterrupt as interrupt:
            self.event = len(self._cursor.events)
            if isinstance(interrupt, LeafAsked):
                self.question = self._question(interrupt.node)
            elif not isinstance(interrupt, TickStopped):
                self.problem = str(interrupt)
            return self._moment_within(step)
        finally:
            self._is_observing, self._log = False, None
            self._cursor.end()
        self._before = None
        self.position, self.event = self.position + 1, 0
        if is_new:
            checksum = self._checksum.value
            self._growing.append(step._replace(inputs=tuple(log), status=status, checksum=checksum))
            self._given.clear()
        return self.current()

    def _moment_within(self, step: Step) -> Moment:
        """Return the moment of a step that was run in part."""
        moment = self.current()
        statuses = list(moment.statuses)
        uid, result = self._cursor.events[-1] if self._cursor.events else (0, None)
        if result not in (None, SKIPPED):
            statuses[uid - 1] = result  # it is stored after the end of the node
        time = step.time - self.recording.head.time
        return moment._replace(tick=step.tick, time=time, root=statuses[0], statuses=tuple(statuses))

    def _next_step(self) -> Step:
        steps = self._growing
        time = steps[-1].time + self._period if steps else self.recording.head.time
        return Step(self.tree.ticks + 1, time, (), (), IDLE, UNKNOWN_CHECKSUM)

    def _tick_events(self, node: TreeNode) -> Iterator[Input]:
        if self._log is None:
            return super()._tick_events(node)
        events = self._ticks_of_children(node) if ticks_its_children(node) else self._next_answer(node)
        return self._logged_events(self._log, events)

    def _halt_events(self, node: TreeNode) -> Iterator[Input]:
        if self._log is None or not node.children:
            return super()._halt_events(node)
        uid = node.config.uid
        self._log.append(ExternalHaltBegan(uid))
        halts = [ChildHalted(child.config.uid) for child in node.children]
        return self._logged_events(self._log, (*halts, StatusSet(uid, IDLE), ExternalHaltEnded(uid, None)))

    def _logged_events(self, log: list[Input], events: Iterable[Input]) -> Iterator[Input]:
        for event in events:
            log.append(event)
            yield event

    def _differ(self, recorded: str, now: str) -> None:
        if self._log is not None:  # a value cannot be written
            raise TickImpossible(now)
        super()._differ(recorded, now)

    def _ticks_of_children(self, node: TreeNode) -> Iterator[Input]:
        """Yield what a control or decorator without code does: as `MockControl` and `MockDecorator`."""
        uid, status = node.config.uid, SUCCESS
        yield StatusSet(uid, RUNNING)
        statuses = [child.status for child in node.children]
        has_skipped_all = SUCCESS not in statuses
        first = statuses.index(RUNNING) if RUNNING in statuses else 0
        for child in node.children[first:]:
            yield ChildTicked(child.config.uid)
            if self._child_error is not None:
                yield Raised(uid, RecordedError("NodeExecutionError", ""))
            status = self._child_result
            has_skipped_all = has_skipped_all and status is SKIPPED
            if status not in (SUCCESS, SKIPPED):
                break
        if status is not RUNNING:
            status = SKIPPED if has_skipped_all else FAILURE if status is FAILURE else SUCCESS
            yield from (ChildHalted(child.config.uid) for child in node.children)
        yield Result(uid, status)

    def _next_answer(self, node: TreeNode) -> Iterator[Input]:
        """Yield what a leaf does in the new tick."""
        if self._used == len(self._given):
            uid = node.config.uid
            if self._answer_count >= MAX_ANSWERS:
                raise TickImpossible(f"a run has at most {MAX_ANSWERS:,} answers of leaves")
            outcome = self._leaves[uid].next(node.status is not RUNNING)
            if outcome is None:
                raise LeafAsked(node)
            self._give(node, outcome)
        answer = self._given[self._used]
        self._used += 1
        try:
            events = list(self._events(node, answer.outcome))
        except BtcoreError as error:  # an answer of an earlier run, or a plan, no longer fits the tree
            raise TickImpossible(f"'{node.path}': {error}") from None
        yield from events

    def _give(self, node: TreeNode, outcome: Outcome) -> None:
        uid = node.config.uid
        answer = Answer(self.position, uid, outcome, node.status is not RUNNING)
        self._given.append(answer)
        self._leaves[uid].add(answer)
        self._answer_count += 1

    def _take_back(self) -> None:
        """Forget the last answer of the tick that has not ended."""
        leaf = self._leaves[self._given.pop().uid]
        leaf.keep(len(leaf.answers) - 1)
        self._answer_count -= 1

    def _events(self, node: TreeNode, outcome: Outcome) -> Iterator[Input]:
        """Yield what a leaf with an outcome does.

        Raises:
            BtcoreError: The text of an output does not fit its port.
        """
        uid = node.config.uid
        for name, text in outcome.outputs:
            # The replayed tree does not have the user's types.
            output = self._source.nodes[uid - 1].config.outputs.get(name)
            if output is None or output.key is None:
                continue  # as `MockAction`
            scope = self.boards.index(node.config.outputs[name].blackboard)
            declared = None if output.type.strong else output.type.name
            yield Written(scope, output.key, self._encode(output, text), declared)
        if outcome.letter == "X":
            yield Raised(uid, RecordedError("MockLeafError", f"the outcome of '{node.name}' is X"))
        else:
            yield Result(uid, LETTERS[outcome.letter])

    def _encode(self, output: Output, text: str) -> Any:
        try:
            return self._output_encoder.encode(output.type.from_text(text, self.recording.head.format))
        except ConversionError as error:
            if output.type.python_type is object:
                return {"__text": text}  # the value of a type whose code is not there
            raise BtcoreError(f"port [{output.name}] takes {output.type.name}: {error}") from None

    def _question(self, node: TreeNode) -> Question:
        outputs = self._source.nodes[node.config.uid - 1].config.outputs
        return Question(
            node.config.uid,
            node.path,
            input_values(node),
            [(name, port.type.name, port.key) for name, port in outputs.items() if port.key is not None],
            not node._must_complete,
        )
