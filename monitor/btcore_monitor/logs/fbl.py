"""Reading `.fbl`, the file of BehaviorTree.CPP 3's FileLogger.

The format is that of src/loggers/bt_file_logger.cpp in version 3. All numbers are little-endian. The file
begins with a length and a flatbuffer with the tree. Each transition has twelve bytes: seconds and µs since
1970 (32 bits each), the node's UID (16 bits), its previous and its new status (8 bits each). There is neither
a magic word nor an end mark.
"""

import os
import struct
from pathlib import Path
from typing import Final

from btcore.logs.files import LogError, read_bytes
from btcore.logs.formats import LogFormat
from btcore.logs.recording import STATUSES, LoggedTransition, RecordedNode, Recording, truncation_message
from btcore.status import NodeType
from btcore_monitor.wire.flatbuffer import FlatbufferError, Table

EXTENSION: Final = ".fbl"

_SIZE: Final = struct.Struct("<I")
_RECORD: Final = struct.Struct("<IIHbb")
_TYPES: Final = {int(node_type): node_type for node_type in NodeType}
# Field numbers of the tables in BehaviorTree.CPP 3's flatbuffer schema, BT_logger.fbs.
_TREE_NODES, _TREE_MODELS = 1, 2
_NODE_UID, _NODE_CHILDREN, _NODE_NAME, _NODE_ID, _NODE_PORTS = 0, 1, 3, 4, 5
_PORT_NAME, _PORT_TEXT = 0, 1
_MODEL_ID, _MODEL_TYPE = 0, 1


def read_fbl(path: str | os.PathLike[str]) -> Recording:
    """Read a `.fbl` file. A truncated or damaged file is read up to the damage.

    The paths of the nodes follow the rule of BehaviorTree.CPP 4, since version 3 has no paths. The order of
    the nodes is that of the file.

    Returns:
        The recording. Its `warnings` describe damage.

    Raises:
        LogError: The file cannot be read, is not a `.fbl` file, or ends within the tree.
    """
    path = Path(path)
    data = read_bytes(path)
    size = _SIZE.unpack_from(data)[0] if len(data) >= _SIZE.size else 0
    first = _SIZE.size + size
    if not size or first > len(data):
        raise LogError(
            f"{path}: this is not a {EXTENSION} file, or it ends within the tree: "
            f"the length of the tree is {size}, and the file has {len(data)} bytes"
        )
    try:
        nodes = _nodes(Table.root(data[_SIZE.size : first]))
    except FlatbufferError as error:
        raise LogError(f"{path}: this is not a {EXTENSION} file, its tree is invalid: {error}") from None
    complete = first + (len(data) - first) // _RECORD.size * _RECORD.size
    damage = truncation_message(len(data) - complete)
    changes: list[LoggedTransition] = []
    for index, (seconds, micros, uid, before, after) in enumerate(_RECORD.iter_unpack(data[first:complete])):
        if uid not in nodes or before not in STATUSES or after not in STATUSES:
            unknown = f"status {before} or {after}" if uid in nodes else f"node {uid}"
            damage = f"the file is damaged from byte {first + index * _RECORD.size} on: unknown {unknown}"
            break
        stamp = seconds * 1_000_000_000 + micros * 1_000
        changes.append(LoggedTransition(stamp, uid, STATUSES[before], STATUSES[after]))
    start = changes[0].stamp if changes else 0
    return Recording(path, "", start, nodes, changes, damage)


def _nodes(tree: Table) -> dict[int, RecordedNode]:
    types = {model.text(_MODEL_ID): model.i8(_MODEL_TYPE) for model in tree.tables(_TREE_MODELS)}
    prefixes: dict[int, str] = {}
    nodes: dict[int, RecordedNode] = {}
    # The file lists parents before their children, so the prefix of a child's path is known in time.
    for table in tree.tables(_TREE_NODES):
        uid, name, id = table.u16(_NODE_UID), table.text(_NODE_NAME), table.text(_NODE_ID)
        node_type = _TYPES.get(types.get(id, 0), NodeType.UNDEFINED)
        prefix = prefixes.get(uid, "")
        nameless = name == id or node_type is NodeType.SUBTREE
        path = f"{prefix}{name}::{uid}" if nameless else prefix + name
        children = table.numbers(_NODE_CHILDREN)
        inside = f"{path}/" if node_type is NodeType.SUBTREE else prefix
        prefixes.update(dict.fromkeys(children, inside))
        ports = {port.text(_PORT_NAME): port.text(_PORT_TEXT) for port in table.tables(_NODE_PORTS)}
        nodes[uid] = RecordedNode(uid, name, id, node_type, path, children, ports)
    return nodes


FORMAT: Final = LogFormat(None, read_fbl)
