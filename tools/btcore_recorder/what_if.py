"""What if: a recorded run with another tree, or with other inputs.

The external nodes do what they did in the recorded run, matched by path: each takes the recorded calls of its
code in their order, and a start takes the next start. If that was in another tick, it is an assumption: the
robot might have behaved differently.
"""

import os
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import cycle, zip_longest
from typing import Any, Literal, NamedTuple

from btcore.blackboard.ports import Port
from btcore.engine.node import TreeNode
from btcore.engine.observers import Observer
from btcore.engine.recorded_events import (
    Paused,
    ScriptRun,
    StatusForced,
    TimeRead,
    Written,
)
from btcore.errors import BtcoreError, NodeExecutionError, TickInterrupt
from btcore.registry.mock_leaves import MockLeafError
from btcore.registry.outcome_grammar import LETTERS, Outcome, parse_outcomes
from btcore.registry.registry import Registry
from btcore.status import FAILURE, IDLE, RUNNING, SKIPPED, SUCCESS, Status, Transition
from btcore.suggestions import did_you_mean
from btcore.tree.tree import Tree, scopes_of
from btcore.xml.models.model_file import collect_ports
from btcore.xml.read.read import parse_file, parse_text, read
from btcore_recorder.failures import Failure, FailureObserver
from btcore_recorder.inputs import Head, Input, RecordedClass, Result, RunRecording, Step, is_external
from btcore_recorder.recorded_tree import RecordedTree
from btcore_recorder.replay import Replay, forced_statuses

File = str | os.PathLike[str]
EndReason = Literal["the tree ended", "no result is recorded", "a node raised"]
"""Why a changed run ended before the recording."""


class SetEntry(NamedTuple):
    """Write an entry of the main tree before a tick."""

    tick: int
    key: str
    value: object


class HoldEntry(NamedTuple):
    """Let an entry have a value during a tick, whatever external nodes write to it.

    Attributes:
        tick: The number of the tick.
        scope: The index of the scope that holds the entry, in the order of the recording.
        key: The key of the entry in this scope.
        value: The value.
    """

    tick: int
    scope: int
    key: str
    value: object


class SetResult(NamedTuple):
    """Replace the result of an external node, given by its path, in a tick."""

    tick: int
    node: str
    status: Status


Change = SetEntry | HoldEntry | SetResult


class ChangedRun(NamedTuple):
    """What a changed run did.

    Attributes:
        ticks: The number of its ticks.
        status: The result of its last tick.
        end: Why it ended before the recording; None if it did not.
        ended_at: The path of the node that raised or lacks a result; else "".
        differs_from: The first tick with other transitions, or another result, than in the recorded run; None
            if there is none.
        recorded: The first transition or result that differs, as recorded; "" if there is none.
        now: The same in the changed run.
        assumed_from: The first tick that rests on an assumption; None if there is none.
        failure: Where it failed first; None if it did not.
        unmatched: The paths of the nodes whose results are recorded, but which the tree does not have.
        unused: The changes without effect: the node was not ticked in this tick, or there is no such tick.
    """

    ticks: int
    status: Status
    end: EndReason | None
    ended_at: str
    differs_from: int | None
    recorded: str
    now: str
    assumed_from: int | None
    failure: Failure | None
    unmatched: Sequence[str]
    unused: Sequence[str]

    @property
    def _reason(self) -> str:
        return self.end or "the recording ended"

    @property
    def is_same(self) -> bool:
        """Whether the run did what was recorded."""
        return self.differs_from is None and self.end is None

    def __str__(self) -> str:
        lines = [f"the same in all {self.ticks:,} ticks"]
        if not self.is_same:
            lines = ["the same until it ends"]
        if self.differs_from is not None:
            recorded, now = self.recorded or "nothing more happens", self.now or "nothing more happens"
            lines = [f"it differs from tick {self.differs_from} on: recorded: {recorded}; now: {now}"]
        place = f" at '{self.ended_at}'" if self.ended_at else ""
        with_result = "" if self.end == "no result is recorded" else f" with {self.status.name}"
        lines.append(f"it ends in tick {self.ticks}{with_result}, because {self._reason}{place}")
        if self.assumed_from is not None:
            lines.append(
                f"from tick {self.assumed_from} on it rests on assumptions: nodes start in other ticks than "
                "recorded"
            )
        lines += [f"{change} had no effect" for change in self.unused]
        return "\n".join(lines)

    @property
    def short_text(self) -> str:
        """The result in a line."""
        if self.is_same:
            text = "the same"
        elif self.differs_from is None:
            text = f"the same until tick {self.ticks}, then: {self.end}"
        else:
            text = f"differs from tick {self.differs_from} on: {self.now or 'nothing more happens'}"
        return text if self.assumed_from is None else f"{text}; assumed from tick {self.assumed_from} on"

    def as_data(self) -> dict[str, object]:
        """Return the run as data of JSON."""
        failure = None if self.failure is None else self.failure._asdict()
        own = {"status": self.status.name, "end": self._reason, "failure": failure, "same": self.is_same}
        return self._asdict() | own


