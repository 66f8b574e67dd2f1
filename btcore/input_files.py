"""Read files that may come from strangers: only regular files, and only up to a maximum size.

`data_folder` finds the files that are installed with btcore.
"""

import errno
import os
import re
import stat
import sys
from pathlib import Path
from typing import BinaryIO, Final

SIZE_VARIABLE: Final = "BTCORE_MAX_FILE_SIZE"
"""The environment variable with the maximum size of a file, such as `1GB`."""
DEFAULT_MAX_SIZE: Final = "256MB"

ENLARGE: Final = (
    "to read it, use 'btcore --max-file-size SIZE …' or set the environment variable " + SIZE_VARIABLE
)
"""The end of an error message about a file that is too large."""

_UNITS: Final = {"": 1, "kb": 10**3, "mb": 10**6, "gb": 10**9}
_FILE_TYPES: Final = {
    stat.S_IFIFO: "a named pipe",
    stat.S_IFCHR: "a device",
    stat.S_IFBLK: "a device",
    stat.S_IFSOCK: "a socket",
}
# Without O_NONBLOCK, opening a named pipe would wait for its writer. Windows lacks both flags.
_FLAGS: Final = getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_NOCTTY", 0)


def read_file(path: str | os.PathLike[str], count: int | None = None) -> bytes:
    """Return the content of a regular file.

    Args:
        count: Return only the first *count* bytes; default the whole file.

    Raises:
        OSError: The file is missing, not a regular file, too large or unreadable. `read_error` returns
            the reason.
        ValueError: The environment variable BTCORE_MAX_FILE_SIZE is not a size.
    """
    limit = max_size()
    with open(path, "rb", opener=_open) as file:
        status = os.fstat(file.fileno())
        if not stat.S_ISREG(status.st_mode):
            file_type = _FILE_TYPES.get(stat.S_IFMT(status.st_mode), "something else")
            raise OSError(errno.EINVAL, f"it is {file_type}, not a regular file", os.fspath(path))
        # Files in /proc have content, but the size 0.
        data = file.read(min(count or limit, status.st_size or limit, limit) + (count is None))
    if max(status.st_size, len(data)) > limit:
        raise _too_large(limit, os.fspath(path))
    return data


def read_stream(stream: BinaryIO, name: str) -> bytes:
    """Return the content of *stream*, for example stdin.

    Args:
        name: The name of the stream in error messages.

    Raises:
        OSError: The content is too large or unreadable. `read_error` returns the reason.
        ValueError: The environment variable BTCORE_MAX_FILE_SIZE is not a size.
    """
    limit = max_size()
    data = stream.read(limit + 1)
    if len(data) > limit:
        raise _too_large(limit, name)
    return data


def max_size() -> int:
    """Return the maximum size of a file in bytes."""
    return parse_size(os.environ.get(SIZE_VARIABLE) or DEFAULT_MAX_SIZE)


def _too_large(limit: int, name: str) -> OSError:
    return OSError(errno.EFBIG, f"it is larger than {format_size(limit)}; {ENLARGE}", name)


FileStamp = tuple[int, int, int]


def file_stamp(path: Path, *, follow_symlinks: bool = True) -> FileStamp | None:
    """Return a value that changes with the content of a file; None if there is no file."""
    try:
        status = path.stat(follow_symlinks=follow_symlinks)
    except OSError:
        return None
    return status.st_mtime_ns, status.st_size, status.st_ino


def real_path(path: str | os.PathLike[str]) -> Path:
    """Return the absolute path without symbolic links. Links that form a loop are kept."""
    return Path(os.path.realpath(path))  # Path.resolve() raises RuntimeError for a loop


def _open(path: str, flags: int) -> int:
    if sys.platform == "win32" and Path(path).is_dir():
        # Windows raises PermissionError for a folder.
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), path)
    return os.open(path, flags | _FLAGS)


def read_error(error: OSError) -> str:
    """Return the reason why a file cannot be read, beginning with a lower-case letter."""
    reason = error.strerror or str(error)
    return reason[:1].lower() + reason[1:]


def parse_size(text: str) -> int:
    """Return the number of bytes for a text such as `500000`, `200MB` or `1.5 GB`."""
    match = re.fullmatch(r"\s*(\d{1,15}(?:\.\d{1,9})?)\s*([kmg]?b|)\s*", text.lower())
    if match is None:
        raise ValueError(f"'{text}' is not the size of a file, such as 200MB or 1GB")
    return int(float(match[1]) * _UNITS.get(match[2], 1))


def format_size(size: int) -> str:
    """Return a number of bytes as text, in the largest unit of at least 1."""
    for name, unit in (("GB", 10**9), ("MB", 10**6), ("kB", 10**3)):
        if size >= unit:
            return f"{size / unit:g} {name}"
    return f"{size} bytes"


def data_folder(name: str) -> Path:
    """Return the folder *name*, such as `docs`: in the package if installed, next to it in a checkout."""
    package = Path(__file__).resolve().parent  # a colcon workspace may contain a link to the package
    installed = package / name
    return installed if installed.is_dir() else package.parent / name
