"""The provider of `btcore run --record`: it records what the ticks of a run's tree depend on."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

from btcore.errors import BtcoreError, OutputError
from btcore.options import option
from btcore.output_files import numbered_file
from btcore.runs.providers import provider
from btcore.runs.report import Report
from btcore.runs.settings import Settings
from btcore.status import FAILURE
from btcore.tree.tree import Tree

if TYPE_CHECKING:
    from btcore_recorder.file_recorder import FileRecorder, RingRecorder

_FAILED_ENDS: Final = ("raised", "interrupted", "program_error")
_log = logging.getLogger("btcore")


class RecordingSettings(Settings):
    """The recording of a run."""

    record: Annotated[
        Path,
        option(
            "Record to FILE (….btrec.txt or ….mcap) what the ticks depend on: results and outputs of leaves, "
            "times, writes. btcore replay runs such a recording again.",
            metavar="FILE",
            one_run_only=True,
        ),
    ]
    record_on: Annotated[
        Literal["always", "failure"],
        option(
            "Write the recording always; or only if the run fails, by a result or an exception, or is "
            "interrupted: then its last 10 minutes (at most 50 MB), which are kept in memory.",
            one_run_only=True,
        ),
    ] = "always"
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
        self._settings = settings
        self._report = report
        self._number = 0
        self._recorder: FileRecorder | RingRecorder | None = None
        self.incomplete: list[Path] = []

    def open(self, tree: Tree) -> None:
        """Begin to record *tree*."""
        from btcore_recorder.file_recorder import FileRecorder, RingRecorder

        self._number += 1
        file = numbered_file(self._settings.record, self._number)
        recorder_class = FileRecorder if self._settings.record_on == "always" else RingRecorder
        self._recorder = recorder_class(tree, file, self._settings.record_exclude)

    def replace_tree(self, tree: Tree) -> None:
        """End the recording, and record *tree* to a file with the next number in its name.

        A tree that cannot be recorded gets a warning, so that the run continues.
        """
        self.close()
        try:
            self.open(tree)
        except BtcoreError as error:
            self.incomplete.append(numbered_file(self._settings.record, self._number))
            _log.warning("%s", error)

    def close(self) -> None:
        """End the recording. The end of a failed run is written now."""
        recorder, self._recorder = self._recorder, None
        if recorder is None:
            return
        recorder.close()
        from btcore_recorder.file_recorder import RingRecorder

        if not isinstance(recorder, RingRecorder):
            if recorder.is_incomplete:
                self.incomplete.append(recorder.path)
        elif recorder.last_result is FAILURE or self._report.end_reason in _FAILED_ENDS:
            recorder.save()
            _log.warning("the end of the run is recorded in %s", recorder.path)


@provider
def recorder(settings: RecordingSettings, tree: Tree, report: Report) -> Iterator[object]:
    """Record the tree to a file.

    Raises:
        BtcoreError: The tree cannot be recorded, or the file cannot be written.
        OutputError: At the end: steps are missing in the recording.
    """
    recordings = TreeRecordings(settings, report)
    recordings.open(tree)
    try:
        yield recordings
    finally:
        recordings.close()
        if recordings.incomplete:
            names = ", ".join(map(str, recordings.incomplete))
            raise OutputError(f"recordings are incomplete: {names}")