class _Call(NamedTuple):
    """A call of the code of an external node in a recorded run.

    Attributes:
        tick: The number of the tick; of a halt between two ticks, that of the tick before.
        kind: A tick of a node that was not RUNNING, a tick of one that was, or a halt.
        events: What it did, up to its result.
    """

    tick: int
    kind: Literal["start", "tick", "halt"]
    events: list[Input]


class _PathTransition(NamedTuple):
    tick: int
    path: str
    status: Status

    def text(self, has_tick: bool) -> str:
        """Return the transition for a sentence, with or without its tick."""
        moment = f" in tick {self.tick}" if has_tick else ""
        return f"'{self.path}' becomes {self.status.name}{moment}"


class PathTransitions(Observer):
    """Collects transitions with the paths of the nodes."""

    def __init__(self, tree: Tree) -> None:
        self.found: list[_PathTransition] = []
        self._paths = list(tree.nodes_by_path())

    def transition(self, change: Transition) -> None:
        """Add a transition."""
        self.found.append(_PathTransition(change.tick, self._paths[change.uid - 1], change.status))


class _TracedReplay(Replay):
    """Collects the calls of external nodes, by UID. A halt in which a node only becomes IDLE is no call."""

    def __init__(self, recording: RunRecording) -> None:
        super().__init__(recording)
        self.calls: dict[int, list[_Call]] = defaultdict(list)

    def _tick_events(self, node: TreeNode) -> Iterator[Input]:
        call = _Call(self.tree.ticks, "tick" if node.status is RUNNING else "start", [])
        return self._trace(node, call, super()._tick_events(node))

    def _halt_events(self, node: TreeNode) -> Iterator[Input]:
        return self._trace(node, _Call(self.tree.ticks, "halt", []), super()._halt_events(node))

    def _trace(self, node: TreeNode, call: _Call, events: Iterator[Input]) -> Iterator[Input]:
        for event in events:
            if not call.events:
                self.calls[node.config.uid].append(call)
            call.events.append(event)
            yield event


class _NoResultError(TickInterrupt):
    """Ends a changed run at a node for which nothing more is recorded."""


class RecordedRun:
    """A recorded run: what its external nodes did, by path, and its transitions.

    Raises:
        BtcoreError: Its replay differs from it.
    """

    def __init__(self, recording: RunRecording) -> None:
        replay = _TracedReplay(recording)
        collected = PathTransitions(replay.tree)
        replay.tree.subscribe(collected)
        if (difference := replay.verify()) is not None:
            raise BtcoreError(f"the replay already differs from the recording: {difference}")
        replay.tree.flush_observers()
        self.recording = recording
        self.tree = replay.tree
        self.paths = list(replay.tree.nodes_by_path())
        self.transitions = collected.found
        self.calls = {self.paths[uid - 1]: calls for uid, calls in replay.calls.items()}


