"""Records a running tree to a file: all of it, or, if the run fails, its end."""

import logging
import os
import threading
from collections import deque
from contextlib import suppress
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, NamedTuple, Self

from btcore.clock import NS_PER_S
from btcore.logs.files import LogError, create, ensure_writable, write_whole
from btcore.output_files import write_file
from btcore.status import Status
from btcore.suggestions import suggestion
from btcore.tree.tree import Tree
from btcore_recorder.inputs import TreeState
from btcore_recorder.recorder import RawStep, Recorder
from btcore_recorder.text_form import EXTENSION, TextWriter

WRITE_INTERVAL_S: Final = 1.0
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


def _check_name(path: Path) -> None:
    if not path.name.endswith(EXTENSION):
        hint = suggestion(f"{path.name.split('.')[0] or 'run'}{EXTENSION}")
        raise LogError(f"{path}: the name of a recording must end in {EXTENSION}; {hint}")


class _TypeFound(NamedTuple):
    name: str
    description: Any


class _SegmentBegun(NamedTuple):
    """A new segment: why steps are missing before it, or "", and the state in which it begins."""

    gap: str
    state: TreeState


class FileRecorder:
    """Records the ticks and halts of *tree* until it is closed. `record` creates it.

    A thread converts and writes them, so that a slow disk does not slow down the tree. If the disk is full or
    too slow, steps are lost, with a warning of the logger `btcore`; the recording continues after this gap.

    Attributes:
        path: The file.
        is_incomplete: Whether steps are missing.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        _check_name(self.path)
        self.is_incomplete = False
        self._tree = tree
        self._queue: SimpleQueue[RawStep | _TypeFound | _SegmentBegun] = SimpleQueue()
        self._added_values = 0
        self._taken_values = 0
        self._loss = ""  # why steps are being lost
        self._recorder = Recorder(tree, self._add_step, self._add_type)
        self._types: list[_TypeFound] = []
        self._text: list[str] = []
        self._writer = TextWriter(self._text.append)
        self._writer.head(self._recorder.head, [node.path for node in tree.nodes])
        self._segment_time = self._recorder.head.time
        head = self._take_text()
        try:
            self._file = create(self.path, head)
        except BaseException:
            self._recorder.close()
            raise
        self._written = len(head), self._writer.crc  # what is complete in the file
        self._is_broken = False  # whether writing has failed, and no segment has followed
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="btcore recorder", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Write the rest, and close the file. Call it while no tick is in progress."""
        self._recorder.close()
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # --- the thread that ticks

    def _add_step(self, step: RawStep) -> None:
        queued = self._added_values - self._taken_values
        if not self._loss and queued + len(step.records) > MAX_QUEUED_VALUES:
            self._lose("the disk is too slow")
        if not self._loss:
            self._added_values += len(step.records)
            self._queue.put(step)
            now = self._tree.context.tick_start
            if now - self._segment_time > SEGMENT_DURATION_S * NS_PER_S:
                self._begin_segment("")
                self._segment_time = now
        elif not queued:  # try again, from the end of this step on
            loss, self._loss = self._loss, ""
            self._begin_segment(loss)

    def _begin_segment(self, gap: str) -> None:
        self._queue.put(_SegmentBegun(gap, self._recorder.capture()))

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
        values = 0
        while True:
            try:
                item = self._queue.get_nowait()
            except Empty:
                break
            if isinstance(item, RawStep):
                values += len(item.records)
                self._writer.step(self._recorder.step(item))
            elif isinstance(item, _TypeFound):
                self._types.append(item)
                self._writer.type(*item)
            else:
                self._write_segment(item)
        self._write_text()
        self._taken_values += values

    def _write_segment(self, item: _SegmentBegun) -> None:
        if self._is_broken:
            self._text.clear()
            self._writer.crc = self._written[1]
            self._is_broken = False
        self._writer.segment(*item)
        if item.gap:
            for found in self._types:  # their lines may be among what is missing
                self._writer.type(*found)

    def _write_text(self) -> None:
        data = self._take_text()
        if not data or self._is_broken:
            return
        try:
            write_whole(self._file, data)
            self._written = self._written[0] + len(data), self._writer.crc
        except OSError as error:
            self._is_broken = True
            self._lose(f"writing failed: {error.strerror or error}")
            with suppress(OSError):
                self._file.truncate(self._written[0])
                self._file.seek(self._written[0])

    def _take_text(self) -> bytes:
        data = "".join(self._text).encode("utf-8", "surrogatepass")
        self._text.clear()
        return data


