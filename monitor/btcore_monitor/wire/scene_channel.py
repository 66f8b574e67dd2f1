"""The scene channel: what Groot 2's protocol has no words for. Messages ⇄ bytes, no sockets.

A publisher's XPUB socket sends two frames: a topic and a MessagePack map with ``v`` (1), ``kind``
and the message's fields. Under the topic ``stream`` it sends :class:`PieceMessage`, which holds
messages of the stream, each encoded by itself; each has the robot's ``tree_id`` and a ``seq`` that
counts from 1 without holes, so a client sees what it missed; and, when another tree takes the place of
the one before, its :class:`TreeMessage` and :class:`StaticMessage`. Under ``alive`` come signs of life;
one of a tree that a client doesn't know tells it to ask.

A client asks by subscribing, so that any SUB socket will do; the last part of the topic is the
client's own token, and the answer comes back under that very topic:

=====================  ================================================================
``again/tree/TOKEN``   :class:`TreeMessage`, :class:`StaticMessage`
``again/N/TOKEN``      :class:`PieceMessage`: the stream from number N on; ask on after its end
``here/TOKEN``         no answer; at its end the robot waits a moment while this is held
=====================  ================================================================

Stamps are ns of the tree's clock, ``wall`` is ns since the epoch, lengths are metres, quaternions
x y z w, and every pose names its frame.
"""

from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, ClassVar, Final, TypeVar

import msgpack

from btcore_monitor.wire import scene_schema
from btcore_monitor.wire.errors import ProtocolError, describe_bytes
from btcore_monitor.wire.msgpack_values import to_portable, unpack_msgpack
from btcore_scene import MovingScene, StaticScene

VERSION: Final = 1
PORT_OFFSET: Final = 2
"""The channel's port is the Groot 2 port plus this."""

ALIVE_EVERY: Final = 0.5
"""Seconds (wall clock) between two signs of life."""

KEEPALIVE: Final = {
    "TCP_KEEPALIVE": 1,
    "TCP_KEEPALIVE_IDLE": 10,
    "TCP_KEEPALIVE_INTVL": 5,
    "TCP_KEEPALIVE_CNT": 3,
}
"""Options of both sides' sockets: a peer whose machine vanished is let go after 25 s.

ZMQ's own heartbeat would do it sooner, but it takes a client that reads slowly for a dead one.
"""

STREAM: Final = b"stream"
"""The topic of what happens."""

ALIVE: Final = b"alive"
"""The topic of signs of life."""


@dataclass(frozen=True, slots=True)
class Message:
    """Anything said about the tree *tree_id*."""

    kind: ClassVar[str] = ""
    tree_id: str


@dataclass(frozen=True, slots=True)
class StreamMessage(Message):
    """Something that happened, the message number *seq* of its tree, at *stamp* and *wall*."""

    seq: int
    stamp: int
    wall: int


@dataclass(frozen=True, slots=True)
class TreeMessage(Message):
    """The tree: Groot 2's FULLTREE *xml*, and where the stream stands.

    *oldest* is the first message that can still be re-sent, *latest* the newest one (0: none
    yet); *statuses* are uid → status just before *oldest*, *stamp* and *wall* the time of that.
    """

    kind: ClassVar[str] = "tree"
    stamp: int
    wall: int
    xml: bytes
    oldest: int
    latest: int
    statuses: dict[int, int]


@dataclass(frozen=True, slots=True)
class StaticMessage(Message):
    """What does not change during a run."""

    kind: ClassVar[str] = "static"
    data: StaticScene


@dataclass(frozen=True, slots=True)
class TicksMessage(StreamMessage):
    """Transitions in their order, and, if *ended*, the end of the tick number *tick*.

    Transition i has the number ``first + i`` and is (stamp, wall, tick, uid, previous, status);
    a robot's transitions count from 1 without holes. *duration* is the tick's wall time in ns.
    """

    kind: ClassVar[str] = "ticks"
    tick: int
    duration: int
    status: int
    ended: bool
    first: int
    transitions: list[list[int]]


@dataclass(frozen=True, slots=True)
class MovingMessage(StreamMessage):
    """What moved or changed."""

    kind: ClassVar[str] = "moving"
    data: MovingScene


@dataclass(frozen=True, slots=True)
class BlackboardMessage(StreamMessage):
    """All blackboards after a tick that wrote one: subtree path (``""``: main) → key → value."""

    kind: ClassVar[str] = "blackboard"
    boards: dict[str, Any]


@dataclass(frozen=True, slots=True)
class RaisedMessage(StreamMessage):
    """A node raised: its full *path*, and the sentence."""

    kind: ClassVar[str] = "raised"
    path: str
    message: str


@dataclass(frozen=True, slots=True)
class EndMessage(StreamMessage):
    """The last message: the robot stops publishing. *status* is that of the last tick.

    *dropped* counts transitions that the robot itself lost because it had no room for them.
    """

    kind: ClassVar[str] = "end"
    status: int
    dropped: int