class ChangedReplay(RecordedTree):
    """A recorded run that is run again with changes, step by step.

    Args:
        changes: Changed inputs.
        document: The file name and the text of another tree, in place of the main document.
        matches: For nodes that have another path in this tree: the new path by the recorded path.
        outcomes: What nodes do when nothing more is recorded for them, by path, such as `RRS|F`; see
            `btcore.registry.outcome_grammar.parse_outcomes`.
        missing: The result of other nodes when nothing is recorded for them; None = the run ends there.

    Attributes:
        position: The number of steps that have been run.
        status: The result of the last tick.
        end: Why the run ended before the recording; None if it did not.
        ended_at: The path of the node that raised or lacks a result; else "".
        unmatched: The paths of the recorded nodes that the other tree does not have.
        other_result: The first tick with another result than recorded, the recorded one and the present one;
            None if there is none.
        assumed_from: The first tick that rests on an assumption; None if there is none.
        invented: The nodes for which nothing was recorded, and which had the result *missing*.

    Raises:
        TreeError: The other tree cannot be loaded.
        BtcoreError: The recording cannot be changed in this way, or there is no such node.
    """

    def __init__(
        self,
        run: RecordedRun,
        changes: Iterable[Change] = (),
        document: tuple[str, str] | None = None,
        matches: Mapping[str, str] | None = None,
        outcomes: Mapping[str, str] | None = None,
        missing: Status | None = None,
    ) -> None:
        recording, head = run.recording, run.recording.head
        if any(segment.gap for segment in recording.segments):
            raise BtcoreError("the recording has a gap: what follows it cannot be changed")
        if document is not None:
            head = head._replace(documents=_exchange(head, document))
            head = head._replace(classes=(*head.classes, *_new_leaves(head, run.tree)))
        changes, matches, outcomes = list(changes), matches or {}, outcomes or {}
        for old in matches:
            _check_node(old, run.paths, "the recorded tree")
        super().__init__(head)
        nodes = self.tree.nodes_by_path()
        self._paths = paths = list(nodes)
        leaves = [path for path, node in nodes.items() if is_external(type(node))]
        results = [each for each in changes if isinstance(each, SetResult)]
        for path in (*(each.node for each in results), *outcomes):
            _check_node(path, leaves, "the tree, whose results are recorded")
        for new in matches.values():
            _check_node(new, paths, "the tree")
        if document is None or _nodes(self.tree) == _nodes(run.tree):
            self.restore(head.state)
        elif any(node.status is not IDLE for node in head.state.nodes):
            raise BtcoreError(
                "the recording begins within a run: it has no start for a tree with other nodes; use a "
                "recording that begins earlier"
            )
        self.position = 0
        self.status = IDLE
        self.end: EndReason | None = None
        self.ended_at = ""
        self.other_result: tuple[int, Status, Status] | None = None
        self.assumed_from: int | None = None
        self.invented: list[str] = []
        self._steps = recording.steps
        self._entries = [each for each in changes if isinstance(each, SetEntry)]
        self._held = [each for each in changes if isinstance(each, HoldEntry)]
        self._results = {(each.tick, each.node): each.status for each in results}
        self._held_now: list[HoldEntry] = []  # in this step
        self._used: set[tuple[int, str]] = set()  # the nodes that were ticked, by tick
        self._missing = missing
        self._outcomes = {path: cycle(parse_outcomes(text)) for path, text in outcomes.items()}
        self._mocked: dict[str, Iterator[Outcome]] = {}
        self._calls = {matches.get(path, path): deque(calls) for path, calls in run.calls.items()}
        self.unmatched = [path for path in self._calls if path not in nodes]
        # The numbers of nodes and scopes of the recorded tree → those of this tree.
        recorded_paths = [matches.get(path, path) for path in run.paths]
        uids = {path: uid for uid, path in enumerate(paths, start=1)}
        self._uids = {uid: uids[path] for uid, path in enumerate(recorded_paths, start=1) if path in uids}
        self._scopes = _match_scopes(run.tree, self.tree, len(head.outer))
        self._forced: dict[tuple[int, bool], Status] = {}  # by callbacks in this step
        self._paused: set[tuple[int, int]] = set()
        forced = {event.uid for event in forced_statuses(recording.steps)}
        self.add_callbacks(self._uids[uid] for uid in forced & self._uids.keys())

    @property
    def unused(self) -> Sequence[str]:
        """The changes that had no effect, as texts."""
        ticks = {step.tick for step in self._steps[: self.position]}
        set_entries: list[SetEntry | HoldEntry] = [*self._entries, *self._held]
        entries = [each for each in set_entries if each.tick not in ticks]
        return [f"{each.key}={each.value}@{each.tick}" for each in entries] + [
            f"{node}={status.name}@{tick}"
            for (tick, node), status in self._results.items()
            if (tick, node) not in self._used
        ]

    def step(self) -> bool:
        """Run the next step. Return False if there is none, or the run ended."""
        if self.position == len(self._steps) or self.end is not None:
            return False
        step = self._steps[self.position]
        self.position += 1
        try:
            status = self.run_step(step)
        except NodeExecutionError as error:
            self.status = IDLE if step.tick else self.status
            if step.status is not IDLE:
                self.end, self.ended_at = "a node raised", error.path
        except TickInterrupt:
            assert self._external is not None
            self.end, self.ended_at = "no result is recorded", self._external.path
        else:
            if step.tick:
                self.status = status
                if status is not step.status and self.other_result is None:
                    self.other_result = step.tick, step.status, status
                if status in (SUCCESS, FAILURE) and step.status not in (SUCCESS, FAILURE, IDLE):
                    self.end = "the tree ended"
        return self.end is None

    def _begin(self, step: Step) -> None:
        self._held_now = []
        for event in self._moved(step.before):
            self._apply(event, "")
        for change in self._entries:
            if change.tick == step.tick:
                self.tree.blackboard[change.key] = change.value
        self._held_now = [each for each in self._held if each.tick == step.tick]
        self._hold_entries()
        self._set_inputs(event for event in step.inputs if isinstance(event, TimeRead))
        self._forced.clear()
        self._paused.clear()
        for event in step.inputs:
            if isinstance(event, (StatusForced, Paused)) and event.uid in self._uids:
                uid = self._uids[event.uid]
                if isinstance(event, StatusForced):
                    self._forced[uid, event.is_pre_tick] = event.status
                else:
                    self._paused.add((uid, event.repetitions))

    def _moved(self, events: Iterable[Input]) -> Iterator[Input]:
        """Yield recorded events with the numbers of this tree, without those of other nodes and scopes."""
        for event in events:
            for name, new in (("uid", self._uids), ("scope", self._scopes)):
                old = getattr(event, name, None)
                if old is not None:
                    if old not in new:
                        self._assume()
                        break
                    moved: dict[str, Any] = {name: new[old]}
                    event = event._replace(**moved)
            else:
                yield event

    def _assume(self) -> None:
        """Note that the run rests on an assumption from the present tick on."""
        if self.assumed_from is None:
            self.assumed_from = self.tree.ticks

    def _take_call(self, path: str, kind: Literal["start", "tick"]) -> _Call | None:
        """Take the next recorded start of a node, or its next tick if this follows; None if there is none."""
        calls = self._calls.get(path)
        while calls and kind == "start" and calls[0].kind != "start":
            calls.popleft()
        return calls.popleft() if calls and calls[0].kind == kind else None

    def _tick_events(self, node: TreeNode) -> Iterator[Input]:
        uid, tick = node.config.uid, self.tree.ticks
        path = self._paths[uid - 1]
        call = self._take_call(path, "tick" if node.status is RUNNING else "start")
        changed = self._results.get((tick, path))
        self._used.add((tick, path))
        if call is not None:
            self._mocked.pop(path, None)
            *events, end = call.events
            if call.kind == "start" and call.tick != tick:
                self._assume()
            yield from self._moved(events)
            if changed is None:
                yield from self._moved([end])
        elif changed is None:
            yield self._unrecorded_result(node, path)
        else:
            self._assume()
        if changed is not None:
            yield Result(uid, changed)

    def _unrecorded_result(self, node: TreeNode, path: str) -> Result:
        """Return the result of a node for whose present tick nothing is recorded."""
        uid, is_running = node.config.uid, node.status is RUNNING
        if path in self._outcomes:
            self._assume()
            if not is_running or path not in self._mocked:
                self._mocked[path] = iter(next(self._outcomes[path]))
            outcome = next(self._mocked[path], Outcome("R"))
            for port, text in outcome.outputs:
                node.set_output(port, text)
            if outcome.letter == "X":
                raise MockLeafError("the outcome is X")
            return Result(uid, LETTERS[outcome.letter])
        if is_running:  # it was halted here, or the recording ended
            self._assume()
            return Result(uid, RUNNING)
        if self._missing is None:
            raise _NoResultError
        self._assume()
        self.invented.append(path)
        is_invalid = self._missing is RUNNING and node.spec.must_complete
        return Result(uid, SUCCESS if is_invalid else self._missing)

    def _halt_events(self, node: TreeNode) -> Iterator[Input]:
        calls = self._calls.get(self._paths[node.config.uid - 1])
        while calls and calls[0].kind == "tick":  # it was halted later
            calls.popleft()
        is_due = node.status is RUNNING or (calls and calls[0].tick == self.tree.ticks)
        if calls and calls[0].kind == "halt" and is_due:
            yield from self._moved(calls.popleft().events)

    def _pauses(self, uid: int, count: int) -> bool:
        return (uid, count) in self._paused or super()._pauses(uid, count)

    def _forced_status(self, uid: int, is_pre_tick: bool) -> Status:
        return self._forced.pop((uid, is_pre_tick), SKIPPED)

    def _apply(self, event: Input, now: str) -> None:
        super()._apply(event, now)
        if isinstance(event, (Written, ScriptRun)):
            self._hold_entries()

    def _hold_entries(self) -> None:
        """Give the entries of `HoldEntry` their values, unless they have them."""
        for _, scope, key, value in self._held_now:
            if self.boards[scope].get(key) != value:
                self.boards[scope].set(key, value)

    def _differ(self, recorded: str, now: str) -> None:
        self._assume()


