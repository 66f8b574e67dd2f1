"""The folder of a sweep, in which its definition and its finished episodes are saved.

`sweep.json` contains the definition of the sweep, `journal.jsonl` a line of JSON for each episode, which
is written as soon as the episode is finished. `recordings` contains the recordings of the episodes without
success, for `btcore replay`. If the process is killed while it writes, the incomplete last
line is removed when the sweep continues.
"""

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Final

import click

from btcore.input_files import read_file
from btcore.json_text import load_json
from btcore.output_files import write_file
from btcore_sweep.definition import SweepDefinition, difference

if sys.platform == "win32":
    import msvcrt
else:
    import fcntl

DEFINITION: Final = "sweep.json"
JOURNAL: Final = "journal.jsonl"
RECORDINGS: Final = "recordings"
_LOCKED_BYTE: Final = 2**31 - 2
"""The offset of the byte that is locked on Windows, where other programs cannot read locked bytes."""

Record = dict[str, Any]
"""The saved result of an episode: the result of `episode.run_episode`, and `episode`, its number."""


class SweepFolder:
    """The folder of a sweep; as a context manager it is locked against other sweeps.

    Entering the context raises click.UsageError if the folder belongs to another sweep, is in use, or cannot
    be written. The attribute `done` contains the records of the finished episodes, by number.

    Args:
        path: The path of the folder, which is created if it does not exist.
    """

    def __init__(self, path: Path, definition: SweepDefinition) -> None:
        self.path = path
        self.definition = definition
        self.done: dict[int, Record] = {}
        self._file: IO[bytes] | None = None

    def __enter__(self) -> "SweepFolder":
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            self._file = (self.path / JOURNAL).open("a+b")  # closed by __exit__
        except OSError as error:
            raise click.UsageError(f"--output {self.path}: {error.strerror}.") from error
        try:
            self._lock(self._file)
            self._check_definition()
            self._read(self._file)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def recording(self, number: int) -> Path:
        """Return the file for the recording of an episode."""
        return self.path / RECORDINGS / f"{number}.btrec.txt"

    def add(self, record: Record) -> None:
        """Save the record of a finished episode. A second record of the same episode is ignored."""
        number = record["episode"]
        if number in self.done:
            return
        assert self._file is not None
        self.done[number] = record
        self._file.write(json.dumps(record, ensure_ascii=False, separators=(",", ":")).encode() + b"\n")
        self._file.flush()  # to the operating system: the record survives a kill of this process

    def _lock(self, file: IO[bytes]) -> None:
        # The lock ends with the process, however it ends: no stale lock can block the folder.
        try:
            if sys.platform == "win32":
                os.lseek(file.fileno(), _LOCKED_BYTE, os.SEEK_SET)
                msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)
            else:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise click.UsageError(
                f"another 'btcore sweep' is writing to '{self.path}'; wait until it ends, or choose "
                "another folder with --output."
            ) from error

    def _check_definition(self) -> None:
        """Write the definition to a new folder, or check that the folder belongs to this sweep."""
        path = self.path / DEFINITION
        now = self.definition.described
        if not path.exists():
            write_file(path, json.dumps(now, ensure_ascii=False, indent=1).encode() + b"\n")
            return
        changed = difference(_read_definition(path), now)
        if changed is not None:
            raise click.UsageError(
                f"'{self.path}' contains another sweep, which differs in {changed}. Choose another folder "
                "with --output, or remove this folder."
            )

    def _read(self, file: IO[bytes]) -> None:
        file.seek(0)
        complete = 0  # bytes
        for line in file:
            try:
                record = load_json(line.decode()) if line.endswith(b"\n") else None
            except ValueError:
                record = None
            if record is None:
                break
            complete += len(line)
            if "blamed" in record:  # the name of the key in older folders
                record["failed_at"] = record.pop("blamed")
            self.done.setdefault(record["episode"], record)
        file.truncate(complete)
        file.seek(0, os.SEEK_END)


def _read_definition(path: Path) -> Mapping[str, Any]:
    try:
        definition = load_json(read_file(path).decode())
    except (OSError, ValueError) as error:
        raise click.UsageError(f"cannot read '{path}' as the definition of a sweep: {error}.") from error
    if not isinstance(definition, dict):
        raise click.UsageError(f"'{path}' is not the definition of a sweep.")
    return definition
