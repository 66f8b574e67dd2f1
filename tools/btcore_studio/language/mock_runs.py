"""Runs of a tree with mock leaves for a page, and the protocol by which another package makes them.

A package offers a function under the entry point group `btcore.runs`: it is called with the plans of a tree
and the simulated time between two ticks (s), and returns a `MockRun`. The entry point needs no import of this
module.

Nothing here waits: a leaf without an answer ends the request with a question.
"""

import re
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import PurePosixPath
from typing import Any, Final, Literal, Protocol

import msgspec

from btcore.errors import BtcoreError, TreeError
from btcore.logs.moments import Moment
from btcore.registry.outcome_grammar import Outcome
from btcore.status import RUNNING
from btcore_studio.language.project import Project
from btcore_studio.language.shown_runs import NUMBERS, ShownRuns, load_first
from btcore_studio.language.studio_protocol import (
    AnswerParams,
    Data,
    LeafPlan,
    QuestionPort,
    RunFile,
    RunFiles,
    RunFilesParams,
    RunLeafParams,
    RunMomentParams,
    RunParams,
    RunQuestion,
    RunRequest,
    RunState,
    StepParams,
    Why,
    WhyParams,
)
from btcore_studio.language.timeline import MAX_WAIT_S, RecordedRun, Timeline, colours_of
from btcore_studio.language.tree_reading import read_xml

_GROUP: Final = "btcore.runs"
MAX_NODES: Final = 5_000
"""Maximum number of nodes of a tree that is run."""
MAX_TEXT: Final = 10_000
"""Maximum number of characters of a plan."""
_PERIODS_S: Final = (0.001, 3_600.0)
_MAX_TICKS: Final = 1_000
"""Maximum number of ticks of a request."""
_MAX_EVENT: Final = 1_000_000
_MAX_RECORDING: Final = 50_000_000
"""Maximum number of characters of a recording that is sent to the page."""
_MAX_NAME: Final = 60


class Question(Protocol):
    """A leaf that is ticked and has no answer."""

    @property
    def uid(self) -> int:
        """The number of the leaf."""

    @property
    def path(self) -> str:
        """The path of the leaf."""

    @property
    def inputs(self) -> Mapping[str, str]:
        """The values of its inputs."""

    @property
    def outputs(self) -> Sequence[tuple[str, str, str]]:
        """The name, the type and the key of each output port."""

    @property
    def can_run(self) -> bool:
        """Whether RUNNING is a valid answer."""


class MockRun(Timeline, Protocol):
    """A run with mock leaves; at the same time the recording of it so far."""

    @property
    def position(self) -> int:
        """The number of steps before the present moment."""

    @property
    def event(self) -> int:
        """The number of begins and ends of nodes in the step; 0 if the moment is between two steps."""

    @property
    def stopped_at(self) -> int:
        """The node that has begun or ended last in the step, or 0."""

    @property
    def question(self) -> Question | None:
        """The leaf that has no answer, or None."""

    @property
    def problem(self) -> str:
        """Why the tick cannot be run further, or ""."""

    @property
    def leaves(self) -> Mapping[int, tuple[str, float | None, int]]:
        """The outcomes, the chance and the seed of each mock leaf, by its number; see `LeafPlan`."""

    @property
    def answers(self) -> Mapping[int, Sequence[Outcome]]:
        """The answers of each mock leaf so far, by its number."""

    def at(self, position: int, limit: float, event: int = 0) -> Moment:
        """Go to a moment, or to the moment that was reached after *limit* s."""
        ...

    def advance(
        self, target: Literal["tick", "into", "over", "out"], breakpoints: Collection[int] = ()
    ) -> Moment:
        """Go on to the end of a tick, or into, over or out of the present node, or to the next question.

        The run also stops at the begin of the nodes with the numbers *breakpoints*.
        """
        ...

    def answer(self, letter: str, outputs: Mapping[str, str]) -> Moment:
        """Answer the question, and go on. Raises BtcoreError if the answer is invalid."""
        ...

    def set_plan(self, uid: int, outcomes: str, chance: float | None, seed: int) -> None:
        """Let a leaf follow a plan, see `LeafPlan`. Raises BtcoreError if it is invalid."""

    def repeat(self, uid: int, answers: Sequence[Outcome]) -> None:
        """Let a leaf do next what it did in another run, before it follows its plan."""

    def forget_later_steps(self) -> None:
        """Forget what follows the present moment."""


