"""The episodes of a sweep that are done, in its folder: a line of JSON each, written as soon as it is known.

``sweep.json`` says what the sweep is, ``journal.jsonl`` what its episodes came to. A process that is killed
leaves whole lines, and perhaps a part of one, which is taken away.
"""

import json
import os
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, Final

import click

from btcore.sweep.definition import SweepDefinition, difference

if sys.platform != "win32":
    import fcntl

DEFINITION: Final = "sweep.json"
JOURNAL: Final = "journal.jsonl"

Record = dict[str, Any]
"""What is kept of an episode: what `episode.play` tells, and its ``episode``, the number."""


class Journal:
    """The journal in *folder*, which is made if need be, of the sweep that *definition* defines.

    *done* are the records there are, by number. As a context manager it holds the folder, which only one
    sweep at a time can. Raises :class:`click.UsageError` where it has another sweep, or one that runs.
    """

    def __init__(self, folder: Path, definition: SweepDefinition) -> None:
        self.folder = folder
        self.definition = definition
        self.done: dict[int, Record] = {}
        self._file: IO[bytes] | None = None

    def __enter__(self) -> "Journal":
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            # Not closed here: it is the journal.
            self._file = (self.folder / JOURNAL).open("a+b")
        except OSError as fault:
            raise click.UsageError(f"--output {self.folder}: {fault.strerror}.") from fault
        try:
            self._hold(self._file)
            self._identify()
            self._read(self._file)
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            self._file.close()
            self._file = None

    def add(self, record: Record) -> None:
        """Write that an episode is done. One that is known already changes nothing."""
        number = record["episode"]
        if number in self.done:
            return
        assert self._file is not None
        self.done[number] = record
        self._file.write(json.dumps(record, ensure_ascii=False, separators=(",", ":")).encode() + b"\n")
        self._file.flush()

    def _hold(self, file: IO[bytes]) -> None:
        if sys.platform == "win32":
            return
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as fault:
            raise click.UsageError(
                f"another 'btcore sweep' is writing to '{self.folder}' now; wait for it, or name another "
                "folder with --output."
            ) from fault

    def _identify(self) -> None:
        """Make sure that the folder is this sweep's."""
        path = self.folder / DEFINITION
        now = self.definition.described
        if not path.exists():
            unfinished = path.with_suffix(".tmp")
            unfinished.write_text(json.dumps(now, ensure_ascii=False, indent=1) + "\n", encoding="utf-8")
            unfinished.replace(path)
            return
        before = _definition(path)
        apart = difference(before, now)
        if apart is not None:
            raise click.UsageError(
                f"'{self.folder}' has another sweep, which differs in {apart}. Name another folder with "
                "--output, or remove that one."
            )

    def _read(self, file: IO[bytes]) -> None:
        file.seek(0)
        whole = 0
        for line in file:
            try:
                record = json.loads(line) if line.endswith(b"\n") else None
            except ValueError:
                record = None
            if record is None:
                break
            whole += len(line)
            self.done.setdefault(record["episode"], record)
        file.truncate(whole)
        file.seek(0, os.SEEK_END)


def _definition(path: Path) -> Mapping[str, Any]:
    try:
        found = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as fault:
        raise click.UsageError(f"'{path}' can't be read as what a sweep is: {fault}.") from fault
    if not isinstance(found, dict):
        raise click.UsageError(f"'{path}' doesn't say what a sweep is.")
    return found
