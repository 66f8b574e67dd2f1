"""Values of a blackboard as MessagePack, by the rules of BehaviorTree.CPP's JSON exporter.

bool → 0 or 1 · enums and integers → int · float → float32 where that is exact, else float64 ·
str · sequences → arrays · dataclasses and named tuples → maps with ``__type`` · everything else,
and an entry never written → nil. Keys are sorted, and an empty blackboard is nil.
"""

import dataclasses
import enum
import struct
from collections.abc import Mapping
from typing import Any, Final

import msgpack

from btcore_monitor.wire.errors import ProtocolError

Boards = Mapping[str, Mapping[str, Any]]
"""The values of blackboards: by the blackboard's name or path, then by key."""

DEPTH_AT_MOST: Final = 16
"""Values nested deeper are cut off with nil: a list may hold itself."""

_FLOAT32_MAX: Final = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
_INT64_MIN: Final = -(1 << 63)
_UINT64_MAX: Final = (1 << 64) - 1
_AS_IT_IS: Final = frozenset({float, str, type(None)})
_NIL: Final = b"\xc0"


def to_portable(value: object, depth: int = DEPTH_AT_MOST) -> Any:
    """*value* in terms of None, int, float, str, list and dict with keys of str.

    Nothing that a caller can still change is shared with the result.
    """
    if type(value) in _AS_IT_IS:
        return value
    if isinstance(value, int):
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
        return {"__type": type(value).__name__} | {key: to_portable(one, depth - 1) for key, one in named}
    if isinstance(value, list | tuple | set | frozenset):
        return [one if type(one) in _AS_IT_IS else to_portable(one, depth - 1) for one in list(value)]
    if isinstance(value, Mapping):
        return {str(key): to_portable(one, depth - 1) for key, one in list(value.items())}
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        fields = {
            one.name: to_portable(getattr(value, one.name, None), depth - 1)
            for one in dataclasses.fields(value)
        }
        return {"__type": type(value).__name__} | fields
    tolist = getattr(value, "tolist", None)
    if callable(tolist) and hasattr(value, "dtype"):
        return to_portable(tolist(), depth - 1)
    return None


def encode_boards(boards: Mapping[str, Mapping[str, Any] | None]) -> bytes:
    """The second frame of a BLACKBOARD reply: name → key → portable value; no names at all is nil."""
    if not boards:
        return _NIL
    return _packed({name: (board or None) for name, board in boards.items()})


def decode_boards(body: bytes) -> dict[str, dict[str, Any]]:
    """Name → key → value of a BLACKBOARD reply; an empty blackboard is an empty dict."""
    whole = unpack_msgpack(body)
    if whole is None:
        return {}
    if not isinstance(whole, dict):
        raise ProtocolError(f"expected blackboards as a map, and got {type(whole).__name__}")
    boards: dict[str, dict[str, Any]] = {}
    for name, board in whole.items():
        if board is not None and not isinstance(board, dict):
            raise ProtocolError(f"expected the blackboard '{name}' as a map, and got {type(board).__name__}")
        boards[name] = board or {}
    return boards


def unpack_msgpack(body: bytes) -> Any:
    """What MessagePack *body* holds; raises :class:`ProtocolError` if none, or if keys aren't text."""
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
        msgpack.exceptions.UnpackException,
    ) as error:
        raise ProtocolError(f"expected MessagePack, and {len(body)} bytes can't be read: {error}") from None


def _text_keys(pairs: list[tuple[Any, Any]]) -> dict[str, Any]:
    for key, _ in pairs:
        if not isinstance(key, str):
            raise ProtocolError(f"expected text as keys of a MessagePack map, and got {type(key).__name__}")
    return dict(pairs)


def _utf8(text: str) -> bytes:
    return text.encode("utf-8", "replace")


def _packed(value: Any) -> bytes:
    """MessagePack with sorted keys and floats as short as they are exact, as nlohmann::json writes it."""
    if isinstance(value, float):
        single = abs(value) <= _FLOAT32_MAX and struct.unpack("<f", struct.pack("<f", value))[0] == value
        return struct.pack(">Bf", 0xCA, value) if single else struct.pack(">Bd", 0xCB, value)
    if isinstance(value, dict):
        # sorted as UTF-8 bytes, which is std::map's order of std::string
        keys = sorted(value, key=_utf8)
        head: bytes = msgpack.Packer().pack_map_header(len(keys))
        return head + b"".join(_packed(key) + _packed(value[key]) for key in keys)
    if isinstance(value, list):
        head = msgpack.Packer().pack_array_header(len(value))
        return head + b"".join(_packed(one) for one in value)
    packed: bytes = msgpack.packb(value, unicode_errors="replace")
    return packed
