"""The journal of a tree: in order, everything that its ticks depend on besides the tree and the blackboard.

These are the results, exceptions and writes of external nodes (not built in), times that built-in nodes read,
statuses that callbacks force, and writes of other threads. While a tree has a journal, built-in code runs
*inside*: no other thread can write to the blackboard then; external code runs outside.
"""

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Final, TypeVar

from mypy_extensions import i64

from btcore.blackboard.blackboard import Blackboard, WriteRecorder
from btcore.engine.node_config import NodeConfig
from btcore.engine.recorded_events import (
    ChildHalted,
    ChildTicked,
    Event,
    ExternalHaltBegan,
    ExternalHaltEnded,
    HaltBegan,
    MessageLogged,
    Paused,
    Raised,
    Removed,
    Replaced,
    ScriptRun,
    StatusForced,
    StatusSet,
    StepEnded,
    TickBegan,
    TimeRead,
    Written,
    recorded_entry,
    recorded_error,
)
from btcore.engine.transition_records import next_checksum
from btcore.status import FAILURE, IDLE, SKIPPED, SUCCESS, Status
from btcore.values import ValueType

NO_THREAD: Final = -1
_POLL_S: Final = 0.000_05
"""The time (s) between two looks of a thread whether the thread that ticks has gone outside."""
T = TypeVar("T")


