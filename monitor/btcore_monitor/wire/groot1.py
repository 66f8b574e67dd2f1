"""Groot 1's protocol as BehaviorTree.CPP 3.8 speaks it: bytes ⇄ messages, no sockets.

The request socket answers whatever it is asked with the tree (groot1_tree.py). The publish socket sends
updates, one frame each: how all nodes stood at the end of the update before, and the transitions since.
Little endian. What doesn't fit raises :class:`~btcore_monitor.wire.errors.ProtocolError`.
"""

import struct
from collections.abc import Iterable, Mapping
from typing import Final, NamedTuple

from btcore_monitor.wire.errors import ProtocolError, describe_bytes

PUBLISH_PORT: Final = 1666
"""Where updates are sent; requests are answered one port further."""

BESIDE_GROOT2: Final = 2666
"""The publish port where Groot 2 has the usual one's neighbour."""

RATE: Final = 25
"""Updates a second, at most."""

QUESTION: Final = [b""]
"""What Groot 1 asks for the tree with; a publisher doesn't look at it, but it must be one frame."""

_SIZE: Final = struct.Struct("<I")
_STATUS: Final = struct.Struct("<Hb")
_CHANGE: Final = struct.Struct("<IIHbb")
_NS_PER_US: Final = 1_000
_US_PER_S: Final = 1_000_000


class WireChange(NamedTuple):
    """A transition; *stamp* is the robot's wall clock in ns since the epoch, of which whole µs are sent."""

    stamp: int
    uid: int
    previous: int
    status: int


class Update(NamedTuple):
    """*statuses* is uid → status before the *changes*, in the tree's order."""

    statuses: Mapping[int, int]
    changes: tuple[WireChange, ...]


def status_code(status: int) -> int:
    """*status* (0–4) as Groot 1 knows it: it has no SKIPPED, and shows an idle node for it."""
    return status if status < 4 else 0


def encode_update(statuses: Iterable[tuple[int, int]], changes: Iterable[WireChange]) -> bytes:
    """The frame for (uid, status) pairs in the tree's order, and for *changes*, oldest first."""
    block = b"".join(_STATUS.pack(uid, status) for uid, status in statuses)
    records = b"".join(map(_encode_change, changes))
    return b"".join(
        (_SIZE.pack(len(block)), block, _SIZE.pack(len(records) // _CHANGE.size), records),
    )


def _encode_change(change: WireChange) -> bytes:
    seconds, micros = divmod(change.stamp // _NS_PER_US, _US_PER_S)
    return _CHANGE.pack(seconds & 0xFFFFFFFF, micros, change.uid, change.previous, change.status)


def decode_update(frame: bytes) -> Update:
    """The update in *frame*."""
    size = _size_at(frame, 0)
    start = 2 * _SIZE.size + size
    if size % _STATUS.size or start > len(frame):
        raise ProtocolError(
            f"expected statuses of {_STATUS.size} bytes each, {size} bytes in all, "
            f"and got {describe_bytes(frame)}"
        )
    count = _size_at(frame, _SIZE.size + size)
    if len(frame) != start + count * _CHANGE.size:
        raise ProtocolError(
            f"expected {count} transitions of {_CHANGE.size} bytes each, and got {describe_bytes(frame)}"
        )
    statuses = {
        uid: _status(status, uid)
        for uid, status in _STATUS.iter_unpack(frame[_SIZE.size : _SIZE.size + size])
    }
    changes = tuple(
        WireChange(
            (seconds * _US_PER_S + micros) * _NS_PER_US, uid, _status(previous, uid), _status(status, uid)
        )
        for seconds, micros, uid, previous, status in _CHANGE.iter_unpack(frame[start:])
    )
    return Update(statuses, changes)


def _size_at(frame: bytes, place: int) -> int:
    if place + _SIZE.size > len(frame):
        raise ProtocolError(f"expected statuses and transitions, and got {describe_bytes(frame)}")
    return int(_SIZE.unpack_from(frame, place)[0])


def _status(code: int, uid: int) -> int:
    if not 0 <= code <= 3:
        raise ProtocolError(f"expected a status 0–3 of node {uid}, and got {code}")
    return code
