"""Records a running tree to a file."""

import logging
import os
import threading
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Final, Self

from btcore.logs.files import LogError, create, write_whole
from btcore.suggestions import suggestion
from btcore.tree.tree import Tree
from btcore_recorder.recorder import RawStep, Recorder
from btcore_recorder.text_form import EXTENSION, TextWriter

WRITE_INTERVAL_S: Final = 1.0
"""The time (s, wall clock) between two writes: what a process that is killed may lose."""
MAX_QUEUED_VALUES: Final = 10_000_000
"""Maximum number of recorded values that wait to be written; beyond it, the recording ends."""

_log = logging.getLogger("btcore")


class FileRecorder:
    """Records the ticks and halts of *tree* until it is closed. `record` creates it.

    A thread writes to the file, so that a slow disk does not slow down the tree. If writing fails, the
    recording ends with a warning of the logger `btcore`; the tree is not affected.

    Attributes:
        path: The file.
        is_incomplete: Whether the recording has ended early.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)
        if not self.path.name.endswith(EXTENSION):
            hint = suggestion(f"{self.path.name.split('.')[0] or 'run'}{EXTENSION}")
            raise LogError(f"{self.path}: the name of a recording must end in {EXTENSION}; {hint}")
        self.is_incomplete = False
        self._queue: SimpleQueue[RawStep | tuple[str, Any]] = SimpleQueue()
        self._queued_values = 0
        self._recorder = Recorder(tree, self._add_step, self._add_type)
        self._text: list[str] = []
        self._writer = TextWriter(self._text.append)
        self._writer.head(self._recorder.head, [node.path for node in tree.nodes])
        try:
            self._file = create(self.path, self._take_text())
        except BaseException:
            self._recorder.close()
            raise
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
        if self.is_incomplete:
            self._recorder.close()
            return
        self._queued_values += len(step.records)
        if self._queued_values > MAX_QUEUED_VALUES:
            self._give_up("the disk is too slow")
            return
        self._queue.put(step)

    def _add_type(self, name: str, description: Any) -> None:
        self._queue.put((name, description))

    # --- the thread that writes

    def _run(self) -> None:
        is_last = False
        while not is_last:
            is_last = self._closing.wait(WRITE_INTERVAL_S)
            try:
                self._write_queued()
            except OSError as error:
                self._give_up(error.strerror or str(error))
                return

    def _write_queued(self) -> None:
        while True:
            try:
                item = self._queue.get_nowait()
            except Empty:
                break
            if isinstance(item, RawStep):
                self._writer.step(self._recorder.step(item))
                self._queued_values -= len(item.records)
            else:
                self._writer.type(*item)
        if self._text:
            write_whole(self._file, self._take_text())

    def _take_text(self) -> bytes:
        data = "".join(self._text).encode("utf-8", "surrogatepass")
        self._text.clear()
        return data

    def _give_up(self, reason: str) -> None:
        self.is_incomplete = True
        _log.warning("the recording %s is incomplete, writing failed: %s", self.path, reason)


def record(tree: Tree, path: str | os.PathLike[str]) -> FileRecorder:
    """Record what the ticks of *tree* depend on to a file, so that `Replay` runs them again.

    Args:
        tree: The tree, before its first tick.
        path: The file, `….btrec.txt`; an existing file is overwritten.

    Returns:
        The recorder. Close it after the last tick, or use it as a context manager.

    Raises:
        BtcoreError: The tree was ticked already, or is being recorded, or is not from a document.
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
