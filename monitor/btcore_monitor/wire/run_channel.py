"""Encode and decode the run channel, btcore's own protocol for all data of a run, without sockets.

The run channel also carries data that Groot 2's protocol does not have: ticks, exceptions, the
blackboards after each tick that changes them, and the scene (the robot, its sensors and its world).

A publisher's XPUB socket sends two frames: a topic, and a MessagePack map with `v` (1), `kind` and the
fields of the message. Under the topic `stream` it sends `PieceMessage`, which holds messages of the
stream, each encoded separately. Each message has the robot's `tree_id` and a `seq` that counts from 1
without gaps, so a client notices missing messages. When the robot replaces its tree, the topic also carries
the `TreeMessage` and `StaticSceneMessage` of the new tree. Under `heartbeat` the publisher
sends heartbeats; a heartbeat of an unknown tree makes a client request that tree.

A client sends a request by subscribing to a topic, so a SUB socket is enough. The last part of the topic is
a token that the client chooses, and the reply has the same topic:

====================  ====================================================================
`request/tree/TOKEN`  `TreeMessage`, `StaticSceneMessage`
`request/N/TOKEN`     `PieceMessage`: the stream from number N to the number in the field `last`
`presence/TOKEN`      no reply; counts a client, for which a run that begins or ends waits
====================  ====================================================================

Stamps are ns of the tree's clock, `wall` is ns since the epoch, lengths are in metres, quaternions are
x y z w, and every pose names its frame.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Final, NamedTuple, TypeGuard, TypeVar, get_origin

import msgpack

from btcore_monitor.wire import scene_schema
from btcore_monitor.wire.errors import ProtocolError, describe_bytes, describe_value
from btcore_monitor.wire.msgpack_values import check_boards, check_depth, to_portable, unpack_msgpack
from btcore_scene import MovingScene, StaticScene

VERSION: Final = 1
PORT_OFFSET: Final = 2
"""The channel's port is the port of requests plus this number."""

HEARTBEAT_INTERVAL_S: Final = 0.5
"""Seconds (wall clock) between two heartbeats."""

KEEPALIVE: Final = {
    "TCP_KEEPALIVE": 1,
    "TCP_KEEPALIVE_IDLE": 10,
    "TCP_KEEPALIVE_INTVL": 5,
    "TCP_KEEPALIVE_CNT": 3,
}
"""Options of a client's socket: the connection to a vanished machine ends after 10 + 3 * 5 = 25 s. The
robot's side has the same values (serve/gateway_process.py).

ZeroMQ's own heartbeat (`ZMQ_HEARTBEAT_IVL`) would be faster, but it disconnects a client that reads slowly.
"""

STREAM_TOPIC: Final = b"stream"
"""The topic of the stream's messages."""

HEARTBEAT_TOPIC: Final = b"heartbeat"
"""The topic of heartbeats."""

REQUEST_TOPIC, PRESENCE_TOPIC, TREE_REQUEST = b"request", b"presence", b"tree"
"""Parts of the topics that clients subscribe to; serve/gateway_process.py repeats the first."""

ANNOUNCEMENT: Final = b"<!-- run channel -->"
"""The end of the tree that a robot with a run channel sends by the protocols of Groot 2 and Groot 1.

Readers of XML ignore a comment, and readers of flatbuffers ignore what follows. A client that does not know
whether there is a run channel would switch to it in the middle of a run, if the machine is busy.
"""


@dataclass(frozen=True, slots=True)
class Message:
    """A message about the tree *tree_id*."""

    kind: ClassVar[str] = ""
    tree_id: str


@dataclass(frozen=True, slots=True)
class StreamMessage(Message):
    """Message number *seq* of its tree, at *stamp* (ns, tree's clock) and *wall* (ns since the epoch)."""

    seq: int
    stamp: int
    wall: int


@dataclass(frozen=True, slots=True)
class TreeMessage(Message):
    """The tree: Groot 2's FULLTREE *xml*, and the state of the stream.

    *oldest* is the number of the first message that the robot can send again, *latest* the number of the
    newest message (0: none yet). *statuses* maps uids to the statuses just before *oldest*, at *stamp* and
    *wall*.
    """

    kind: ClassVar[str] = "tree"
    stamp: int
    wall: int
    xml: bytes
    oldest: int
    latest: int
    statuses: dict[int, int]


