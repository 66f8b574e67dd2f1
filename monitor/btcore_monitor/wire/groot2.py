"""Groot 2's protocol as BehaviorTree.CPP 4.10 speaks it: bytes ⇄ messages, no sockets.

A request is a header of 6 bytes and, for some, a second frame; a reply is a header of 22 bytes
and, for some, a second frame; an error is the frame ``error`` and a sentence. Integers are
little endian. Whatever doesn't fit raises :class:`~btcore_monitor.wire.errors.ProtocolError`.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, NamedTuple

from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError, describe_bytes

DEFAULT_PORT: Final = 1667
PROTOCOL: Final = 2
"""The number that both sides write into byte 0; servers don't check it."""

RECORDED_AT_MOST: Final = 1000
"""Transitions that a publisher keeps for GET_TRANSITIONS: older ones are dropped."""

_REQUEST: Final = struct.Struct("<BBI")
_REPLY: Final = struct.Struct("<BBI16s")
_STATUS: Final = struct.Struct("<HB")
_TRANSITION: Final = struct.Struct("<IHHB")

ERROR: Final = b"error"
WRONG_HEADER: Final = "wrong request header"
NOT_RECOGNIZED: Final = "Request not recognized"
TWO_PARTS: Final = "must be 2 parts message"
NO_SUCH_NODE: Final = "Node ID not found"
HOOKS_DISABLED: Final = "hooks are disabled"


class Request(IntEnum):
    """What can be asked; the values are ASCII letters on the wire."""

    FULLTREE = ord("T")
    STATUS = ord("S")
    BLACKBOARD = ord("B")
    HOOK_INSERT = ord("I")
    HOOK_REMOVE = ord("R")
    BREAKPOINT_REACHED = ord("N")
    BREAKPOINT_UNLOCK = ord("U")
    HOOKS_DUMP = ord("D")
    REMOVE_ALL_HOOKS = ord("A")
    DISABLE_ALL_HOOKS = ord("X")
    TOGGLE_RECORDING = ord("r")
    GET_TRANSITIONS = ord("t")


TWO_FRAMES: Final = frozenset(
    {
        Request.BLACKBOARD,
        Request.HOOK_INSERT,
        Request.HOOK_REMOVE,
        Request.BREAKPOINT_UNLOCK,
        Request.TOGGLE_RECORDING,
    }
)
"""Requests that need exactly two frames."""

HOOKS: Final = frozenset(
    {
        Request.HOOK_INSERT,
        Request.HOOK_REMOVE,
        Request.BREAKPOINT_UNLOCK,
        Request.HOOKS_DUMP,
        Request.REMOVE_ALL_HOOKS,
        Request.DISABLE_ALL_HOOKS,
    }
)
"""Requests that control a robot, or look at what controls it."""


class RequestHeader(NamedTuple):
    """Frame 0 of a request. *kind* is a byte: a server answers unknown ones too, with an error."""

    kind: int
    unique_id: int
    protocol: int = PROTOCOL

    def encode(self) -> bytes:
        """The six bytes."""
        return _REQUEST.pack(self.protocol, self.kind, self.unique_id)

    @classmethod
    def decode(cls, frame: bytes) -> "RequestHeader":
        """The header in *frame*; raises :class:`ProtocolError` unless it has six bytes."""
        if len(frame) != _REQUEST.size:
            raise ProtocolError(
                f"expected a request header of {_REQUEST.size} bytes, and got {describe_bytes(frame)}"
            )
        protocol, kind, unique_id = _REQUEST.unpack(frame)
        return cls(kind, unique_id, protocol)


def encode_request(kind: Request, unique_id: int, body: bytes | None = None) -> list[bytes]:
    """The frames of a request; *unique_id* (32 bits) comes back in the reply."""
    header = RequestHeader(kind, unique_id).encode()
    return [header] if body is None else [header, body]


def encode_reply(asked: RequestHeader, tree_id: bytes, body: bytes | None = None) -> list[bytes]:
    """The frames of a reply to *asked*; *tree_id* has 16 bytes."""
    header = _REPLY.pack(PROTOCOL, asked.kind, asked.unique_id, tree_id)
    return [header] if body is None else [header, body]


def encode_error(sentence: str) -> list[bytes]:
    """The frames of a reply that refuses."""
    return [ERROR, sentence.encode("utf-8", "replace")]


@dataclass(frozen=True, slots=True)
class Reply:
    """A successful reply: *tree_id* is 32 hex digits, *body* the second frame (empty if none)."""

    kind: int
    unique_id: int
    tree_id: str
    body: bytes


