"""Encode and decode the tree in the reply of Groot 1's request socket, which is a flatbuffer.

The schema is BehaviorTree.CPP 3.8's `BT_logger_generated.h`. Groot 1 reads the buffer without any check,
so every field that it reads is written: all statuses, vectors and strings, even if they are empty.

The protocol has neither paths nor the ID of the main tree. Paths follow BehaviorTree.CPP 4's rule, and the
main tree gets the name of its root node. A robot's process numbers the nodes of all its trees together; an
observed node gets its position in the tree as uid, as in Groot 1.
"""

from collections.abc import Callable, Iterable, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

from btcore_monitor.events import NODE_TYPES, ObservedNode, ObservedTree, infer_node_type
from btcore_monitor.wire.errors import ProtocolError, describe_bytes
from btcore_monitor.wire.flatbuffer import FlatbufferError, Table

if TYPE_CHECKING:
    from flatbuffers import Builder

INPUT: Final = 0
OUTPUT: Final = 1
INOUT: Final = 2

# Fields of the tables, by their numbers in the schema.
_ROOT_UID, _NODES, _MODELS = 0, 1, 2
_UID, _CHILDREN, _STATUS, _NAME, _ID, _REMAPS = 0, 1, 2, 3, 4, 5
_REMAP_PORT, _REMAP_TEXT = 0, 1
_MODEL_ID, _MODEL_TYPE, _MODEL_PORTS = 0, 1, 2
_PORT_NAME, _PORT_DIRECTION, _PORT_TYPE, _PORT_DESCRIPTION = 0, 1, 2, 3


class WireNode(NamedTuple):
    """A node. *name* is its instance name (for a SubTree: the tree's ID), *id* its registration ID.

    *ports* are pairs of a port's name and its text in the XML: inputs first, then outputs. A port that is
    both input and output has two pairs.
    """

    uid: int
    children: tuple[int, ...]
    status: int
    name: str
    id: str
    ports: tuple[tuple[str, str], ...] = ()


class WirePort(NamedTuple):
    """A port of a model. *type* is a C++ name (`void`: untyped), *direction* INPUT, OUTPUT or INOUT."""

    name: str
    direction: int
    type: str
    description: str


class WireModel(NamedTuple):
    """The model of all nodes with the registration ID *id*.

    *type* is the position of the nodes' type in NODE_TYPES, counted from 1; 0 is undefined.
    """

    id: str
    type: int
    ports: tuple[WirePort, ...] = ()


class WireTree(NamedTuple):
    """A whole tree: its nodes depth-first, the root first, and the models of all registered nodes."""

    nodes: tuple[WireNode, ...]
    models: tuple[WireModel, ...]


def decode_tree(data: bytes) -> WireTree:
    """Return the nodes and models in *data*, without a check that the nodes form one tree.

    Raises:
        ProtocolError: *data* is not a flatbuffer of this schema.
    """
    try:
        root = Table.root(data)
        nodes = tuple(map(_read_node, root.tables(_NODES)))
        return WireTree(nodes, tuple(map(_read_model, root.tables(_MODELS))))
    except FlatbufferError as error:
        raise ProtocolError(f"{error}: {describe_bytes(data)}") from None


def find_tree(frames: Sequence[bytes]) -> WireTree | None:
    """Return the tree in the reply of a Groot 1 publisher, or None if *frames* is another reply."""
    if len(frames) != 1:
        return None
    try:
        tree = decode_tree(frames[0])
    except ProtocolError:
        return None
    return tree if tree.nodes else None


def status_places(data: bytes) -> list[int]:
    """Return the byte offset of each node's status in *data*, the result of `encode_tree`.

    A server writes new statuses in place, instead of encoding the whole tree for every request.
    """
    return [node.place(_STATUS) for node in Table.root(data).tables(_NODES)]


def _read_node(table: Table) -> WireNode:
    uid = table.u16(_UID)
    return WireNode(
        uid,
        table.numbers(_CHILDREN),
        _check_range(table.i8(_STATUS), 3, f"a status of node {uid}"),
        table.text(_NAME),
        table.text(_ID),
        tuple((remap.text(_REMAP_PORT), remap.text(_REMAP_TEXT)) for remap in table.tables(_REMAPS)),
    )


def _read_model(table: Table) -> WireModel:
    id = table.text(_MODEL_ID)
    node_type = _check_range(table.i8(_MODEL_TYPE), len(NODE_TYPES), f"a type of the model '{id}'")
    return WireModel(id, node_type, tuple(map(_read_port, table.tables(_MODEL_PORTS))))


def _read_port(table: Table) -> WirePort:
    name = table.text(_PORT_NAME)
    direction = _check_range(table.i8(_PORT_DIRECTION), INOUT, f"a direction of the port '{name}'")
    return WirePort(name, direction, table.text(_PORT_TYPE), table.text(_PORT_DESCRIPTION))


def _check_range(number: int, most: int, noun: str) -> int:
    if not 0 <= number <= most:
        raise ProtocolError(f"expected {noun} from 0 to {most}, and got {number}")
    return number


def encode_tree(tree: WireTree) -> bytes:
    """Return the flatbuffer of *tree*; the first node is the root."""
    # Not at the top of the module: flatbuffers imports numpy, which a run without Groot 1 does not need.
    from flatbuffers import Builder

    builder = Builder(1024 + 128 * (len(tree.nodes) + len(tree.models)))
    # Without defaults the builder leaves out fields of value 0. Then an idle node's status has no byte that
    # status_places could find.
    builder.ForceDefaults(True)
    nodes = _add_tables(builder, [_write_node(builder, node) for node in tree.nodes])
    models = _add_tables(builder, [_write_model(builder, model) for model in tree.models])
    root_uid = tree.nodes[0].uid if tree.nodes else 0
    builder.Finish(_write_table(builder, "Haa", root_uid, nodes, models))
    return bytes(builder.Output())


