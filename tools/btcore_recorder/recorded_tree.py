"""The tree of a recording, with stand-ins for the external nodes, which do what was recorded."""

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import Any, Final, NoReturn

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.blackboard.format3 import Format3Blackboard
from btcore.blackboard.ports import Direction, Port
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.leaf import LeafNode
from btcore.engine.node import TreeNode, execute_tick, halt_node, reset_status
from btcore.engine.node_config import NodeConfig
from btcore.engine.node_spec import NodeSpec
from btcore.engine.observers import Observers
from btcore.engine.recorded_events import (
    ChildHalted,
    ChildTicked,
    ExternalHaltBegan,
    ExternalHaltEnded,
    MessageLogged,
    Paused,
    Raised,
    RecordedEntry,
    RecordedError,
    Removed,
    Replaced,
    ScriptRun,
    StatusForced,
    StatusSet,
    TimeRead,
    Written,
)
from btcore.errors import BtcoreError, NodeError, NodeExecutionError, ScriptError, TickInterrupt
from btcore.loading.instantiate import instantiate
from btcore.logs.files import LogError
from btcore.registry.manifest import Manifest, create_manifest
from btcore.registry.registration_checks import default_value_error
from btcore.registry.registry import Registry, SubstitutionRule
from btcore.script.program import compile_script
from btcore.status import IDLE, SKIPPED, NodeType, Status
from btcore.tree.tree import scopes_of
from btcore.values import UserType, ValueType, VectorType
from btcore.xml.define import define
from btcore.xml.plan.plan import plan
from btcore.xml.read.document import CollectedDiagnostics
from btcore.xml.read.read import Sources, parse_text
from btcore_recorder.inputs import Head, Input, RecordedClass, Result, Step, TreeState
from btcore_recorder.tree_state import restore_entries, restore_nodes
from btcore_recorder.values import Decoder, NotReplayable

MAX_REPETITIONS: Final = 5_000_000
"""Maximum number of repetitions in a step without a pause. A recording may be a stranger's."""


class StepClock:
    """The clock of the external nodes, of entries and of observers: the time at which the step began."""

    def __init__(self) -> None:
        self.time = 0

    def now(self) -> int:
        """Return the time (ns)."""
        return self.time

    def wait_until(self, deadline: int, wake: object) -> bool:
        """Return False at once: the time of a recording does not pass by waiting."""
        return False


class _Differs(TickInterrupt):
    """Ends a tick of a replay that differs from the recording."""


class RecordedTimes(StepClock):
    """The clock of the built-in nodes: the times that they have read, which are among *inputs*."""

    def __init__(self, inputs: deque[Input]) -> None:
        super().__init__()
        self._inputs = inputs
        self._repeats = 0

    def begin(self, time: int) -> None:
        """Begin a tick at *time*, which the tree reads first; or a halt, at −1."""
        if time >= 0:
            self.time = time
        self._repeats = 0 if time < 0 else -1

    def now(self) -> int:
        """Return the time (ns) that was read here."""
        head = self._inputs[0] if self._inputs else None
        if isinstance(head, TimeRead) and self._repeats == head.repeats:
            self._inputs.popleft()
            self.time = head.time
            self._repeats = 0
        else:
            self._repeats += 1
        return self.time


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


