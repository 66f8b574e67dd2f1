"""Convert the messages of `btcore_scene` to plain maps for the wire, and back.

A message becomes a map of its fields, and a `Frame` becomes an array. Fields with a value of None are left
out, and so are empty fields, unless their default is None. Cells and rgb8 pixels are compressed; such an
entry has the key `coding` with the value `zlib`. Received maps are checked against the type annotations
of the messages. Unknown keys of a received scene become its `extra`.
"""

import struct
import zlib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import cache
from types import NoneType
from typing import Annotated, Any, Final, Literal, get_args, get_origin, get_type_hints

from btcore_monitor.wire.errors import ProtocolError, describe_value
from btcore_scene import Grid, Mesh, MovingScene, Picture, StaticScene

MAX_CELLS: Final = 1 << 25
"""Maximum accepted cells and pixels of a message: a few compressed bytes could fill the memory."""
MAX_NUMBER: Final = 1e9
"""Maximum absolute value of a number, such as a coordinate in m. Numbers in an array may be larger."""
_MAX_STAMP: Final = 1 << 62
_MAX_ENTRIES: Final = 100_000
_MAX_TEXT: Final = 100_000
_LEVEL: Final = 1
"""Compression level. It reduces costmaps to 1/20 of their size; higher levels take several times as long."""

Reader = Callable[[object, str], Any]
Scene = StaticScene | MovingScene
SCENES: Final[Mapping[str, Any]] = {"static": StaticScene, "moving": MovingScene}
"""Scenes by the kind of their message."""

_BLOBS: Final = {"grids": "cells", "pictures": "data"}
_PLAIN: Final[Mapping[Any, tuple[Any, str]]] = {
    float: ((int, float), "a number"),
    int: (int, "a whole number"),
    str: (str, "text"),
    bytes: (bytes, "bytes"),
}


def pack_scene(scene: Scene) -> dict[str, Any]:
    """Return *scene* as plain data, with its cells and pixels compressed."""
    packed: dict[str, Any] = _to_plain(scene)
    extra = packed.pop("extra", {})
    for key, blob in _BLOBS.items():
        if key in packed:
            packed[key] = [_deflate(entry, blob) for entry in packed[key]]
    return {**packed, **extra}


def unpack_scene(data: Mapping[str, Any], kind: str) -> Scene:
    """Return the scene in the *data* of a message of *kind*.

    Raises:
        ProtocolError: The data do not match the annotations of the scene's class, or are too large.
    """
    scene: Scene = _reader(SCENES[kind])(data, f"a '{kind}' message")
    sizes = [entry.size for key in _BLOBS for entry in getattr(scene, key, ())]
    # Negative sizes are rejected below.
    if sum(abs(width * height) for width, height in sizes) > MAX_CELLS:
        raise ProtocolError(f"expected at most {MAX_CELLS} cells and pixels in a '{kind}' message")
    known = {field.name for field in fields(scene)}
    for mesh in getattr(scene, "meshes", ()):
        _check_mesh(mesh)
    changed: dict[str, Any] = {"extra": {key: value for key, value in data.items() if key not in known}}
    for key, blob in _BLOBS.items():
        if key in known and key in data:
            entries = zip(getattr(scene, key), data[key], strict=True)
            changed[key] = tuple(_inflate(entry, sent, key, blob) for entry, sent in entries)
    return replace(scene, **changed)


def _check_mesh(mesh: Mesh) -> None:
    count = len(mesh.vertices) // 12
    if len(mesh.normals) != len(mesh.vertices):
        raise ProtocolError(f"expected a normal for each of the {count} vertices of a mesh")
    highest = max(struct.unpack(f"<{len(mesh.triangles) // 4}I", mesh.triangles), default=-1)
    if highest >= count:
        raise ProtocolError(f"expected triangles of {count} vertices, and got the vertex {highest}")


def _to_plain(value: Any) -> Any:
    if isinstance(value, list | tuple) and value and is_dataclass(value[0]):
        return [_to_plain(item) for item in value]
    if not is_dataclass(value):
        return value
    sent: dict[str, Any] = {}
    for field in fields(value):
        content = getattr(value, field.name)
        # An empty sequence is sent if the default is None: an empty `arrows` removes all, None keeps them.
        unset = field.default is not None and isinstance(content, list | tuple | dict) and not content
        if content is not None and not unset:
            sent[field.name] = _to_plain(content)
    return sent


def _deflate(entry: dict[str, Any], blob: str) -> dict[str, Any]:
    # JPEG is compressed already.
    if entry.get("format") == "jpeg":
        return entry
    return {**entry, blob: zlib.compress(entry[blob], _LEVEL), "coding": "zlib"}


def _inflate(entry: Grid | Picture, sent: Mapping[str, Any], key: str, blob: str) -> Grid | Picture:
    """Return *entry* with its data decompressed. *sent* is its form on the wire."""
    if isinstance(entry, Picture) and entry.format == "jpeg":
        return entry
    width, height = entry.size
    length = width * height * (3 if isinstance(entry, Picture) else 1)
    if width < 1 or height < 1 or length > MAX_CELLS:
        raise ProtocolError(f"expected at most {MAX_CELLS} bytes in '{key}', and got {width} times {height}")
    data: Any = _decompress(sent, blob, length) if "coding" in sent else sent[blob]
    if len(data) != length:
        raise ProtocolError(f"expected {length} bytes of '{blob}' for {entry.name!r}, and got {len(data)}")
    changed: Any = {blob: data}
    return replace(entry, **changed)


