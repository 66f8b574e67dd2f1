"""Questions of a page about all runs of its tree, and the protocol by which another package answers them.

A package offers a function under the entry point group `btcore.proofs`, which is called as `Search`
describes, and another package a function under `btcore.recorded_runs`, which returns the recording of a run
as text. The entry points need no import of this module. A search runs in a process that a stop ends; in a
browser, where there are no processes, it runs in the Web Worker, which the page ends.
"""

import asyncio
import json
import sys
from asyncio.subprocess import PIPE, Process
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, Final, Protocol

import msgspec
from msgspec import Meta

from btcore import entry_points
from btcore.errors import BtcoreError
from btcore.registry.registry import Registry
from btcore.tree.tree import Tree
from btcore.xml.define import Definitions
from btcore_studio.language.mock_runs import MAX_NODES
from btcore_studio.language.node_models import NodeModel
from btcore_studio.language.project import Project, Settings
from btcore_studio.language.shown_runs import NUMBERS, ShownRun, ShownRuns, load_first
from btcore_studio.language.studio_protocol import Data, DocumentParams
from btcore_studio.language.tree_reading import read_xml

_PROOFS_GROUP: Final = "btcore.proofs"
_RECORDER_GROUP: Final = "btcore.recorded_runs"
_MAX_RECORDING: Final = 8_000_000
"""Maximum number of characters of a counterexample that can be played."""
_MAX_MESSAGE: Final = 256_000_000
"""Maximum size of a message of the process (bytes)."""
_GRACE_S: Final = 60.0
"""Time (s) after the time limit of a search in which the answers must be ready."""
_MAX_DETAIL: Final = 2_000

Progress = Callable[[int, int, int], object]
"""Called with the numbers of searched states, of found states, and of ticks."""
RecordRun = Callable[[Callable[[Callable[[Tree], object]], object]], str]
"""Returns the recording of a run, which gets a function to call with the tree before the first tick."""
_Text = Annotated[str, Meta(max_length=1_000)]
_Texts = Annotated[tuple[_Text, ...], Meta(max_length=50)]


class RepeatableRun(Protocol):
    """A run that can be run again."""

    def run(self, attach: Callable[[Tree], object]) -> object:
        """Run the tree; *attach* is called with it before the first tick."""
        ...


class Counterexample(Protocol):
    """A run that shows what is wrong."""

    @property
    def run(self) -> RepeatableRun | None:
        """The run."""

    @property
    def cycle(self) -> int | None:
        """The index of the tick from which on the ticks repeat forever; None if they do not."""


class Answer(Protocol):
    """The answer to one question; see `ProofAnswer`."""

    @property
    def question(self) -> str:
        """The question."""

    @property
    def answer(self) -> str:
        """The answer."""

    @property
    def detail(self) -> str:
        """What is wrong, or a condition; ""."""

    @property
    def ticks(self) -> int:
        """The number of ticks."""

    @property
    def states(self) -> int:
        """The number of states."""

    @property
    def is_vacuous(self) -> bool:
        """Whether the premise of the question never occurs."""

    @property
    def counterexample(self) -> Counterexample | None:
        """A run that shows what is wrong, or None."""


class Report(Protocol):
    """The result of a search."""

    @property
    def answers(self) -> Sequence[Answer]:
        """The answers."""

    @property
    def transitions(self) -> int:
        """The number of ticks that the search has run."""


class Search(Protocol):
    """Answers standard questions and others about all possible runs of a tree."""

    def __call__(
        self,
        definitions: Definitions,
        nodes: Registry,
        file: Path | None,
        questions: Sequence[str],
        given: Sequence[str],
        time_s: float,
        progress: Progress,
    ) -> Report:
        """Search.

        Args:
            definitions: The definitions of the tree.
            nodes: The available nodes.
            file: The file of the tree, beside which there may be declarations; None if there is no file.
            questions: The questions, in addition to the standard questions.
            given: The keys that the program sets before the first tick.
            time_s: The time (s) after which the search ends with the answers so far.
            progress: Called from time to time.

        Raises:
            BtcoreError: The tree or a question has errors.
        """
        ...


