"""The tree of a recording, with stand-ins for the external nodes, which do what was recorded."""

from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
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
from btcore.tree.tree import Tree, scopes_of
from btcore.values import UserType, ValueType, VectorType
from btcore.xml.define import define
from btcore.xml.plan.plan import Plans, plan
from btcore.xml.read.document import CollectedDiagnostics
from btcore.xml.read.read import Sources, parse_text
from btcore_recorder.inputs import Head, Input, RecordedClass, Result, Step
from btcore_recorder.tree_state import restore_entries
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


class Inputs:
    """The inputs of a step that were not used yet."""

    def __init__(self) -> None:
        self._left: deque[Input] = deque()

    def begin(self, inputs: Iterable[Input]) -> None:
        """Begin a step with *inputs*."""
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


class RecordedTimes(StepClock):
    """The clock of the built-in nodes: the times that they have read, which are among *inputs*."""

    def __init__(self, inputs: Inputs) -> None:
        super().__init__()
        self.inputs = inputs
        self._repeats = 0

    def begin(self, time: int) -> None:
        """Begin a tick at *time*, which the tree reads first; or a halt, at −1."""
        if time >= 0:
            self.time = time
        self._repeats = 0 if time < 0 else -1

    def now(self) -> int:
        """Return the time (ns) that was read here."""
        head = self.inputs.next
        if isinstance(head, TimeRead) and self._repeats == head.repeats:
            self.inputs.take()
            self.time = head.time
            self._repeats = 0
        else:
            self._repeats += 1
        return self.time


class ExternalCode:
    """Does what external nodes have done."""

    def __init__(self, inputs: Inputs, types: Mapping[str, Any]) -> None:
        self.registry = Registry.standard()
        self._inputs = inputs
        self._decoder = Decoder(types)
        self.plans: Plans | None = None  # of the recorded tree
        self.nodes: Sequence[TreeNode] = ()
        self.boards: Sequence[Blackboard] = ()
        self._types: dict[str, ValueType] = {}
        self.difference: tuple[str, str] | None = None
        self.node: TreeNode | None = None  # the external node that is ticked or halted
        self.has_unreplayable_values = False
        self.child_result = IDLE  # of the child that an external node has ticked last
        self._child_error: NodeExecutionError | None = None
        self.repetitions = 0

    def begin_step(self) -> None:
        """Begin a step, or what happens before it."""
        self.node = None
        self.repetitions = 0

    def take(self) -> Input | None:
        """Take the next input of the tick or halt of an external node."""
        return self._inputs.take()

    def tick(self, node: TreeNode) -> Status:
        """Do what the tick of *node* did."""
        uid = node.config.uid
        self.node = node
        while True:
            event = self.take()
            if isinstance(event, (Result, Raised)) and event.uid == uid:
                if isinstance(event, Result):
                    return event.status
                self.raise_error(event.error)
            self.apply(event, f"'{node.path}' is ticked")

    def halt(self, node: TreeNode) -> None:
        """Do what the halt of *node* did."""
        head = self._inputs.next
        if not (isinstance(head, ExternalHaltBegan) and head.uid == node.config.uid):
            reset_status(node)
            return
        self.take()
        self.node = node
        while True:
            event = self.take()
            if isinstance(event, ExternalHaltEnded) and event.uid == node.config.uid:
                if event.error is not None:
                    self.raise_error(event.error)
                return
            self.apply(event, f"'{node.path}' is halted")

    def paused(self, uid: int, count: int) -> bool:
        """Return whether the node with *uid* pauses after *count* repetitions."""
        self.repetitions += 1
        if self.repetitions > MAX_REPETITIONS:
            raise NodeError(f"more than {MAX_REPETITIONS:,} repetitions in a tick")
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
        writes = (Written, Removed, Replaced, ScriptRun, MessageLogged)
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
                    decoded = self.decode(value)
                    if isinstance(decoded, NotReplayable):
                        self._write_text(self.boards[scope], key, decoded, value_type)
                    else:
                        self.boards[scope].set(key, decoded, value_type)
                except BtcoreError as error:
                    self.differ(self.words(event), str(error))
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
                        self.child_result = execute_tick(self.nodes[uid - 1])
                    else:
                        halt_node(self.nodes[uid - 1])
                except NodeExecutionError as error:
                    self._child_error = error
            case _:
                self.differ("the end of the step" if event is None else self.words(event), now)

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
        known = self._types.get(name) or self.registry.types.named(name)
        if known is None:
            if name.startswith("std::vector<"):
                known = VectorType(self.type(name[len("std::vector<") : -1]))
            else:
                # The converters of the user's class are not there; its leaves do not read their ports here.
                known = UserType(self._decoder.stand_in(name), name, NotReplayable)
            self._types[name] = known
        return known

    def raise_error(self, recorded: RecordedError) -> NoReturn:
        """Raise a recorded exception."""
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


