"""Writing and reading `.btlog`, the file of BehaviorTree.CPP 4's FileLogger2.

The format is that of src/loggers/bt_file_logger_v2.cpp. All numbers are little-endian. The file begins with a
magic word, the protocol version (1 byte), the length and text of the tree's XML, and the first time stamp
(µs since 1970). Each transition has nine bytes: the time since the first stamp (µs, 48 bits), the node's UID
(16 bits), and its status (8 bits). There is no count and no end mark: a truncated file is a shorter log.

The format cannot express that transitions are missing. Known gaps are written to `FILE.btlog.gaps`, a line
for each gap with the number of transitions before it and the reason.
"""

import os
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from btcore.clock import NS_PER_US
from btcore.input_files import read_file
from btcore.loading.tree_xml import tree_to_xml
from btcore.logs.files import LogError, create, expect_extension, read_bytes, write_whole
from btcore.logs.log import Log
from btcore.logs.recording import (
    STATUSES,
    Gap,
    Recording,
    TransitionCollector,
    parse_nodes,
    truncation_message,
)
from btcore.status import Status, Transition
from btcore.tree.tree import Tree

MAGIC: Final = b"BTCPP4-FileLogger2"
PROTOCOL: Final = 1
EXTENSION: Final = ".btlog"

_HEADER: Final = struct.Struct(f"<{len(MAGIC)}sBi")
_FIRST_STAMP: Final = struct.Struct("<q")
# The 48 bits of the stamp as the low 32 and the high 16 bits, then the UID and the status.
_RECORD: Final = struct.Struct("<IHHB")


class BtLogWriter:
    """A writer of a `.btlog` file; an existing file is overwritten.

    Args:
        xml: The XML of the tree, in UTF-8.
        start: The first time stamp (µs since 1970).
    """

    def __init__(self, path: Path, xml: bytes, start: int) -> None:
        expect_extension(path, EXTENSION)
        self.path = path
        self._count = 0
        self._file = create(path, _HEADER.pack(MAGIC, PROTOCOL, len(xml)) + xml + _FIRST_STAMP.pack(start))
        try:
            _gaps_file(path).unlink(missing_ok=True)
        except OSError as error:
            self._file.close()
            raise LogError(
                f"{_gaps_file(path)}: cannot remove the gaps of the previous log: {error}"
            ) from None

    def append(self, records: Iterable[tuple[int, int, Status, Status]]) -> None:
        """Append transitions, given as (time since the start in µs, UID, previous, status).

        The file does not contain the previous statuses.
        """
        data = bytearray()
        for since, uid, _, status in records:
            data += _RECORD.pack(since & 0xFFFFFFFF, since >> 32, uid, status)
            self._count += 1
        write_whole(self._file, bytes(data))

    def gap(self, reason: str) -> None:
        """Record that transitions are missing before the next transition, because of *reason*."""
        with _gaps_file(self.path).open("a", encoding="utf-8", newline="\n") as file:
            file.write(f"{self._count} {' '.join(reason.split())}\n")

    def finish(self) -> None:
        """Do nothing: the format has no end. Other writers complete their files."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class BtLog(Log):
    """A log of a tree in a `.btlog` file, as FileLogger2 writes it; an existing file is overwritten.

    Args:
        tree: The tree to log.
        path: The file.
        idle: Whether to log transitions to IDLE.

    Raises:
        LogError: The extension is not `.btlog`, or the file cannot be written.

    Examples:
        >>> import btcore
        >>> from btcore.logs import BtLog, read_log
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Inverter(b.AlwaysFailure()))
        >>> with BtLog(tree, "run.btlog"):
        ...     tree.tick_while_running()
        <Status.SUCCESS: 2>
        >>> recording = read_log("run.btlog")
        >>> [(change.uid, change.status.name) for change in recording.transitions]
        [(1, 'RUNNING'), (2, 'FAILURE'), (2, 'IDLE'), (1, 'SUCCESS'), (1, 'IDLE')]
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str], *, idle: bool = True) -> None:
        self.path = Path(path)
        xml = tree_to_xml(tree).encode("utf-8")
        super().__init__(tree, str(self.path), idle=idle)
        self._file = BtLogWriter(self.path, xml, self.epoch // NS_PER_US)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Append the transitions *changes* to the file."""
        start = self.start
        self._file.append(
            ((stamp - start) // NS_PER_US, uid, previous, status)
            for _, stamp, _, uid, previous, status in changes
        )

    def release(self) -> None:
        """Close the file."""
        self._file.close()


def read_btlog(path: str | os.PathLike[str]) -> Recording:
    """Read a `.btlog` file. A truncated or damaged file is read up to the damage.

    Returns:
        The recording. Its `warnings` describe damage.

    Raises:
        LogError: The file cannot be read, is not a `.btlog` file, or ends within its header.
    """
    path = Path(path)
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise LogError(f"{path}: this is not a {EXTENSION} file, it does not begin with {MAGIC.decode()}")
    if len(data) < _HEADER.size:
        raise LogError(f"{path}: this log ends in its header, after {len(data)} bytes")
    _, protocol, size = _HEADER.unpack_from(data)
    if protocol != PROTOCOL:
        raise LogError(
            f"{path}: this log has protocol version {protocol}; btcore supports version {PROTOCOL}"
        )
    first = _HEADER.size + size + _FIRST_STAMP.size
    if size < 0 or len(data) < first:
        reason = f"{len(data)} of {first} bytes" if size >= 0 else f"the length of the tree is {size}"
        raise LogError(f"{path}: this log ends in its header: {reason}")
    xml = data[_HEADER.size : _HEADER.size + size]
    nodes = parse_nodes(xml, str(path))
    (start,) = _FIRST_STAMP.unpack_from(data, _HEADER.size + size)
    complete = first + (len(data) - first) // _RECORD.size * _RECORD.size
    damage = truncation_message(len(data) - complete)
    history = TransitionCollector()
    for index, (low, high, uid, code) in enumerate(_RECORD.iter_unpack(data[first:complete])):
        if uid not in nodes or code not in STATUSES:
            unknown = f"status {code}" if uid in nodes else f"node {uid}"
            damage = f"the file is damaged from byte {first + index * _RECORD.size} on: unknown {unknown}"
            break
        history.add((start + low + (high << 32)) * NS_PER_US, uid, STATUSES[code])
    changes = history.changes
    text = xml.decode("utf-8", "replace")
    return Recording(path, text, start * NS_PER_US, nodes, changes, damage, _gaps(path, len(changes)))


def _gaps_file(path: Path) -> Path:
    return path.with_name(f"{path.name}.gaps")


def _gaps(path: Path, count: int) -> tuple[Gap, ...]:
    """Return the recorded gaps of the log *path* with *count* transitions; invalid lines are ignored."""
    try:
        lines = read_file(_gaps_file(path)).decode(errors="replace").splitlines()
    except OSError:
        return ()
    parts = [line.partition(" ") for line in lines]
    return tuple(Gap(int(at), text) for at, _, text in parts if at.isdecimal() and int(at) <= count and text)
