"""Lists of one type."""

from typing import Final

from btcore.errors import ConversionError
from btcore.values.numbers import json_items, lenient_float, lenient_int, to_single_precision, wrap_signed
from btcore.values.types import BOOL, DOUBLE, INT, STRING, IntegerType, RealType, ValueType, mismatch


class VectorType(ValueType):
    """A list of one type, in text separated by ``;``."""

    item: ValueType

    def __init__(self, item: ValueType) -> None:
        super().__init__(vector_name(item.name), list)
        self.item = item

    def from_text(self, text: str, format: int = 4) -> list[object]:
        """The items of ``a;b;c``, or in format 4 of the array ``json:[…]``. Raises ConversionError."""
        if format == 3 and self.item is INT:
            return [lenient_int(part) for part in split_items(text)]
        if format == 3 and self.item is DOUBLE:
            return [lenient_float(part) for part in split_items(text)]
        if format != 3 and text.startswith("json:"):
            return [self._from_json(one) for one in json_items(text[5:])]
        return [self.item.from_text(part, format) for part in split_items(text)]

    def to_text(self, value: object) -> str:
        """A JSON array, ``json:[…]``, of numbers, bools or strings; else the items between ``;``."""
        items = self.cast(value)
        if self.item in (INT, DOUBLE, BOOL, STRING):
            import json

            return "json:" + json.dumps(items, separators=(",", ":"), ensure_ascii=False)
        return ";".join([self.item.to_text(one) for one in items])

    def accepts(self, value: object) -> bool:
        """Whether *value* is a list of nothing but such items."""
        return isinstance(value, list) and self._all(value)

    def cast(self, value: object) -> list[object]:
        """The list, itself if all its items are of the type; integers may become reals."""
        if not isinstance(value, (list, tuple)):
            raise mismatch(value, self)
        if isinstance(value, list) and self._all(value):
            return value
        return [self.item.adapt(one) for one in value]

    def adapt(self, value: object) -> list[object]:
        """A list or tuple whose items fit."""
        return self.cast(value)

    def _all(self, items: list[object]) -> bool:
        item = self.item
        return all(item.accepts(one) for one in items)

    def _from_json(self, one: object) -> object:
        item = self.item
        if isinstance(one, bool):
            # Of the numbers only C++'s int takes a JSON bool.
            if item is BOOL:
                return one
            if item is INT:
                return int(one)
        elif isinstance(one, str):
            if item is STRING:
                return one
        elif isinstance(one, (int, float)):
            if isinstance(item, RealType):
                return to_single_precision(float(one)) if item.is_single else float(one)
            if isinstance(item, IntegerType):
                return wrap_signed(int(one), item.high.bit_length() + (1 if item.low < 0 else 0))
        raise ConversionError(f"{one!r} in a JSON array is no {item.name}")


def vector_name(item: str) -> str:
    """What C++ calls a vector of *item*."""
    return f"std::vector<{item}>"


def split_items(text: str) -> list[str]:
    """The items of *text* between ``;``; the last one may end with it, and "" has none."""
    parts = text.split(";")
    if not parts[-1]:
        parts.pop()
    return parts


VECTOR_INT: Final = VectorType(INT)
VECTOR_DOUBLE: Final = VectorType(DOUBLE)
VECTOR_BOOL: Final = VectorType(BOOL)
VECTOR_STRING: Final = VectorType(STRING)
