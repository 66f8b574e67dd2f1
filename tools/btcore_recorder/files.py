"""The files of recordings: their names, and their forms, by the extension or the first bytes."""

import logging
import os
import re
from collections.abc import Iterable
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Final, Protocol

from btcore.escaping import escape_controls
from btcore.extras import describe_missing
from btcore.logs.files import LogError, read_bytes
from btcore.output_files import numbered_file, write_file
from btcore.suggestions import suggestion
from btcore_recorder.inputs import Head, RunRecording
from btcore_recorder.lines import WrittenLine, read_lines, recording_lines
from btcore_recorder.text_form import MAGIC, TextEncoder, TextLines

TEXT: Final = ".btrec.txt"
MCAP: Final = ".mcap"
EXTENSIONS: Final = (TEXT, MCAP)

_log = logging.getLogger("btcore")

RECONSTRUCTED: Final = "reconstructed"
"""The name of an item in the versions of a head: the log from which the recording was reconstructed."""
_MAX_NAME: Final = 200
_OF_A_LOG: Final = "btcore replay LOG --save-recording FILE writes a recording from a log of statuses"
FOLDER_BYTES: Final = 500_000_000
"""Maximum size of the recordings in a folder; beyond it, the oldest are removed."""

_NAME_IN_FOLDER: Final = r"\d{4}-\d\d-\d\dT\d\d-\d\d-\d\d_.+"
_MCAP_MAGIC: Final = b"\x89MCAP0\r\n"


class RecordingEncoder(Protocol):
    """Encodes lines as the bytes of a file."""

    def add(self, lines: Iterable[WrittenLine], time: int = 0) -> None:
        """Add the lines of the head, a segment or a step, at *time* (ns since 1970)."""

    def take(self) -> bytes:
        """Return the bytes since the last call."""
        ...

    def take_end(self) -> bytes:
        """Return the bytes since the last call, and the end of the file."""
        ...


def encoder_for(path: Path) -> RecordingEncoder:
    """Return the encoder of a new file by its extension.

    Raises:
        LogError: The extension is not that of a recording, or a package is not installed.
    """
    if path.name.endswith(TEXT):
        return TextEncoder()
    if path.name.endswith(MCAP):
        try:
            from btcore_recorder.mcap_form import McapEncoder
        except ModuleNotFoundError as error:
            raise LogError(f"{path}: {describe_missing(error.name)}") from error
        return McapEncoder()
    hint = suggestion(f"{path.name.split('.')[0] or 'run'}{TEXT}")
    raise LogError(f"{path}: the name of a recording must end in {TEXT} or {MCAP}; {hint}")


def read_recording(path: Path) -> RunRecording:
    """Read a recording. A truncated or damaged file is read up to the damage.

    A warning is logged if the recording was reconstructed from a log.

    Raises:
        LogError: The file cannot be read, is not a recording, or is damaged in its head.
    """
    data = read_bytes(path)
    if data.startswith(_MCAP_MAGIC):
        try:
            from btcore_recorder.mcap_form import McapLines, has_recording
        except ModuleNotFoundError as error:
            raise LogError(f"{path}: {describe_missing(error.name)}") from error
        if not has_recording(data):
            raise LogError(f"{path}: there is no recording in this bag; {_OF_A_LOG}")
        recording = read_lines(McapLines(data), str(path))
    elif data.startswith(MAGIC):
        recording = read_lines(TextLines(data), str(path))
    else:
        raise LogError(f"{path}: this is not a recording: it does not begin with 'btrec'; {_OF_A_LOG}")
    if text := describe_reconstruction(recording.head):
        _log.warning("%s: %s", path, text)
    return recording


def describe_reconstruction(head: Head) -> str:
    """Return what a recording lacks if it was reconstructed from a log, or ""."""
    log = head.versions.get(RECONSTRUCTED)
    if log is None:
        return ""
    name = escape_controls(log[:_MAX_NAME], one_line=True)
    return (
        f"reconstructed from the statuses in '{name}': results of leaves are derived, and ticks without a "
        "change are missing; questions about entries, inputs, outputs and conditions need a recording of the "
        "run itself (btcore run --record)"
    )


def save_recording(path: Path, recording: RunRecording) -> None:
    """Write a recording.

    Raises:
        LogError: The extension is not that of a recording, or the file cannot be written.
    """
    try:
        write_file(path, _encode(recording, encoder_for(path)))
    except OSError as error:
        raise LogError(f"{path}: cannot write the recording: {error.strerror or error}") from None


def recording_text(recording: RunRecording) -> str:
    """Return the text form of a recording."""
    return _encode(recording, TextEncoder()).decode("utf-8", "surrogatepass")


def _encode(recording: RunRecording, encoder: RecordingEncoder) -> bytes:
    head = recording.head
    time = head.time
    for lines in recording_lines(recording):
        time = next((line[2] for line in lines if line[0] == "tick"), time)
        encoder.add(lines, head.wall_time_at(time))
    return encoder.take_end()


def local_file(name: str) -> Path | None:
    """Return the file of a recorded document, if it exists below the working directory."""
    path = Path(name)
    return path if path.is_file() and path.resolve().is_relative_to(Path.cwd()) else None


class RecordingFiles:
    """The files of the recordings of a run: their names, and when a recording continues in a new file.

    Args:
        path: A file, to which numbered files are added, as `run.2.btrec.txt`; or a folder, which exists
            already, or whose name has no extension: there a name consists of the time and the tree.
        max_bytes: The size at which a new file begins; None = any.
        max_duration_s: The time (s of the tree's clock) after which a new file begins; None = any.

    Attributes:
        is_folder: Whether *path* is a folder.
        count: The number of names that were given.
    """

    def __init__(
        self, path: Path, max_bytes: float | None = None, max_duration_s: float | None = None
    ) -> None:
        self.is_folder = path.is_dir() or not path.suffix
        self.max_bytes = max_bytes
        self.max_duration_s = max_duration_s
        self.count = 0
        self._path = path

    def next(self, tree_id: str) -> Path:
        """Return the name of the next recording. A folder is created, and its oldest recordings are removed.

        Raises:
            LogError: The folder cannot be created.
        """
        self.count += 1
        if not self.is_folder:
            return numbered_file(self._path, self.count)
        try:
            self._path.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise LogError(f"{self._path}: cannot create the folder: {error.strerror or error}") from None
        self._remove_oldest()
        tree = re.sub(r"[^\w-]", "_", tree_id)[:60]
        now = datetime.now().strftime("%Y-%m-%dT%H-%M-%S")
        return self._path / f"{now}_{tree}_{os.getpid()}-{self.count:05}{TEXT}"

    def _remove_oldest(self) -> None:
        with suppress(OSError):  # another process may remove the same files
            named = [file for file in self._path.iterdir() if re.fullmatch(_NAME_IN_FOLDER, file.name)]
            left = FOLDER_BYTES
            for file in sorted(named, reverse=True):
                left -= file.stat().st_size
                if left < 0:
                    file.unlink(missing_ok=True)
