"""Reading flatbuffers: tables whose fields are found by their numbers, without generated code.

A table starts with how far before it its vtable is; that tells for each field how far behind the
table's start it lies (0 = absent). Strings, vectors and tables are reached by forward offsets. All
little endian (https://flatbuffers.dev/internals).
"""

import struct
from typing import Final

_U16: Final = struct.Struct("<H")
_I32: Final = struct.Struct("<i")
_U32: Final = struct.Struct("<I")
_I8: Final = struct.Struct("<b")


class FlatbufferError(Exception):
    """The bytes aren't the table that is expected."""


class Table:
    """One table in *data*."""

    def __init__(self, data: bytes, start: int) -> None:
        self._data = data
        self._start = start
        self._vtable = start - self._number(_I32, start)
        self._size = self._number(_U16, self._vtable)

    @classmethod
    def root(cls, data: bytes) -> "Table":
        """The table that everything hangs on. Raises FlatbufferError, as all reading does."""
        return cls(data, cls._forward(data, 0))

    def u16(self, field: int) -> int:
        """An unsigned number of 16 bits; 0 if absent."""
        place = self._place(field)
        return self._number(_U16, place) if place else 0

    def i8(self, field: int) -> int:
        """A number of 8 bits; 0 if absent."""
        place = self._place(field)
        return self._number(_I8, place) if place else 0

    def text(self, field: int) -> str:
        """A string, which must be there."""
        start, size = self._vector(field, 1)
        try:
            return self._data[start : start + size].decode("utf-8")
        except UnicodeDecodeError:
            raise FlatbufferError(f"the text at byte {start} is not UTF-8") from None

    def numbers(self, field: int) -> tuple[int, ...]:
        """A vector of unsigned numbers of 16 bits."""
        start, size = self._vector(field, _U16.size)
        return struct.unpack_from(f"<{size}H", self._data, start)

    def tables(self, field: int) -> "list[Table]":
        """A vector of tables."""
        start, size = self._vector(field, _U32.size)
        data = self._data
        return [Table(data, self._forward(data, start + _U32.size * index)) for index in range(size)]

    def _place(self, field: int) -> int:
        """Where *field* is, 0 if it is absent."""
        slot = 4 + 2 * field
        if slot + _U16.size > self._size:
            return 0
        offset = self._number(_U16, self._vtable + slot)
        return self._start + offset if offset else 0

    def _vector(self, field: int, width: int) -> tuple[int, int]:
        """Start and number of the elements, *width* bytes each, of a vector."""
        place = self._place(field)
        if not place:
            raise FlatbufferError(f"the table at byte {self._start} has no field {field}")
        start = self._forward(self._data, place)
        size = self._number(_U32, start)
        if start + _U32.size + size * width > len(self._data):
            raise FlatbufferError(f"the vector at byte {start} goes beyond the end")
        return start + _U32.size, size

    def _number(self, shape: struct.Struct, place: int) -> int:
        return self._unpack(self._data, shape, place)

    @classmethod
    def _forward(cls, data: bytes, place: int) -> int:
        return place + cls._unpack(data, _U32, place)

    @staticmethod
    def _unpack(data: bytes, shape: struct.Struct, place: int) -> int:
        if place < 0 or place + shape.size > len(data):
            raise FlatbufferError(f"byte {place} is asked for, and there are {len(data)}")
        return int(shape.unpack_from(data, place)[0])
