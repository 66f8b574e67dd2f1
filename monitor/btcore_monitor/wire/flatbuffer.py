"""A reader of flatbuffers from untrusted sources, without generated code.

Unlike the flatbuffers package, this reader raises FlatbufferError for an offset that leads out of the buffer,
and for a small buffer that refers to the same bytes so often that reading it would take very long.

A table starts with the distance to its vtable. The vtable lists the offset of each field from the table's
start; 0 = the field is absent. A field that is a string, a vector or a table holds the distance to its
content. All numbers are little endian (https://flatbuffers.dev/internals).
"""

import struct
from typing import Final, Self

from btcore_monitor.errors import MonitorError

_U16: Final = struct.Struct("<H")
_I32: Final = struct.Struct("<i")
_U32: Final = struct.Struct("<I")
_I8: Final = struct.Struct("<b")

_SHARING: Final = 32
"""The maximum number of bytes read, as a multiple of the buffer's size; above 1, as tables share strings."""
_TABLE_COST: Final = 8  # bytes that a table counts as


class FlatbufferError(MonitorError):
    """The bytes are not the expected flatbuffer."""


class Buffer:
    """The bytes of a flatbuffer, and the number of bytes that may still be read."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self._left = _SHARING * len(data)

    def number(self, shape: struct.Struct, place: int) -> int:
        """Return the number of the format *shape* at byte *place*. Raise FlatbufferError."""
        if place < 0 or place + shape.size > len(self.data):
            raise FlatbufferError(f"the flatbuffer points to byte {place}, but has {len(self.data)} bytes")
        return int(shape.unpack_from(self.data, place)[0])

    def forward(self, place: int) -> int:
        """Return the position to which the offset at byte *place* points. Raise FlatbufferError."""
        return place + self.number(_U32, place)

    def spend(self, size: int) -> None:
        """Count *size* bytes as read. Raise FlatbufferError if the limit is exceeded."""
        self._left -= size
        if self._left < 0:
            raise FlatbufferError("the flatbuffer refers to the same bytes too often")


class Table:
    """A table of a flatbuffer. Every method raises FlatbufferError if the bytes are invalid.

    The *field* of the methods is the index of a field, from 0, in the order of the schema.
    """

    def __init__(self, buffer: Buffer, start: int) -> None:
        buffer.spend(_TABLE_COST)
        self._buffer = buffer
        self._start = start
        self._vtable = start - buffer.number(_I32, start)
        self._size = buffer.number(_U16, self._vtable)

    @classmethod
    def root(cls, data: bytes) -> Self:
        """Return the root table of *data*."""
        buffer = Buffer(data)
        return cls(buffer, buffer.forward(0))

    def place(self, field: int) -> int:
        """Return the position of *field* in bytes, or 0 if the field is absent."""
        slot = 4 + 2 * field
        if slot + _U16.size > self._size:
            return 0
        offset = self._buffer.number(_U16, self._vtable + slot)
        return self._start + offset if offset else 0

    def u16(self, field: int) -> int:
        """Return an unsigned number of 16 bits, or 0 if the field is absent."""
        place = self.place(field)
        return self._buffer.number(_U16, place) if place else 0

    def i8(self, field: int) -> int:
        """Return a signed number of 8 bits, or 0 if the field is absent."""
        place = self.place(field)
        return self._buffer.number(_I8, place) if place else 0

    def text(self, field: int) -> str:
        """Return a required string; bytes that are not UTF-8 become �."""
        start, size = self._vector(field, 1)
        return self._buffer.data[start : start + size].decode("utf-8", "replace")

    def numbers(self, field: int) -> tuple[int, ...]:
        """Return a required vector of unsigned numbers of 16 bits."""
        start, size = self._vector(field, _U16.size)
        return struct.unpack_from(f"<{size}H", self._buffer.data, start)

    def tables(self, field: int) -> "list[Table]":
        """Return a required vector of tables."""
        start, size = self._vector(field, _U32.size)
        forward = self._buffer.forward
        return [Table(self._buffer, forward(start + _U32.size * index)) for index in range(size)]

    def _vector(self, field: int, width: int) -> tuple[int, int]:
        """Return the start and the length of a vector of elements of *width* bytes."""
        place = self.place(field)
        if not place:
            raise FlatbufferError(f"the flatbuffer's table at byte {self._start} lacks its field {field}")
        start = self._buffer.forward(place)
        size = self._buffer.number(_U32, start)
        start += _U32.size
        if start + size * width > len(self._buffer.data):
            raise FlatbufferError(f"the flatbuffer's vector at byte {start} exceeds the flatbuffer's end")
        self._buffer.spend(size * width)
        return start, size