def _decompress(sent: Mapping[str, Any], blob: str, length: int) -> bytes:
    if sent["coding"] != "zlib":
        raise ProtocolError(
            f"expected '{blob}' to be coded by zlib, and got {describe_value(sent['coding'])}"
        )
    try:
        # At most one byte more than expected: enough to detect too much data without decompressing it all.
        return zlib.decompressobj().decompress(sent[blob], length + 1)
    except zlib.error as error:
        raise ProtocolError(f"expected compressed '{blob}' for {sent['name']!r}, and got {error}") from None


def _create_error(where: str, expected: str, value: object) -> ProtocolError:
    return ProtocolError(f"expected {where} to be {expected}, and got {describe_value(value)}")


@cache
def _reader(hint: Any) -> Reader:
    """Return a function that checks a received value against *hint* and converts it to the message's type."""
    origin, args = get_origin(hint), [arg for arg in get_args(hint) if arg is not NoneType]
    # From the plain types to the compound types; a type that none of the tests matches is a named tuple.
    if hint in _PLAIN:
        return _plain_value(*_PLAIN[hint])
    if is_dataclass(hint):
        return _record(hint)
    if origin is Annotated:
        return _values(*get_args(hint)[1:])
    if origin is Literal:
        return _word(args)
    if origin is tuple:
        return _list(_reader(args[0]), len(args))
    if origin is Sequence:
        return _list(_reader(args[0]))
    if origin is Mapping:
        return _texts
    if origin is not None:  # a union of one type and None, or of messages that differ in their `kind`
        return _reader(args[0]) if len(args) == 1 else _one_of(args)
    return _row(hint)


def _plain_value(value_type: Any, expected: str) -> Reader:
    def read(value: object, where: str) -> object:
        if not isinstance(value, value_type) or isinstance(value, bool):
            raise _create_error(where, expected, value)
        if isinstance(value, int | float):
            # The comparison is false for NaN.
            if not abs(value) <= (_MAX_STAMP if value_type is int else MAX_NUMBER):
                raise _create_error(where, f"{expected} of a usual size", value)
        elif isinstance(value, str) and len(value) > _MAX_TEXT:
            raise _create_error(where, f"{expected} of at most {_MAX_TEXT} characters", value)
        return value

    return read


def _values(width: int, expected: str) -> Reader:
    def read(value: object, where: str) -> object:
        data: bytes = _reader(bytes)(value, where)
        if len(data) % width:
            raise ProtocolError(f"expected {where} to be {expected}, and got {len(data)} bytes")
        return data

    return read


def _word(words: Sequence[str]) -> Reader:
    def read(value: object, where: str) -> object:
        if value not in words:
            raise _create_error(where, " or ".join(words), value)
        return value

    return read


def _list(reader: Reader, count: int | None = None) -> Reader:
    def read(value: object, where: str) -> object:
        if not isinstance(value, list | tuple) or (count is not None and len(value) != count):
            raise _create_error(where, "a list" if count is None else f"{count} values", value)
        if len(value) > _MAX_ENTRIES:
            raise ProtocolError(f"expected at most {_MAX_ENTRIES} values in {where}, and got {len(value)}")
        return tuple(reader(item, where) for item in value)

    return read


def _texts(value: object, where: str) -> object:
    if not isinstance(value, Mapping):
        raise _create_error(where, "a map", value)
    return {key: _reader(str)(text, where) for key, text in value.items()}


def _record(record_class: Any) -> Reader:
    hints = get_type_hints(record_class, include_extras=True)
    known = [
        (field.name, _reader(hints[field.name]), field.default is field.default_factory is MISSING)
        for field in fields(record_class)
        if field.init and field.name != "extra"
    ]

    def read(value: object, where: str) -> object:
        if not isinstance(value, Mapping):
            raise _create_error(where, "a map", value)
        values = {}
        for name, reader, required in known:
            if name in value:
                values[name] = reader(value[name], f"'{name}' of {where}")
            elif required:
                raise ProtocolError(f"expected '{name}' of {where}, and got nothing")
        if not all(0 <= part <= 255 for part in values.get("color") or ()):
            raise ProtocolError(f"expected 'color' of {where} with values from 0 to 255")
        return record_class(**values)

    return read


def _one_of(record_classes: Sequence[Any]) -> Reader:
    readers: dict[Any, Reader] = {
        field.default: _reader(record_class)
        for record_class in record_classes
        for field in fields(record_class)
        if field.name == "kind"
    }
    word = _word(list(readers))

    def read(value: object, where: str) -> object:
        kind = value.get("kind") if isinstance(value, Mapping) else None
        word(kind, f"'kind' of one of {where}")
        return readers[kind](value, f"one of {where}")

    return read


def _row(row_class: Any) -> Reader:
    """Return the reader of a named tuple."""
    readers = [(name, _reader(hint)) for name, hint in get_type_hints(row_class).items()]

    def read(value: object, where: str) -> object:
        if not isinstance(value, list | tuple) or len(value) != len(readers):
            raise _create_error(f"one of {where}", f"{len(readers)} values", value)
        pairs = zip(readers, value, strict=True)
        return row_class(*(reader(item, f"the {name} in {where}") for (name, reader), item in pairs))

    return read
