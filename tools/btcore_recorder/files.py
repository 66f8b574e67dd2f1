"""The files of recordings: their forms, by the extension or the first bytes."""

from collections.abc import Iterable
from pathlib import Path
from typing import Final, Protocol

from btcore.extras import describe_missing
from btcore.logs.files import LogError, read_bytes
from btcore.suggestions import suggestion
from btcore_recorder.inputs import RunRecording
from btcore_recorder.lines import Line, read_lines
from btcore_recorder.text_form import MAGIC, TextForm, TextLines

TEXT: Final = ".btrec.txt"
MCAP: Final = ".mcap"
EXTENSIONS: Final = (TEXT, MCAP)

_MCAP_MAGIC: Final = b"\x89MCAP0\r\n"


class Form(Protocol):
    """Converts lines to the bytes of a file."""

    def add(self, lines: Iterable[Line], time: int = 0) -> None:
        """Add the lines of the head, a segment or a step, at *time* (ns since 1970)."""

    def take(self) -> bytes:
        """Return the bytes since the last call."""
        ...

    def take_end(self) -> bytes:
        """Return the bytes since the last call, and the end of the file."""
        ...


def form_for(path: Path) -> Form:
    """Return the form of a new file by its extension.

    Raises:
        LogError: The extension is not that of a recording, or a package is not installed.
    """
    if path.name.endswith(TEXT):
        return TextForm()
    if path.name.endswith(MCAP):
        try:
            from btcore_recorder.mcap_form import McapForm
        except ModuleNotFoundError as error:
            raise LogError(f"{path}: {describe_missing(error.name)}") from error
        return McapForm()
    hint = suggestion(f"{path.name.split('.')[0] or 'run'}{TEXT}")
    raise LogError(f"{path}: the name of a recording must end in {TEXT} or {MCAP}; {hint}")


def read_recording(path: Path) -> RunRecording:
    """Read a recording. A truncated or damaged file is read up to the damage.

    Raises:
        LogError: The file cannot be read, is not a recording, or is damaged in its head.
    """
    data = read_bytes(path)
    if data.startswith(_MCAP_MAGIC):
        try:
            from btcore_recorder.mcap_form import McapLines
        except ModuleNotFoundError as error:
            raise LogError(f"{path}: {describe_missing(error.name)}") from error
        return read_lines(McapLines(data), str(path))
    if not data.startswith(MAGIC):
        raise LogError(f"{path}: this is not a recording: it does not begin with 'btrec'")
    return read_lines(TextLines(data), str(path))
