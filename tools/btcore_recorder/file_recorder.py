"""Records a running tree to a file: all of it, or, if the run fails, its end."""

import logging
import os
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, NamedTuple, Self

from btcore.clock import NS_PER_S
from btcore.logs.files import LogError, create, ensure_writable, write_whole
from btcore.output_files import write_file
from btcore.tree.tree import Tree
from btcore_recorder.files import RecordingFiles, encoder_for
from btcore_recorder.inputs import Head, TreeState
from btcore_recorder.lines import WrittenLine, head_lines, segment_lines
from btcore_recorder.recorder import RawStep, Recorder, RecorderOptions

WRITE_INTERVAL_S: Final = 0.5
"""The time (s, wall clock) between two writes: what a process that is killed may lose."""
SEGMENT_DURATION_S: Final = 60.0
"""The time (s of the tree's clock) after which a new segment begins, with the state of the tree."""
MAX_QUEUED_VALUES: Final = 2_000_000
"""Maximum number of recorded values that wait to be written; beyond it, steps are lost."""
RING_DURATION_S: Final = 600.0
"""The time (s of the tree's clock) before the end of a run that a `RingRecorder` keeps."""
RING_BYTES: Final = 50_000_000
"""Maximum memory, approximately, of what a `RingRecorder` keeps."""
_RING_SEGMENTS: Final = 10
_BYTES_OF_RECORD: Final = 16
_BYTES_OF_VALUE: Final = 100

_log = logging.getLogger("btcore")


class _TypeFound(NamedTuple):
    name: str
    description: Any


class _SegmentBegun(NamedTuple):
    """A new segment.

    Attributes:
        gap: Why steps are missing before it, or "".
        state: The state in which it begins.
        time: The time (ns) of the tree's clock.
        begins_file: Whether it is the first of a new file.
    """

    gap: str
    state: TreeState
    time: int
    begins_file: bool