def run_changed(
    recording: RunRecording,
    changes: Iterable[Change] = (),
    document: tuple[str, str] | None = None,
    matches: Mapping[str, str] | None = None,
    outcomes: Mapping[str, str] | None = None,
    attach: Callable[[Tree], object] | None = None,
) -> ChangedRun:
    """Run a recording again with changes, and compare it with the recorded run; see `ChangedReplay`.

    Args:
        attach: Called with the changed tree before its first step, for example to record it.
    """
    run = RecordedRun(recording)
    changed = ChangedReplay(run, changes, document, matches, outcomes)
    if attach is not None:
        attach(changed.tree)
    collected, failures = PathTransitions(changed.tree), FailureObserver(changed.tree)
    changed.tree.subscribe(collected)
    changed.tree.subscribe(failures)
    while changed.step():
        pass
    changed.tree.flush_observers()
    matches = matches or {}
    transitions = [each._replace(path=matches.get(each.path, each.path)) for each in run.transitions]
    pairs = zip_longest(transitions, collected.found)
    differing = (
        pair for pair in pairs if pair[0] != pair[1] and (changed.end is None or pair[1] is not None)
    )
    differs_from: int | None = None
    recorded = now = ""
    if (pair := next(differing, None)) is not None:
        ticks = {side.tick for side in pair if side is not None}
        differs_from = min(ticks)
        recorded, now = ["" if side is None else side.text(len(ticks) > 1) for side in pair]
    elif changed.other_result is not None:
        differs_from, before, after = changed.other_result
        recorded, now = f"the result is {before.name}", f"the result is {after.name}"
    return ChangedRun(
        changed.tree.ticks,
        changed.status,
        changed.end,
        changed.ended_at,
        differs_from,
        recorded,
        now,
        changed.assumed_from,
        failures.found,
        changed.unmatched,
        changed.unused,
    )


