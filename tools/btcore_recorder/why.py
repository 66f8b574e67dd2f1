"""Why: explain a moment of a recorded run, and try by replay which changed inputs would have changed it.

The explanation follows one tick from a result down to the leaves and conditions that led to it, and from the
entries that these have read to the nodes that wrote them, also in earlier ticks. What the tick depends on are
leaf results and entries that external code wrote; a smallest set of them is searched by running the recording
again with other results and values (`btcore_recorder.what_if`).
"""

import math
import os
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, suppress
from itertools import combinations, product, zip_longest
from pathlib import PurePath
from typing import Final, Literal, NamedTuple

from btcore.blackboard.blackboard import Entry
from btcore.clock import NS_PER_S
from btcore.errors import BtcoreError, TreeError
from btcore.status import FAILURE, IDLE, RUNNING, SUCCESS, Status
from btcore.suggestions import did_you_mean, join_names
from btcore.xml.read.read import parse_file
from btcore_recorder.causes import Cause, CauseFinder, name_of, short_text
from btcore_recorder.files import local_file
from btcore_recorder.inputs import RunRecording
from btcore_recorder.replay import Replay
from btcore_recorder.tick_trace import Read, TickTrace, Visit, find_name
from btcore_recorder.what_if import (
    Change,
    ChangedReplay,
    HoldEntry,
    PathTransitions,
    RecordedRun,
    SetResult,
)

MAX_LINKS: Final = 10
"""Maximum number of links of a chain."""
MAX_TRIALS: Final = 600
"""Maximum number of replays for an answer."""
MAX_DISTANCE: Final = 5_000
"""Maximum number of steps that a trial runs. An input of an earlier step is not changed."""
OUTSIDE: Final = "code outside of the tree"
_RUNS: Final = ("first run", "second run")
_MOST_OF_A_SET: Final = ((1, 60, 12), (2, 14, 3), (3, 8, 2))
"""For sets of 1, 2 and 3 inputs: the most inputs, and the most values of each, that are combined."""


class Link(NamedTuple):
    """A link of the chain from a result to what it depends on.

    Attributes:
        tick: The number of the tick.
        time: The time of the tick (s since the recording began).
        node: The path of the node; "" = outside of the tree.
        place: The place of the node in the XML, `file:line`, and that of a leaf's code; "" = none.
        because: Why the node did what it did.
        tried: What another result or value changes, as a replay shows; "" = this was not tried.
    """

    tick: int
    time: float
    node: str
    place: str
    because: str
    tried: str


class Answer(NamedTuple):
    """Why something happened.

    Attributes:
        question: The question.
        answer: The answer in one or two sentences.
        chain: The links from the result to what it depends on.
        changes: A smallest set of changed inputs with another outcome; empty if none was found.
    """

    question: str
    answer: str
    chain: Sequence[Link]
    changes: Sequence[Change] = ()

    def as_data(self) -> dict[str, object]:
        """Return the answer as data of JSON."""
        chain = [link._asdict() for link in self.chain]
        return {"question": self.question, "answer": self.answer, "chain": chain}

    def __str__(self) -> str:
        lines = [self.question]
        for link in self.chain:
            place = f"{link.place}  " if link.place else ""
            lines.append(f"  tick {link.tick}  {place}{link.node or OUTSIDE}: {link.because}")
        return "\n".join([*lines, self.answer])


class _Question(NamedTuple):
    """What a node did in a step."""

    kind: Literal["result", "halt", "no tick"]
    uid: int
    step: int
    result: Status | None = None

    def is_same(self, trace: TickTrace) -> bool:
        """Return whether the node did this in *trace*, too."""
        if self.kind == "halt":
            return trace.halt_of(self.uid) is not None
        visits = trace.visits_of(self.uid)
        if self.kind == "no tick":
            return not visits
        return bool(visits) and visits[-1].result is self.result


class _SmallestSet(NamedTuple):
    """Inputs that change an outcome, with their changes, and the other outcome."""

    causes: Sequence[Cause]
    changes: Sequence[Change]
    outcome: str