@dataclass(frozen=True, slots=True)
class StaticSceneMessage(Message):
    """The part of the scene that does not change during a run."""

    kind: ClassVar[str] = "static"
    data: StaticScene


class TransitionRow(NamedTuple):
    """A transition of the node *uid* in a `TransitionsMessage`."""

    stamp: int
    wall: int
    tick: int
    uid: int
    previous: int
    status: int


@dataclass(frozen=True, slots=True)
class TransitionsMessage(StreamMessage):
    """Transitions in their order, and, only if *ended*, the end of tick number *tick* with its *status*.

    Transition i has the number `first + i`. The numbers of a tree's transitions count from 1 without gaps.
    *duration* is the tick's wall time in ns.
    """

    kind: ClassVar[str] = "transitions"
    tick: int
    duration: int
    status: int
    ended: bool
    first: int
    transitions: list[TransitionRow]


@dataclass(frozen=True, slots=True)
class MovingSceneMessage(StreamMessage):
    """The part of the scene that moved or changed."""

    kind: ClassVar[str] = "moving"
    data: MovingScene


@dataclass(frozen=True, slots=True)
class BlackboardMessage(StreamMessage):
    """All blackboards after a tick that wrote an entry: subtree path (`""`: main) → key → value."""

    kind: ClassVar[str] = "blackboard"
    boards: dict[str, Any]


@dataclass(frozen=True, slots=True)
class ExceptionMessage(StreamMessage):
    """An exception of a node: the node's full *path*, and the error message."""

    kind: ClassVar[str] = "exception"
    path: str
    message: str


@dataclass(frozen=True, slots=True)
class EndMessage(StreamMessage):
    """The last message: the robot stops publishing. *status* is the tree's status at the end.

    *dropped* counts transitions that the robot itself lost because its queue was full.
    """

    kind: ClassVar[str] = "end"
    status: int
    dropped: int


@dataclass(frozen=True, slots=True)
class HeartbeatMessage(Message):
    """A heartbeat.

    *latest* is the number of the stream's newest message, so a client notices if the last messages were lost.
    """

    kind: ClassVar[str] = "heartbeat"
    latest: int


@dataclass(frozen=True, slots=True)
class PieceMessage(Message):
    """A piece of the stream, past or present: its messages from *first* to *last*, encoded separately.

    Messages with a number in this range that are not in *messages* are lost and cannot be requested again.
    *latest* is the number of the stream's newest message; if it is larger than *last*, the client can request
    more.
    """

    kind: ClassVar[str] = "piece"
    first: int
    last: int
    latest: int
    messages: list[bytes]


@dataclass(frozen=True, slots=True)
class UnknownMessage(Message):
    """A message of a kind that only a newer publisher has; *seq* is 0 if it is not part of the stream."""

    seq: int


_MESSAGE_CLASSES: Final[dict[str, type[Any]]] = {
    message.kind: message
    for message in (
        TreeMessage,
        StaticSceneMessage,
        TransitionsMessage,
        MovingSceneMessage,
        BlackboardMessage,
        ExceptionMessage,
        EndMessage,
        HeartbeatMessage,
        PieceMessage,
    )
}
_FIELDS: Final[Mapping[str, Sequence[tuple[str, Any]]]] = {
    kind: [(field.name, get_origin(field.type) or field.type) for field in fields(message)]
    for kind, message in _MESSAGE_CLASSES.items()
}
"""Names and classes of the fields, by the kind of message. Of a list or dict, only the class is checked."""
_STATUSES: Final = range(5)
_INT_END: Final = 1 << 62
_T = TypeVar("_T")


def encode(message: Message) -> bytes:
    """Return *message* as MessagePack.

    Integers must fit into 64 bits. Objects that MessagePack does not support are converted to portable values
    (`btcore_monitor.wire.msgpack_values`).
    """
    # `kind` is a class variable, so it is not among the fields.
    kind = message.kind
    values: dict[str, Any] = {"v": VERSION, "kind": kind}
    for name, _ in _FIELDS[kind]:
        values[name] = getattr(message, name)
    if isinstance(message, TreeMessage):
        # pairs, because many MessagePack readers accept only text as keys of a map
        values["statuses"] = list(message.statuses.items())
    elif isinstance(message, StaticSceneMessage | MovingSceneMessage):
        values["data"] = scene_schema.pack_scene(message.data)
    encoded: bytes = msgpack.packb(values, default=to_portable, unicode_errors="replace")
    return encoded


