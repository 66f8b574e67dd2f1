"""Reading flatbuffers that strangers sent: tables whose fields are found by their numbers.

The flatbuffers package reads without looking whether an offset leads out of the buffer, and whether a
few bytes pretend to be a million tables. Here both end in a ProtocolError. A table starts with how far
before it its vtable is, which tells how far behind the table's start each field lies (0: absent);
strings, vectors and tables are reached by forward offsets (https://flatbuffers.dev/internals).
"""

import struct
from typing import Final, Self

from btcore_monitor.wire.errors import ProtocolError, describe_bytes

_U16: Final = struct.Struct("<H")
_I32: Final = struct.Struct("<i")
_U32: Final = struct.Struct("<I")
_I8: Final = struct.Struct("<b")

_SHARING: Final = 32
"""How many times its own size a buffer may be read in all; tables that share strings may exceed it once."""
_TABLE_COST: Final = 8


class Buffer:
    """The received bytes, and how much of them may still be read."""

    def __init__(self, data: bytes) -> None:
        self.data = data
        self._left = _SHARING * len(data)

    def number(self, shape: struct.Struct, place: int) -> int:
        """The number at byte *place*."""
        if place < 0 or place + shape.size > len(self.data):
            raise ProtocolError(
                f"the flatbuffer points to byte {place}, and there are {describe_bytes(self.data)}"
            )
        return int(shape.unpack_from(self.data, place)[0])

    def forward(self, place: int) -> int:
        """Where the offset at *place* leads."""
        return place + self.number(_U32, place)

    def spend(self, size: int) -> None:
        """Count *size* bytes as read."""
        self._left -= size
        if self._left < 0:
            raise ProtocolError(
                f"the flatbuffer shows the same bytes again and again: {describe_bytes(self.data)}"
            )


class Table:
    """One table. All reading raises :class:`ProtocolError` where the bytes make no sense."""

    def __init__(self, buffer: Buffer, start: int) -> None:
        buffer.spend(_TABLE_COST)
        self._buffer = buffer
        self._start = start
        self._vtable = start - buffer.number(_I32, start)
        self._size = buffer.number(_U16, self._vtable)

    @classmethod
    def root(cls, data: bytes) -> Self:
        """The table that everything in *data* hangs on."""
        buffer = Buffer(data)
        return cls(buffer, buffer.forward(0))

    def place(self, field: int) -> int:
        """At which byte *field* is; 0 if it is absent."""
        slot = 4 + 2 * field
        if slot + _U16.size > self._size:
            return 0
        offset = self._buffer.number(_U16, self._vtable + slot)
        return self._start + offset if offset else 0

    def u16(self, field: int) -> int:
        """An unsigned number of 16 bits; 0 if absent."""
        place = self.place(field)
        return self._buffer.number(_U16, place) if place else 0

    def i8(self, field: int) -> int:
        """A number of 8 bits; 0 if absent."""
        place = self.place(field)
        return self._buffer.number(_I8, place) if place else 0

    def text(self, field: int) -> str:
        """A string, which must be there; what is not UTF-8 in it is shown as �."""
        start, size = self._vector(field, 1)
        return self._buffer.data[start : start + size].decode("utf-8", "replace")

    def numbers(self, field: int) -> tuple[int, ...]:
        """A vector of unsigned numbers of 16 bits, which must be there."""
        start, size = self._vector(field, _U16.size)
        return struct.unpack_from(f"<{size}H", self._buffer.data, start)

    def tables(self, field: int) -> "list[Table]":
        """A vector of tables, which must be there."""
        start, size = self._vector(field, _U32.size)
        forward = self._buffer.forward
        return [Table(self._buffer, forward(start + _U32.size * index)) for index in range(size)]

    def _vector(self, field: int, width: int) -> tuple[int, int]:
        """The start and the number of the elements, *width* bytes each, of a vector."""
        place = self.place(field)
        if not place:
            raise ProtocolError(f"the flatbuffer's table at byte {self._start} lacks its field {field}")
        start = self._buffer.forward(place)
        size = self._buffer.number(_U32, start)
        start += _U32.size
        if start + size * width > len(self._buffer.data):
            raise ProtocolError(
                f"the flatbuffer's vector at byte {start} is longer than {describe_bytes(self._buffer.data)}"
            )
        self._buffer.spend(size * width)
        return start, size