class Explainer:
    """Explains moments of a recorded run.

    Args:
        recording: The recording, or the path of its file.
        limit_s: The time (s) after which no further changed inputs are tried.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import Explainer, record
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Sequence(b.Script(code="d := 3"), b.ScriptCondition(code="d < 1", name="near")))
        >>> with record(tree, "run.btrec.txt"):
        ...     _ = tree.tick_once()
        >>> [link.because for link in Explainer("run.btrec.txt").why().chain][1:]
        ['code="d < 1" is false: d = 3', 'wrote d = 3 by code="d := 3" in this tick']
    """

    def __init__(self, recording: RunRecording | str | os.PathLike[str], limit_s: float = math.inf) -> None:
        self._replay = Replay(recording)
        self._limit_s = limit_s
        self._has_given_up = False  # because of the time
        self._steps = self._replay.steps
        self._causes = CauseFinder(self._replay)
        self._runs: dict[tuple[int, int], RecordedRun] = {}

    def changed_files(self) -> list[str]:
        """Return the recorded files of the tree whose text differs from that of the present file."""
        documents = self._replay.recording.head.documents
        return [file for file, text, _ in documents if _read(file) not in (None, text)]

    # --- the questions

    def why(self, node: str = "", tick: int | None = None, time: float | None = None) -> Answer:
        """Explain what a node did: its result, why it was halted, or why it was not ticked.

        Args:
            node: The path of the node; "" = the root. Without a moment, the last failure of the tree is
                explained, if there is one.
            tick: The number of the tick; by default the last one.
            time: Instead of *tick*, a time (s since the recording began).

        Returns:
            The answer.

        Raises:
            BtcoreError: There is no such node or tick, or the replay differs from the recording.
        """
        uid = self._find_node(node) if node else 1
        index = self._find_step(tick, time, prefers_failure=not node)
        self._causes.begin()
        trace = self._causes.trace(index)
        visits = trace.visits_of(uid)
        halt = trace.halt_of(uid)
        if halt is not None and (not visits or visits[-1].result is RUNNING or halt.by is visits[-1]):
            question = _Question("halt", uid, index)
            cause = self._causes.explain_halt(index, halt)
        elif visits:
            question = _Question("result", uid, index, visits[-1].result)
            cause = self._causes.explain_result(index, visits[-1])
        else:
            question = _Question("no tick", uid, index)
            cause = self._causes.explain_no_tick(index, uid)
        found = self._find_smallest_set(question, cause)
        return self._answer(question, cause, found)

    def who_wrote(self, key: str, tick: int | None = None, time: float | None = None) -> Answer:
        """Explain the value of an entry: who wrote it, and why it had this value.

        Args:
            key: The key in the main tree, or after the path of a subtree, such as `charge/level`. Without a
                path, the first subtree that has such an entry is meant if the main tree has none.
            tick: The number of the tick; by default the last one.
            time: Instead of *tick*, a time (s since the recording began).

        Returns:
            The answer, without changes.

        Raises:
            BtcoreError: There is no such entry or tick, or the replay differs from the recording.
        """
        index = self._find_step(tick, time, prefers_failure=False)
        self._causes.begin()
        self._causes.seek(index + 1)
        entry = next(self._find_entries(key), None)
        if entry is None:
            keys = [key for board in self._replay.boards for key in board.visible_keys()]
            raise BtcoreError(f"there is no entry '{key}'{did_you_mean(key, keys)}")
        name = find_name(self._replay.boards, entry)
        read = Read(key.rpartition("/")[2], "", "", name, entry.value, entry.sequence_id)
        cause = self._causes.explain_value(index, read, is_input=False)
        value = short_text(entry.value)
        question = f"who wrote {{{key}}} = {value}, as it was after tick {self._causes.tick(index)}?"
        return Answer(question, f"{self._describe_cause(cause)}.", self._chain(cause, ()))

    def _find_entries(self, key: str) -> Iterator[Entry]:
        """Yield the entries that *key* may mean, the most probable first."""
        path, _, inner = key.rpartition("/")
        for subtree in self._replay.tree.subtrees:
            for name in [key] if not path else [key, inner] if subtree.path == path else []:
                entry = subtree.blackboard.find(name)
                if entry is not None:
                    yield entry

    def differs_from(self, other: "Explainer") -> Answer:
        """Explain the first decision that differs in another run, what it read, and who wrote that.

        Args:
            other: The other run, of the same tree or a similar one.

        Returns:
            The answer, without changes.
        """
        question = "what is the first decision that differs between the runs?"
        sides = (self, other)
        index = self._find_difference(other)
        if index is None:
            length = min(len(side._steps) for side in sides)
            text = f"The runs are the same in all {length:,} ticks and halts"
            longer = [word for word, side in zip(_RUNS, sides, strict=True) if len(side._steps) > length]
            text += f"; then only the {longer[0]} goes on" if longer else ""
            return Answer(question, f"{text}.", ())
        traces = [side._causes.trace(index) for side in sides]
        for visits in zip_longest(*[trace.ended for trace in traces]):
            results = [
                None if visit is None else (side._causes.path(visit.uid), visit.result)
                for side, visit in zip(sides, visits, strict=True)
            ]
            if results[0] != results[1]:
                return self._describe_difference(question, index, other, visits)
        text = f"In tick {self._causes.tick(index)} all nodes have the same results, but other statuses."
        return Answer(question, text, ())

    def _find_difference(self, other: "Explainer") -> int | None:
        """Return the index of the first step with other transitions than in *other*, or None."""
        sides = (self, other)
        followed: list[PathTransitions] = []
        with ExitStack() as stack:
            for side in sides:
                side._causes.begin()
                side._causes.seek(0)
                followed.append(PathTransitions(side._replay.tree))
                stack.callback(side._replay.tree.subscribe(followed[-1]))
            for index in range(min(len(side._steps) for side in sides)):
                for side, transitions in zip(sides, followed, strict=True):
                    transitions.found.clear()
                    side._replay.step()
                    side._replay.tree.flush_observers()
                if followed[0].found != followed[1].found:
                    return index
        return None

    def _describe_difference(
        self,
        question: str,
        index: int,
        other: "Explainer",
        visits: Sequence[Visit | None],
    ) -> Answer:
        chain: list[Link] = []
        texts = []
        for word, side, visit in zip(_RUNS, (self, other), visits, strict=True):
            if visit is None:
                texts.append(f"nothing more happens in the {word}")
                continue
            texts.append(f"'{side._causes.path(visit.uid)}' returned {name_of(visit.result)} in the {word}")
            links = side._chain(side._causes.explain_result(index, visit), ())[: MAX_LINKS // 2]
            chain += [link._replace(because=f"{link.because} [{word}]") for link in links]
        answer = f"The runs differ from tick {self._causes.tick(index)} on: {' and '.join(texts)}."
        return Answer(question, answer, chain)

    # --- moments

    def _find_node(self, node: str) -> int:
        if node in self._causes.paths:
            return self._causes.paths.index(node) + 1
        raise BtcoreError(f"the recorded tree has no node '{node}'{did_you_mean(node, self._causes.paths)}")

    def _find_step(self, tick: int | None, time: float | None, prefers_failure: bool) -> int:
        """Return the index of a step."""
        steps = self._steps
        ticks = [index for index, step in enumerate(steps) if step.tick]
        if not ticks:
            raise BtcoreError("the recording has no tick")
        if tick is not None:
            found = next((index for index in ticks if steps[index].tick == tick), None)
            if found is None:
                first, last = steps[ticks[0]].tick, steps[ticks[-1]].tick
                raise BtcoreError(f"the recording has no tick {tick}; its ticks are {first} to {last}")
            return found
        if time is not None:
            start = self._replay.recording.head.time + round(time * NS_PER_S)
            end = self._causes.time(ticks[-1])
            if time > end:
                raise BtcoreError(f"the recording has no tick at {time:g} s; its last tick is at {end:g} s")
            return max((index for index in ticks if steps[index].time <= start), default=ticks[0])
        if prefers_failure:
            failed = [index for index in ticks if steps[index].status in (FAILURE, IDLE)]
            if failed:
                return failed[-1]
        return ticks[-1]

    # --- trials

    def _find_smallest_set(self, question: _Question, cause: Cause) -> _SmallestSet | None:
        """Return a smallest set of changed inputs that changes the outcome, or None."""
        inputs: list[Cause] = []
        for each in cause.walk():
            if each is cause or not each.changes:  # a leaf's own result is what is asked for
                continue
            is_near = question.step - each.step <= MAX_DISTANCE
            if is_near and not any(other.changes == each.changes for other in inputs):
                inputs.append(each)
        trials, self._has_given_up = 0, False
        deadline = time.monotonic() + self._limit_s
        for size, most, values in _MOST_OF_A_SET:
            another: _SmallestSet | None = None  # the run ends before the tick in question
            for group in combinations(inputs[:most], size):
                for changes in product(*[each.changes[:values] for each in group]):
                    self._has_given_up = time.monotonic() > deadline
                    if trials == MAX_TRIALS or self._has_given_up:
                        return another
                    trials += 1
                    outcome, is_reached = self._try(question, changes)
                    if outcome and is_reached:
                        return _SmallestSet(group, changes, outcome)
                    if outcome and another is None:
                        another = _SmallestSet(group, changes, outcome)
            if another is not None:
                return another
        return None

    def _try(self, question: _Question, changes: Sequence[Change]) -> tuple[str, bool]:
        """Return the other outcome of the run with changed inputs, or "", and whether it reaches the tick."""
        ticks = {change.tick for change in changes}
        start = min(index for index, step in enumerate(self._steps) if step.tick in ticks)
        run = self._run_from(start, question.step)
        guesses = (RUNNING, FAILURE, SUCCESS) if question.result is SUCCESS else (RUNNING, SUCCESS, FAILURE)
        for missing in (*guesses, None):  # what nodes return for which nothing is recorded
            try:
                changed = ChangedReplay(run, changes, missing=missing)
                outcome = self._outcome(question, changed, question.step - start)
            except BtcoreError:  # the entry has another type
                return "", True
            is_reached = changed.position > question.step - start
            if missing is None and changed.end == "no result is recorded":
                ended_at = changed.ended_at
                text = f"the run would have gone on to '{ended_at}', for which nothing is recorded"
                return text, is_reached
            if outcome and changed.invented and missing is not None:
                names = join_names([f"'{name}'" for name in dict.fromkeys(changed.invented)], most=3)
                outcome = (
                    f"the run would have gone on to {names}, for which nothing is recorded; with "
                    f"{missing.name} from there, {outcome}"
                )
            if outcome or not changed.invented:
                return outcome, is_reached
        return "", True

    def _run_from(self, start: int, end: int) -> RecordedRun:
        if (start, end) not in self._runs:
            self._runs[start, end] = RecordedRun(self._replay.cut(start, end + 1))
        return self._runs[start, end]

    def _outcome(self, question: _Question, changed: ChangedReplay, last: int) -> str:
        path = self._causes.path(question.uid)
        while changed.position < last:
            if not changed.step():
                if question.kind == "result" and question.uid == 1 and changed.status is question.result:
                    return ""
                return f"the tree would have ended earlier, with {changed.status.name}"
        trace = TickTrace(changed.tree)
        changed.step()
        trace.close()
        if trace.is_truncated or question.is_same(trace):
            return ""
        visits = trace.visits_of(question.uid)
        if question.kind == "halt":
            return f"'{path}' would not have been halted"
        if not visits:
            return f"'{path}' would not have been ticked"
        result = visits[-1].result
        if question.kind == "no tick":
            return f"'{path}' would have been ticked"
        return f"'{path}' would have {'raised' if result is None else f'returned {result.name}'}"

    # --- the answer

    def _answer(self, question: _Question, cause: Cause, found: _SmallestSet | None) -> Answer:
        path, tick = self._causes.path(question.uid), self._causes.tick(question.step)
        moment = f"in tick {tick} ({self._causes.time(question.step):g} s)"
        match question:
            case _Question(kind="halt"):
                asked = f"why was '{path}' halted {moment}?"
            case _Question(kind="no tick"):
                asked = f"why was '{path}' not ticked {moment}?"
            case _Question(result=Status.RUNNING):
                asked = f"why is '{path}' RUNNING {moment}?"
            case _Question(result=None):
                asked = f"why did '{path}' raise {moment}?"
            case _Question(result=result):
                asked = f"why did '{path}' return {name_of(result)} {moment}?"
        if found is not None:
            changes = " and ".join(map(_describe_change, found.changes))
            causes = " and ".join(map(self._describe_cause, found.causes))
            answer = f"{causes}. If {changes}, {found.outcome}; this was tried in a replay."
            for each, change in zip(found.causes, found.changes, strict=True):
                each.tried = f"{_describe_change(change)}: {found.outcome}"
        elif question.kind == "result" and cause.changes:
            answer = f"'{path}' decides this in its own code, which a replay does not run."
        elif self._has_given_up:
            answer = f"In {self._limit_s:g} s, no leaf result or entry was found that would change this."
        elif any(each.changes for each in cause.walk()):
            answer = "No other results of these leaves, and no other values of these entries, change this."
        else:
            answer = "The tree alone decided this: no leaf result, and no entry from outside, has led to it."
        chosen, all_changes = ((), ()) if found is None else (found.causes, found.changes)
        return Answer(asked, answer, self._chain(cause, chosen), all_changes)

    def _describe_cause(self, cause: Cause) -> str:
        who = f"'{self._causes.path(cause.uid)}'" if cause.uid else OUTSIDE[0].upper() + OUTSIDE[1:]
        return f"{who} {cause.because}"

    def _chain(self, cause: Cause, chosen: Sequence[Cause]) -> list[Link]:
        """Return the links: the paths from *cause* to the chosen causes, and what else led to the result."""
        order = list(cause.walk())
        kept: list[Cause] = []
        for target in chosen or [_end_of(cause)]:
            kept += [each for each in _path_to(cause, target) if not any(each is one for one in kept)]
        while len(kept) > MAX_LINKS:
            passing = next((each for each in kept[1:] if each.is_passed_on and each not in chosen), kept[-2])
            kept = [each for each in kept if each is not passing]
        for each in order:
            is_new = not each.is_context and not any(each.is_like(one) for one in kept)
            if is_new and len(kept) < MAX_LINKS:
                kept.append(each)
        return [self._link(each) for each in order if any(each is one for one in kept)]

    def _link(self, cause: Cause) -> Link:
        config = self._replay.tree.nodes[cause.uid - 1].config if cause.uid else None
        place = "" if config is None else config.where
        code = None if config is None else self._replay.recording.head.facts.code.get(config.id)
        if code is not None:
            place += f" ({PurePath(code.place).name})"
        time = round(self._causes.time(cause.step), 9)
        return Link(
            self._causes.tick(cause.step),
            time,
            self._causes.path(cause.uid),
            place,
            f"{cause.because}{cause.details}",
            cause.tried,
        )


def _describe_change(change: Change) -> str:
    match change:
        case SetResult(tick, node, status):
            return f"'{node}' had returned {status.name} in tick {tick}"
        case HoldEntry(tick, _, key, value):
            return f"{key} had been {short_text(value)} in tick {tick}"
    return str(change)


def _read(file: str) -> str | None:
    """Return the text of a tree's file below the working directory, or None."""
    path = local_file(file)
    if path is not None:
        with suppress(OSError, TreeError):
            return parse_file(path).text
    return None


def _path_to(cause: Cause, target: Cause) -> list[Cause]:
    """Return the causes from *cause* to *target*; empty if it does not lead there."""
    if cause is target:
        return [cause]
    for each in cause.causes:
        found = _path_to(each, target)
        if found:
            return [cause, *found]
    return []


def _end_of(cause: Cause) -> Cause:
    """Return the cause at the end of the most important ones."""
    while cause.causes:
        cause = cause.causes[0]
    return cause
