"""Records a running tree: what its ticks depend on, and a checksum of the transitions that follow from it."""

import logging
import platform
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from fnmatch import fnmatchcase
from itertools import chain
from typing import Any, Final, NamedTuple
from uuid import uuid4
from weakref import WeakSet

import btcore
from btcore.blackboard.blackboard import Blackboard
from btcore.builds import active_build
from btcore.engine.control import ControlNode, DecoratorNode
from btcore.engine.journal import Journal
from btcore.engine.node import tick_wrapper
from btcore.engine.node_config import NodeConfig
from btcore.engine.observers import Observer
from btcore.engine.recorded_events import HaltBegan, StepEnded, TickBegan
from btcore.engine.transition_records import Transitions
from btcore.errors import BtcoreError, NodeExecutionError
from btcore.registry.manifest import Manifest
from btcore.status import FAILURE, IDLE, Status, Transition
from btcore.tree.tree import Tree, scopes_of, with_parents
from btcore_recorder.facts import collect_facts
from btcore_recorder.inputs import Head, RecordedClass, TreeState, is_external
from btcore_recorder.lines import WrittenLine, input_line, result_lines, transitions_line
from btcore_recorder.tree_state import capture
from btcore_recorder.values import EXCLUDED, MAX_TEXT, Encoder

_NAMES: Final = {status: status.name for status in Status}


class RawStep(NamedTuple):
    """What the journal recorded up to the end of a tick or halt.

    Attributes:
        records: The pairs of the journal.
        checksum: The checksum of all transitions.
        time: The time (ns) at which the tick began; of a halt, that of the last tick.
        transitions: The transitions, or None if they are not recorded.
    """

    records: list[object]
    checksum: int
    time: int
    transitions: list[list[Transition]] | None

    @property
    def is_halt(self) -> bool:
        """Whether the step is a halt that is not a part of a tick."""
        end = self.records[-1]
        # What other threads wrote before the step comes first.
        return (
            isinstance(end, StepEnded)
            and end.status is IDLE
            and any(type(event) is HaltBegan for event in self.records[1::2])
        )


class RecorderOptions(NamedTuple):
    """What a `Recorder` records.

    Attributes:
        exclude: Patterns of keys; the values of these entries are not recorded.
        keeps_transitions: Whether it records all transitions, besides their checksum.
        run: Identifies the run in all recordings of its trees; "" = a new run.
        gives_way: Whether another recorder of the tree ends the recording.
    """

    exclude: Sequence[str] = ()
    keeps_transitions: bool = False
    run: str = ""
    gives_way: bool = False


class _LogRecordFactory:
    """The factory of log records, while trees are recorded: the recorders record the messages.

    It is no handler: if the root logger has a handler, logging does not print warnings by itself, and
    `logging.basicConfig` has no effect.
    """

    def __init__(self) -> None:
        self.recorders: WeakSet[Recorder] = WeakSet()
        self._create = logging.getLogRecordFactory()

    def __call__(self, *args: Any, **arguments: Any) -> logging.LogRecord:
        record = self._create(*args, **arguments)
        for recorder in list(self.recorders):
            recorder.add_message(record)
        return record


def _log_record_factory() -> _LogRecordFactory:
    factory = logging.getLogRecordFactory()
    if not isinstance(factory, _LogRecordFactory):
        factory = _LogRecordFactory()
        logging.setLogRecordFactory(factory)
    return factory


class _TransitionList(Observer):
    """The transitions since the last call of `take`."""

    def __init__(self) -> None:
        self._found: list[list[Transition]] = []

    def transitions(self, changes: Transitions) -> None:
        self._found.append(changes.to_list())

    def take(self) -> list[list[Transition]]:
        found, self._found = self._found, []
        return found