class PageRuns:
    """The run of a page. A new run replaces it.

    Args:
        project: The project with the documents of the page.
        shown: The other runs of the page.
    """

    def __init__(self, project: Project, shown: ShownRuns) -> None:
        self._project = project
        self._shown = shown
        self._run: _PageRun | None = None

    @property
    def requests(self) -> Sequence[tuple[str, type[Data], Callable[[Any], Data | None]]]:
        """The requests of a run: the method, the class of the parameters, and the function that replies."""
        return (
            ("btcore/run", RunParams, self._start),
            ("btcore/runStep", StepParams, self._step),
            ("btcore/runAnswer", AnswerParams, self._answer),
            ("btcore/runMoment", RunMomentParams, self._go_to),
            ("btcore/runLeaf", RunLeafParams, self._plan_leaf),
            ("btcore/runFiles", RunFilesParams, self._write_files),
            ("btcore/endRun", RunRequest, self._end),
            ("btcore/why", WhyParams, self._explain),
        )

    def _start(self, params: RunParams) -> RunState:
        low, high = _PERIODS_S
        if not low <= params.period <= high:
            raise BtcoreError(f"the time between two ticks must be from {low:g} s to {high:g} s")
        before = self._present(params.again) if params.again else None
        plans = read_xml(self._project, params.text_document.uri).plans_of(params.tree)
        size = None if plans.main_tree is None else plans.sizes.get(plans.main_tree.id)
        if size is not None and size.nodes > MAX_NODES:
            raise BtcoreError(f"a tree with more than {MAX_NODES:,} nodes cannot be run here")
        create_run = load_first(_GROUP, "trees cannot be run")
        try:
            run: MockRun = create_run(plans, params.period)
        except TreeError as error:
            raise BtcoreError(f"the tree cannot be run: {error.diagnostics[0].message}") from None
        self._run = started = _PageRun(run)
        started.set_plans(params.plans)
        if before is not None:
            started.repeat(before)
        return started.first_state(0 if before is None else before.run.count)

    def _present(self, number: int) -> "_PageRun":
        if self._run is None or self._run.number != number:
            raise BtcoreError("this run has ended: start another")
        return self._run

    def recorded_run(self, number: int) -> RecordedRun:
        """Return the run with a number, which is this run or another run of the page, as a recording.

        Raises:
            BtcoreError: There is no such run.
        """
        return self._shown.find(number) or self._present(number).data

    def _step(self, params: StepParams) -> RunState:
        if not 1 <= params.ticks <= _MAX_TICKS:
            raise BtcoreError(f"a request runs from 1 to {_MAX_TICKS:,} ticks")
        return self._present(params.run).advance(params)

    def _answer(self, params: AnswerParams) -> RunState:
        present = self._present(params.run)
        return present.state(present.run.answer(params.result, params.outputs))

    def _go_to(self, params: RunMomentParams) -> RunState:
        present = self._present(params.run)
        moment = present.run.at(params.position, MAX_WAIT_S, min(params.event, _MAX_EVENT))
        if params.cut and moment.position == params.position:
            present.run.forget_later_steps()
            moment = present.run.at(params.position, MAX_WAIT_S)
        return present.state(moment)

    def _plan_leaf(self, params: RunLeafParams) -> None:
        self._present(params.run).set_plan(params.key, params.plan)

    def _write_files(self, params: RunFilesParams) -> RunFiles:
        run = self.recorded_run(params.run).timeline
        tree = PurePosixPath(params.tree.replace("\\", "/")).name
        name = re.sub(r"\W+", "_", PurePosixPath(tree).stem)[:_MAX_NAME] or "tree"
        recording = run.recording_text()
        if len(recording) > _MAX_RECORDING:
            raise BtcoreError(
                f"the recording has more than {_MAX_RECORDING:,} characters: record such a run in a "
                "terminal, with btcore run --record"
            )
        files = [RunFile(f"{name}.btrec.txt", recording)]
        if params.test:
            files.append(RunFile(f"test_{name}.py", run.test_text(name, tree)))
        return RunFiles(files)

    def _explain(self, params: WhyParams) -> Why:
        recorded = self._shown.find(params.run)
        if recorded is not None:
            return recorded.why(params.key, params.position)
        present = self._present(params.run)
        if present.run.position == params.position and present.run.event:
            raise BtcoreError("this tick has not ended: go to its end first")
        return present.data.why(params.key, params.position)

    def _end(self, params: RunRequest) -> None:
        self._present(params.run)
        self._run = None