class _Segment:
    """A part of a recording in memory, which begins with a state of the tree."""

    def __init__(self, state: TreeState, time: int) -> None:
        self.state = state
        self.time = time
        self.size = 0
        self.steps: list[RawStep] = []


class RingRecorder:
    """Keeps the last ticks and halts of *tree* in memory: of `RING_DURATION_S`, and at most `RING_BYTES`.

    Args:
        tree: The tree, between two ticks.
        path: The file to which `save` writes, `….btrec.txt`.

    Raises:
        BtcoreError: The tree is in a tick, is being recorded, or is not from a document.
        LogError: The file cannot be written, or its name has another extension.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        _check_name(self.path)
        is_new = not self.path.exists()
        ensure_writable(self.path)
        if is_new:
            self.path.unlink()
        self._tree = tree
        self._types: dict[str, Any] = {}
        self._recorder = Recorder(tree, self._add_step, self._types.__setitem__)
        head = self._recorder.head
        self._time = head.time
        self._value_count = 0
        self._segments = deque([_Segment(head.state, head.time)])

    @property
    def last_result(self) -> Status:
        """The result of the last tick that raised no exception."""
        return self._recorder.last_result

    def close(self) -> None:
        """End the recording. Call it while no tick is in progress."""
        self._recorder.close()

    def save(self) -> None:
        """End the recording, and write what is kept.

        Raises:
            LogError: The file cannot be written.
        """
        self.close()
        parts: list[str] = []
        writer = TextWriter(parts.append)
        head = self._recorder.head
        head = head._replace(state=self._segments[0].state, types={**head.types, **self._types})
        writer.head(head, [node.path for node in self._tree.nodes])
        for segment in self._segments:
            if segment is not self._segments[0]:
                writer.segment("", segment.state)
            for step in segment.steps:
                writer.step(self._recorder.step(step))
        try:
            write_file(self.path, "".join(parts).encode("utf-8", "surrogatepass"))
        except OSError as error:
            raise LogError(f"{self.path}: cannot write the recording: {error.strerror or error}") from None

    def _add_step(self, step: RawStep) -> None:
        segments, last = self._segments, self._segments[-1]
        last.steps.append(step)
        count = self._recorder.value_count
        last.size += _BYTES_OF_RECORD * len(step.records) + _BYTES_OF_VALUE * (count - self._value_count)
        self._value_count = count
        self._time = max(self._time, self._tree.context.tick_start)
        if (
            last.size > RING_BYTES / _RING_SEGMENTS
            or self._time - last.time > RING_DURATION_S * NS_PER_S / _RING_SEGMENTS
        ):
            segments.append(_Segment(self._recorder.capture(), self._time))
            while len(segments) > 2 and (
                sum(segment.size for segment in segments) > RING_BYTES
                or self._time - segments[1].time > RING_DURATION_S * NS_PER_S
            ):
                segments.popleft()


def record(tree: Tree, path: str | os.PathLike[str]) -> FileRecorder:
    """Record what the ticks of *tree* depend on to a file, so that `Replay` runs them again.

    Args:
        tree: The tree, between two ticks.
        path: The file, `….btrec.txt`; an existing file is overwritten.

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
    return FileRecorder(tree, path)
