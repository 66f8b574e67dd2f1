"""``.fbl``: the file of BehaviorTree.CPP 3's FileLogger, read (groot1.md §3 and §6).

A length, a flatbuffer with the tree, then twelve bytes a transition: seconds and µs since 1970, the
node's uid, its previous and its new status. Little endian, with neither a magic word nor an end.
"""

import os
import struct
from pathlib import Path
from typing import Final

from btcore.flatbuffer import FlatbufferError, Table
from btcore.logs.files import LogError, read_bytes
from btcore.logs.recording import (
    STATUSES,
    LoggedTransition,
    RecordedNode,
    Recording,
)
from btcore.status import NodeType

EXTENSION: Final = ".fbl"

_SIZE: Final = struct.Struct("<I")
_RECORD: Final = struct.Struct("<IIHbb")
_TYPES: Final = {int(kind): kind for kind in NodeType}
# Fields of the tables, by their numbers in the schema.
_TREE_NODES, _TREE_MODELS = 1, 2
_NODE_UID, _NODE_CHILDREN, _NODE_NAME, _NODE_ID, _NODE_PORTS = 0, 1, 3, 4, 5
_PORT_NAME, _PORT_TEXT = 0, 1
_MODEL_ID, _MODEL_TYPE = 0, 1


def read_fbl(path: str | os.PathLike[str]) -> Recording:
    """What the file *path* tells, up to where it was cut off or damaged, if it was.

    Paths are made by BehaviorTree.CPP 4's rule (version 3 has none); the order of nodes is the file's.
    Raises LogError if it can't be read, is no such log, or ends within the tree.
    """
    path = Path(path)
    data = read_bytes(path)
    size = _SIZE.unpack_from(data)[0] if len(data) >= _SIZE.size else 0
    first = _SIZE.size + size
    if not size or first > len(data):
        raise LogError(
            f"{path}: this isn't a {EXTENSION}, or it ends within the tree: "
            f"it begins with the length of a tree, {size}, and has {len(data)} bytes"
        )
    try:
        nodes = _nodes(Table.root(data[_SIZE.size : first]))
    except FlatbufferError as fault:
        raise LogError(f"{path}: this isn't a {EXTENSION}, the tree in it makes no sense: {fault}") from None
    whole = first + (len(data) - first) // _RECORD.size * _RECORD.size
    damage = ""
    if whole < len(data):
        damage = (
            f"the file is cut off within a transition, {len(data) - whole} bytes after the last whole one"
        )
    changes: list[LoggedTransition] = []
    for index, (seconds, micros, uid, before, after) in enumerate(_RECORD.iter_unpack(data[first:whole])):
        if uid not in nodes or before not in STATUSES or after not in STATUSES:
            what = f"status {before} or {after}" if uid in nodes else f"node {uid}"
            damage = f"the file is damaged from byte {first + index * _RECORD.size} on: there is no {what}"
            break
        stamp = seconds * 1_000_000_000 + micros * 1_000
        changes.append(LoggedTransition(stamp, uid, STATUSES[before], STATUSES[after]))
    start = changes[0].stamp if changes else 0
    return Recording(path, "", start, nodes, changes, damage)


def _nodes(tree: Table) -> dict[int, RecordedNode]:
    types = {model.text(_MODEL_ID): model.i8(_MODEL_TYPE) for model in tree.tables(_TREE_MODELS)}
    prefixes: dict[int, str] = {}
    found: dict[int, RecordedNode] = {}
    # A parent stands before its children, so their prefix is known when they come.
    for table in tree.tables(_TREE_NODES):
        uid, name, id = table.u16(_NODE_UID), table.text(_NODE_NAME), table.text(_NODE_ID)
        kind = _TYPES.get(types.get(id, 0), NodeType.UNDEFINED)
        prefix = prefixes.get(uid, "")
        nameless = name == id or kind is NodeType.SUBTREE
        path = f"{prefix}{name}::{uid}" if nameless else prefix + name
        children = table.numbers(_NODE_CHILDREN)
        inside = f"{path}/" if kind is NodeType.SUBTREE else prefix
        prefixes.update(dict.fromkeys(children, inside))
        ports = {port.text(_PORT_NAME): port.text(_PORT_TEXT) for port in table.tables(_NODE_PORTS)}
        found[uid] = RecordedNode(uid, name, id, kind, path, children, ports)
    return found