class FileRecorder:
    """Records the ticks and halts of a tree until it is closed.

    A thread converts and writes them, so that a slow disk does not slow down the tree. If the disk is full or
    too slow, steps are lost, with a warning of the logger `btcore`; the recording continues after this gap.

    Args:
        tree: As in `record`, which creates the recorder.
        files: The files.
        options: What is recorded.

    Attributes:
        path: The file, or the last of several.
        is_incomplete: Whether steps are missing.
    """

    def __init__(self, tree: Tree, files: RecordingFiles, options: RecorderOptions) -> None:
        self._files = files
        self.path = files.next(tree.id)
        self._encoder = encoder_for(self.path)
        self.is_incomplete = False
        self._queue: SimpleQueue[RawStep | _TypeFound | _SegmentBegun] = SimpleQueue()
        self._added_values = 0
        self._encoded_values = 0
        self._written_values = 0
        self._is_rotating = False  # whether the first segment of another file is in the queue
        self._loss = ""  # why steps are being lost
        self._recorder = Recorder(tree, self._add_step, self._add_type, options)
        self._types: dict[str, Any] = {}  # found since the last step
        self._head = head = self._recorder.head
        self._segment_time = self._file_time = head.time
        self._encoder.add(head_lines(head), head.wall_time)
        data = self._encoder.take()
        try:
            self._file = create(self.path, data)
        except BaseException:
            self._recorder.close()
            raise
        self._size = len(data)  # of what is complete in the file
        self._unwritten = b""
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="btcore recorder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write the rest, and close the file. Call it while no tick is in progress."""
        self._recorder.close()
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            self._write(self._encoder.take_end())
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- the thread that ticks

    def _add_step(self, step: RawStep) -> None:
        queued = self._added_values - self._written_values
        if not self._loss and queued + len(step.records) > MAX_QUEUED_VALUES:
            self._lose("the disk is too slow")
        if not self._loss:
            self._added_values += len(step.records)
            self._queue.put(step)
            is_full = self._is_full(step.time)
            if is_full or step.time - self._segment_time > SEGMENT_DURATION_S * NS_PER_S:
                self._begin_segment("", step.time, is_full)
        elif not queued:  # try again, from the end of this step on
            loss, self._loss = self._loss, ""
            self._begin_segment(loss, step.time)

    def _is_full(self, time: int) -> bool:
        files, duration_s = self._files, (time - self._file_time) / NS_PER_S
        is_long = files.max_duration_s is not None and duration_s >= files.max_duration_s
        is_large = files.max_bytes is not None and self._size >= files.max_bytes
        return (is_long or is_large) and not self._is_rotating

    def _begin_segment(self, gap: str, time: int, begins_file: bool = False) -> None:
        self._queue.put(_SegmentBegun(gap, self._recorder.capture(), time, begins_file))
        self._segment_time = time
        if begins_file:
            self._file_time, self._is_rotating = time, True

    def _add_type(self, name: str, description: Any) -> None:
        self._queue.put(_TypeFound(name, description))

    def _lose(self, reason: str) -> None:
        """Lose the steps that follow, until what is queued was written."""
        self._loss = reason
        if not self.is_incomplete:
            self.is_incomplete = True
            _log.warning("the recording %s is incomplete: %s", self.path, reason)

    # --- the thread that writes

    def _run(self) -> None:
        is_last = False
        while not is_last:
            is_last = self._closing.wait(WRITE_INTERVAL_S)
            self._write_queued()

    def _write_queued(self) -> None:
        while True:
            try:
                item = self._queue.get_nowait()
            except Empty:
                break
            if isinstance(item, RawStep):
                self._encoded_values += len(item.records)
                types: list[WrittenLine] = [["type", *found] for found in self._types.items()]
                self._encoder.add(types + self._recorder.lines(item), self._head.wall_time_at(item.time))
                self._types.clear()
            elif isinstance(item, _TypeFound):
                self._types[item.name] = item.description
                self._head = self._head._replace(types={**self._head.types, item.name: item.description})
            elif not (item.begins_file and self._begin_file(item)):
                self._encoder.add(segment_lines(item.gap, item.state), self._head.wall_time_at(item.time))
        if self._write(self._encoder.take()):
            self._written_values = self._encoded_values

    def _begin_file(self, segment: _SegmentBegun) -> bool:
        """Continue in a new file; return False if the present file has to be continued."""
        self._is_rotating = False
        if not self._write(self._encoder.take()):
            return False
        self._head = self._head._replace(state=segment.state)
        try:
            path = self._files.next(self._head.tree_id)
            encoder = encoder_for(path)
            encoder.add(head_lines(self._head), self._head.wall_time_at(segment.time))
            data = encoder.take()
            file = create(path, data)
        except LogError as error:
            _log.warning("%s", error)
            return False
        self._write(self._encoder.take_end())
        self._file.close()
        self.path, self._encoder, self._file = path, encoder, file
        self._size, self._unwritten = len(data), b""
        self._types.clear()
        return True

    def _write(self, data: bytes) -> bool:
        """Write *data*, and what could not be written before; return whether it was possible."""
        self._unwritten += data
        try:
            write_whole(self._file, self._unwritten)
            os.fsync(self._file.fileno())  # a power failure must not lose more than a killed process
        except OSError as error:
            self._lose(f"writing failed: {error.strerror or error}")
            with suppress(OSError):
                self._file.truncate(self._size)
                self._file.seek(self._size)
            return False
        self._size += len(self._unwritten)
        self._unwritten = b""
        return True


class _Segment:
    """A part of a recording in memory, which begins with a state of the tree."""

    def __init__(self, state: TreeState, time: int) -> None:
        self.state = state
        self.time = time
        self.size = 0
        self.steps: list[RawStep] = []


class KeptSteps(NamedTuple):
    """What a `RingRecorder` has kept. Any thread may write it, also while the tree is ticked."""

    head: Head
    segments: Sequence[_Segment]
    lines: Callable[[RawStep], list[WrittenLine]]

    def write(self, path: Path) -> None:
        """Write a recording.

        Raises:
            LogError: The file cannot be written.
        """
        encoder, head, first = encoder_for(path), self.head, self.segments[0]
        encoder.add(head_lines(head._replace(state=first.state)), head.wall_time)
        for segment in self.segments:
            if segment is not first:
                encoder.add(segment_lines("", segment.state), head.wall_time_at(segment.time))
            for step in segment.steps:
                encoder.add(self.lines(step), head.wall_time_at(step.time))
        try:
            write_file(path, encoder.take_end())
        except OSError as error:
            raise LogError(f"{path}: cannot write the recording: {error.strerror or error}") from None