def _write_node(builder: "Builder", node: WireNode) -> int:
    # Vectors and strings first: a flatbuffer's objects cannot be nested while they are written.
    children = _add_vector(builder, 2, node.children, builder.PrependUint16)
    remaps = _add_tables(
        builder, [_write_table(builder, "aa", *_add_texts(builder, *pair)) for pair in node.ports]
    )
    name, id = _add_texts(builder, node.name, node.id)
    return _write_table(builder, "Habaaa", node.uid, children, node.status, name, id, remaps)


def _write_model(builder: "Builder", model: WireModel) -> int:
    ports = _add_tables(builder, [_write_port(builder, port) for port in model.ports])
    return _write_table(builder, "aba", *_add_texts(builder, model.id), model.type, ports)


def _write_port(builder: "Builder", port: WirePort) -> int:
    name, type_name, description = _add_texts(builder, port.name, port.type, port.description)
    return _write_table(builder, "abaa", name, port.direction, type_name, description)


def _write_table(builder: "Builder", fields: str, *values: int) -> int:
    """Write a table with *values* in its fields 0, 1, … and return its offset.

    *fields* has a letter for each field, as in `struct`: H for uint16, b for int8, and a for the offset
    of a string, vector or table, which must be written before.
    """
    prepend = {
        "H": builder.PrependUint16Slot,
        "b": builder.PrependInt8Slot,
        "a": builder.PrependUOffsetTRelativeSlot,
    }
    builder.StartObject(len(fields))
    for slot, (field, value) in enumerate(zip(fields, values, strict=True)):
        # The default 0 is written, too, because of ForceDefaults.
        prepend[field](slot, value, 0)
    return int(builder.EndObject())


def _add_texts(builder: "Builder", *texts: str) -> list[int]:
    # Shared: the same IDs, ports and types occur in many nodes and models.
    return [builder.CreateSharedString(text) for text in texts]


def _add_tables(builder: "Builder", offsets: list[int]) -> int:
    return _add_vector(builder, 4, offsets, builder.PrependUOffsetTRelative)


def _add_vector(
    builder: "Builder", width: int, items: Iterable[int], prepend: Callable[[int], object]
) -> int:
    backwards = list(items)[::-1]  # a flatbuffer is built from its end to its beginning
    builder.StartVector(width, len(backwards), width)
    for item in backwards:
        prepend(item)
    return int(builder.EndVector())


class Groot1ObservedTree(NamedTuple):
    """An observed *tree* with the data of the robot's reply.

    *uids* maps the robot's uids to the uids in *tree*; *statuses* maps the uids in *tree* to the statuses.
    """

    tree: ObservedTree
    uids: dict[int, int]
    statuses: dict[int, int]


def read_groot1(tree: WireTree, tree_id: str) -> Groot1ObservedTree:
    """Convert the tree in a robot's reply to an ObservedTree, with uids in depth-first order.

    Args:
        tree: The nodes and models of the robot's reply.
        tree_id: The ID for the observed tree, 32 hexadecimal digits, since the protocol has no tree IDs.

    Raises:
        ProtocolError: The nodes do not form one tree.
    """
    ordered = _depth_first(tree)
    uids = {node.uid: place for place, (node, _) in enumerate(ordered, start=1)}
    types = {model.id: NODE_TYPES[model.type - 1] for model in tree.models if model.type}
    nodes: list[ObservedNode] = []
    subtrees = {"": ordered[0][0].name}
    subtree_below: dict[int, str] = {0: ""}
    for node, parent in ordered:
        uid, above = uids[node.uid], uids.get(parent, 0)
        node_type = types.get(node.id) or infer_node_type(len(node.children))
        subtree = subtree_below[above]
        # BehaviorTree.CPP 4 appends the uid to the path of a node without a name of its own. In version 3 a
        # SubTree node has its tree's ID as name, so it counts as a node without a name.
        path = node.name if node.name != node.id and node_type != "subtree" else f"{node.name}::{uid}"
        if subtree:
            path = f"{subtree}/{path}"
        subtree_below[uid] = subtree
        if node_type == "subtree":
            subtree_below[uid] = path
            subtrees[path] = node.name
        children = tuple(uids[child] for child in node.children)
        nodes.append(
            ObservedNode(uid, node.name, node.id, node_type, path, above, children, dict(node.ports), subtree)
        )
    statuses = {uids[node.uid]: node.status for node, _ in ordered}
    return Groot1ObservedTree(ObservedTree(tree_id, subtrees[""], tuple(nodes), subtrees), uids, statuses)


def _depth_first(tree: WireTree) -> list[tuple[WireNode, int]]:
    """Return the nodes in pre-order, each with its parent's uid (-1 for the root)."""
    if not tree.nodes:
        raise ProtocolError("expected nodes in the tree, and got none")
    by_uid = {node.uid: node for node in tree.nodes}
    if len(by_uid) != len(tree.nodes):
        raise ProtocolError(
            f"expected unique uids, and {len(tree.nodes)} nodes have {len(by_uid)} different uids"
        )
    ordered: list[tuple[WireNode, int]] = []
    waiting = [(tree.nodes[0].uid, -1)]
    while waiting:
        uid, parent = waiting.pop()
        node = by_uid.pop(uid, None)
        if node is None:
            raise ProtocolError(
                f"expected a tree, and node {parent} has node {uid} as a child that is missing or used twice"
            )
        ordered.append((node, parent))
        waiting.extend((child, uid) for child in reversed(node.children))
    if by_uid:
        raise ProtocolError(f"expected a tree, and node {next(iter(by_uid))} has no parent")
    return ordered
