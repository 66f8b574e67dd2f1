"""Encode and decode Groot 2's protocol as in BehaviorTree.CPP 4.10, without sockets.

A request is a header of 6 bytes and, for some kinds, a second frame. A reply is a header of 22 bytes and, for
some kinds, a second frame. An error reply is the frame `error` and a frame with a sentence. Integers are
little endian: `groot2_protocol.h` copies them with `memcpy` in the byte order of the robot's processor,
which is little endian on x86-64 and ARM. Invalid bytes raise
`ProtocolError`.
"""

import struct
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, NamedTuple

from btcore_monitor.wire.errors import ProtocolError, RobotRefusedError, describe_bytes

DEFAULT_PORT: Final = 1667
DEFAULT_ADDRESS: Final = f"tcp://127.0.0.1:{DEFAULT_PORT}"
"""The address of a robot on this machine."""
PROTOCOL: Final = 2
"""The number that both sides write into byte 0 (`kProtocolID`). Servers do not check it."""

MAX_RECORDED: Final = 1000
"""Maximum transitions that a publisher keeps for GET_TRANSITIONS; the oldest are dropped.

The limit is in BehaviorTree.CPP's `src/loggers/groot2_publisher.cpp`.
"""

# protocol, kind, unique ID; a reply also has the tree's UUID
_REQUEST: Final = struct.Struct("<BBI")
_REPLY: Final = struct.Struct("<BBI16s")
# uid, status code
_STATUS: Final = struct.Struct("<HB")
# The offset in µs has 48 bits: groot2_publisher.cpp copies the first 6 bytes of a 64-bit integer.
_TRANSITION: Final = struct.Struct("<IHHB")
TRANSITION_SIZE: Final = _TRANSITION.size
"""Bytes of a recorded transition."""

_MAX_STATUSES: Final = _STATUS.size << 16
"""Maximum bytes of a STATUS buffer: a uid has 16 bits."""

_MAX_RECORDING: Final = 1 << 17
"""Maximum bytes of recorded transitions: more than 10 times the number that a publisher keeps."""

_MAX_START: Final = (1 << 62) // 1000
"""Maximum start of a recording in µs, in the year 2116: times in ns must fit into 64 bits."""

ERROR: Final = b"error"
WRONG_HEADER: Final = "wrong request header"
NOT_RECOGNIZED: Final = "Request not recognized"
TWO_PARTS: Final = "must be 2 parts message"
NO_SUCH_NODE: Final = "Node ID not found"
HOOKS_DISABLED: Final = "hooks are disabled"
HOOKS_NEED_KEY: Final = "hooks need a key, and this port is for watching without keys"


class Request(IntEnum):
    """The kinds of requests. The values are ASCII letters on the wire."""

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
"""Requests that set, remove, disable or list hooks, and so control a robot."""


class RequestHeader(NamedTuple):
    """Frame 0 of a request. *kind* may be any byte: a server answers an unknown kind with an error."""

    kind: int
    unique_id: int
    protocol: int = PROTOCOL

    def encode(self) -> bytes:
        """Return the six bytes."""
        return _REQUEST.pack(self.protocol, self.kind, self.unique_id)

    @classmethod
    def decode(cls, frame: bytes) -> "RequestHeader":
        """Return the header in *frame*.

        Raises:
            ProtocolError: *frame* does not have six bytes.
        """
        if len(frame) != _REQUEST.size:
            raise ProtocolError(
                f"expected a request header of {_REQUEST.size} bytes, and got {describe_bytes(frame)}"
            )
        protocol, kind, unique_id = _REQUEST.unpack(frame)
        return cls(kind, unique_id, protocol)


def encode_request(kind: IntEnum, unique_id: int, body: bytes | None = None) -> list[bytes]:
    """Return the frames of a request.

    Args:
        kind: The kind of request.
        unique_id: A number of 32 bits, which the reply repeats.
        body: The second frame, if the kind has one.
    """
    header = RequestHeader(kind, unique_id).encode()
    return [header] if body is None else [header, body]


def encode_reply(request: RequestHeader, tree_id: bytes, body: bytes | None = None) -> list[bytes]:
    """Return the frames of a reply.

    Args:
        request: The header of the request, which the reply repeats.
        tree_id: The UUID of the tree, 16 bytes.
        body: The second frame, if the kind has one.
    """
    header = _REPLY.pack(PROTOCOL, request.kind, request.unique_id, tree_id)
    return [header] if body is None else [header, body]


def encode_error(sentence: str) -> list[bytes]:
    """Return the frames of an error reply with the message *sentence*."""
    return [ERROR, sentence.encode("utf-8", "replace")]


@dataclass(frozen=True, slots=True)
class Reply:
    """A successful reply. *tree_id* is 32 hexadecimal digits, *body* the second frame (default: empty)."""

    kind: int
    unique_id: int
    tree_id: str
    body: bytes