def decode(data: bytes) -> Message:
    """Return the message in *data*.

    Raises:
        ProtocolError: *data* is not a message of the run channel, or of a newer version.
    """
    values = unpack_msgpack(data)
    if not isinstance(values, dict) or "v" not in values:
        raise ProtocolError(f"expected a message of the run channel, and got {describe_bytes(data)}")
    version = values["v"]
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ProtocolError(f"expected a version of the run channel, and got {describe_value(version)}")
    if version > VERSION:
        raise ProtocolError(
            f"the robot uses version {version} of the run channel, and this monitor supports up to version "
            f"{VERSION}: update btcore on this machine"
        )
    kind = values.get("kind")
    if not isinstance(kind, str):
        raise ProtocolError(f"expected the kind of a message, and got {describe_value(kind)}")
    # A message of a newer publisher still counts in the numbers of the stream.
    if kind not in _MESSAGE_CLASSES:
        seq = values.get("seq")
        return UnknownMessage(_read_field(str, values, "tree_id", kind), seq if _is_int(seq) else 0)
    if kind == TreeMessage.kind:
        values["statuses"] = _read_pairs(values)
    elif kind == TransitionsMessage.kind:
        values["transitions"] = _read_rows(values)
    elif kind == BlackboardMessage.kind:
        values["boards"] = check_boards(_read_field(dict, values, "boards", kind))
    elif kind in scene_schema.SCENES:
        check_depth(values)
        values["data"] = scene_schema.unpack_scene(_read_field(dict, values, "data", kind), kind)
    message: Message = _MESSAGE_CLASSES[kind](
        *(_read_field(type_, values, name, kind) for name, type_ in _FIELDS[kind])
    )
    if isinstance(message, PieceMessage) and not all(isinstance(data, bytes) for data in message.messages):
        raise ProtocolError("expected messages as bytes in a 'piece' message")
    return message


def _read_field(type_: type[_T], values: Mapping[str, Any], name: str, kind: str) -> _T:
    value = values.get(name)
    if not isinstance(value, type_) or (type_ is int and not _is_int(value)):
        got = "nothing" if name not in values else describe_value(value)
        raise ProtocolError(f"expected '{name}' of a '{kind}' message to be {type_.__name__}, and got {got}")
    if name == "status" and value not in _STATUSES:
        raise ProtocolError(f"expected 'status' of a '{kind}' message from 0 to 4, and got {value}")
    return value


def _is_int(value: object) -> TypeGuard[int]:
    """Return whether *value* is an integer of at most 62 bits, so that sums fit into 64 bits."""
    # bool is a subclass of int in Python, but another type in MessagePack.
    return isinstance(value, int) and not isinstance(value, bool) and -_INT_END < value < _INT_END


def _read_pairs(values: Mapping[str, Any]) -> dict[int, int]:
    statuses = {}
    for pair in _read_field(list, values, "statuses", "tree"):
        if (
            not (isinstance(pair, list) and len(pair) == 2 and _is_int(pair[0]) and _is_int(pair[1]))
            or pair[1] not in _STATUSES
        ):
            raise ProtocolError("expected [uid, status] in 'statuses' of a 'tree' message")
        statuses[pair[0]] = pair[1]
    return statuses


def _read_rows(values: Mapping[str, Any]) -> list[TransitionRow]:
    rows = []
    for numbers in _read_field(list, values, "transitions", TransitionsMessage.kind):
        if not (isinstance(numbers, list) and len(numbers) == 6 and all(map(_is_int, numbers))):
            raise ProtocolError("expected six integers in a transition")
        row = TransitionRow(*numbers)
        if row.previous not in _STATUSES or row.status not in _STATUSES:
            raise ProtocolError(
                f"expected statuses 0–4 in a transition, and got {row.previous} and {row.status}"
            )
        rows.append(row)
    return rows