def read_document(file: File | None) -> tuple[str, str] | None:
    """Return the name and the text of a file for `ChangedReplay`; None for none."""
    return None if file is None else (os.fspath(file), parse_file(file).text)


def _exchange(head: Head, document: tuple[str, str]) -> tuple[tuple[str, str, bool], ...]:
    """Return the documents of *head* with another main document, and the files that it includes."""
    file, text = document
    sources = read(parse_text(text, file))
    if sources.diagnostics.errors:  # an included file is elsewhere
        return *head.documents[:-1], (*document, False)
    shared = (each for each in head.documents if each[2])
    return *shared, *((each.file, each.text, False) for each in sources.documents)


def _new_leaves(head: Head, recorded: Tree) -> Iterator[RecordedClass]:
    """Yield the classes of leaves that are neither built in nor recorded, and have no recorded name."""
    nodes = Registry.standard()
    roots = [parse_text(text, file).root for file, text, _ in head.documents]
    trees = [tree for root in roots for tree in root.iterchildren("BehaviorTree")]
    known = {each.id for each in head.classes} | {tree.get("ID") for tree in trees}
    names = {node.name for node in recorded.nodes}
    found: dict[str, dict[str, Port]] = {}
    for element in (element for tree in trees for child in tree.children for element in child.iter()):
        id = element.get("ID") if element.tag in ("Action", "Condition") else element.tag
        is_known = id is None or id in known or nodes.get(id, head.format) is not None
        if not (is_known or element.children or element.get("name") in names):
            collect_ports(element, found.setdefault(str(id), {}), head.format)
    for id, ports in found.items():
        described = [(port.name, port.direction.name, "BT::AnyTypeAllowed", None) for port in ports.values()]
        yield RecordedClass(id, "leaf", "ACTION", False, tuple(described))


def _nodes(tree: Tree) -> list[tuple[str, str]]:
    """Return the paths and the IDs of the nodes."""
    return [(path, node.config.id) for path, node in tree.nodes_by_path().items()]


def _check_node(path: str, paths: Sequence[str], where: str) -> None:
    if path not in paths:
        raise BtcoreError(f"there is no node '{path}' in {where}{did_you_mean(path, paths)}")


def _match_scopes(recorded: Tree, changed: Tree, outer: int) -> dict[int, int]:
    """Return the indices of the scopes of *changed* by those of *recorded*: those of subtrees by path."""

    def keys(tree: Tree) -> list[str]:
        paths = {id(subtree.blackboard): subtree.path for subtree in reversed(tree.subtrees)}
        return [
            f"#{index}" if index < outer else paths[id(board)] for index, board in enumerate(scopes_of(tree))
        ]

    indices = {key: index for index, key in enumerate(keys(changed))}
    return {index: indices[key] for index, key in enumerate(keys(recorded)) if key in indices}
