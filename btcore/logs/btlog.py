"""``.btlog``: the file of BehaviorTree.CPP 4's FileLogger2, written and read (groot2.md §11).

The magic word, one byte of protocol, the tree's XML behind its length, the first stamp in µs since
1970; then nine bytes a transition: 48 bits of µs since the first stamp, the node's uid, its status.
Little endian. There is no count and no end, so a file that was cut off is a shorter file.

It has no place for what a writer knows to be missing. That stands beside it, in ``FILE.btlog.gaps``: a
line a gap, the number of transitions before it and a sentence.
"""

import os
import struct
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from btcore.clock import NS_PER_US
from btcore.logs.files import (
    LogError,
    create,
    expect_extension,
    read_bytes,
    write_whole,
)
from btcore.logs.log import Log
from btcore.logs.recording import (
    STATUSES,
    Gap,
    Recording,
    TransitionCollector,
    parse_nodes,
)
from btcore.status import Transition
from btcore.tree.tree import Tree
from btcore.xml.render.tree_xml import tree_to_xml

MAGIC: Final = b"BTCPP4-FileLogger2"
PROTOCOL: Final = 1
EXTENSION: Final = ".btlog"

_HEADER: Final = struct.Struct(f"<{len(MAGIC)}sBi")
_FIRST_STAMP: Final = struct.Struct("<q")
# The stamp's 48 bits as their low 32 and high 16.
_RECORD: Final = struct.Struct("<IHHB")


class BtLogWriter:
    """Such a file, being written; what was in it is gone.

    *xml* is the tree, *start* the first stamp (µs since 1970). Raises LogError: the extension isn't
    ``.btlog``, or the file can't be written.
    """

    def __init__(self, path: Path, xml: bytes, start: int) -> None:
        expect_extension(path, EXTENSION)
        self.path = path
        self._count = 0
        self._file = create(path, _HEADER.pack(MAGIC, PROTOCOL, len(xml)) + xml + _FIRST_STAMP.pack(start))
        try:
            _beside(path).unlink(missing_ok=True)
        except OSError as error:
            self._file.close()
            raise LogError(
                f"{_beside(path)}: this is of an older log, and can't be removed: {error}"
            ) from None

    def append(self, records: Iterable[tuple[int, int, int]]) -> None:
        """Append transitions: µs since the start, uid, status. Raises OSError."""
        data = bytearray()
        for since, uid, status in records:
            data += _RECORD.pack(since & 0xFFFFFFFF, since >> 32, uid, status)
            self._count += 1
        write_whole(self._file, bytes(data))

    def gap(self, said: str) -> None:
        """Note, beside the file, what is missing before the next transition. Raises OSError."""
        with _beside(self.path).open("a", encoding="utf-8") as file:
            file.write(f"{self._count} {' '.join(said.split())}\n")

    def close(self) -> None:
        """Let go of the file."""
        self._file.close()


class BtLog(Log):
    """Writes the transitions of *tree* to *path*, as FileLogger2 does; what was in the file is gone.

    *idle* false leaves out the transitions to IDLE. Raises LogError: the extension isn't ``.btlog``,
    or the file can't be written.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str], *, idle: bool = True) -> None:
        self.path = Path(path)
        expect_extension(self.path, EXTENSION)
        xml = tree_to_xml(tree).encode("utf-8")
        super().__init__(tree, str(self.path), idle=idle)
        self._file = BtLogWriter(self.path, xml, self.epoch // NS_PER_US)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Append *changes*."""
        start = self.start
        self._file.append(
            ((stamp - start) // NS_PER_US, uid, status) for _, stamp, _, uid, _, status in changes
        )

    def release(self) -> None:
        """Close the file."""
        self._file.close()


def read_btlog(path: str | os.PathLike[str]) -> Recording:
    """What the file *path* tells, up to where it was cut off or damaged, if it was.

    Raises LogError if it can't be read, is no such log, or ends before its first transition could begin.
    """
    path = Path(path)
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise LogError(f"{path}: this isn't a {EXTENSION}, it doesn't begin with {MAGIC.decode()}")
    if len(data) < _HEADER.size:
        raise LogError(f"{path}: this log ends in its header, after {len(data)} bytes")
    _, protocol, size = _HEADER.unpack_from(data)
    if protocol != PROTOCOL:
        raise LogError(f"{path}: this log is of protocol {protocol}, and btcore reads protocol {PROTOCOL}")
    first = _HEADER.size + size + _FIRST_STAMP.size
    if size < 0 or len(data) < first:
        said = f"{len(data)} of {first} bytes" if size >= 0 else f"a tree of {size} bytes is announced"
        raise LogError(f"{path}: this log ends in its header: {said}")
    xml = data[_HEADER.size : _HEADER.size + size]
    nodes = parse_nodes(xml, str(path))
    (start,) = _FIRST_STAMP.unpack_from(data, _HEADER.size + size)
    whole = first + (len(data) - first) // _RECORD.size * _RECORD.size
    damage = ""
    if whole < len(data):
        damage = (
            f"the file is cut off within a transition, {len(data) - whole} bytes after the last whole one"
        )
    history = TransitionCollector()
    for index, (low, high, uid, code) in enumerate(_RECORD.iter_unpack(data[first:whole])):
        if uid not in nodes or code not in STATUSES:
            what = f"status {code}" if uid in nodes else f"node {uid}"
            damage = f"the file is damaged from byte {first + index * _RECORD.size} on: there is no {what}"
            break
        history.add((start + low + (high << 32)) * NS_PER_US, uid, STATUSES[code])
    changes = history.changes
    text = xml.decode("utf-8", "replace")
    return Recording(path, text, start * NS_PER_US, nodes, changes, damage, _gaps(path, len(changes)))


def _beside(path: Path) -> Path:
    return path.with_name(f"{path.name}.gaps")


def _gaps(path: Path, most: int) -> tuple[Gap, ...]:
    """The gaps noted beside *path*, up to *most* transitions; what is no such line is passed over."""
    try:
        lines = _beside(path).read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ()
    parted = [line.partition(" ") for line in lines]
    return tuple(Gap(int(at), said) for at, _, said in parted if at.isdecimal() and int(at) <= most and said)