def decode_reply(frames: Sequence[bytes]) -> Reply:
    """Return the reply in *frames*.

    Raises:
        RobotRefusedError: *frames* is an error reply.
        ProtocolError: *frames* is not a reply.
    """
    # An error reply has no header. It belongs to the last request, because a REQ socket sends one at a time.
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
    """The status of a node. *previous* is the status before it became IDLE (0: it never ran)."""

    status: int
    previous: int


def status_code(previous: int, status: int) -> int:
    """Return the byte of STATUS for a node that went from *previous* to *status*.

    An idle node keeps its last status as `10 + previous` (`IDLE_FROM_SUCCESS` and so on in
    `groot2_publisher.cpp`), so that Groot 2 shows how a node ended after its parent reset it.
    """
    return 10 + previous if status == 0 else status


def encode_statuses(codes: Iterable[tuple[int, int]]) -> bytes:
    """Return the STATUS buffer of (uid, code) pairs, in their order."""
    return b"".join(_STATUS.pack(uid, code) for uid, code in codes)


def decode_statuses(body: bytes) -> dict[int, StatusRecord]:
    """Return the status records of a STATUS buffer by uid, in the order of the buffer.

    Raises:
        ProtocolError: *body* is not a STATUS buffer.
    """
    if len(body) % _STATUS.size or len(body) > _MAX_STATUSES:
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
    """A recorded transition: *offset* in µs since the start of the recording, and the new status."""

    offset: int
    uid: int
    status: int


def encode_transition(offset: int, uid: int, status: int) -> bytes:
    """Return the nine bytes of a recorded transition.

    Args:
        offset: Time since the start of the recording in µs, of which the lower 48 bits are sent.
        uid: The node.
        status: The new status, 0–4.
    """
    return _TRANSITION.pack(offset & 0xFFFFFFFF, (offset >> 32) & 0xFFFF, uid, status)


def decode_transitions(body: bytes) -> list[RecordedTransition]:
    """Return the transitions of a GET_TRANSITIONS reply, the oldest first.

    Raises:
        ProtocolError: *body* does not hold recorded transitions.
    """
    if len(body) % _TRANSITION.size or len(body) > _MAX_RECORDING:
        raise ProtocolError(
            f"expected transitions of {_TRANSITION.size} bytes each, and got {describe_bytes(body)}"
        )
    transitions = []
    for low, high, uid, status in _TRANSITION.iter_unpack(body):
        if status > 4:
            raise ProtocolError(f"expected a status 0–4 in the transition of node {uid}, and got {status}")
        transitions.append(RecordedTransition(high << 32 | low, uid, status))
    return transitions


def decode_recording_start(body: bytes) -> int:
    """Return when a recording began (µs since the epoch), from the reply to `start`.

    Raises:
        ProtocolError: *body* is not a decimal number, or too large.
    """
    if not body.isdigit() or len(body) > 20 or int(body) > _MAX_START:
        raise ProtocolError(
            f"expected the recording's start in µs as decimal digits, and got {describe_bytes(body)}"
        )
    return int(body)


def encode_names(names: Iterable[str]) -> bytes:
    """Return the second frame of a BLACKBOARD request."""
    return ";".join(names).encode()


def decode_names(body: bytes) -> list[str]:
    """Return the requested names: the main tree's ID, and the paths of other subtrees."""
    return [name for name in body.decode("utf-8", "replace").split(";") if name]


def decode_breakpoint_reached(frames: Sequence[bytes]) -> int:
    """Return the uid of the node in a BREAKPOINT_REACHED notification.

    Raises:
        ProtocolError: *frames* is not such a notification.
    """
    if len(frames) != 2:
        raise ProtocolError(f"expected a notification of two frames, and got {len(frames)}")
    header = RequestHeader.decode(frames[0])
    if header.kind != Request.BREAKPOINT_REACHED:
        raise ProtocolError(f"expected a notification 'N', and got {chr(header.kind)!r}")
    # A uid has 16 bits, so at most five digits.
    if not frames[1].isdigit() or len(frames[1]) > 5:
        raise ProtocolError(f"expected a node's uid in decimal digits, and got {describe_bytes(frames[1])}")
    return int(frames[1])


def boards_by_path(boards: Mapping[str, dict[str, Any]], main: str) -> dict[str, dict[str, Any]]:
    """Return the *boards* of a reply with paths as keys.

    Args:
        boards: The values by the blackboard's name and by key.
        main: The main tree's ID, which becomes `""`. `ROOT` is left out if it equals the main blackboard.
    """
    by_path = {("" if name == main else name): board for name, board in boards.items()}
    if "ROOT" in by_path and by_path["ROOT"] == by_path.get(""):
        del by_path["ROOT"]
    return by_path