def load_recorded(head: Head, external: ExternalCode, clock: StepClock) -> Tree:
    """Return the tree of a recording, whose external nodes call *external*, in its state at the start.

    Raises:
        TreeError: The tree cannot be loaded.
    """
    registry = external.registry
    registry.add_enum(head.enums)
    for recorded in head.classes:
        if registry.get(recorded.id, head.format) is not None:
            registry.remove(recorded.id)
        registry.add(_stand_in_class(recorded, external), ID=recorded.id)
    for uid, recorded in head.replaced.items():
        by: Manifest | str = recorded.id
        if recorded.kind != "built-in":
            stand_in = _stand_in_class(recorded, external)
            by = create_manifest(recorded.id, stand_in, registry.types, {}, "the recording")
        registry.substitutions[str(uid)] = _RecordedRule(uid, by)
    documents = [parse_text(text, file) for file, text, _ in head.documents]
    marks = [is_shared for _, _, is_shared in head.documents]
    shared = [document for document, is_shared in zip(documents, marks, strict=True) if is_shared]
    sources = Sources(tuple(documents), tuple(shared), CollectedDiagnostics())
    plans = external.plans = plan(define(sources, head.tree_id, head.format), registry)
    outer: list[Blackboard] = []
    for autoremap, remaps in reversed(head.outer):
        parent = outer[-1] if outer else None
        board_class = Format3Blackboard if head.format == 3 else Blackboard
        board = board_class(parent, clock)
        board.autoremap = autoremap
        for internal, outside in remaps.items():
            board.remap(internal, outside)
        outer.append(board)
    # Loading checks the ports against the entries that exist, and creates further entries.
    restore_entries(head.state, outer[::-1], external.entry)
    tree = instantiate(plans, (), outer[-1], clock)
    external.nodes, external.boards = tree.nodes, scopes_of(tree)
    tree.context.uses_time = True
    tree.context.recorded_pause = external.paused
    return tree


def add_callbacks(external: ExternalCode, steps: Iterable[Step], uids: Mapping[int, int]) -> None:
    """Let callbacks force the statuses that were forced in *steps*.

    Args:
        external: The external code, which has the callbacks.
        steps: The recorded steps.
        uids: The UIDs of the nodes by those in *steps*.
    """
    inputs = (event for step in steps for event in step.inputs)
    for uid in {event.uid for event in inputs if isinstance(event, StatusForced)} & uids.keys():
        node = external.nodes[uids[uid] - 1]
        node.set_pre_tick_function(external.pre_tick)
        node.set_post_tick_function(external.post_tick)


def _stand_in_class(recorded: RecordedClass, external: ExternalCode) -> type[TreeNode]:
    ports = [
        Port(name, Direction[direction], external.type(type_name), default)
        for name, direction, type_name, default in recorded.ports
    ]
    for port in ports:
        if default_value_error(port):
            port.default_value = None  # the default is a Python value, which is not recorded
    members: dict[str, Any] = {
        "tick": lambda node: external.tick(node),
        "halt": lambda node: external.halt(node),
        "provided_ports": staticmethod(lambda: ports),
        "spec": NodeSpec(node_type=NodeType[recorded.node_type], must_complete=recorded.must_complete),
        "__module__": __name__,
    }
    return type(recorded.id, (_BASES[recorded.kind],), members)