class ProofParams(DocumentParams, frozen=True):
    """The tree and the questions about it.

    Attributes:
        tree: The ID of the tree; None for the main tree.
        questions: The questions, in addition to the standard questions, as in `btcore prove --ask`.
        given: The keys that the program sets before the first tick.
        seconds: The time (s) after which the search ends with the answers so far.
    """

    tree: str | None = None
    questions: _Texts = ()
    given: _Texts = ()
    seconds: Annotated[float, Meta(ge=1, le=600)] = 30.0


class ProofAnswer(Data, frozen=True):
    """The answer to one question.

    Attributes:
        answer: `proved`, `refuted`, `possible` or `unknown`.
        detail: What is wrong, what bounded the search, or under which condition the question is proved; "".
        vacuous: Whether the premise of the question never occurs.
        ticks: The number of ticks of the counterexample, or of the longest run without a repeated state.
        states: The number of states that were searched.
        playable: Whether there is a counterexample that can be played.
        cycle: The number of the tick from which on the counterexample repeats its ticks forever; 0 for none.
    """

    question: str
    answer: str
    detail: str
    vacuous: bool
    ticks: int
    states: int
    playable: bool
    cycle: int


class ProofResult(Data, frozen=True):
    """The answers to the questions; *proof* identifies them, and *ticks* were run."""

    proof: int
    answers: list[ProofAnswer]
    ticks: int


class CounterexampleParams(Data, frozen=True):
    """The counterexample of the answer with an index (from 0)."""

    proof: int
    answer: int


class FoundAnswers(msgspec.Struct, frozen=True):
    """The answers of a search, and the recording of each counterexample, or ""."""

    answers: list[ProofAnswer]
    recordings: list[str]
    ticks: int


class SearchRequest(msgspec.Struct, frozen=True):
    """What the process of a search gets: the state of the project, and the questions."""

    folders: list[str]
    models: list[dict[str, Any]]
    enums: dict[str, int]
    documents: dict[str, str]
    params: ProofParams

    def project(self) -> Project:
        """Return a project in the same state."""
        project = Project()
        project.configure([Path(folder) for folder in self.folders], Settings())
        project.set_models([NodeModel.from_data(data) for data in self.models], self.enums)
        for uri, text in self.documents.items():
            project.open(uri, text, 0)
        return project


def search(project: Project, params: ProofParams, progress: Progress) -> FoundAnswers:
    """Answer the questions of a page, in this process.

    Raises:
        BtcoreError: The tree or a question has errors, or a package is not installed.
    """
    reading = read_xml(project, params.text_document.uri)
    plans = reading.plans_of(params.tree)
    plans.diagnostics.raise_errors()
    size = None if plans.main_tree is None else plans.sizes.get(plans.main_tree.id)
    if size is not None and size.nodes > MAX_NODES:
        raise BtcoreError(
            f"questions about a tree with more than {MAX_NODES:,} nodes cannot be answered here"
        )
    answer: Search = load_first(_PROOFS_GROUP, "questions cannot be answered")
    report = answer(
        plans.definitions,
        reading.nodes,
        reading.source.path,
        params.questions,
        params.given,
        params.seconds,
        progress,
    )
    recordings = [_recording(each.counterexample) for each in report.answers]
    answers = [
        ProofAnswer(
            each.question,
            each.answer,
            each.detail[:_MAX_DETAIL],
            each.is_vacuous,
            each.ticks,
            each.states,
            text != "",
            0
            if each.counterexample is None or each.counterexample.cycle is None
            # The first tick has the number 1.
            else each.counterexample.cycle + 1,
        )
        for each, text in zip(report.answers, recordings, strict=True)
    ]
    return FoundAnswers(answers, recordings, report.transitions)