class Journal(WriteRecorder):
    """Records what the ticks of a tree depend on, in a flat list of pairs.

    A pair is the config of an external node and the result of its tick, or None and an event.

    Args:
        boards: The scopes of the tree, in the order of their indices.
        encode: Returns the recorded form of a value, which may change later, of a key of a scope.
        deliver: Called with the pairs at the end of each tick and halt, on the thread that ticks.

    Attributes:
        checksum: A number of 32 bits that depends on the nodes and new statuses of all transitions.
    """

    def __init__(
        self,
        boards: Sequence[Blackboard],
        encode: Callable[[Blackboard, str, object], object],
        deliver: Callable[[list[object]], object],
    ) -> None:
        self.checksum: i64 = 0
        self._scopes = {id(board): index for index, board in enumerate(boards)}
        self._encode = encode
        self._deliver = deliver
        self._records: list[object] = []
        # The thread that ticks goes inside and outside with each external leaf. A lock would take most of the
        # time of a recorded leaf, so it takes none: it goes inside, then waits if a thread has announced a
        # write. A thread that writes announces it first, then waits until the thread that ticks is outside.
        self._inside: i64 = NO_THREAD  # the thread that ticks, while it is inside
        self._writer: i64 = NO_THREAD  # the thread that writes or waits to write; it holds the lock
        self._lock = threading.Lock()
        self._tick_thread: i64 = 0
        self._time = -1
        self._repeats = 0

    @property
    def is_inside(self) -> bool:
        """Whether the thread that ticks executes built-in code: not an external node, nor between ticks."""
        return self._inside == self._tick_thread

    @property
    def record_count(self) -> int:
        """The number of recorded values."""
        return len(self._records)

    # --- steps: ticks of the root, and halts of the whole tree

    def begin_tick(self, tick: int, time: int, woken_by: int) -> None:
        """Go inside for a tick of the root; see `TickBegan`."""
        self._begin(TickBegan(tick, time, woken_by), time)

    def begin_halt(self) -> None:
        """Go inside for a halt of the whole tree, unless it is a part of a tick."""
        if not self.is_inside:
            self._begin(HaltBegan(), -1)

    def _begin(self, event: TickBegan | HaltBegan, time: int) -> None:
        self._tick_thread = threading.get_ident()
        self.enter()
        self._time = time
        self._repeats = 0
        self.add(event)

    def end_step(self, status: Status) -> None:
        """End the tick or halt, unless it has ended, and deliver the records."""
        if not self.is_inside:
            return
        self.add(StepEnded(status))
        records = self._records
        self._records = []
        self.leave()
        self._deliver(records)

    def capture(self, capture: Callable[[], T]) -> T:
        """Return the result of *capture*, between two steps: what follows is recorded relative to it."""
        with self._lock:
            self._records = []
            return capture()

    # --- inside and outside

    def enter(self) -> None:
        """Go inside: until `leave`, no other thread can write to the blackboard."""
        self._inside = self._tick_thread
        if self._writer != NO_THREAD:
            self._wait_for_writers()

    def _wait_for_writers(self) -> None:
        while self._writer != NO_THREAD:
            self._inside = NO_THREAD
            with self._lock:
                pass
            self._inside = self._tick_thread

    def leave(self) -> None:
        """Go outside, because external code follows."""
        self._inside = NO_THREAD

    # --- recording

    def add(self, event: Event) -> None:
        """Record *event*."""
        self._records.append(None)
        self._records.append(event)

    def enter_with_result(self, config: NodeConfig, status: Status) -> None:
        """Go inside, because the tick of the external node with *config* returned *status*; record it."""
        self.enter()
        self._records.append(config)
        self._records.append(status)

    def enter_with_error(self, uid: int, error: BaseException) -> None:
        """Go inside, because the tick of the external node *uid* raised *error*; record it."""
        self.enter()
        self.add(Raised(uid, recorded_error(error)))

    def enter_child_tick(self, uid: int) -> None:
        """Go inside, because an external node ticks its child *uid*; record it."""
        self.enter()
        self.add(ChildTicked(uid))

    def enter_child_halt(self, uid: int) -> None:
        """Go inside, because an external node halts its child *uid*; record it."""
        self.enter()
        self.add(ChildHalted(uid))

    def add_transition(self, config: NodeConfig, status: Status) -> None:
        """Add a transition to the checksum. Record it if external code makes it."""
        self.checksum = next_checksum(self.checksum, config.uid, status)
        if self._inside == NO_THREAD:
            with self._lock:
                self.add(StatusSet(config.uid, status))

    def add_halt(self, uid: int, start: int, error: BaseException | None, is_idle: bool) -> None:
        """Record that an external node was halted, unless it has only become IDLE.

        Args:
            start: The `record_count` before the halt.
            error: What the halt raised, or None.
            is_idle: Whether the node is IDLE now.
        """
        records = self._records
        if error is None and is_idle:
            if len(records) == start:
                return
            event = records[-1] if len(records) == start + 2 else None
            if isinstance(event, StatusSet) and event.uid == uid and event.status is IDLE:
                del records[start:]
                return
        records[start:start] = [None, ExternalHaltBegan(uid)]
        self.add(ExternalHaltEnded(uid, None if error is None else recorded_error(error)))

    def call_back(self, uid: int, is_pre_tick: bool, callback: Callable[[], Status]) -> Status:
        """Call a callback of a node, return its result, and record it unless it forces and writes nothing."""
        start = self.record_count
        self.leave()
        try:
            forced = callback()
        finally:
            self.enter()
        forces = forced is SUCCESS or forced is FAILURE
        if forces or self.record_count > start:
            self.add(StatusForced(uid, is_pre_tick, forced if forces else SKIPPED))
        return forced

    def add_pause(self, uid: int, repetitions: int) -> None:
        """Record that a node pauses; see `Paused`."""
        self.add(Paused(uid, repetitions))

    def add_time(self, time: int) -> None:
        """Record that a built-in node has read *time* (ns). Of other nodes only the results are recorded."""
        if self._inside != self._tick_thread:
            return
        if time == self._time:
            self._repeats += 1
            return
        self.add(TimeRead(time, self._repeats))
        self._time = time
        self._repeats = 0

    def add_message(self, level: str, text: str) -> None:
        """Record that external code, on the thread that ticks, logs a message."""
        thread: i64 = threading.get_ident()
        if thread == self._tick_thread and not self._has_access(thread):
            with self._lock:
                self.add(MessageLogged(level, text))

    # --- writes

    def _has_access(self, thread: i64) -> bool:
        """Return whether *thread* is inside, or writes already."""
        return thread == self._inside or thread == self._writer

    def _begin_write(self, thread: i64) -> None:
        """Wait until *thread* may write: no other thread writes, and the thread that ticks is outside."""
        self._lock.acquire()
        self._writer = thread
        try:
            while self._inside != NO_THREAD:
                time.sleep(_POLL_S)
        except BaseException:  # a signal
            self._end_write()
            raise

    def _end_write(self) -> None:
        self._writer = NO_THREAD
        self._lock.release()

    def write(self, board: Blackboard, key: str, value: object, declared: ValueType | None) -> bool:
        """Write an entry, and record it. Return False, without effect, if called from inside."""
        thread: i64 = threading.get_ident()
        if self._has_access(thread):
            return False
        self._begin_write(thread)
        try:
            board.set(key, value, declared)
            entry = board.written_entry(key)
            value = self._encode(board, key, entry.value)
            if declared is None and isinstance(value, dict) and "__text" in value:
                declared = entry.declared  # the text does not have the type of the value
            self.add_written(board, key, value, declared)
        finally:
            self._end_write()
        return True

    def add_written(self, board: Blackboard, key: str, value: object, declared: ValueType | None) -> None:
        """Record that an entry was written, whose encoded value is *value*."""
        self.add(Written(self._scopes[id(board)], key, value, None if declared is None else declared.name))

    def remove(self, board: Blackboard, key: str) -> bool:
        """Remove an entry, and record it. Return False, without effect, if called from inside."""
        thread: i64 = threading.get_ident()
        if self._has_access(thread):
            return False
        self._begin_write(thread)
        try:
            if board.local_entries().pop(key, None) is not None:
                self.add(Removed(self._scopes[id(board)], key))
        finally:
            self._end_write()
        return True

    def add_entries(self, board: Blackboard) -> None:
        """Record all entries of a scope, which were replaced."""
        entries = {
            key: recorded_entry(entry, self._encode(board, key, entry.value))
            for key, entry in board.local_entries().items()
        }
        self._begin_write(threading.get_ident())
        try:
            self.add(Replaced(self._scopes[id(board)], entries))
        finally:
            self._end_write()

    def begin_script(self, board: Blackboard, text: str, enums: Mapping[str, int]) -> bool:
        """Go inside for a script that external code runs. Return False, without effect, if called inside."""
        thread: i64 = threading.get_ident()
        if self._has_access(thread):
            return False
        self._begin_write(thread)
        used = {name: number for name, number in enums.items() if name in text}
        self.add(ScriptRun(self._scopes[id(board)], text, used))
        return True

    def end_script(self) -> None:
        """Go outside after a script."""
        self._end_write()
