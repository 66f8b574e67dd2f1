"""Runs a recording again: the engine ticks the recorded tree, whose external nodes do what was recorded."""

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.format3 import Format3Blackboard
from btcore.blackboard.ports import Direction, Port
from btcore.clock import NS_PER_S
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.journal import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    Paused,
    StatusForced,
    StatusSet,
    TimeRead,
)
from btcore.engine.leaf import LeafNode
from btcore.engine.node import TreeNode, execute_tick, halt_node, reset_status
from btcore.engine.node_config import NodeConfig
from btcore.engine.node_spec import NodeSpec
from btcore.engine.observers import Observer
from btcore.engine.transition_records import Transitions
from btcore.errors import BtcoreError, NodeExecutionError, ScriptError, TickInterrupt
from btcore.loading.instantiate import instantiate
from btcore.logs.files import LogError
from btcore.registry.manifest import Manifest, create_manifest
from btcore.registry.registry import Registry, SubstitutionRule
from btcore.script.program import compile_script
from btcore.status import IDLE, SKIPPED, NodeType, Status
from btcore.tree.tree import Tree
from btcore.values import TypeRegistry, UserType, ValueType, VectorType
from btcore.xml.define import define
from btcore.xml.plan.plan import plan
from btcore.xml.read.document import Diagnostics
from btcore.xml.read.read import Sources, parse_text
from btcore_recorder.files import read_recording
from btcore_recorder.inputs import (
    ExternalHaltEnded,
    Head,
    Input,
    Raised,
    RecordedClass,
    RecordedEntry,
    RecordedError,
    Removed,
    Replaced,
    Result,
    RunRecording,
    ScriptRun,
    Segment,
    Step,
    TreeState,
    Written,
    scopes_of,
)
from btcore_recorder.tree_state import capture, describe_difference, restore_entries, restore_nodes
from btcore_recorder.values import Decoder, Encoder, NotReplayable

STATE_INTERVAL: Final = 250
"""The number of steps between two saved states, from which `Replay.seek` runs to any step between them."""


class Difference(NamedTuple):
    """The first difference between a recording and its replay.

    Attributes:
        step: The index of the step.
        tick: The number of the tick; 0 = a halt.
        recorded: What was recorded.
        now: What happens in the replay.
        node: The path of the node at which they differ; "" = not known.
        place: The place of this node in the XML, `file:line`; "" = not known.
    """

    step: int
    tick: int
    recorded: str
    now: str
    node: str = ""
    place: str = ""

    def __str__(self) -> str:
        moment = f"tick {self.tick}" if self.tick else f"the halt after step {self.step}"
        place = f" ({self.place})" if self.place else ""
        return f"{moment}: recorded: {self.recorded}; now: {self.now}{place}"


class _Differs(TickInterrupt):
    """Ends a tick of a replay that differs from the recording."""


class _StandInClock:
    """The clock of the external nodes, of entries and of observers: the time at which the step began."""

    def __init__(self) -> None:
        self.time = 0

    def now(self) -> int:
        return self.time

    def wait_until(self, deadline: int, wake: object) -> bool:
        return False


class _RecordedTimes(_StandInClock):
    """The clock of the built-in nodes: the times that they have read."""

    def __init__(self, inputs: "_Inputs") -> None:
        super().__init__()
        self._inputs = inputs
        self._repeats = 0

    def begin(self, time: int) -> None:
        """Begin a step at *time*, which the tree reads first unless it is −1."""
        self.time = time
        self._repeats = 0 if time < 0 else -1

    def now(self) -> int:
        head = self._inputs.next
        if isinstance(head, TimeRead) and self._repeats == head.repeats:
            self._inputs.take()
            self.time = head.time
            self._repeats = 0
        else:
            self._repeats += 1
        return self.time


class _Inputs:
    """The inputs of a step that were not used yet."""

    def __init__(self) -> None:
        self._left: deque[Input] = deque()

    def begin(self, inputs: Iterable[Input]) -> None:
        self._left = deque(inputs)

    @property
    def next(self) -> Input | None:
        """The next input, or None."""
        return self._left[0] if self._left else None

    def take(self) -> Input | None:
        """Take the next input."""
        return self._left.popleft() if self._left else None

    def __iter__(self) -> Iterator[Input]:
        return iter(self._left)


