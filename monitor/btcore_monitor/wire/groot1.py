"""Encode and decode Groot 1's protocol as in BehaviorTree.CPP 3.8 (`src/loggers/bt_zmq_publisher.cpp`).

The request socket answers every request with the tree (groot1_tree.py). The publish socket sends updates of
one frame each: the statuses of all nodes at the end of the previous update, and the transitions since then.
Integers are little endian: the C++ publisher writes them with `flatbuffers::WriteScalar`. Invalid bytes
raise `ProtocolError`.
"""

import struct
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from btcore_monitor.wire.errors import ProtocolError, describe_bytes

PUBLISH_PORT: Final = 1666
"""The port of updates. The next port answers requests."""

PORT_BESIDE_GROOT2: Final = 2666
"""The port of updates of a robot that also publishes for Groot 2, which needs the ports 1667 and 1668."""

RATE: Final = 25
"""Maximum updates per second; the default of BehaviorTree.CPP's PublisherZMQ."""

_SIZE: Final = struct.Struct("<I")
# uid and status without padding, as the C++ publisher writes them
_STATUS: Final = struct.Struct("<Hb")
# SerializeTransition writes int64 seconds at byte 0 and int64 microseconds at byte 4. Each write covers the
# high half of the previous value, so 32 bits of each remain on the wire.
_TRANSITION: Final = struct.Struct("<IIHbb")
_NS_PER_US: Final = 1_000
_US_PER_S: Final = 1_000_000


class WireTransition(NamedTuple):
    """A transition. *wall* is the robot's wall clock in ns since the epoch; the wire carries whole µs."""

    wall: int
    uid: int
    previous: int
    status: int


class Update(NamedTuple):
    """An update: *statuses* maps uids to the statuses before *transitions*, in the tree's order."""

    statuses: Mapping[int, int]
    transitions: tuple[WireTransition, ...]


def status_code(status: int) -> int:
    """Return *status* (0–4) in Groot 1's numbers, which have no SKIPPED (4): it is sent as IDLE (0)."""
    return status if status < 4 else 0


def encode_update(statuses: Iterable[tuple[int, int]], transitions: Iterable[WireTransition]) -> bytes:
    """Return the frame of an update.

    Args:
        statuses: Pairs of a uid and the status before *transitions*, in the tree's order.
        transitions: The transitions, the oldest first.
    """
    block = b"".join(_STATUS.pack(uid, status) for uid, status in statuses)
    records = b"".join(map(_encode_transition, transitions))
    # The first size counts bytes, the second counts transitions.
    return b"".join(
        (_SIZE.pack(len(block)), block, _SIZE.pack(len(records) // _TRANSITION.size), records),
    )


def _encode_transition(transition: WireTransition) -> bytes:
    seconds, micros = divmod(transition.wall // _NS_PER_US, _US_PER_S)
    # Unsigned, the 32 bits of the seconds last until 2106.
    return _TRANSITION.pack(
        seconds & 0xFFFFFFFF, micros, transition.uid, transition.previous, transition.status
    )


def decode_update(frame: bytes) -> Update:
    """Return the update in *frame*.

    Raises:
        ProtocolError: *frame* is not an update.
    """
    size = _read_size(frame, 0)
    start = 2 * _SIZE.size + size
    if size % _STATUS.size or start > len(frame):
        raise ProtocolError(
            f"expected statuses of {_STATUS.size} bytes each, {size} bytes in all, "
            f"and got {describe_bytes(frame)}"
        )
    count = _read_size(frame, _SIZE.size + size)
    if len(frame) != start + count * _TRANSITION.size:
        raise ProtocolError(
            f"expected {count} transitions of {_TRANSITION.size} bytes each, and got {describe_bytes(frame)}"
        )
    statuses = {
        uid: _decode_status(status, uid)
        for uid, status in _STATUS.iter_unpack(frame[_SIZE.size : _SIZE.size + size])
    }
    transitions = tuple(
        WireTransition(
            (seconds * _US_PER_S + micros) * _NS_PER_US,
            uid,
            _decode_status(previous, uid),
            _decode_status(status, uid),
        )
        for seconds, micros, uid, previous, status in _TRANSITION.iter_unpack(frame[start:])
    )
    return Update(statuses, transitions)


def _read_size(frame: bytes, offset: int) -> int:
    if offset + _SIZE.size > len(frame):
        raise ProtocolError(f"expected statuses and transitions, and got {describe_bytes(frame)}")
    return int(_SIZE.unpack_from(frame, offset)[0])


def _decode_status(code: int, uid: int) -> int:
    if not 0 <= code <= 3:
        raise ProtocolError(f"expected a status 0–3 of node {uid}, and got {code}")
    return code