class Recorder(Observer):
    """Records the ticks and halts of *tree* until it is closed.

    Args:
        tree: The tree, between two ticks.
        deliver: Called with each step, on the thread that ticks. `lines` converts it, on any thread.
        found: Called with the name and description of each user's type that is met later than in the head.
        options: What is recorded.

    Attributes:
        head: The head of the recording.
        has_failed: Whether the last tick ended in FAILURE, or raised an exception.

    Raises:
        BtcoreError: The tree is in a tick, is being recorded, or is not from a document, or the substitution
            rules of its registry have changed.
    """

    def __init__(
        self,
        tree: Tree,
        deliver: Callable[[RawStep], object],
        found: Callable[[str, Any], object],
        options: RecorderOptions,
    ) -> None:
        self._options = options
        if tree._is_in_tick:
            raise BtcoreError(f"tree '{tree.id}' is in a tick: begin to record it between two ticks")
        observers = tree.context.observers
        for other in () if observers is None else observers.observers:
            if isinstance(other, Recorder) and other._options.gives_way:
                other.close()
        if tree.context.journal is not None:
            raise BtcoreError(f"tree '{tree.id}' is being recorded already")
        self._tree = tree
        self._deliver = deliver
        self._transitions = _TransitionList() if options.keeps_transitions else None
        types: dict[str, Any] = {}
        self._encoder = Encoder(types.__setitem__)
        self._boards = scopes_of(tree)
        self.has_failed = False
        self._time = tree.clock.now()
        self._records: list[object] | None = None
        if not tree.documents:
            raise BtcoreError(f"tree '{tree.id}' is not from a document: it cannot be recorded")
        added = [self] if self._transitions is None else [self, self._transitions]
        self._unsubscribe = [tree.subscribe(observer) for observer in added]
        observers = tree.context.observers
        assert observers is not None
        self._observers = observers
        self._journal = Journal(self._boards, self._encode, self._end_step)
        self._result_lines: dict[NodeConfig, list[tuple[str, int, str]]] = {}
        for node in tree.nodes:
            if is_external(type(node)):
                self._result_lines[node.config] = result_lines(node.uid)
                wrapper = tick_wrapper(node)
                wrapper.is_external = True
                for each in (wrapper, *map(tick_wrapper, node.children)):
                    each.journal = self._journal
        for board in self._boards:
            board.recorder = self._journal
        tree.context.uses_time = True  # each tick has a time
        tree.context.woken_by = 0
        observers.journal = self._journal
        self.head = self._create_head(types)
        self._encoder.found = found
        self._log_records = _log_record_factory()
        self._log_records.recorders.add(self)

    def close(self) -> None:
        """End the recording. Call it while no tick is in progress."""
        if self._observers.journal is not self._journal:
            return
        self._observers.journal = None
        self._log_records.recorders.discard(self)
        for board in self._boards:
            board.recorder = None
        for node in self._tree.nodes:
            if node._wrapper is not None:
                node._wrapper.journal = None
        for unsubscribe in self._unsubscribe:
            unsubscribe()

    def capture(self) -> TreeState:
        """Return the state of the tree, between two steps. A new segment begins, with a new checksum."""
        self._journal.checksum = 0
        state = self._journal.capture(lambda: capture(self._tree, self._boards, self._encoder.encode))
        excluded = {index for keys in state.scopes for key, index in keys.items() if self._is_excluded(key)}
        entries = [
            entry._replace(value=EXCLUDED) if index in excluded else entry
            for index, entry in enumerate(state.entries)
        ]
        return state._replace(entries=tuple(entries))

    def _encode(self, board: Blackboard, key: str, value: object) -> object:
        excludes = self._options.exclude and self._is_excluded(key, board)
        return EXCLUDED if excludes else self._encoder.encode(value)

    def _is_excluded(self, key: str, board: Blackboard | None = None) -> bool:
        """Return whether the entry of a key is excluded, by the key or by a key that *board* remaps it to."""
        while not any(fnmatchcase(key.removeprefix("@"), pattern) for pattern in self._options.exclude):
            if board is None:
                return False
            key, board = board.remappings().get(key, key).strip("{}"), board.parent
        return True

    @property
    def value_count(self) -> int:
        """The number of values that were encoded so far."""
        return self._encoder.count

    # --- the head

    def _create_head(self, types: Mapping[str, Any]) -> Head:
        """Return the head. Encoding the entries adds to *types*."""
        tree = self._tree
        texts = [text for _, text, _ in tree.documents]
        # Also those of trees that are not used: a document with an unknown node cannot be loaded.
        manifests = [
            manifest
            for manifest in tree.registry.manifests_of(tree.format).values()
            if is_external(manifest.cls) and any(manifest.id in text for text in texts)
        ]
        return Head(
            tree.id,
            tree.format,
            tree.documents,
            dict(tree.registry.types.enums),
            types,
            tuple(map(_describe, manifests)),
            self._find_replaced(),
            tuple((board.autoremap, dict(board.remappings())) for board in with_parents(tree.blackboard)),
            self.capture(),
            tree.clock.now(),
            time.time_ns(),
            {"btcore": btcore.__version__, "build": active_build(), "python": platform.python_version()},
            collect_facts(self._options.run or uuid4().hex, tree.documents, manifests),
            tuple(node.path for node in tree.nodes),
        )

    def _find_replaced(self) -> dict[int, RecordedClass]:
        """Return the classes of the nodes that substitution rules have replaced, by UID."""
        tree, registry = self._tree, self._tree.registry
        replaced = {}
        for node in tree.nodes if registry.substitutions else ():
            manifest = registry.get(node.config.id, tree.format)
            by = None if manifest is None else registry.apply_substitutions(node.config, manifest, 1)
            if by is None or by.cls is not type(node):
                raise BtcoreError(f"the substitution rule of '{node.path}' has changed: load the tree again")
            if by is not manifest:
                replaced[node.config.uid] = _describe(by)
        return replaced

    # --- steps

    def add_message(self, record: logging.LogRecord) -> None:
        """Record a message that external code logs."""
        with suppress(Exception):  # the message does not fit its arguments, which logging reports
            self._journal.add_message(record.levelname, record.getMessage()[:MAX_TEXT])

    def ticked(self, tick: int, stamp: int, duration_ns: int, status: Status) -> None:
        """Deliver the step, now that its transitions are known."""
        self.has_failed = status is FAILURE
        self._time = self._tree.context.tick_start
        if self._records is not None:
            records, self._records = self._records, None
            self._deliver(self._raw_step(records))

    def raised(self, error: NodeExecutionError, stamp: int) -> None:
        """Note that the tick, or a halt, has failed."""
        self.has_failed = True

    def _end_step(self, records: list[object]) -> None:
        end = records[-1]
        assert isinstance(end, StepEnded)
        # After an exception and in a halt, the transitions are known already.
        if end.status is IDLE:
            self._deliver(self._raw_step(records))
        else:
            self._records = records

    def _raw_step(self, records: list[object]) -> RawStep:
        transitions = None if self._transitions is None else self._transitions.take()
        return RawStep(records, self._journal.checksum, self._time, transitions)

    def lines(self, raw: RawStep) -> list[WrittenLine]:
        """Return the lines of a step, which do not depend on the tree. Thread-safe."""
        lines: list[WrittenLine] = []
        results: list[tuple[str, int, str]] = []
        values: Iterator[Any] = iter(raw.records)
        for config, event in zip(values, values, strict=True):
            if config is not None:
                results.append(self._result_lines[config][event])
                continue
            if results:
                lines.append(tuple(results))
                results = []
            if isinstance(event, TickBegan):
                lines.append(["tick", *event])
            elif isinstance(event, HaltBegan):
                lines.append(["halt"])
            elif isinstance(event, StepEnded):
                if raw.transitions is not None:
                    changes = chain.from_iterable(raw.transitions)
                    lines.append(transitions_line((change.uid, change.status) for change in changes))
                lines.append(["end", _NAMES[event.status], raw.checksum])
            else:
                lines.append(input_line(event))
        return lines


def _describe(manifest: Manifest) -> RecordedClass:
    cls, kind = manifest.cls, "leaf"
    if not is_external(cls):
        kind = "built-in"
    elif issubclass(cls, DecoratorNode):
        kind = "decorator"
    elif issubclass(cls, ControlNode):
        kind = "control"
    ports = [
        (port.name, port.direction.name, port.type.name, port.default) for port in manifest.ports.values()
    ]
    return RecordedClass(manifest.id, kind, manifest.type.name, cls.spec.must_complete, tuple(ports))
