"""The tree as Groot 1 gets it from the request socket: a flatbuffer ⇄ nodes and models.

The schema is BehaviorTree.CPP 3.8's ``BT_logger_generated.h``. Groot 1 reads it without any check, so
everything that it looks at is written: each vector and each string, even an empty one, and each status.
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
    """One node. *name* is its own (a SubTree's: the tree's ID), *id* what it is registered as.

    *ports* are pairs of a port and its text in the XML: inputs first, then outputs, so that a port which
    is both comes twice.
    """

    uid: int
    children: tuple[int, ...]
    status: int
    name: str
    id: str
    ports: tuple[tuple[str, str], ...] = ()


class WirePort(NamedTuple):
    """One port of a model. *type* is a C++ name (``void``: untyped), *direction* INPUT, OUTPUT or INOUT."""

    name: str
    direction: int
    type: str
    description: str


class WireModel(NamedTuple):
    """What is known of all nodes that are registered as *id*; *type* is ACTION, CONDITION, …"""

    id: str
    type: int
    ports: tuple[WirePort, ...] = ()


class WireTree(NamedTuple):
    """A whole tree: its nodes depth-first, the root first, and the models of all that may be in it."""

    nodes: tuple[WireNode, ...]
    models: tuple[WireModel, ...]


def decode_tree(data: bytes) -> WireTree:
    """The nodes and models in *data*; whether they are one tree is not looked at.

    Raises :class:`ProtocolError` if *data* is something else.
    """
    try:
        root = Table.root(data)
        nodes = tuple(map(_read_node, root.tables(_NODES)))
        return WireTree(nodes, tuple(map(_read_model, root.tables(_MODELS))))
    except FlatbufferError as error:
        raise ProtocolError(f"{error}: {describe_bytes(data)}") from None


def status_places(data: bytes) -> list[int]:
    """At which byte of *data*, that :func:`encode_tree` wrote, the status of each node is, in their order."""
    return [node.place(_STATUS) for node in Table.root(data).tables(_NODES)]


def _read_node(table: Table) -> WireNode:
    uid = table.u16(_UID)
    return WireNode(
        uid,
        table.numbers(_CHILDREN),
        _among(table.i8(_STATUS), 3, f"a status of node {uid}"),
        table.text(_NAME),
        table.text(_ID),
        tuple((one.text(_REMAP_PORT), one.text(_REMAP_TEXT)) for one in table.tables(_REMAPS)),
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
    """The flatbuffer of *tree*; the first node is the root."""
    # Here, because it takes numpy in, which a run without Groot 1 needn't wait for.
    from flatbuffers import Builder

    builder = Builder(1024 + 128 * (len(tree.nodes) + len(tree.models)))
    builder.ForceDefaults(True)
    nodes = _tables(builder, [_write_node(builder, one) for one in tree.nodes])
    models = _tables(builder, [_write_model(builder, one) for one in tree.models])
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
    port, text = (builder.CreateSharedString(one) for one in pair)
    builder.StartObject(2)
    builder.PrependUOffsetTRelativeSlot(_REMAP_PORT, port, 0)
    builder.PrependUOffsetTRelativeSlot(_REMAP_TEXT, text, 0)
    return int(builder.EndObject())


def _write_model(builder: "Builder", model: WireModel) -> int:
    ports = _tables(builder, [_write_port(builder, one) for one in model.ports])
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
    backwards = list(items)[::-1]  # flatbuffers grow from their end
    builder.StartVector(width, len(backwards), width)
    for item in backwards:
        prepend(item)
    return int(builder.EndVector())