def decode_reply(frames: Sequence[bytes]) -> Reply:
    """The reply in *frames*; raises :class:`RobotRefusedError` for an error reply."""
    if len(frames) == 2 and frames[0] == ERROR:
        raise RobotRefusedError(frames[1].decode("utf-8", "replace"))
    if not 1 <= len(frames) <= 2:
        raise ProtocolError(f"expected a reply of one or two frames, and got {len(frames)}")
    if len(frames[0]) != _REPLY.size:
        raise ProtocolError(
            f"expected a reply header of {_REPLY.size} bytes, and got {describe_bytes(frames[0])}"
        )
    _, kind, unique_id, tree_id = _REPLY.unpack(frames[0])
    return Reply(kind, unique_id, tree_id.hex(), frames[1] if len(frames) == 2 else b"")


class StatusRecord(NamedTuple):
    """One node's standing; *previous* is what an idle node was before (0: it never ran)."""

    status: int
    previous: int


def status_code(previous: int, status: int) -> int:
    """The byte of a transition: an idle node keeps what it was, as ``10 + previous``."""
    return 10 + previous if status == 0 else status


def encode_statuses(codes: Iterable[tuple[int, int]]) -> bytes:
    """The STATUS buffer of (uid, code) pairs, in their order."""
    return b"".join(_STATUS.pack(uid, code) for uid, code in codes)


def decode_statuses(body: bytes) -> dict[int, StatusRecord]:
    """uid → standing, of a STATUS buffer, in its order."""
    if len(body) % _STATUS.size:
        raise ProtocolError(f"expected statuses of {_STATUS.size} bytes each, and got {describe_bytes(body)}")
    statuses = {}
    for uid, code in _STATUS.iter_unpack(body):
        if code <= 4:
            statuses[uid] = StatusRecord(code, 0)
        elif 10 <= code <= 14:
            statuses[uid] = StatusRecord(0, code - 10)
        else:
            raise ProtocolError(f"expected a status 0–4 or 10–14 of node {uid}, and got {code}")
    return statuses


class RecordedTransition(NamedTuple):
    """One recorded change: *offset* in µs since the recording's start, and the new status."""

    offset: int
    uid: int
    status: int


def encode_transition(offset: int, uid: int, status: int) -> bytes:
    """The nine bytes of one record; *offset* (µs) keeps its lower 48 bits."""
    return _TRANSITION.pack(offset & 0xFFFFFFFF, (offset >> 32) & 0xFFFF, uid, status)


def decode_transitions(body: bytes) -> list[RecordedTransition]:
    """The records of a GET_TRANSITIONS reply, oldest first."""
    if len(body) % _TRANSITION.size:
        raise ProtocolError(
            f"expected transitions of {_TRANSITION.size} bytes each, and got {describe_bytes(body)}"
        )
    found = []
    for low, high, uid, status in _TRANSITION.iter_unpack(body):
        if status > 4:
            raise ProtocolError(f"expected a status 0–4 in the transition of node {uid}, and got {status}")
        found.append(RecordedTransition(high << 32 | low, uid, status))
    return found


def decode_recording_start(body: bytes) -> int:
    """When a recording began, in µs since the epoch: the answer to ``start``."""
    if not body.isdigit() or len(body) > 20:
        raise ProtocolError(
            f"expected the recording's start in decimal digits, and got {describe_bytes(body)}"
        )
    return int(body)


def encode_names(names: Iterable[str]) -> bytes:
    """The second frame of a BLACKBOARD request."""
    return ";".join(names).encode()


def decode_names(body: bytes) -> list[str]:
    """Names of subtrees asked for; the main tree goes by its tree ID, the others by their path."""
    return [name for name in body.decode("utf-8", "replace").split(";") if name]


def decode_breakpoint_reached(frames: Sequence[bytes]) -> int:
    """The uid of the node that a BREAKPOINT_REACHED notification is about."""
    if len(frames) != 2:
        raise ProtocolError(f"expected a notification of two frames, and got {len(frames)}")
    header = RequestHeader.decode(frames[0])
    if header.kind != Request.BREAKPOINT_REACHED:
        raise ProtocolError(f"expected a notification 'N', and got {chr(header.kind)!r}")
    if not frames[1].isdigit() or len(frames[1]) > 5:
        raise ProtocolError(f"expected a node's uid in decimal digits, and got {describe_bytes(frames[1])}")
    return int(frames[1])


def blackboard_name(path: str, main: str) -> str:
    """How a BLACKBOARD request calls the subtree at *path*: *main* is the main tree's ID."""
    return path or main


def boards_by_path(boards: Mapping[str, dict[str, Any]], main: str) -> dict[str, dict[str, Any]]:
    """A decoded reply with paths as keys: *main* becomes ``""``; ``ROOT`` goes if it is only main again."""
    found = {("" if name == main else name): board for name, board in boards.items()}
    if "ROOT" in found and found["ROOT"] == found.get(""):
        del found["ROOT"]
    return found
