"""The tree in the reply of Groot 1's request socket: a flatbuffer ⇄ nodes and models.

The schema is BehaviorTree.CPP 3.8's ``BT_logger_generated.h``. Groot 1 reads the buffer without any check,
so every field that it reads is written: all statuses, vectors and strings, even if they are empty.
"""

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

from btcore.flatbuffer import FlatbufferError, Table
from btcore_monitor.wire.errors import ProtocolError, describe_bytes

if TYPE_CHECKING:
    from flatbuffers import Builder

ACTION: Final = 1
CONDITION: Final = 2
CONTROL: Final = 3
DECORATOR: Final = 4
SUBTREE: Final = 5

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
    both has two pairs.
    """

    uid: int
    children: tuple[int, ...]
    status: int
    name: str
    id: str
    ports: tuple[tuple[str, str], ...] = ()


class WirePort(NamedTuple):
    """A port of a model. *type* is a C++ name (``void``: untyped), *direction* INPUT, OUTPUT or INOUT."""

    name: str
    direction: int
    type: str
    description: str


class WireModel(NamedTuple):
    """The model of all nodes with the registration ID *id*. *type* is ACTION, CONDITION, …"""

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


def status_places(data: bytes) -> list[int]:
    """Return the byte offset of each node's status in *data*, the result of :func:`encode_tree`.

    A server writes new statuses in place, instead of encoding the whole tree for every request.
    """
    return [node.place(_STATUS) for node in Table.root(data).tables(_NODES)]


def _read_node(table: Table) -> WireNode:
    uid = table.u16(_UID)
    return WireNode(
        uid,
        table.numbers(_CHILDREN),
        _among(table.i8(_STATUS), 3, f"a status of node {uid}"),
        table.text(_NAME),
        table.text(_ID),
        tuple((remap.text(_REMAP_PORT), remap.text(_REMAP_TEXT)) for remap in table.tables(_REMAPS)),
    )


def _read_model(table: Table) -> WireModel:
    id = table.text(_MODEL_ID)
    kind = _among(table.i8(_MODEL_TYPE), SUBTREE, f"a type of the model '{id}'")
    return WireModel(id, kind, tuple(map(_read_port, table.tables(_MODEL_PORTS))))


def _read_port(table: Table) -> WirePort:
    name = table.text(_PORT_NAME)
    direction = _among(table.i8(_PORT_DIRECTION), INOUT, f"a direction of the port '{name}'")
    return WirePort(name, direction, table.text(_PORT_TYPE), table.text(_PORT_DESCRIPTION))


def _among(number: int, most: int, what: str) -> int:
    if not 0 <= number <= most:
        raise ProtocolError(f"expected {what} from 0 to {most}, and got {number}")
    return number


def encode_tree(tree: WireTree) -> bytes:
    """Return the flatbuffer of *tree*; the first node is the root."""
    # Not at the top of the module: flatbuffers imports numpy, which a run without Groot 1 does not need.
    from flatbuffers import Builder

    builder = Builder(1024 + 128 * (len(tree.nodes) + len(tree.models)))
    # Without defaults the builder leaves out fields of value 0. Then an idle node's status has no byte that
    # status_places could find.
    builder.ForceDefaults(True)
    nodes = _tables(builder, [_write_node(builder, node) for node in tree.nodes])
    models = _tables(builder, [_write_model(builder, model) for model in tree.models])
    builder.StartObject(3)
    builder.PrependUint16Slot(_ROOT_UID, tree.nodes[0].uid if tree.nodes else 0, 0)
    builder.PrependUOffsetTRelativeSlot(_NODES, nodes, 0)
    builder.PrependUOffsetTRelativeSlot(_MODELS, models, 0)
    builder.Finish(builder.EndObject())
    return bytes(builder.Output())


def _write_node(builder: "Builder", node: WireNode) -> int:
    children = _vector(builder, 2, node.children, builder.PrependUint16)
    remaps = _tables(builder, [_write_texts(builder, pair) for pair in node.ports])
    name, id = builder.CreateSharedString(node.name), builder.CreateSharedString(node.id)
    builder.StartObject(6)
    builder.PrependUint16Slot(_UID, node.uid, 0)
    builder.PrependUOffsetTRelativeSlot(_CHILDREN, children, 0)
    builder.PrependInt8Slot(_STATUS, node.status, 0)
    builder.PrependUOffsetTRelativeSlot(_NAME, name, 0)
    builder.PrependUOffsetTRelativeSlot(_ID, id, 0)
    builder.PrependUOffsetTRelativeSlot(_REMAPS, remaps, 0)
    return int(builder.EndObject())


def _write_texts(builder: "Builder", pair: tuple[str, str]) -> int:
    port, text = (builder.CreateSharedString(item) for item in pair)
    builder.StartObject(2)
    builder.PrependUOffsetTRelativeSlot(_REMAP_PORT, port, 0)
    builder.PrependUOffsetTRelativeSlot(_REMAP_TEXT, text, 0)
    return int(builder.EndObject())


def _write_model(builder: "Builder", model: WireModel) -> int:
    ports = _tables(builder, [_write_port(builder, port) for port in model.ports])
    id = builder.CreateSharedString(model.id)
    builder.StartObject(3)
    builder.PrependUOffsetTRelativeSlot(_MODEL_ID, id, 0)
    builder.PrependInt8Slot(_MODEL_TYPE, model.type, 0)
    builder.PrependUOffsetTRelativeSlot(_MODEL_PORTS, ports, 0)
    return int(builder.EndObject())


def _write_port(builder: "Builder", port: WirePort) -> int:
    name, kind = builder.CreateSharedString(port.name), builder.CreateSharedString(port.type)
    description = builder.CreateSharedString(port.description)
    builder.StartObject(4)
    builder.PrependUOffsetTRelativeSlot(_PORT_NAME, name, 0)
    builder.PrependInt8Slot(_PORT_DIRECTION, port.direction, 0)
    builder.PrependUOffsetTRelativeSlot(_PORT_TYPE, kind, 0)
    builder.PrependUOffsetTRelativeSlot(_PORT_DESCRIPTION, description, 0)
    return int(builder.EndObject())


def _tables(builder: "Builder", offsets: list[int]) -> int:
    return _vector(builder, 4, offsets, builder.PrependUOffsetTRelative)


def _vector(builder: "Builder", width: int, items: Iterable[int], prepend: Callable[[int], object]) -> int:
    backwards = list(items)[::-1]  # a flatbuffer is built from its end to its beginning
    builder.StartVector(width, len(backwards), width)
    for item in backwards:
        prepend(item)
    return int(builder.EndVector())
