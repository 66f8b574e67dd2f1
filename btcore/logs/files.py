"""The files of logs: checking their extensions, creating and reading them, and explaining errors."""

import os
from io import FileIO
from pathlib import Path

from btcore.errors import BtcoreError
from btcore.input_files import read_error, read_file
from btcore.suggestions import join_names, suggestion


class LogError(BtcoreError):
    """Raised when a log cannot be written, or when a file that is read is not a log."""


def expect_extension(path: Path, *extensions: str) -> None:
    """Check the extension of a log, since BehaviorTree.CPP's tools require it too.

    Args:
        extensions: The accepted extensions, such as `.btlog`.
    """
    if path.suffix in extensions:
        return
    hint = path.with_suffix(extensions[0]) if path.name else f"run{extensions[0]}"
    known = join_names(extensions, "or")
    raise LogError(f"{path}: the name of this log must end in {known}; {suggestion(hint)}")


def create(path: Path, head: bytes) -> FileIO:
    """Create or overwrite a file, and return it open for unbuffered writing.

    Args:
        head: The first bytes, which are written at once.
    """
    try:
        file = path.open("wb", buffering=0)
        try:
            write_whole(file, head)
        except OSError:
            file.close()
            raise
    except OSError as error:
        raise LogError(f"{path}: {_explain(path, error)}") from None
    return file


def ensure_writable(path: Path) -> None:
    """Check that *path* can be written; the file is created if it does not exist, and else unchanged."""
    try:
        path.open("ab").close()
    except OSError as error:
        raise LogError(f"{path}: {_explain(path, error)}") from None


def write_whole(file: FileIO, data: bytes) -> None:
    """Write all of *data* to an unbuffered file."""
    # Usually a single system call, so that a killed process leaves complete records. A call may write less.
    written = file.write(data)
    while written < len(data):
        data = data[written:]
        written = file.write(data)


def read_bytes(path: Path, count: int | None = None) -> bytes:
    """Return the content of a file.

    Args:
        count: Return only the first *count* bytes; default the whole file.
    """
    try:
        return read_file(path, count)
    except OSError as error:
        raise LogError(f"{path}: cannot read this log: {read_error(error)}") from None


def _explain(path: Path, error: OSError) -> str:
    message = "cannot write a log here"
    folder = path.parent
    if path.is_dir():  # on Windows the error is a PermissionError
        return f"{message}: this is a folder; give the path of a file"
    if isinstance(error, NotADirectoryError):
        return f"{message}: {folder} is not a folder"
    if isinstance(error, FileNotFoundError):
        return f"{message}: the folder {folder} does not exist; create it first"
    if isinstance(error, PermissionError):
        return f"{message}: no permission to write to {path if os.access(path, os.F_OK) else folder}"
    return f"{message}: {read_error(error)}"
