"""What if: a recorded run with another tree, or with other inputs.

The external nodes do what they did in the recorded run, matched by path. What a node did is divided into
activations, each from a start to its end or its halt, which are taken in their order. An activation that
begins in another tick than the recorded one is an assumption: the robot might have behaved differently.
"""

import os
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle, zip_longest
from typing import Any, Literal, NamedTuple

from btcore.blackboard.ports import Port
from btcore.engine.node import TreeNode, reset_status
from btcore.engine.observers import Observer
from btcore.engine.recorded_events import (
    ExternalHaltBegan,
    ExternalHaltEnded,
    Paused,
    Raised,
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
from btcore_recorder.inputs import Head, Input, RecordedClass, Result, RunRecording, is_external
from btcore_recorder.recorded_tree import (
    ExternalCode,
    Inputs,
    RecordedTimes,
    StepClock,
    add_callbacks,
    load_recorded,
)
from btcore_recorder.replay import Replay
from btcore_recorder.tree_state import restore_entries, restore_nodes

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


@dataclass
class _Activation:
    """What an external node did from a start on: the inputs of each tick, and of its halt."""

    tick: int
    ticks: list[list[Input]] = field(default_factory=list)
    halt: list[Input] = field(default_factory=list)


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


class _Tracer(ExternalCode):
    """Does what external nodes have done, and collects their activations, by UID."""

    def __init__(self, inputs: Inputs, types: Mapping[str, Any]) -> None:
        super().__init__(inputs, types)
        self.activations: dict[int, list[_Activation]] = defaultdict(list)
        self.present_tick = 0
        self._taken: list[list[Input]] = []  # what each external node that is being ticked has taken

    def tick(self, node: TreeNode) -> Status:
        known = self.activations[node.config.uid]
        if node.status is not RUNNING or not known:
            known.append(_Activation(self.present_tick))
        known[-1].ticks.append([])
        self._taken.append(known[-1].ticks[-1])
        try:
            return super().tick(node)
        finally:
            self._taken.pop()

    def halt(self, node: TreeNode) -> None:
        known = self.activations[node.config.uid]
        head = self._inputs.next
        is_recorded = isinstance(head, ExternalHaltBegan) and head.uid == node.config.uid
        if not known and (is_recorded or node.status is RUNNING):  # since before the recording
            known.append(_Activation(self.present_tick))
        self._taken.append(known[-1].halt if known else [])
        try:
            super().halt(node)
        finally:
            self._taken.pop()

    def take(self) -> Input | None:
        event = super().take()
        if event is not None:
            self._taken[-1].append(event)
        return event


class _NoResultError(TickInterrupt):
    """Ends a changed run at a node for which no activation is left."""


class _Activations(ExternalCode):
    """Does what external nodes have done, in another order if the tree demands it.

    Args:
        types: The descriptions of the recorded types.
        activations: What each node did, by its path in the changed tree.
        results: The changed results, by tick and path.
        outcomes: Outcomes of nodes for which no activation is left, by path, as in `parse_outcomes`.
        missing: The result of other nodes for which no activation is left; None = the run ends there.
    """

    def __init__(
        self,
        types: Mapping[str, Any],
        activations: Mapping[str, Sequence[_Activation]],
        results: Mapping[tuple[int, str], Status],
        outcomes: Mapping[str, str],
        missing: Status | None = None,
    ) -> None:
        super().__init__(Inputs(), types)
        self.held: list[HoldEntry] = []
        self.used: set[tuple[int, str]] = set()  # the nodes that were ticked, by tick
        self.invented: list[str] = []  # the nodes that had *missing* as their result
        self._missing = missing
        self._outcomes = {path: cycle(parse_outcomes(text)) for path, text in outcomes.items()}
        self._mocked: dict[str, Iterator[Outcome]] = {}
        self.present_tick = 0
        self.assumed_from: int | None = None
        self.uids: Mapping[int, int] = {}  # of the recorded tree → of the changed tree
        self._paths: Sequence[str] = ()
        self._scopes: Mapping[int, int] = {}
        self._forced_statuses: dict[tuple[int, bool], Status] = {}
        self._pauses: set[tuple[int, int]] = set()
        self._left = {path: deque(known) for path, known in activations.items()}
        self._results = results
        self._present: dict[str, tuple[_Activation, int]] = {}

    def match_nodes(
        self, recorded_paths: Sequence[str], paths: Sequence[str], scopes: Mapping[int, int]
    ) -> None:
        """Match the nodes of the recorded tree with nodes of the same path, and its scopes with *scopes*."""
        uids = {path: uid for uid, path in enumerate(paths, start=1)}
        self.uids = {uid: uids[path] for uid, path in enumerate(recorded_paths, start=1) if path in uids}
        self._paths, self._scopes = paths, scopes

    def begin_inputs(self, inputs: Iterable[Input]) -> None:
        """Take the statuses that callbacks force, and the pauses, from the inputs of a step."""
        known = [event for event in inputs if getattr(event, "uid", 0) in self.uids]
        self._forced_statuses = {
            (self.uids[event.uid], event.is_pre_tick): event.status
            for event in known
            if isinstance(event, StatusForced)
        }
        self._pauses = {
            (self.uids[event.uid], event.repetitions) for event in known if isinstance(event, Paused)
        }

    def assume(self) -> None:
        """Note that the run rests on an assumption from the present tick on."""
        if self.assumed_from is None:
            self.assumed_from = self.present_tick

    def tick(self, node: TreeNode) -> Status:
        path = self._paths[node.config.uid - 1]
        if node.status is not RUNNING or path not in self._present:
            left = self._left.get(path)
            if not left:
                return self._tick_unrecorded(node, path)
            activation = left.popleft()
            self._present[path] = activation, 0
            if activation.tick != self.present_tick:
                self.assume()
        activation, index = self._present[path]
        last: Input | None = None
        if index == len(activation.ticks):  # the node was halted here, or the recording ended
            self.assume()
        else:
            self._present[path] = activation, index + 1
            *events, last = activation.ticks[index]
            for event in events:
                self.apply(event, "")
        changed = self._changed_result(path)
        if changed is not None:
            return changed
        if isinstance(last, Raised):
            self.raise_error(last.error)
        return last.status if isinstance(last, Result) else RUNNING

    def _tick_unrecorded(self, node: TreeNode, path: str) -> Status:
        """Tick a node for which no activation is left."""
        self.node = node
        changed = self._changed_result(path)
        if changed is not None or path in self._outcomes:
            self.assume()
            return self._tick_mock(node, path) if changed is None else changed
        if self._missing is None:
            raise _NoResultError
        self.assume()
        if node.status is RUNNING:  # it was halted here, or the recording ended
            return RUNNING
        self.invented.append(path)
        is_invalid = self._missing is RUNNING and node.spec.must_complete
        return SUCCESS if is_invalid else self._missing

    def _tick_mock(self, node: TreeNode, path: str) -> Status:
        """Do the next outcome of a node for which no activation is left."""
        if node.status is not RUNNING or path not in self._mocked:
            self._mocked[path] = iter(next(self._outcomes[path]))
        outcome = next(self._mocked[path], Outcome("R"))
        for port, text in outcome.outputs:
            node.set_output(port, text)
        if outcome.letter == "X":
            raise MockLeafError("the outcome is X")
        return LETTERS[outcome.letter]

    def _changed_result(self, path: str) -> Status | None:
        """Return the result of `SetResult` for the present tick of a node, or None."""
        self.used.add((self.present_tick, path))
        return self._results.get((self.present_tick, path))

    def halt(self, node: TreeNode) -> None:
        path = self._paths[node.config.uid - 1]
        present = self._present.pop(path, None)
        activation = None if present is None else present[0]
        left = self._left.get(path)
        if activation is None and left and not left[0].ticks:
            is_due = node.status is RUNNING or left[0].tick == self.present_tick
            activation = left.popleft() if is_due else None
        for event in () if activation is None else activation.halt:
            if isinstance(event, ExternalHaltEnded):
                if event.error is not None:
                    self.raise_error(event.error)
            elif not isinstance(event, ExternalHaltBegan):
                self.apply(event, "")
        reset_status(node)

    def paused(self, uid: int, count: int) -> bool:
        return (uid, count) in self._pauses or super().paused(uid, count)

    def pre_tick(self, node: TreeNode) -> Status:
        return self._forced_statuses.pop((node.config.uid, True), SKIPPED)

    def post_tick(self, node: TreeNode, status: Status) -> Status:
        return self._forced_statuses.pop((node.config.uid, False), SKIPPED)

    def apply(self, event: Input | None, now: str) -> None:
        for name, new in (("uid", self.uids), ("scope", self._scopes)):
            old = getattr(event, name, None)
            if old is not None:
                if old not in new:
                    self.assume()
                    return
                replaced: dict[str, Any] = {name: new[old]}
                event = event._replace(**replaced)  # type: ignore[union-attr]
        super().apply(event, now)
        if isinstance(event, (Written, ScriptRun)):
            self.hold_entries()

    def hold_entries(self) -> None:
        """Give the entries of `HoldEntry` their values, unless they have them."""
        for _, scope, key, value in self.held:
            if self.boards[scope].get(key) != value:
                self.boards[scope].set(key, value)

    def differ(self, recorded: str, now: str) -> None:
        self.assume()


class RecordedRun:
    """A recorded run: what its external nodes did, by path, and its transitions.

    Raises:
        BtcoreError: Its replay differs from it.
    """

    def __init__(self, recording: RunRecording) -> None:
        replay = Replay(recording, _Tracer)
        tracer = replay.external
        assert isinstance(tracer, _Tracer)
        collected = PathTransitions(replay.tree)
        replay.tree.subscribe(collected)
        while replay.position < len(replay.steps):
            tracer.present_tick = replay.steps[replay.position].tick or tracer.present_tick
            if not replay.step():
                raise BtcoreError(f"the replay already differs from the recording: {replay.difference}")
        replay.tree.flush_observers()
        self.recording = recording
        self.tree = replay.tree
        self.paths = list(replay.tree.nodes_by_path())
        self.transitions = collected.found
        self.activations = {self.paths[uid - 1]: known for uid, known in tracer.activations.items()}


class ChangedReplay:
    """A recorded run that is run again with changes, step by step.

    Args:
        changes: Changed inputs.
        document: The file name and the text of another tree, in place of the main document.
        matches: For nodes that have another path in this tree: the new path by the recorded path.
        outcomes: What nodes do when nothing more is recorded for them, by path, such as `RRS|F`; see
            `btcore.registry.outcome_grammar.parse_outcomes`.
        missing: The result of other nodes when nothing is recorded for them; None = the run ends there.

    Attributes:
        tree: The tree.
        position: The number of steps that have been run.
        status: The result of the last tick.
        end: Why the run ended before the recording; None if it did not.
        ended_at: The path of the node that raised or lacks a result; else "".
        unmatched: The paths of the recorded nodes that the other tree does not have.
        other_result: The first tick with another result than recorded, the recorded one and the present one;
            None if there is none.

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
        matches = matches or {}
        for old in matches:
            _check_node(old, run.paths, "the recorded tree")
        changes = list(changes)
        results = {(each.tick, each.node): each.status for each in changes if isinstance(each, SetResult)}
        activations = {matches.get(path, path): known for path, known in run.activations.items()}
        external = _Activations(head.types, activations, results, outcomes or {}, missing)
        self.tree = tree = load_recorded(head, external, StepClock())
        nodes = tree.nodes_by_path()
        paths = list(nodes)
        leaves = [path for path, node in nodes.items() if is_external(type(node))]
        for path in (*(node for _, node in results), *(outcomes or ())):
            _check_node(path, leaves, "the tree, whose results are recorded")
        for new in matches.values():
            _check_node(new, paths, "the tree")
        recorded_paths = [matches.get(path, path) for path in run.paths]
        external.match_nodes(recorded_paths, paths, _match_scopes(run.tree, tree, len(head.outer)))
        if document is None or _nodes(tree) == _nodes(run.tree):
            entries = restore_entries(head.state, external.boards, external.entry)
            restore_nodes(head.state, tree, entries, external.decode)
        elif any(node.status is not IDLE for node in head.state.nodes):
            raise BtcoreError(
                "the recording begins within a run: it has no start for a tree with other nodes; use a "
                "recording that begins earlier"
            )
        self.unmatched = [path for path in activations if path not in nodes]
        self.position = 0
        self.status = IDLE
        self.end: EndReason | None = None
        self.ended_at = ""
        self.other_result: tuple[int, Status, Status] | None = None
        self._recording = recording
        self._external = external
        self._results = results
        self._entries = [each for each in changes if isinstance(each, SetEntry)]
        self._held = [each for each in changes if isinstance(each, HoldEntry)]
        tree.context.clock = self._clock = RecordedTimes(Inputs())
        add_callbacks(external, recording.steps, external.uids)

    @property
    def assumed_from(self) -> int | None:
        """The first tick that rests on an assumption; None if there is none."""
        return self._external.assumed_from

    @property
    def unused(self) -> Sequence[str]:
        """The changes that had no effect, as texts."""
        ticks = {step.tick for step in self._recording.steps[: self.position]}
        set_entries: list[SetEntry | HoldEntry] = [*self._entries, *self._held]
        entries = [each for each in set_entries if each.tick not in ticks]
        return [f"{each.key}={each.value}@{each.tick}" for each in entries] + [
            f"{node}={status.name}@{tick}"
            for (tick, node), status in self._results.items()
            if (tick, node) not in self._external.used
        ]

    @property
    def invented(self) -> Sequence[str]:
        """The nodes for which nothing was recorded, and which had the result *missing*."""
        return self._external.invented

    def step(self) -> bool:
        """Run the next step. Return False if there is none, or the run ended."""
        if self.position == len(self._recording.steps) or self.end is not None:
            return False
        step = self._recording.steps[self.position]
        self.position += 1
        tree, external = self.tree, self._external
        external.begin_step()
        external.present_tick = step.tick or external.present_tick
        external.held = []
        for event in step.before:
            external.apply(event, "")
        for change in self._entries:
            if change.tick == step.tick:
                tree.blackboard[change.key] = change.value
        external.held = [each for each in self._held if each.tick == step.tick]
        external.hold_entries()
        self._clock.inputs.begin(event for event in step.inputs if isinstance(event, TimeRead))
        self._clock.begin(step.time)
        external.begin_inputs(step.inputs)
        try:
            if step.tick:
                tree.ticks = step.tick - 1
                self.status = tree.tick_exactly_once()
                if self.status is not step.status and self.other_result is None:
                    self.other_result = step.tick, step.status, self.status
                if self.status in (SUCCESS, FAILURE) and step.status not in (SUCCESS, FAILURE, IDLE):
                    self.end = "the tree ended"
            else:
                tree.halt()
        except NodeExecutionError as error:
            self.status = IDLE if step.tick else self.status
            if step.status is not IDLE:
                self.end, self.ended_at = "a node raised", error.path
        except TickInterrupt:
            assert external.node is not None
            self.end, self.ended_at = "no result is recorded", external.node.path
        return self.end is None


def run_changed(
    recording: RunRecording,
    changes: Iterable[Change] = (),
    document: tuple[str, str] | None = None,
    matches: Mapping[str, str] | None = None,
    outcomes: Mapping[str, str] | None = None,
) -> ChangedRun:
    """Run a recording again with changes, and compare it with the recorded run; see `ChangedReplay`."""
    run = RecordedRun(recording)
    changed = ChangedReplay(run, changes, document, matches, outcomes)
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