class _ExternalCode:
    """Does what external nodes have done."""

    def __init__(self, inputs: _Inputs, decoder: Decoder, known_types: TypeRegistry) -> None:
        self._inputs = inputs
        self._decoder = decoder
        self._known_types = known_types
        self.nodes: Sequence[TreeNode] = ()
        self.boards: Sequence[Blackboard] = ()
        self._types: dict[str, ValueType] = {}
        self.difference: tuple[str, str] | None = None
        self.node: TreeNode | None = None  # the external node that is ticked or halted
        self.has_unreplayable_values = False
        self._child_error: NodeExecutionError | None = None

    def tick(self, node: TreeNode) -> Status:
        """Do what the tick of *node* did."""
        uid = node.config.uid
        self.node = node
        while True:
            event = self._inputs.take()
            if isinstance(event, (Result, Raised)) and event.uid == uid:
                if isinstance(event, Result):
                    return event.status
                self._raise(event.error)
            self.apply(event, f"'{node.path}' is ticked")

    def halt(self, node: TreeNode) -> None:
        """Do what the halt of *node* did."""
        head = self._inputs.next
        if not (isinstance(head, ExternalHaltBegan) and head.uid == node.config.uid):
            reset_status(node)
            return
        self._inputs.take()
        self.node = node
        while True:
            event = self._inputs.take()
            if isinstance(event, ExternalHaltEnded) and event.uid == node.config.uid:
                if event.error is not None:
                    self._raise(event.error)
                return
            self.apply(event, f"'{node.path}' is halted")

    def paused(self, uid: int, count: int) -> bool:
        """Return whether the node with *uid* pauses after *count* repetitions."""
        head = self._inputs.next
        # Named tuples of two types are equal if their values are.
        is_paused = isinstance(head, Paused) and head == (uid, count)
        if is_paused:
            self._inputs.take()
        return is_paused

    def pre_tick(self, node: TreeNode) -> Status:
        """Return the status that a callback forced before the tick of *node*."""
        return self._forced(node, True)

    def post_tick(self, node: TreeNode, status: Status) -> Status:
        """Return the status that a callback forced after the tick of *node*."""
        return self._forced(node, False)

    def _forced(self, node: TreeNode, is_pre_tick: bool) -> Status:
        writes = (Written, Removed, Replaced, ScriptRun)
        first = next((event for event in self._inputs if not isinstance(event, writes)), None)
        uid = node.config.uid
        if not (isinstance(first, StatusForced) and first[:2] == (uid, is_pre_tick)):
            return SKIPPED
        while (event := self._inputs.take()) is not first:
            self.apply(event, "a callback is called")
        return first.status

    def apply(self, event: Input | None, now: str) -> None:
        """Do what *event* says, which is not the end of a tick or halt."""
        match event:
            case Written(scope, key, value, declared):
                value_type = None if declared is None else self.type(declared)
                try:
                    self.boards[scope].set(key, self.decode(value), value_type)
                except (BtcoreError, ValueError) as error:
                    self.differ(self.words(event), str(error))
            case ScriptRun(scope, text, enums):
                with suppress(ScriptError):  # the leaf has got it, too
                    compile_script(text, enums).run(self.boards[scope])
            case Removed(scope, key):
                self.boards[scope].unset(key)
            case Replaced(scope, entries):
                held = self.boards[scope].local_entries()
                held.clear()
                held.update((key, self.entry(recorded)) for key, recorded in entries.items())
            case StatusSet(uid, status):
                node = self.nodes[uid - 1]
                if status is IDLE:
                    reset_status(node)
                else:
                    node.set_status(status)
            case ChildTicked(uid) | ChildHalted(uid):
                try:
                    if isinstance(event, ChildTicked):
                        execute_tick(self.nodes[uid - 1])
                    else:
                        halt_node(self.nodes[uid - 1])
                except NodeExecutionError as error:
                    self._child_error = error
            case _:
                self.differ("the end of the step" if event is None else self.words(event), now)

    def decode(self, data: Any) -> object:
        """Return a recorded value.

        Raises:
            ValueError: *data* is not the form of a value.
        """
        value = self._decoder.decode(data)
        self.has_unreplayable_values |= isinstance(value, NotReplayable)
        return value

    def differ(self, recorded: str, now: str) -> None:
        """End the step with a difference."""
        if self.difference is None:
            self.difference = recorded, now
        raise _Differs

    def words(self, event: Input) -> str:
        """Return *event* for a message."""
        uid = getattr(event, "uid", None)
        path = "" if uid is None else f" of '{self.nodes[uid - 1].path}'"
        return f"{type(event).__name__}{path}: {tuple(event)}"

    def entry(self, recorded: RecordedEntry) -> Entry:
        """Return a recorded entry."""
        entry = Entry(self.type(recorded.declared), recorded.inferred)
        entry.value_type = None if recorded.value_type is None else self.type(recorded.value_type)
        entry.value, entry.sequence_id = self.decode(recorded.value), recorded.sequence_id
        return entry

    def type(self, name: str) -> ValueType:
        """Return the type with a recorded name."""
        known = self._types.get(name) or self._known_types.named(name)
        if known is None:
            if name.startswith("std::vector<"):
                known = VectorType(self.type(name[len("std::vector<") : -1]))
            else:
                known = UserType(self._decoder.stand_in(name), name)
            self._types[name] = known
        return known

    def _raise(self, recorded: RecordedError) -> None:
        if recorded.type == "NodeExecutionError" and self._child_error is not None:
            error, self._child_error = self._child_error, None
            raise error
        if recorded.type == "TickInterrupt":
            raise TickInterrupt
        raise type(recorded.type, (Exception,), {})(recorded.text)


