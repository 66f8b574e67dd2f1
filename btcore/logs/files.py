"""Where logs are kept: their extensions, and what goes wrong with files, as sentences."""

import os
from io import FileIO
from pathlib import Path

from btcore.errors import BtcoreError
from btcore.suggestions import join_names


class LogError(BtcoreError):
    """A log can't be written where it is wanted, or what is read isn't one."""


def expect_extension(path: Path, *extensions: str) -> None:
    """Raise LogError unless *path* ends in one of *extensions*, which the tools that read it ask for."""
    if path.suffix in extensions:
        return
    wanted = join_names(extensions, "or")
    hint = path.with_suffix(extensions[0]) if path.name else f"run{extensions[0]}"
    raise LogError(f"{path}: this log's file ends in {wanted}; did you mean {hint}?")


def create(path: Path, head: bytes) -> FileIO:
    """The file *path*, with *head* in it and open for writing without a buffer. Raises LogError."""
    try:
        file = path.open("wb", buffering=0)
        try:
            write_whole(file, head)
        except OSError:
            file.close()
            raise
    except OSError as error:
        raise LogError(f"{path}: {_why_not(path, error)}") from None
    return file


def ensure_writable(path: Path) -> None:
    """Raise LogError unless *path* is, or can be made, a file to write; what it holds stays."""
    try:
        path.open("ab").close()
    except OSError as error:
        raise LogError(f"{path}: {_why_not(path, error)}") from None


def write_whole(file: FileIO, data: bytes) -> None:
    """Write all of *data*, in one call of the system unless that takes less. Raises OSError."""
    written = file.write(data)
    while written < len(data):
        data = data[written:]
        written = file.write(data)


def read_bytes(path: Path, most: int = -1) -> bytes:
    """The bytes of *path*, the first *most* if that is not negative. Raises LogError."""
    try:
        with path.open("rb") as file:
            return file.read(most)
    except OSError as error:
        raise LogError(f"{path}: this log can't be read: {_reason(error)}") from None


def _why_not(path: Path, error: OSError) -> str:
    said = "a log can't be written here"
    folder = path.parent
    if isinstance(error, IsADirectoryError):
        return f"{said}, this is a folder; name a file in it"
    if isinstance(error, NotADirectoryError):
        return f"{said}, {folder} is no folder"
    if isinstance(error, FileNotFoundError):
        return f"{said}, there is no folder {folder}; make it first"
    if isinstance(error, PermissionError):
        return f"{said}, {path if os.access(path, os.F_OK) else folder} is write-protected for you"
    return f"{said}: {_reason(error)}"


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()