class RingRecorder:
    """Keeps the last ticks and halts of *tree* in memory: of `RING_DURATION_S`, and at most `RING_BYTES`.

    Args:
        tree: The tree, between two ticks.
        path: The file to which `save` writes, `….btrec.txt` or `….mcap`.
        options: What is recorded.
        on_halt: Called after each halt of the whole tree that is not a part of a tick.

    Attributes:
        path: The file.
        is_halted: Whether the last step was such a halt.

    Raises:
        BtcoreError: The tree is in a tick, is being recorded, or is not from a document.
        LogError: The file cannot be written, or its name has another extension.
    """

    def __init__(
        self,
        tree: Tree,
        path: str | os.PathLike[str],
        options: RecorderOptions,
        on_halt: Callable[[], object] = lambda: None,
    ) -> None:
        self.path = Path(path)
        encoder_for(self.path)  # checks the name
        is_new = not self.path.exists()
        ensure_writable(self.path)
        if is_new:
            self.path.unlink()
        self.is_halted = False
        self._on_halt = on_halt
        self._types: dict[str, Any] = {}
        self._recorder = Recorder(tree, self._add_step, self._types.__setitem__, options)
        head = self._recorder.head
        self._value_count = 0
        self._segments = deque([_Segment(head.state, head.time)])

    @property
    def has_failed(self) -> bool:
        """Whether the last tick ended in FAILURE or raised an exception, and is kept here."""
        return self._recorder.has_failed and self.has_steps

    @property
    def has_steps(self) -> bool:
        """Whether a tick or halt is kept."""
        return any(segment.steps for segment in self._segments)

    def close(self) -> None:
        """End the recording. Call it while no tick is in progress."""
        self._recorder.close()

    def save(self) -> None:
        """End the recording, and write what is kept.

        Raises:
            LogError: The file cannot be written.
        """
        self.close()
        self._kept_steps().write(self.path)

    def take(self) -> KeptSteps:
        """Return what is kept, and begin again with the present state. Call it between two ticks."""
        kept = self._kept_steps()
        self._segments = deque([_Segment(self._recorder.capture(), self._segments[-1].time)])
        return kept

    def _kept_steps(self) -> KeptSteps:
        head = self._recorder.head
        head = head._replace(types={**head.types, **self._types})
        return KeptSteps(head, self._segments, self._recorder.lines)

    def _add_step(self, step: RawStep) -> None:
        segments, last = self._segments, self._segments[-1]
        last.steps.append(step)
        count = self._recorder.value_count
        last.size += _BYTES_OF_RECORD * len(step.records) + _BYTES_OF_VALUE * (count - self._value_count)
        self._value_count = count
        if (
            last.size > RING_BYTES / _RING_SEGMENTS
            or step.time - last.time > RING_DURATION_S * NS_PER_S / _RING_SEGMENTS
        ):
            segments.append(_Segment(self._recorder.capture(), step.time))
            while len(segments) > 2 and (
                sum(segment.size for segment in segments) > RING_BYTES
                or step.time - segments[1].time > RING_DURATION_S * NS_PER_S
            ):
                segments.popleft()
        self.is_halted = step.is_halt
        if step.is_halt:
            self._on_halt()


def record(
    tree: Tree,
    path: str | os.PathLike[str],
    exclude: Sequence[str] = (),
    *,
    max_bytes: float | None = None,
    max_duration_s: float | None = None,
    keeps_transitions: bool = False,
) -> FileRecorder:
    """Record what the ticks of *tree* depend on to a file, so that `Replay` runs them again.

    Args:
        tree: The tree, between two ticks.
        path: The file, `….btrec.txt` or `….mcap`; an existing file is overwritten. Or a folder, in which each
            recording gets a name.
        exclude: Patterns of keys, such as `password*`; the values of these entries are not recorded.
        max_bytes: The size after which another file begins, `run.2.btrec.txt`; None = any.
        max_duration_s: The time (s of the tree's clock) after which another file begins; None = any.
        keeps_transitions: Whether to record all transitions, not only their checksum, so that a difference of
            a replay is located to the transition.

    Returns:
        The recorder. Close it after the last tick, or use it as a context manager.

    Raises:
        BtcoreError: The tree is in a tick, is being recorded, or is not from a document.
        LogError: The file cannot be written, or its name has another extension.

    Examples:
        >>> import btcore
        >>> from btcore_recorder import Replay, record
        >>> @btcore.action
        ... def measure(distance: btcore.Put[float]):
        ...     distance(1.5)
        ...     return True
        >>> nodes = btcore.Registry.standard()
        >>> nodes.add(measure)
        >>> b = btcore.Builder(nodes)
        >>> tree = b.build(b.Sequence(b.Measure(distance="{d}"), b.Script(code="near := d < 2")))
        >>> with record(tree, "run.btrec.txt"):
        ...     tree.tick_once()
        <Status.SUCCESS: 2>
        >>> replay = Replay("run.btrec.txt")
        >>> replay.verify(), replay.tree.blackboard["near"]
        (None, 1.0)
    """
    files = RecordingFiles(Path(path), max_bytes, max_duration_s)
    return FileRecorder(tree, files, RecorderOptions(exclude, keeps_transitions))
