"""What a scene is made of: the data of `StaticMessage` and `MovingMessage`, checked, and packed for the wire.

Every key may be left out; others than these are passed on unseen. Lengths are metres, angles radians, colours
RGBA (0–255), quaternions x y z w, blobs little-endian.

===============  =====================================================================================
``frame``        the frame that the others lead up to
``parts``        shapes: ``kind`` box (``size``), cylinder (``radius``, ``length``) or sphere (``radius``)
``laser``        the scanner's geometry
``places``       what has a name on the floor: ``name``, ``position``
``areas``        rectangles on the floor: ``name``, ``corners`` (xmin, ymin, xmax, ymax)
``cameras``      pinholes: ``name``, ``frame`` (z ahead), ``size`` (pixels), ``focal``, ``center`` (pixels)
``battery``      how full it is (percent)
``frames``       poses: [child, parent, position, quaternion]
``scan``         ``stamp``, and ``ranges`` as float32
``velocity``     m/s and rad/s
``grids``        cells on the floor: ``name``; ``kind`` occupancy (-1 unknown, 0–100) or costs (Nav2's
                 0–255); ``resolution``; ``origin`` of the lower-left corner; ``size`` (columns, rows);
                 ``cells``, a byte each, lowest row first
``poses``        poses on the floor: ``name``; ``kind`` path, cloud, goal, estimate or odometry; ``rows`` of
                 x, y, yaw as float32, of which none clears what was there
``arrows``       all there are now: ``name``, ``start``, ``end``, ``color``
``boxes``        what was found in space, all there is now: ``name``, ``position`` of its middle, ``size``;
                 maybe ``frame``, ``quaternion``, ``color``
``pictures``     ``name``, ``stamp``, ``size``, ``format`` jpeg or rgb8, ``data``
``detections``   all there are now: ``picture`` (its name), ``name``, ``box`` (left, top, width, height)
``notes``        what is to be said of the robot: name → text
===============  =====================================================================================

Whoever takes the place of a grid, a picture, or poses has the same ``name``. On the wire cells and pixels are
deflated: such an entry has ``coding``: ``zlib``.
"""

import zlib
from collections.abc import Callable, Mapping
from typing import Any, Final

from btcore_monitor.wire.errors import ProtocolError

CELLS_AT_MOST: Final = 1 << 25
"""Cells of a grid, or bytes of a picture, that are taken in."""
_LEVEL: Final = 1
"""Of deflation: costs shrink to a twentieth by it, and higher ones take several times as long."""

Check = Callable[[object, str], None]
Entry = Mapping[str, Any]


def pack_scene(data: Entry) -> dict[str, Any]:
    """*data* with its cells and pixels deflated."""
    return {
        **data,
        **{key: [_deflated(one, blob) for one in data[key]] for key, blob in _BLOBS.items() if data.get(key)},
    }


def unpack_scene(data: Entry, kind: str) -> dict[str, Any]:
    """Return the unpacked *data* of a message of *kind*. Raises ProtocolError for anything unexpected."""
    _SCENE(data, f"a '{kind}' message")
    return {
        **data,
        **{key: [_inflated(one, key) for one in data[key]] for key in _BLOBS if data.get(key)},
    }


_BLOBS: Final = {"grids": "cells", "pictures": "data"}


def _deflated(entry: Entry, blob: str) -> Entry:
    if "coding" in entry or entry.get("format") == "jpeg":
        return entry
    return {**entry, blob: zlib.compress(entry[blob], _LEVEL), "coding": "zlib"}


def _inflated(entry: Entry, key: str) -> Entry:
    if entry.get("format") == "jpeg":
        return entry
    blob = _BLOBS[key]
    width, height = entry["size"]
    wanted = width * height * (3 if key == "pictures" else 1)
    if width < 1 or height < 1 or wanted > CELLS_AT_MOST:
        raise ProtocolError(
            f"expected at most {CELLS_AT_MOST} bytes in '{key}', and got {width} times {height}"
        )
    plain = {name: value for name, value in entry.items() if name != "coding"}
    if "coding" in entry:
        plain[blob] = _unzipped(entry, blob, wanted)
    if len(plain[blob]) != wanted:
        raise ProtocolError(
            f"expected {wanted} bytes of '{blob}' for {entry['name']!r}, and got {len(plain[blob])}"
        )
    return plain


def _unzipped(entry: Entry, blob: str, wanted: int) -> bytes:
    if entry["coding"] != "zlib":
        raise ProtocolError(f"expected '{blob}' to be coded by zlib, and got {_said(entry['coding'])}")
    try:
        return zlib.decompressobj().decompress(entry[blob], wanted + 1)
    except zlib.error as error:
        raise ProtocolError(f"expected deflated '{blob}' for {entry['name']!r}, and got {error}") from None


def _said(value: object) -> str:
    return repr(value)[:40] if isinstance(value, str | int | float | None) else type(value).__name__


def _is(kind: type | tuple[type, ...], said: str) -> Check:
    def check(value: object, where: str) -> None:
        if not isinstance(value, kind) or isinstance(value, bool):
            raise ProtocolError(f"expected {where} to be {said}, and got {_said(value)}")

    return check


_number = _is((int, float), "a number")
_text = _is(str, "text")
_whole = _is(int, "a whole number")
_blob = _is(bytes, "bytes")