def _recording(counterexample: Counterexample | None) -> str:
    if counterexample is None or counterexample.run is None:
        return ""
    loaded, _ = entry_points.load(_RECORDER_GROUP)
    if not loaded:
        return ""
    record: RecordRun = loaded[0].value
    text = record(counterexample.run.run)
    return text if len(text) <= _MAX_RECORDING else ""


class PageProofs:
    """The searches of a page. A new search replaces the last.

    Args:
        project: The project with the documents of the page.
        runs: Shows counterexamples.
        notify: Called with the parameters of `btcore/proofProgress`.
    """

    def __init__(self, project: Project, runs: ShownRuns, notify: Callable[[dict[str, Any]], None]) -> None:
        self._project = project
        self._runs = runs
        self._notify = notify
        self._process: Process | None = None
        self._searches = 0  # that have begun or were stopped
        self._found: tuple[int, FoundAnswers] | None = None

    def prove(self, params: ProofParams) -> ProofResult:
        """Answer the questions in this process."""
        return self._result(search(self._project, params, self._report))

    def stop(self) -> None:
        """End the search that is running."""
        self._searches += 1
        if self._process is not None:
            with suppress(ProcessLookupError):
                self._process.kill()
            self._process = None

    def counterexample(self, params: CounterexampleParams) -> ShownRun:
        """Show the counterexample of an answer.

        Raises:
            BtcoreError: There is no such counterexample.
        """
        number, found = self._found or (0, None)
        if found is None or params.proof != number:
            raise BtcoreError("these answers are no longer known: ask again")
        if not (0 <= params.answer < len(found.recordings) and found.recordings[params.answer]):
            raise BtcoreError("this answer has no counterexample that can be played")
        return self._runs.show(found.recordings[params.answer])

    def _report(self, searched: int, states: int, ticks: int) -> None:
        self._notify({"searched": searched, "states": states, "ticks": ticks})

    def _result(self, found: FoundAnswers) -> ProofResult:
        number = next(NUMBERS)
        self._found = number, found
        return ProofResult(number, found.answers, found.ticks)

    async def prove_in_process(self, params: ProofParams) -> ProofResult:
        """Answer the questions in a process of their own."""
        self.stop()
        project = self._project
        request = SearchRequest(
            list(map(str, project.folders)),
            [model.as_data() for model in project.models.values()],
            dict(project.registry.types.enums),
            {document.uri: document.text for document in project.open_documents},
            params,
        )
        number = self._searches
        command = [sys.executable, "-P", "-m", "btcore_studio.language.proof_process"]
        process = await asyncio.create_subprocess_exec(*command, stdin=PIPE, stdout=PIPE, limit=_MAX_MESSAGE)
        data: dict[str, Any] | None = None
        try:
            if number == self._searches:
                self._process = process
                async with asyncio.timeout(params.seconds + _GRACE_S):
                    data = await self._receive(process, msgspec.json.encode(request))
        except TimeoutError:
            raise BtcoreError("the answers took too long: choose a shorter time limit") from None
        finally:
            with suppress(ProcessLookupError):
                process.kill()
            await asyncio.shield(process.wait())
        if number != self._searches:
            raise BtcoreError("the search was stopped")
        self._process = None
        if data is None:
            raise BtcoreError("the process of the search ended unexpectedly")
        if "error" in data:
            raise BtcoreError(data["error"])
        return self._result(msgspec.convert(data["found"], FoundAnswers))

    async def _receive(self, process: Process, request: bytes) -> dict[str, Any] | None:
        """Return the last message of the process, or None if it ends without it."""
        assert process.stdin is not None
        assert process.stdout is not None
        with suppress(ConnectionError):  # it was stopped
            process.stdin.write(request + b"\n")
            await process.stdin.drain()
        while line := await process.stdout.readline():
            data: dict[str, Any] = json.loads(line)
            if "progress" not in data:
                return data
            if self._process is process:
                self._report(*data["progress"])
        return None
