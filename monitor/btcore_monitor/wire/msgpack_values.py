"""Values of a blackboard as MessagePack, by the rules of BehaviorTree.CPP's JSON exporter.

A bool becomes the integer 0 or 1, and an enum member becomes its value. A float becomes a float32 if that is
exact, otherwise a float64. Lists, tuples, sets and numpy arrays become arrays, and mappings become maps.
Dataclasses and named tuples become maps with the class's name at the key `__type`. Integers and texts are
unchanged. Values of other classes, and entries that were never written, become nil. Keys are sorted, and an
empty blackboard is nil.
"""

import dataclasses
import enum
import struct
from collections.abc import Mapping
from typing import Any, Final

import msgpack

from btcore_monitor.wire.errors import ProtocolError, describe_value

Boards = Mapping[str, Mapping[str, Any]]
"""The values of blackboards: by the blackboard's name or path, then by key."""

MAX_DEPTH: Final = 16
"""Maximum nesting; deeper values become nil. A limit is necessary, because a list may contain itself."""

_MAX_RECEIVED_DEPTH: Final = 64
"""Maximum nesting of received values. C++ robots may send deeper values than btcore."""

_MAX_BOARDS: Final = 8 << 20
"""Maximum bytes of received blackboards: small values take many times as much memory when decoded."""

_FLOAT32_MAX: Final = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
_INT64_MIN: Final = -(1 << 63)
_UINT64_MAX: Final = (1 << 64) - 1
_AS_IT_IS: Final = frozenset({float, str, type(None)})
_NIL: Final = b"\xc0"


def to_portable(value: object, depth: int = MAX_DEPTH) -> Any:
    """Convert *value* to a portable value: None, int, float, str, or lists and dicts of these.

    The keys of dicts are str. The result shares no mutable object with *value*.

    Args:
        value: Any object.
        depth: Maximum nesting; deeper values become None.
    """
    if type(value) in _AS_IT_IS:
        return value
    if isinstance(value, int):
        # bool too: the C++ exporter writes bool as an integer. MessagePack has no larger integers.
        return int(value) if _INT64_MIN <= value <= _UINT64_MAX else None
    if isinstance(value, float):
        return float(value)
    if isinstance(value, str):
        return str(value)
    if depth == 0:
        return None
    if isinstance(value, enum.Enum):
        return to_portable(value.value, depth - 1)
    names = getattr(value, "_fields", None)
    if names is not None and isinstance(value, tuple):
        named = zip(names, value, strict=False)
        return {"__type": type(value).__name__} | {key: to_portable(item, depth - 1) for key, item in named}
    if isinstance(value, list | tuple | set | frozenset):
        # list() first: the tick thread may change the container during the iteration
        return [item if type(item) in _AS_IT_IS else to_portable(item, depth - 1) for item in list(value)]
    if isinstance(value, Mapping):
        return {str(key): to_portable(item, depth - 1) for key, item in list(value.items())}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {
            field.name: to_portable(getattr(value, field.name, None), depth - 1)
            for field in dataclasses.fields(value)
        }
        return {"__type": type(value).__name__} | fields
    # arrays and scalars of numpy, without an import of numpy
    tolist = getattr(value, "tolist", None)
    if callable(tolist) and hasattr(value, "dtype"):
        return to_portable(tolist(), depth - 1)
    return None


def encode_boards(boards: Mapping[str, Mapping[str, Any] | None]) -> bytes:
    """Return the second frame of a BLACKBOARD reply. It is nil if there are no blackboards.

    Args:
        boards: Portable values by the blackboard's name and by key. An empty blackboard is sent as nil.
    """
    if not boards:
        return _NIL
    return _packed({name: (board or None) for name, board in boards.items()})


def decode_boards(body: bytes) -> dict[str, dict[str, Any]]:
    """Return the values in a BLACKBOARD reply, by the blackboard's name and by key.

    An empty blackboard is an empty dict.

    Raises:
        ProtocolError: *body* is not MessagePack, or not a map of maps.
    """
    if len(body) > _MAX_BOARDS:
        raise ProtocolError(f"expected blackboards of at most {_MAX_BOARDS} bytes, and got {len(body)}")
    return check_boards(unpack_msgpack(body))


def check_boards(values: Any) -> dict[str, dict[str, Any]]:
    """Return *values*, the received values of blackboards, with an empty dict for an empty blackboard.

    Raises:
        ProtocolError: *values* is not a map of maps, or nested too deeply.
    """
    if values is None:
        return {}
    check_depth(values)
    if not isinstance(values, dict):
        raise ProtocolError(f"expected blackboards as a map, and got {type(values).__name__}")
    boards: dict[str, dict[str, Any]] = {}
    for name, board in values.items():
        if board is not None and not isinstance(board, dict):
            got = type(board).__name__
            raise ProtocolError(f"expected the blackboard {describe_value(name)} as a map, and got {got}")
        boards[name] = board or {}
    return boards


def unpack_msgpack(body: bytes) -> Any:
    """Return the value that the MessagePack data in *body* describe.

    Raises:
        ProtocolError: *body* is not MessagePack, or a map has a key that is not text.
    """
    try:
        return msgpack.unpackb(
            body, raw=False, unicode_errors="replace", strict_map_key=False, object_pairs_hook=_text_keys
        )
    except ProtocolError:
        raise
    except (
        ValueError,
        TypeError,
        OverflowError,
        RecursionError,
        MemoryError,
        msgpack.exceptions.UnpackException,
    ) as error:
        raise ProtocolError(f"expected MessagePack, and {len(body)} bytes can't be read: {error}") from None


def check_depth(value: object) -> None:
    """Raise ProtocolError if *value* is nested so deeply that recursive functions might fail."""
    level = [value] if isinstance(value, dict | list) else []
    for _ in range(_MAX_RECEIVED_DEPTH):
        if not level:
            return
        level = [
            item
            for container in level
            for item in (container.values() if isinstance(container, dict) else container)
            if isinstance(item, dict | list)
        ]
    raise ProtocolError(f"expected values with at most {_MAX_RECEIVED_DEPTH} levels, and got more")


def _text_keys(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    for key, _ in pairs:
        if not isinstance(key, str):
            raise ProtocolError(f"expected text as keys of a MessagePack map, and got {type(key).__name__}")
    return dict(pairs)


def _packed(value: Any) -> bytes:
    """Return *value* as nlohmann::json::to_msgpack encodes it: sorted keys, float32 where that is exact."""
    if isinstance(value, float):
        # NaN and infinities compare false, so they are sent as float64.
        single = abs(value) <= _FLOAT32_MAX and struct.unpack("<f", struct.pack("<f", value))[0] == value
        return struct.pack(">Bf", 0xCA, value) if single else struct.pack(">Bd", 0xCB, value)
    if isinstance(value, dict):
        # std::map orders std::string by bytes, Python orders str by code points
        keys = sorted(value, key=lambda key: key.encode("utf-8", "replace"))
        header: bytes = msgpack.Packer().pack_map_header(len(keys))
        return header + b"".join(_packed(key) + _packed(value[key]) for key in keys)
    if isinstance(value, list):
        header = msgpack.Packer().pack_array_header(len(value))
        return header + b"".join(_packed(item) for item in value)
    packed: bytes = msgpack.packb(value, unicode_errors="replace")
    return packed