class _PageRun:
    """A run, whose nodes have keys (*data*); *number* identifies it."""

    def __init__(self, run: MockRun) -> None:
        self.number = next(NUMBERS)
        self.run = run
        self.data = RecordedRun(run)

    def repeat(self, before: "_PageRun") -> None:
        """Give the answers of another run again, by the keys of the leaves."""
        leaves = self.run.leaves
        for uid, answers in before.run.answers.items():
            now = self.data.uids.get(before.data.keys[uid - 1])
            if now is not None and now in leaves:
                self.run.repeat(now, answers)

    def set_plans(self, plans: Mapping[str, LeafPlan]) -> None:
        """Plan the leaves with these keys, as far as the tree has them and the plans fit."""
        leaves = self.run.leaves
        for key, plan in plans.items():
            if self.data.uids.get(key) in leaves:
                with suppress(BtcoreError):
                    self.set_plan(key, plan)

    def set_plan(self, key: str, plan: LeafPlan) -> None:
        """Plan the leaf with a key."""
        if key not in self.data.uids:
            raise BtcoreError("the tree that is run does not have this node")
        if len(plan.outcomes) > MAX_TEXT:
            raise BtcoreError(f"outcomes have at most {MAX_TEXT:,} characters")
        self.run.set_plan(self.data.uids[key], plan.outcomes, plan.chance, plan.seed)

    def advance(self, params: StepParams) -> RunState:
        """Go on; of several ticks, at most until the root completes, or a question, or the time is over."""
        breakpoints = {self.data.uids[key] for key in params.breakpoints if key in self.data.uids}
        deadline = time.monotonic() + MAX_WAIT_S
        moment = self.run.advance(params.to, breakpoints)
        for _ in range(params.ticks - 1):
            is_over = moment.root is not RUNNING or self.run.event or self.run.problem
            if is_over or time.monotonic() > deadline:
                break
            moment = self.run.advance(params.to, breakpoints)
        return self.state(moment)

    def first_state(self, ticks: int) -> RunState:
        """Return the state with the nodes, after *ticks* ticks if their answers are given again."""
        run, keys, deadline = self.run, self.data.keys, time.monotonic() + MAX_WAIT_S
        moment = run.at(0, MAX_WAIT_S)
        while run.count < ticks and not (run.event or run.problem) and time.monotonic() < deadline:
            moment = run.advance("tick")
        state = self.state(moment)
        calls = [call._asdict() for call in self.data.calls]
        leaves = {keys[uid - 1]: LeafPlan(*plan) for uid, plan in run.leaves.items()}
        return msgspec.structs.replace(state, keys=keys, calls=calls, leaves=leaves)

    def state(self, moment: Moment) -> RunState:
        """Return a moment as data."""
        run, keys = self.run, self.data.keys
        width, colours = colours_of(run.roots)
        question, asked = None, run.question
        if asked is not None:
            ports = [QuestionPort(*port) for port in asked.outputs]
            question = RunQuestion(keys[asked.uid - 1], asked.path, dict(asked.inputs), ports, asked.can_run)
        return RunState(
            self.number,
            run.count,
            colours,
            width,
            self.data.data_of(moment),
            run.event,
            keys[run.stopped_at - 1] if run.stopped_at else "",
            question,
            run.problem,
        )
