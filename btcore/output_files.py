"""The names of numbered files, and writing files so that they are never left incomplete.

A killed process or a full disk leaves the old content or the new, never a part.
"""

import os
import shutil
from pathlib import Path


def numbered_file(path: Path, number: int) -> Path:
    """Return the file for one of several trees that follow each other: `run.btlog`, `run.2.btlog` …

    A name with two extensions, such as `run.btrec.txt`, becomes `run.2.btrec.txt`.

    Args:
        path: The file of the first tree.
        number: The number of the tree, from 1.
    """
    extension = "".join(path.suffixes[-2:]) if path.name.endswith(".txt") else path.suffix
    name = path.name.removesuffix(extension)
    return path if number == 1 else path.with_name(f"{name}.{number}{extension}")


def write_file(path: str | os.PathLike[str], data: bytes) -> None:
    """Write *data* to a file; an existing file is replaced, and keeps its permissions.

    Args:
        path: The file. A symbolic link is followed. A device such as `/dev/stdout` is written directly.

    Raises:
        OSError: The file cannot be written. An existing file is unchanged.
    """
    target = Path(os.path.realpath(path))
    if target.exists() and not target.is_file():
        target.write_bytes(data)
        return
    # In the same folder, since only within a file system a file can take the place of another.
    incomplete = target.with_name(f".{target.name}.{os.getpid()}.tmp")
    try:
        incomplete.write_bytes(data)
        if target.exists():
            shutil.copymode(target, incomplete)
        incomplete.replace(target)
    except OSError as error:
        incomplete.unlink(missing_ok=True)
        raise type(error)(error.errno, error.strerror, os.fspath(path)) from None
