"""``.btlog``: the file of BehaviorTree.CPP 4's FileLogger2, written and read (groot2.md §11).

The magic word, one byte of protocol, the tree's XML behind its length, the first stamp in µs since
1970; then nine bytes a transition: 48 bits of µs since the first stamp, the node's uid, its status.
Little endian. There is no count and no end, so a file that was cut off is a shorter file.
"""

import os
import struct
from pathlib import Path
from typing import Final

from btcore.logs.files import LogFault, contents, create, expect_extension, write_whole
from btcore.logs.log import Log
from btcore.logs.recording import STATUSES, History, Recording, nodes_of
from btcore.status import Transition
from btcore.tree import Tree
from btcore.xml.write import tree_to_xml

MAGIC: Final = b"BTCPP4-FileLogger2"
PROTOCOL: Final = 1
EXTENSION: Final = ".btlog"
NS_PER_US: Final = 1_000

_HEADER: Final = struct.Struct(f"<{len(MAGIC)}sBi")
_FIRST_STAMP: Final = struct.Struct("<q")
# The stamp's 48 bits as their low 32 and high 16.
_RECORD: Final = struct.Struct("<IHHB")


class BtLog(Log):
    """Writes the transitions of *tree* to *path*, as FileLogger2 does; what was in the file is gone.

    *idle* false leaves out the transitions to IDLE. Raises LogFault: the extension isn't ``.btlog``,
    or the file can't be written.
    """

    def __init__(self, tree: Tree, path: str | os.PathLike[str], *, idle: bool = True) -> None:
        self.path = Path(path)
        expect_extension(self.path, EXTENSION)
        xml = tree_to_xml(tree).encode("utf-8")
        super().__init__(tree, str(self.path), idle=idle)
        head = _HEADER.pack(MAGIC, PROTOCOL, len(xml)) + xml + _FIRST_STAMP.pack(self.epoch // NS_PER_US)
        self._file = create(self.path, head)
        self.attach()

    def write(self, changes: list[Transition]) -> None:
        """Append *changes*."""
        start = self.start
        data = bytearray()
        for _, stamp, _, uid, _, status in changes:
            since = (stamp - start) // NS_PER_US
            data += _RECORD.pack(since & 0xFFFFFFFF, since >> 32, uid, status)
        write_whole(self._file, bytes(data))

    def release(self) -> None:
        """Close the file."""
        self._file.close()


def read_btlog(path: str | os.PathLike[str]) -> Recording:
    """What the file *path* tells, up to where it was cut off or damaged, if it was.

    Raises LogFault if it can't be read, is no such log, or ends before its first transition could begin.
    """
    path = Path(path)
    data = contents(path)
    if not data.startswith(MAGIC):
        raise LogFault(f"{path}: this isn't a {EXTENSION}, it doesn't begin with {MAGIC.decode()}")
    if len(data) < _HEADER.size:
        raise LogFault(f"{path}: this log ends in its header, after {len(data)} bytes")
    _, protocol, size = _HEADER.unpack_from(data)
    if protocol != PROTOCOL:
        raise LogFault(f"{path}: this log is of protocol {protocol}, and btcore reads protocol {PROTOCOL}")
    first = _HEADER.size + size + _FIRST_STAMP.size
    if size < 0 or len(data) < first:
        said = f"{len(data)} of {first} bytes" if size >= 0 else f"a tree of {size} bytes is announced"
        raise LogFault(f"{path}: this log ends in its header: {said}")
    xml = data[_HEADER.size : _HEADER.size + size]
    nodes = nodes_of(xml, str(path))
    (start,) = _FIRST_STAMP.unpack_from(data, _HEADER.size + size)
    whole = first + (len(data) - first) // _RECORD.size * _RECORD.size
    damage = ""
    if whole < len(data):
        damage = (
            f"the file is cut off within a transition, {len(data) - whole} bytes after the last whole one"
        )
    history = History()
    for index, (low, high, uid, code) in enumerate(_RECORD.iter_unpack(data[first:whole])):
        if uid not in nodes or code not in STATUSES:
            what = f"status {code}" if uid in nodes else f"node {uid}"
            damage = f"the file is damaged from byte {first + index * _RECORD.size} on: there is no {what}"
            break
        history.add((start + low + (high << 32)) * NS_PER_US, uid, STATUSES[code])
    return Recording(path, xml.decode("utf-8", "replace"), start * NS_PER_US, nodes, history.changes, damage)