@dataclass(frozen=True, slots=True)
class AliveMessage(Message):
    """A sign of life; *latest* is the newest number of the stream, so a lost tail shows."""

    kind: ClassVar[str] = "alive"
    latest: int


@dataclass(frozen=True, slots=True)
class PieceMessage(Message):
    """A piece of the stream, past or present: its messages from *first* to *last*, encoded one by one.

    Numbers in that range that are not among *messages* are lost for good. *latest* is the newest
    number of the stream: there is more to ask for if it is larger than *last*.
    """

    kind: ClassVar[str] = "piece"
    first: int
    last: int
    latest: int
    messages: list[bytes]


@dataclass(frozen=True, slots=True)
class UnknownMessage(Message):
    """A kind that a newer publisher of the same version has; *seq* is 0 if it is not of the stream."""

    seq: int


_KINDS: Final[dict[str, type[Any]]] = {
    one.kind: one
    for one in (
        TreeMessage,
        StaticMessage,
        TicksMessage,
        MovingMessage,
        BlackboardMessage,
        RaisedMessage,
        EndMessage,
        AliveMessage,
        PieceMessage,
    )
}
_TYPES: Final[dict[Any, type]] = {
    int: int,
    str: str,
    bool: bool,
    bytes: bytes,
    dict[str, Any]: dict,
    dict[int, int]: dict,
    list[bytes]: list,
    list[list[int]]: list,
    StaticScene: StaticScene,
    MovingScene: MovingScene,
}
_FIELDS: Final = {
    kind: tuple((one.name, _TYPES[one.type]) for one in fields(message)) for kind, message in _KINDS.items()
}
_T = TypeVar("_T")


def encode(message: Message) -> bytes:
    """*message* as MessagePack. Its data must be portable (:mod:`btcore_monitor.wire.msgpack_values`)."""
    kind = message.kind
    whole: dict[str, Any] = {"v": VERSION, "kind": kind}
    for name, _ in _FIELDS[kind]:
        whole[name] = getattr(message, name)
    if isinstance(message, TreeMessage):
        whole["statuses"] = list(message.statuses.items())
    elif isinstance(message, StaticMessage | MovingMessage):
        whole["data"] = scene_schema.pack_scene(message.data)
    encoded: bytes = msgpack.packb(whole, default=to_portable, unicode_errors="replace")
    return encoded


def decode(data: bytes) -> Message:
    """The message in *data*; raises :class:`ProtocolError` with what was expected and what came."""
    whole = unpack_msgpack(data)
    if not isinstance(whole, dict) or "v" not in whole:
        raise ProtocolError(f"expected a message of the scene channel, and got {describe_bytes(data)}")
    version = whole["v"]
    if not isinstance(version, int) or isinstance(version, bool) or version < 1:
        raise ProtocolError(f"expected a version of the scene channel, and got {version!r}")
    if version > VERSION:
        raise ProtocolError(
            f"the robot speaks version {version} of the scene channel, and this monitor understands up to "
            f"{VERSION}: update btcore here"
        )
    kind = whole.get("kind")
    if not isinstance(kind, str):
        raise ProtocolError(f"expected the kind of a message, and got {kind!r}")
    if kind not in _KINDS:
        return UnknownMessage(
            _as(str, whole, "tree_id", kind), whole["seq"] if _is_int(whole.get("seq")) else 0
        )
    if kind == TreeMessage.kind:
        whole["statuses"] = _pairs(whole)
    elif kind in scene_schema.SCENES:
        whole["data"] = scene_schema.unpack_scene(_as(dict, whole, "data", kind), kind)
    message: Message = _KINDS[kind](*(_as(wanted, whole, name, kind) for name, wanted in _FIELDS[kind]))
    if isinstance(message, TicksMessage):
        _check_rows(message.transitions)
    elif isinstance(message, PieceMessage) and not all(isinstance(one, bytes) for one in message.messages):
        raise ProtocolError("expected messages as bytes in a 'piece' message")
    return message


def _as(wanted: type[_T], whole: Mapping[str, Any], name: str, kind: str) -> _T:
    value = whole.get(name)
    if not isinstance(value, wanted) or (wanted is int and isinstance(value, bool)):
        got = "nothing" if name not in whole else type(value).__name__
        raise ProtocolError(f"expected '{name}' of a '{kind}' message to be {wanted.__name__}, and got {got}")
    return value


def _is_int(value: object) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _pairs(whole: Mapping[str, Any]) -> dict[int, int]:
    statuses = {}
    for pair in _as(list, whole, "statuses", "tree"):
        if not (isinstance(pair, list) and len(pair) == 2 and all(_is_int(one) for one in pair)):
            raise ProtocolError(f"expected [uid, status] in 'statuses' of a 'tree' message, and got {pair!r}")
        statuses[pair[0]] = pair[1]
    return statuses


def _check_rows(rows: list[list[int]]) -> None:
    for row in rows:
        if not (isinstance(row, list) and len(row) == 6 and all(_is_int(one) for one in row)):
            raise ProtocolError(f"expected six integers in a transition, and got {row!r:.80}")
