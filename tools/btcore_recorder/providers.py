"""The provider of `btcore run --record`: it records what the ticks of a run's tree depend on."""

import logging
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal
from uuid import uuid4

from btcore.errors import BtcoreError, OutputError
from btcore.options import option
from btcore.output_files import numbered_file
from btcore.runs.providers import provider
from btcore.runs.report import Report
from btcore.runs.settings import Settings
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    from btcore_recorder.file_recorder import FileRecorder, KeptSteps, RingRecorder

_FAILED_ENDS: Final = ("raised", "interrupted", "program_error")
MAX_FILE_SIZE: Final = 50.0
"""The size (MB) after which a recording in a folder continues in a new file, unless it is given."""

_log = logging.getLogger("btcore")


class RecordingSettings(Settings):
    """The recording of a run."""

    record: Annotated[
        Path,
        option(
            "Record to FILE (….btrec.txt or ….mcap) what the ticks depend on: results and outputs of leaves, "
            "times, writes. btcore replay runs such a recording again. In a folder, each tree gets a file, "
            "and the oldest files beyond 500 MB are removed.",
            metavar="FILE|FOLDER",
            one_run_only=True,
            may_be_folder=True,
        ),
    ]
    record_on: Annotated[
        Literal["always", "failure", "never"],
        option(
            "Write the recording always; or only if the run fails, by a result or an exception, or is "
            "interrupted: then its last 10 minutes (at most 50 MB), which are kept in memory; or never.",
            one_run_only=True,
        ),
    ] = "always"
    record_max_size: (
        Annotated[
            float,
            option(
                "Continue the recording in a new file, such as run.2.btrec.txt, beyond MB megabytes.",
                metavar="MB",
                gt=0,
                one_run_only=True,
            ),
        ]
        | None
    ) = None
    record_max_time: (
        Annotated[
            float,
            option(
                "Continue the recording in a new file after S seconds of the tree's clock.",
                metavar="S",
                gt=0,
                one_run_only=True,
            ),
        ]
        | None
    ) = None
    record_transitions: Annotated[
        bool,
        option(
            "Record all transitions, too, so that a difference of a replay is located to the transition.",
            one_run_only=True,
        ),
    ] = False
    record_exclude: Annotated[
        tuple[str, ...],
        option(
            "Do not record the values of entries whose key matches, such as 'password*'. Repeatable.",
            metavar="PATTERN",
            one_run_only=True,
        ),
    ] = ()


class TreeRecordings:
    """The recordings of a tree, and of those that replace it."""

    def __init__(self, settings: RecordingSettings, report: Report) -> None:
        from btcore_recorder.files import RecordingFiles

        self._settings = settings
        self._run = uuid4().hex  # the same for all trees of the run
        self._report = report
        self._files = files = RecordingFiles(settings.record, max_duration_s=settings.record_max_time)
        max_size = settings.record_max_size or (MAX_FILE_SIZE if files.is_folder else None)
        files.max_bytes = max_size and max_size * 1e6
        self._file_recorder: FileRecorder | None = None
        self._ring: RingRecorder | None = None
        self._tree: Tree | None = None
        self._is_over = False  # whether the program has halted the tree before the end of the run
        self._write_lock = threading.Lock()
        self._writers: list[threading.Thread] = []
        self.incomplete: list[Path] = []

    def open(self, tree: Tree) -> None:
        """Begin to record *tree*.

        Raises:
            BtcoreError: The tree cannot be recorded, or the file cannot be written.
        """
        from btcore_recorder.file_recorder import FileRecorder, RingRecorder
        from btcore_recorder.recorder import RecorderOptions

        self._tree = tree
        settings, files = self._settings, self._files
        options = RecorderOptions(settings.record_exclude, settings.record_transitions, self._run)
        if settings.record_on == "always":
            self._file_recorder = FileRecorder(tree, files, options)
        else:
            self._ring = RingRecorder(tree, files.next(tree.id), options, self._note_halt)

    def replace_tree(self, tree: Tree) -> None:
        """End the recording, and record *tree* to a file with the next number in its name.

        A tree that cannot be recorded gets a warning, so that the run continues.
        """
        try:
            self.close()
            self.open(tree)
        except BtcoreError as error:
            self._note_error(error, numbered_file(self._settings.record, self._files.count))

    def close(self) -> None:
        """End the recording. The end of a failed run is written now."""
        recorder, self._file_recorder = self._file_recorder, None
        if recorder is not None:
            recorder.close()
            if recorder.is_incomplete:
                self.incomplete.append(recorder.path)
        ring, self._ring = self._ring, None
        if ring is not None:
            ring.close()
            is_end = self._report.end_reason in _FAILED_ENDS and not (self._is_over and ring.is_halted)
            if ring.has_failed or is_end:
                self._write(ring.take(), "", ring.path)

    def wait(self) -> None:
        """Wait until the recordings are written that threads write."""
        for writer in self._writers:
            writer.join()

    def _note_halt(self) -> None:
        """Write the recording of a tree that a server has halted at its end, if it failed.

        The server continues, so that a thread writes the file.
        """
        ring, tree = self._ring, self._tree
        assert tree is not None
        is_interrupted = tree.context.limit.is_interrupted
        self._is_over = self._report.end_reason is None and not is_interrupted
        if self._files.is_folder and ring is not None and (ring.has_failed or is_interrupted):
            writer = threading.Thread(target=self._write, args=(ring.take(), tree.id), daemon=True)
            self._writers = [*(other for other in self._writers if other.is_alive()), writer]
            writer.start()

    def _write(self, kept: "KeptSteps", tree_id: str, file: Path | None = None) -> None:
        try:
            with self._write_lock:  # one file after the other: a folder has a maximum size
                file = file or self._files.next(tree_id)
                kept.write(file)
        except BtcoreError as error:
            self._note_error(error, file)
        else:
            _log.warning("the end of the run is recorded in %s", file)

    def _note_error(self, error: BtcoreError, file: Path | None) -> None:
        _log.warning("%s", error)
        if file is not None and not self._files.is_folder:
            self.incomplete.append(file)


@provider
def recorder(settings: RecordingSettings, tree: Tree, report: Report) -> Iterator[object]:
    """Record the tree to a file. A program without a tree is not recorded, but the trees that replace it are.

    Raises:
        BtcoreError: The tree cannot be recorded, or the file cannot be written.
        OutputError: At the end: steps are missing in the recording.
    """
    if settings.record_on == "never":
        yield None
        return
    recordings = TreeRecordings(settings, report)
    if tree.documents:
        recordings.open(tree)
    try:
        yield recordings
    finally:
        recordings.close()
        recordings.wait()
        if recordings.incomplete:
            names = ", ".join(map(str, recordings.incomplete))
            raise OutputError(f"recordings are incomplete: {names}")