def _each(check: Check, count: int | None = None) -> Check:
    def checks(value: object, where: str) -> None:
        if not isinstance(value, list | tuple) or (count is not None and len(value) != count):
            what = "a list" if count is None else f"{count} values"
            raise ProtocolError(f"expected {where} to be {what}, and got {_said(value)}")
        for one in value:
            check(one, where)

    return checks


def _floats(value: object, where: str) -> None:
    _blob(value, where)
    assert isinstance(value, bytes)
    if len(value) % 4:
        raise ProtocolError(f"expected {where} to be float32, and got {len(value)} bytes")


def _rows_of_three(value: object, where: str) -> None:
    _blob(value, where)
    assert isinstance(value, bytes)
    if len(value) % 12:
        raise ProtocolError(f"expected {where} to be rows of three float32, and got {len(value)} bytes")


def _record(needed: Mapping[str, Check], more: Mapping[str, Check] | None = None) -> Check:
    known = [*((name, check, True) for name, check in needed.items())]
    known += [(name, check, False) for name, check in (more or {}).items()]

    def check_record(value: object, where: str) -> None:
        if not isinstance(value, Mapping):
            raise ProtocolError(f"expected {where} to be a map, and got {_said(value)}")
        for name, check, must in known:
            if name in value:
                check(value[name], f"'{name}' of {where}")
            elif must:
                raise ProtocolError(f"expected '{name}' of {where}, and got nothing")

    return check_record


def _word(*words: str) -> Check:
    def check(value: object, where: str) -> None:
        if value not in words:
            raise ProtocolError(f"expected {where} to be {' or '.join(words)}, and got {_said(value)}")

    return check


def _texts(value: object, where: str) -> None:
    if not isinstance(value, Mapping):
        raise ProtocolError(f"expected {where} to be a map, and got {_said(value)}")
    for one in value.values():
        _text(one, where)


_VECTOR: Final = _each(_number, 3)
_QUATERNION: Final = _each(_number, 4)
_COLOUR: Final = {"color": _each(_whole, 4)}
_FRAME: Final = {"frame": _text}
_SIZE: Final = _each(_whole, 2)
_SHAPES: Final[Mapping[str, Mapping[str, Check]]] = {
    "box": {"size": _VECTOR},
    "cylinder": {"radius": _number, "length": _number},
    "sphere": {"radius": _number},
}
_PARTS: Final = {
    kind: _record(
        {"position": _VECTOR, **needed}, {"name": _text, "quaternion": _QUATERNION, **_FRAME, **_COLOUR}
    )
    for kind, needed in _SHAPES.items()
}


def _part(value: object, where: str) -> None:
    kind = value.get("kind") if isinstance(value, Mapping) else None
    _word(*_PARTS)(kind, f"'kind' of one of {where}")
    _PARTS[str(kind)](value, f"one of {where}")


def _frame_row(value: object, where: str) -> None:
    _each(lambda one, there: None, 4)(value, f"one of {where}")
    assert isinstance(value, list | tuple)
    child, parent, position, quaternion = value
    _text(child, f"the child in {where}")
    _text(parent, f"the parent in {where}")
    _VECTOR(position, f"the position in {where}")
    _QUATERNION(quaternion, f"the quaternion in {where}")


_LASER: Final = _record(
    {"frame": _text, "angle_min": _number, "angle_increment": _number},
    {"range_min": _number, "range_max": _number},
)
_GRID: Final = _record(
    {
        "name": _text,
        "kind": _word("occupancy", "costs"),
        "resolution": _number,
        "origin": _each(_number, 2),
        "size": _SIZE,
        "cells": _blob,
    },
    _FRAME,
)
_SCENE: Final = _record(
    {},
    {
        "frame": _text,
        "parts": _each(_part),
        "laser": _LASER,
        "footprint_radius": _number,
        "places": _each(_record({"name": _text, "position": _VECTOR}, _FRAME)),
        "areas": _each(_record({"name": _text, "corners": _QUATERNION}, _FRAME)),
        "cameras": _each(
            _record(
                {"name": _text, "frame": _text, "size": _SIZE, "focal": _each(_number, 2)},
                {"center": _each(_number, 2)},
            )
        ),
        "battery": _number,
        "frames": _each(_frame_row),
        "scan": _record({"ranges": _floats}, {"stamp": _whole}),
        "velocity": _each(_number, 2),
        "grids": _each(_GRID),
        "poses": _each(
            _record(
                {
                    "name": _text,
                    "kind": _word("path", "cloud", "goal", "estimate", "odometry"),
                    "rows": _rows_of_three,
                },
                _FRAME,
            )
        ),
        "arrows": _each(_record({"name": _text, "start": _VECTOR, "end": _VECTOR}, {**_FRAME, **_COLOUR})),
        "boxes": _each(
            _record(
                {"name": _text, "position": _VECTOR, "size": _VECTOR},
                {"quaternion": _QUATERNION, **_FRAME, **_COLOUR},
            )
        ),
        "pictures": _each(
            _record(
                {"name": _text, "size": _SIZE, "format": _word("jpeg", "rgb8"), "data": _blob},
                {"stamp": _whole},
            )
        ),
        "detections": _each(_record({"picture": _text, "name": _text, "box": _each(_number, 4)})),
        "notes": _texts,
        "collisions": _whole,
        "grazes": _whole,
    },
)