class RecordedTree:
    """The tree of a recording, whose external nodes do what was recorded, in this order.

    Subclasses change what external nodes do: `_tick_events` and `_halt_events`.

    Args:
        head: The head of the recording.

    Attributes:
        tree: The tree. `restore` puts it in the state at the start.
        plans: Its plans.
        boards: Its scopes.
        has_unreplayable_values: Whether one of the values so far was recorded as text; see `NotReplayable`.

    Raises:
        TreeError: The tree cannot be loaded.
    """

    def __init__(self, head: Head) -> None:
        self.has_unreplayable_values = False
        self._inputs: deque[Input] = deque()  # those of the step that were not used yet
        self._mismatch: tuple[str, str] | None = None  # what was recorded, and what happens now
        self._external: TreeNode | None = None  # the external node that was ticked or halted last
        self._child_result = IDLE  # of the child that an external node has ticked last
        self._child_error: NodeExecutionError | None = None
        self._repetitions = 0  # in the step
        self._registry = registry = Registry.standard()
        self._decoder = Decoder(head.types)
        self._types: dict[str, ValueType] = {}
        registry.add_enum(head.enums)
        for recorded in head.classes:
            if registry.get(recorded.id, head.format) is not None:
                registry.remove(recorded.id)
            registry.add(self._stand_in_class(recorded), ID=recorded.id)
        for uid, recorded in head.replaced.items():
            by: Manifest | str = recorded.id
            if recorded.kind != "built-in":
                stand_in = self._stand_in_class(recorded)
                by = create_manifest(recorded.id, stand_in, registry.types, {}, "the recording")
            registry.substitutions[str(uid)] = _RecordedRule(uid, by)
        documents = [parse_text(text, file) for file, text, _ in head.documents]
        marks = [is_shared for _, _, is_shared in head.documents]
        shared = [document for document, is_shared in zip(documents, marks, strict=True) if is_shared]
        sources = Sources(tuple(documents), tuple(shared), CollectedDiagnostics())
        self.plans = plan(define(sources, head.tree_id, head.format), registry)
        self._clock = StepClock()
        outer: list[Blackboard] = []
        for autoremap, remaps in reversed(head.outer):
            parent = outer[-1] if outer else None
            board_class = Format3Blackboard if head.format == 3 else Blackboard
            board = board_class(parent, self._clock)
            board.autoremap = autoremap
            for internal, outside in remaps.items():
                board.remap(internal, outside)
            outer.append(board)
        # Loading checks the ports against the entries that exist, and creates further entries.
        restore_entries(head.state, outer[::-1], self._entry)
        self.tree = tree = instantiate(self.plans, (), outer[-1], self._clock)
        self.boards = scopes_of(tree)
        context = tree.context
        context.observers = Observers(self._clock)  # they take no recorded times
        context.clock = self._times = RecordedTimes(self._inputs)
        context.uses_time = True
        context.recorded_pause = self._pauses

    def _stand_in_class(self, recorded: RecordedClass) -> type[TreeNode]:
        ports = [
            Port(name, Direction[direction], self._type(type_name), default)
            for name, direction, type_name, default in recorded.ports
        ]
        for port in ports:
            if default_value_error(port):
                port.default_value = None  # the default is a Python value, which is not recorded
        spec = NodeSpec(node_type=NodeType[recorded.node_type], must_complete=recorded.must_complete)
        members: dict[str, Any] = {
            "tick": lambda node: self._tick_external(node),
            "halt": lambda node: self._halt_external(node),
            "provided_ports": staticmethod(lambda: ports),
            "spec": spec,
            "__module__": __name__,
        }
        return type(recorded.id, (_BASES[recorded.kind],), members)

    def restore(self, state: TreeState) -> None:
        """Restore a state of the tree."""
        entries = restore_entries(state, self.boards, self._entry)
        restore_nodes(state, self.tree, entries, self.decode)

    def add_callbacks(self, uids: Iterable[int]) -> None:
        """Let callbacks force the recorded statuses of nodes."""
        for uid in uids:
            node = self.tree.nodes[uid - 1]
            node.set_pre_tick_function(self._pre_tick)
            node.set_post_tick_function(self._post_tick)

    # --- running a step

    def run_step(self, step: Step) -> Status:
        """Do what happened before a step, and run the step. Return its result.

        Raises:
            NodeExecutionError: A node raised.
            TickInterrupt: The tick was interrupted.
        """
        self._external = None
        self._repetitions = 0
        self._begin(step)
        self._times.begin(step.time)
        self._clock.time = max(step.time, 0)
        if step.tick:
            self.tree.ticks = step.tick - 1
            return self.tree.tick_exactly_once()
        self.tree.halt()
        return IDLE

    def _begin(self, step: Step) -> None:
        """Do what happened before a step, and take its inputs."""
        self._set_inputs(step.before)
        while self._inputs:
            self._apply(self._inputs.popleft(), "nothing happens between two steps")
        self._set_inputs(step.inputs)

    def _set_inputs(self, inputs: Iterable[Input]) -> None:
        self._inputs.clear()
        self._inputs.extend(inputs)

    def _next_events(self, node: TreeNode, action: str) -> Iterator[Input]:
        """Yield the next inputs, while *node* is "ticked" or "halted"."""
        while self._inputs:
            yield self._inputs.popleft()
        self._differ("the end of the step", f"'{node.path}' is {action}")

    def _tick_events(self, node: TreeNode) -> Iterator[Input]:
        """Yield what the tick of an external node does, up to its result or exception."""
        return self._next_events(node, "ticked")

    def _halt_events(self, node: TreeNode) -> Iterator[Input]:
        """Yield what the halt of an external node does, up to its end; nothing if it only becomes IDLE."""
        head = self._inputs[0] if self._inputs else None
        if isinstance(head, ExternalHaltBegan) and head.uid == node.config.uid:
            self._inputs.popleft()
            yield from self._next_events(node, "halted")

    def _tick_external(self, node: TreeNode) -> Status:
        self._external = node
        uid = node.config.uid
        events = self._tick_events(node)
        while True:
            event = next(events)
            if isinstance(event, (Result, Raised)) and event.uid == uid:
                if isinstance(event, Result):
                    return event.status
                self._raise_error(event.error)
            self._apply(event, f"'{node.path}' is ticked")

    def _halt_external(self, node: TreeNode) -> None:
        for event in self._halt_events(node):
            self._external = node
            if isinstance(event, ExternalHaltEnded) and event.uid == node.config.uid:
                if event.error is not None:
                    self._raise_error(event.error)
                return
            self._apply(event, f"'{node.path}' is halted")
        reset_status(node)

    def _pauses(self, uid: int, count: int) -> bool:
        """Return whether the node with *uid* pauses after *count* repetitions."""
        self._repetitions += 1
        if self._repetitions > MAX_REPETITIONS:
            raise NodeError(f"more than {MAX_REPETITIONS:,} repetitions in a tick")
        head = self._inputs[0] if self._inputs else None
        # Named tuples of two types are equal if their values are.
        is_paused = isinstance(head, Paused) and head == (uid, count)
        if is_paused:
            self._inputs.popleft()
        return is_paused

    def _pre_tick(self, node: TreeNode) -> Status:
        return self._forced_status(node.config.uid, True)

    def _post_tick(self, node: TreeNode, status: Status) -> Status:
        return self._forced_status(node.config.uid, False)

    def _forced_status(self, uid: int, is_pre_tick: bool) -> Status:
        """Return the status that a callback forces before or after the tick of a node; SKIPPED = none."""
        writes = (Written, Removed, Replaced, ScriptRun, MessageLogged)
        first = next((event for event in self._inputs if not isinstance(event, writes)), None)
        if not (isinstance(first, StatusForced) and first[:2] == (uid, is_pre_tick)):
            return SKIPPED
        while (event := self._inputs.popleft()) is not first:
            self._apply(event, "a callback is called")
        return first.status

    # --- events

    def _apply(self, event: Input, now: str) -> None:
        """Do what *event* says, which is not the end of a tick or halt."""
        match event:
            case Written(scope, key, value, declared):
                value_type = None if declared is None else self._type(declared)
                try:
                    decoded = self.decode(value)
                    if isinstance(decoded, NotReplayable):
                        self._write_text(self.boards[scope], key, decoded, value_type)
                    else:
                        self.boards[scope].set(key, decoded, value_type)
                except BtcoreError as error:
                    self._differ(self._words(event), str(error))
            case ScriptRun(scope, text, enums):
                with suppress(ScriptError):  # the leaf has got it, too
                    compile_script(text, enums).run(self.boards[scope])
            case MessageLogged():
                pass
            case Removed(scope, key):
                self.boards[scope].unset(key)
            case Replaced(scope, entries):
                held = self.boards[scope].local_entries()
                held.clear()
                held.update((key, self._entry(recorded)) for key, recorded in entries.items())
            case StatusSet(uid, status):
                node = self.tree.nodes[uid - 1]
                if status is IDLE:
                    reset_status(node)
                else:
                    node.set_status(status)
            case ChildTicked(uid) | ChildHalted(uid):
                try:
                    if isinstance(event, ChildTicked):
                        self._child_result = execute_tick(self.tree.nodes[uid - 1])
                    else:
                        halt_node(self.tree.nodes[uid - 1])
                except NodeExecutionError as error:
                    self._child_error = error
            case _:
                self._differ(self._words(event), now)

    def _write_text(
        self, board: Blackboard, key: str, value: NotReplayable, value_type: ValueType | None
    ) -> None:
        """Write a value that is not of the type of its entry."""
        entry = board.written_entry(key)
        if value_type is not None and not entry.declared.strong:
            entry.declared, entry.inferred = value_type, True
        entry.put(value, board.now())

    def decode(self, data: Any) -> object:
        """Return a recorded value.

        Raises:
            LogError: *data* is not the form of a value.
        """
        try:
            value = self._decoder.decode(data)
        except (ValueError, TypeError) as error:
            raise LogError(f"a recorded value is invalid: {error}") from None
        self.has_unreplayable_values |= isinstance(value, NotReplayable)
        return value

    def _differ(self, recorded: str, now: str) -> None:
        """End the step with a difference."""
        if self._mismatch is None:
            self._mismatch = recorded, now
        raise _Differs

    def _words(self, event: Input) -> str:
        """Return *event* for a message."""
        uid = getattr(event, "uid", None)
        path = "" if uid is None else f" of '{self.tree.nodes[uid - 1].path}'"
        return f"{type(event).__name__}{path}: {tuple(event)}"

    def _entry(self, recorded: RecordedEntry) -> Entry:
        """Return a recorded entry."""
        entry = Entry(self._type(recorded.declared), recorded.inferred)
        entry.value_type = None if recorded.value_type is None else self._type(recorded.value_type)
        entry.value, entry.sequence_id = self.decode(recorded.value), recorded.sequence_id
        return entry

    def _type(self, name: str) -> ValueType:
        """Return the type with a recorded name."""
        known = self._types.get(name) or self._registry.types.named(name)
        if known is None:
            if name.startswith("std::vector<"):
                known = VectorType(self._type(name[len("std::vector<") : -1]))
            else:
                # The converters of the user's class are not there; its leaves do not read their ports here.
                known = UserType(self._decoder.stand_in(name), name, NotReplayable)
            self._types[name] = known
        return known

    def _raise_error(self, recorded: RecordedError) -> NoReturn:
        """Raise a recorded exception."""
        if recorded.type == "NodeExecutionError" and self._child_error is not None:
            error, self._child_error = self._child_error, None
            raise error
        if recorded.type == "TickInterrupt":
            raise TickInterrupt
        raise type(recorded.type, (Exception,), {})(recorded.text)