_BASES: Final[dict[str, type[TreeNode]]] = {
    "leaf": LeafNode,
    "control": ControlNode,
    "decorator": DecoratorNode,
}


class _RecordedRule(SubstitutionRule):
    """Replaces one node, as a rule has done in the recorded run."""

    def __init__(self, uid: int, by: Manifest | str) -> None:
        super().__init__("", by)
        self._uid = uid

    def matches(self, config: NodeConfig) -> bool:
        return config.uid == self._uid


class _Checksum(Observer):
    def __init__(self) -> None:
        self.value = 0

    def transitions(self, changes: Transitions) -> None:
        self.value = changes.checksum(self.value)


class Replay:
    """A recording that is run again, step by step.

    The leaves return, write and raise what was recorded; the engine computes everything else. Neither a robot
    nor the libraries of the leaves are needed.

    Args:
        recording: A recording, or the path of its file.

    Attributes:
        recording: The recording.
        steps: The recorded steps: the ticks of the root, and the halts of the whole tree.
        position: The number of steps that have been run.
        tree: The tree, after these steps.
        difference: The first difference between the recording and the replay, or None.

    Raises:
        LogError: The file cannot be read, or the recording is invalid.
        TreeError: The recorded tree cannot be loaded.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import Replay, record
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysSuccess(name="door")))
        >>> with record(tree, "run.btrec.txt"):
        ...     _ = tree.tick_once()
        >>> replay = Replay("run.btrec.txt")
        >>> replay.step(), replay.tree.status
        (True, <Status.FAILURE: 3>)
    """

    def __init__(self, recording: RunRecording | str | os.PathLike[str]) -> None:
        if not isinstance(recording, RunRecording):
            recording = read_recording(Path(recording))
        head, steps = recording.head, recording.steps
        self.recording = recording
        self.steps = steps
        self.difference: Difference | None = None
        self.position = 0
        self._start_time = head.time
        self._inputs = _Inputs()
        registry = Registry.standard()
        self._external = external = _ExternalCode(self._inputs, Decoder(head.types), registry.types)
        registry.add_enum(head.enums)
        for recorded in head.classes:
            if recorded.id in registry:
                registry.remove(recorded.id)
            registry.add(_stand_in_class(recorded, external), ID=recorded.id)
        for uid, recorded in head.replaced.items():
            registry.substitutions[str(uid)] = _RecordedRule(uid, self._replacement(recorded, registry))
        self._stamps = _StandInClock()
        self.tree = self._load(head, registry)
        external.nodes, external.boards = self.tree.nodes, scopes_of(self.tree)
        _check_numbers(recording, len(external.nodes), len(external.boards))
        self._checksum = _Checksum()
        self.tree.subscribe(self._checksum)
        self._restore(head.state)
        self._encoder = Encoder(lambda name, description: None)  # the types are those of the recording
        self._states = {0: (head.state, 0)}
        self._segments = {segment.position: segment for segment in recording.segments}
        self._times = _RecordedTimes(self._inputs)
        self.tree.context.clock = self._times
        self.tree.context.uses_time = True
        self.tree.context.recorded_pause = external.paused
        self.tree.context.must_check_end = True
        self._add_callbacks(steps)

    def _replacement(self, recorded: RecordedClass, registry: Registry) -> Manifest | str:
        if recorded.kind == "built-in":
            return recorded.id
        stand_in = _stand_in_class(recorded, self._external)
        return create_manifest(recorded.id, stand_in, registry.types, {}, "the recording")

    def _load(self, head: Head, registry: Registry) -> Tree:
        documents = [parse_text(text, file) for file, text, _ in head.documents]
        marks = [is_shared for _, _, is_shared in head.documents]
        shared = [document for document, is_shared in zip(documents, marks, strict=True) if is_shared]
        plans = plan(
            define(Sources(tuple(documents), tuple(shared), Diagnostics()), head.tree_id, head.format),
            registry,
        )
        outer: list[Blackboard] = []
        for autoremap, remaps in reversed(head.outer):
            parent = outer[-1] if outer else None
            board_class = Format3Blackboard if head.format == 3 else Blackboard
            board = board_class(parent, self._stamps)
            board.autoremap = autoremap
            for internal, external in remaps.items():
                board.remap(internal, external)
            outer.append(board)
        # Loading checks the ports against the entries that exist, and creates further entries.
        restore_entries(head.state, outer[::-1], self._external.entry)
        return instantiate(plans, (), outer[-1], self._stamps)

    def _restore(self, state: TreeState) -> None:
        external = self._external
        entries = restore_entries(state, external.boards, external.entry)
        restore_nodes(state, self.tree, entries, external.decode)

    def _add_callbacks(self, steps: Sequence[Step]) -> None:
        forced = {
            (event.uid, event.is_pre_tick)
            for step in steps
            for event in step.inputs
            if isinstance(event, StatusForced)
        }
        for uid, is_pre_tick in forced:
            node = self.tree.nodes[uid - 1]
            if is_pre_tick:
                node.set_pre_tick_function(self._external.pre_tick)
            else:
                node.set_post_tick_function(self._external.post_tick)

    def step(self) -> bool:
        """Run the next step. Return False if there is none, or if it differs from the recording."""
        if self.difference is not None or self.position == len(self.steps):
            return False
        if self.position in self._segments:
            self._begin_segment(self._segments[self.position])
            if self.difference is not None:
                return False
        elif self.position % STATE_INTERVAL == 0 and self.position not in self._states:
            state = capture(self.tree, self._external.boards, self._encoder.encode)
            self._states[self.position] = state, self._checksum.value
        step = self.steps[self.position]
        self.position += 1
        self._external.node = None
        inputs, external = self._inputs, self._external
        status = IDLE
        with suppress(NodeExecutionError, TickInterrupt):
            inputs.begin(step.before)
            while (event := inputs.take()) is not None:
                external.apply(event, "nothing happens between two steps")
            inputs.begin(step.inputs)
            self._times.begin(step.time)
            self._stamps.time = max(step.time, 0)
            if step.tick:
                self.tree.ticks = step.tick - 1
                status = self.tree.tick_exactly_once()
            else:
                self.tree.halt()
        left = inputs.next
        if external.difference is None:
            if left is not None:
                external.difference = external.words(left), "the step ends"
            elif status is not step.status:
                external.difference = f"the result is {step.status.name}", f"the result is {status.name}"
            elif self._checksum.value != step.checksum:
                external.difference = "other transitions", "transitions with another checksum"
        if external.difference is not None:
            node = external.node
            place = ("", "") if node is None else (node.path, node.config.where)
            self.difference = Difference(self.position, step.tick, *external.difference, *place)
        return self.difference is None

    def _begin_segment(self, segment: Segment) -> None:
        self._checksum.value = 0
        if segment.gap:
            self._restore(segment.state)
            return
        state = capture(self.tree, self._external.boards, self._encoder.encode)
        if state != segment.state:
            self.difference = Difference(
                self.position, segment.state.ticks, *describe_difference(segment.state, state)
            )

    def seek(
        self,
        position: int | None = None,
        *,
        tick: int | None = None,
        time: float | None = None,
        until: Callable[[Tree], object] | None = None,
    ) -> bool:
        """Run the tree, forward or backward, to another moment of the recording.

        Args:
            position: Go to the end of this number of steps.
            tick: Go to the end of the tick with this number.
            time: Go to the end of the last tick that began at this time or before (s since the start).
            until: Run until the first step after which *until* of the tree is true.

        Returns:
            Whether the moment was reached: there is such a moment, and no difference before it.
        """
        if until is not None:
            while self.step():
                if until(self.tree):
                    return True
            return False
        if position is None:
            position = self._find_tick(tick) if tick is not None else self._find_time(time or 0.0)
        if not 0 <= position <= len(self.steps):
            return False
        start = position - position % STATE_INTERVAL
        while start not in self._states:
            start -= STATE_INTERVAL
        if position < self.position or self.position < start:
            self._go_back(start)
        while self.position < position and self.step():
            pass
        return self.position == position and self.difference is None

    def _find_tick(self, tick: int) -> int:
        return next((index for index, step in enumerate(self.steps, 1) if step.tick == tick), -1)

    def _find_time(self, seconds: float) -> int:
        time = self._start_time + round(seconds * NS_PER_S)
        return next((index for index, step in enumerate(self.steps) if step.time > time), len(self.steps))

    def _go_back(self, position: int) -> None:
        state, checksum = self._states[position]
        self.position = position
        self.difference = self._external.difference = None
        self._restore(state)
        self.tree.status = self.steps[position - 1].status if position else self.tree.root.status
        self._checksum.value = checksum

    @property
    def has_unreplayable_values(self) -> bool:
        """Whether one of the values so far was recorded as text; see `NotReplayable`."""
        return self._external.has_unreplayable_values

    def verify(self) -> Difference | None:
        """Run all steps, and return the first difference, or None."""
        while self.step():
            pass
        return self.difference


def _check_numbers(recording: RunRecording, node_count: int, board_count: int) -> None:
    """Raise LogError if the recording names a node or a scope that the tree does not have."""
    for state in (recording.head.state, *(segment.state for segment in recording.segments)):
        if len(state.scopes) != board_count:
            raise LogError(f"the recording has {len(state.scopes)} scopes, but its tree has {board_count}")
        for node in state.nodes:
            if not 1 <= node.uid <= node_count:
                raise LogError(f"the recording has the state of a node {node.uid}, which does not exist")
    for step in recording.steps:
        for event in (*step.before, *step.inputs):
            uid, scope = getattr(event, "uid", 1), getattr(event, "scope", 0)
            if not (1 <= uid <= node_count and 0 <= scope < board_count):
                raise LogError(f"the recording of tick {step.tick} names a node or scope that does not exist")


def _stand_in_class(recorded: RecordedClass, external: _ExternalCode) -> type[TreeNode]:
    ports = [
        Port(name, Direction[direction], external.type(type_name), default)
        for name, direction, type_name, default in recorded.ports
    ]
    spec = NodeSpec(node_type=NodeType[recorded.node_type])
    if recorded.kind == "control":
        spec = replace(spec, child_count=(0, None), child_count_at_load=(0, None))
    members: dict[str, Any] = {
        "tick": lambda node: external.tick(node),
        "halt": lambda node: external.halt(node),
        "provided_ports": staticmethod(lambda: ports),
        "spec": spec,
        "_must_complete": recorded.must_complete,
        "__module__": __name__,
    }
    return type(recorded.id, (_BASES[recorded.kind],), members)
