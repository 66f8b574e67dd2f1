"""The types of ports and entries: their names in C++, their text forms, and which values they accept.

The rules are those of BehaviorTree.CPP 4.10. `from_text` corresponds to `convertFromString`. `cast`
corresponds to `Any::cast`, which reads a stored value as another type. `adapt` corresponds to the check
in `Blackboard::set`, which writes a value to an entry that already has a type.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass
from enum import Enum, IntEnum
from typing import Any, Final

from mypy_extensions import mypyc_attr

from btcore.errors import ConversionError
from btcore.status import NodeType, Status
from btcore.suggestions import join_names
from btcore.values.numbers import (
    MAX_INT64,
    MAX_UINT64,
    MIN_INT64,
    c_float,
    c_int,
    c_unsigned,
    json_items,
    leading_float,
    leading_int,
    lenient_float,
    lenient_int,
    read_json,
    to_single_precision,
    wrap_signed,
)

# The largest integer that, like both its neighbours, is exact as a double.
MAX_EXACT: Final = 2**53 - 1
# Most numbers are smaller and take a fast path, in which compiled code needs no large integers.
_SMALL: Final = 2**31
_SMALL_REAL: Final = 2.0**31


@mypyc_attr(allow_interpreted_subclasses=True)
class ValueType:
    """The type of a port or of an entry. Subclass it for a type that is more specific than a Python class.

    Attributes:
        name: The name of the type in C++, in monitoring protocols and in XML models.
        strong: Whether the type restricts the values. False for types that accept any value.
        converts: Whether a text is converted when it is written to an entry of this type. False for enums,
            which are looked up when they are read.
        python_type: The class of the values.

    Examples:
        >>> from btcore import values
        >>> values.INT.from_text("42"), values.BOOL.to_text(True), values.VECTOR_DOUBLE.from_text("1;2")
        (42, 'true', [1.0, 2.0])
    """

    def __init__(self, name: str, python_type: type, strong: bool = True, converts: bool = True) -> None:
        self.name = name
        self.python_type = python_type
        self.strong = strong
        self.converts = converts

    def from_text(self, text: str, format: int = 4) -> object:
        """Return the value that a text stands for.

        Args:
            text: The text, for example of an attribute in the XML.
            format: The XML format whose conversion rules apply, 3 or 4.

        Raises:
            ConversionError: The text does not stand for a value of this type, or the type has no text form.
        """
        raise ConversionError(
            f"'{text}' cannot be converted: {self.name} has no text form; "
            f"give it one with add_type({self.python_type.__name__}, from_text=…)"
        )

    def to_text(self, value: object) -> str:
        """Return *value* as text; for most types, `from_text` reads it back.

        Raises:
            ConversionError: The value has no text.
        """
        raise ConversionError(f"{self.name} has no text form; give it one with add_type(…, to_text=…)")

    @property
    def has_converters(self) -> bool:
        """Whether a converter from text is registered."""
        return False

    def accepts(self, value: object) -> bool:
        """Return whether *value* is of exactly this type."""
        return isinstance(value, self.python_type)

    def cast(self, value: object) -> object:
        """Return the stored *value* as this type. Raise ConversionError if that would lose information."""
        if isinstance(value, self.python_type):
            return value
        raise mismatch(value, self)

    def adapt(self, value: object) -> object:
        """Return *value* in the form in which an entry of this type stores it. Raise ConversionError."""
        if self.accepts(value):
            return value
        raise mismatch(value, self)

    def same(self, other: "ValueType") -> bool:
        """Return whether *other* is the same type."""
        return self is other or (self.name == other.name and self.python_type is other.python_type)

    def is_related(self, other: "ValueType") -> bool:
        """Return whether both types are user's classes, and one of the classes derives from the other."""
        return False

    def __repr__(self) -> str:
        return f"<type {self.name}>"


def mismatch(value: object, value_type: ValueType) -> ConversionError:
    """Return the error for a *value* that does not fit *value_type*; None stands for an unwritten entry."""
    if value is None:
        return ConversionError("there is no value: the entry was never written")
    return ConversionError(f"{value!r} is not a valid {value_type.name}")


def number_of(value: object) -> int | float | None:
    """Return *value* as a number (bools and enum members are integers), or None if it is not a number.

    Examples:
        >>> from btcore import values
        >>> values.number_of(True), values.number_of("3")
        (True, None)
    """
    if isinstance(value, (int, float)):
        return value
    if isinstance(value, Enum) and isinstance(value.value, int):
        return int(value.value)
    return None


def quick_double(value: object) -> float:
    """Return *value* as a double if it is a float or a small integer, else NaN."""
    if isinstance(value, float):
        return value
    if isinstance(value, int) and -_SMALL < value < _SMALL:
        return float(value)
    return math.nan


def as_double(number: int | float) -> float:
    """Return *number* as a double.

    Raises:
        ConversionError: The number is an integer of more than 53 bits.

    Examples:
        >>> from btcore import values
        >>> values.as_double(3)
        3.0
    """
    if isinstance(number, float):
        return number
    if -MAX_EXACT <= number <= MAX_EXACT:
        return float(number)
    raise ConversionError(f"{number} is too large: a double represents integers of at most 53 bits")


def as_bool(number: int | float) -> bool:
    """Return *number* as a bool; every positive float is true.

    Raises:
        ConversionError: The number is an integer except 0 and 1, or a negative float.

    Examples:
        >>> from btcore import values
        >>> values.as_bool(0.5), values.as_bool(0)
        (True, False)
    """
    if isinstance(number, float):
        if number < 0.0:
            raise ConversionError(f"{number!r} is not a valid bool: it is negative")
        return number != 0.0
    if number == 0 or number == 1:
        return number == 1
    raise ConversionError(f"{number} is not a valid bool; the only valid integers are 0 and 1")


def as_int(number: int | float, low: int, high: int, name: str = "int64_t") -> int:
    """Return *number* as an integer.

    Args:
        number: The number.
        low: The minimum.
        high: The maximum.
        name: The name of the integer type, for the error message.

    Raises:
        ConversionError: The number is not an integer from *low* to *high*.

    Examples:
        >>> from btcore import values
        >>> values.as_int(3.0, 0, 255, "uint8_t")
        3
    """
    if isinstance(number, float):
        if -_SMALL_REAL < number < _SMALL_REAL:
            value = int(number)
            if float(value) == number and low <= value <= high:
                return value
        # The limits are compared as doubles, as in C++. 2^63 − 1 rounds up to 2^63, hence the check below.
        if number != number or not (float(low) <= number <= float(high)) or number != math.floor(number):
            raise ConversionError(f"{number!r} is not a valid {name}")
        value = int(number)
    else:
        value = int(number)
    if value < low or value > high:
        raise ConversionError(f"{value} is out of range for {name}: {low} to {high}")
    return value


class IntegerType(ValueType):
    """Integers from *low* to *high*.

    Examples:
        >>> from btcore import values
        >>> values.UINT8.from_text("255"), values.UINT8.low, values.UINT8.high
        (255, 0, 255)
    """

    def __init__(self, name: str, low: int, high: int) -> None:
        super().__init__(name, int)
        self.low = low
        self.high = high

    def from_text(self, text: str, format: int = 4) -> int:
        """Return the integer at the start of *text* (3 for `3.7`). Raise ConversionError."""
        if format == 3:
            if self.low == 0:
                return c_unsigned(text, self.high.bit_length())
            return c_int(text, self.low, self.high)
        # BehaviorTree.CPP reads all types but uint64_t as int64_t, so "-0" is an error for uint64_t only.
        return leading_int(text, self.low, self.high, self.high == MAX_UINT64)

    def to_text(self, value: object) -> str:
        """Return decimal digits."""
        return str(self.cast(value))

    def accepts(self, value: object) -> bool:
        """Return whether *value* is an int in the range."""
        return type(value) is int and self.low <= value <= self.high

    def cast(self, value: object) -> int:
        """Return a number, or the number at the start of a text, as an integer. Raise ConversionError."""
        if isinstance(value, str):
            return leading_int(value, self.low, self.high, self.low == 0)
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        return as_int(number, self.low, self.high, self.name)

    def adapt(self, value: object) -> int:
        """Return a number as an integer. Raise ConversionError unless it is an integer in the range."""
        if isinstance(value, (int, float)):
            return as_int(value, self.low, self.high, self.name)
        raise mismatch(value, self)


class RealType(ValueType):
    """Floating-point numbers: C++'s float if *is_single*, to which values are rounded, else double."""

    def __init__(self, name: str, is_single: bool) -> None:
        super().__init__(name, float)
        self.is_single = is_single

    def from_text(self, text: str, format: int = 4) -> float:
        """Return the number at the start of *text*. Raise ConversionError."""
        if format == 3:
            return c_float(text, self.is_single)
        return leading_float(text, self.is_single)

    def to_text(self, value: object) -> str:
        """Return six decimals, as C's `%f`."""
        return real_text(self.cast(value))

    def accepts(self, value: object) -> bool:
        """Return whether *value* is a float."""
        return isinstance(value, float)

    def cast(self, value: object) -> float:
        """Return a number, or the number at the start of a text, as a float.

        Raises:
            ConversionError: The value is not a number, or an integer that is not exact as a double.
        """
        if type(value) is float and not self.is_single:
            return value
        if isinstance(value, str):
            return leading_float(value, self.is_single)
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        real = as_double(number)
        return to_single_precision(real) if self.is_single else real

    def adapt(self, value: object) -> float:
        """Return a number as a float. Raise ConversionError for an integer that is not exact as a double."""
        if isinstance(value, (int, float)):
            return self.cast(value)
        raise mismatch(value, self)


class BoolType(ValueType):
    """True and false."""

    def from_text(self, text: str, format: int = 4) -> bool:
        """Read `0 1 true TRUE True false FALSE False`. Raise ConversionError for any other text."""
        if text in ("1", "true", "TRUE", "True"):
            return True
        if text in ("0", "false", "FALSE", "False"):
            return False
        raise ConversionError(f"'{text}' is not a valid bool; use true, false, 1 or 0")

    def to_text(self, value: object) -> str:
        """Return `true` or `false`."""
        return "true" if self.cast(value) else "false"

    def cast(self, value: object) -> bool:
        """Return a bool, or a number as a bool. Raise ConversionError, also for every text."""
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        return as_bool(number)


class StringType(ValueType):
    """Strings of any content."""

    def from_text(self, text: str, format: int = 4) -> str:
        """Return the text itself."""
        return text

    def to_text(self, value: object) -> str:
        """Return the text itself."""
        return self.cast(value)

    def cast(self, value: object) -> str:
        """Return a text, or a number as text: `%d` for integers, `%f` for reals."""
        if isinstance(value, str):
            return value
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        return number_text(number)


class AnyType(ValueType):
    """A type that accepts any value: the type of a port declared without a type, or `BT::Any`."""

    def __init__(self, name: str, converts: bool) -> None:
        super().__init__(name, object, strong=False, converts=converts)

    def from_text(self, text: str, format: int = 4) -> object:
        """Return the text itself."""
        return text

    def accepts(self, value: object) -> bool:
        """Return True."""
        return True

    def cast(self, value: object) -> object:
        """Return the value itself."""
        if value is None:
            raise mismatch(value, self)
        return value


def number_text(number: int | float) -> str:
    """Return *number* as BehaviorTree.CPP writes it: `%d` or `%f`.

    Examples:
        >>> from btcore import values
        >>> values.number_text(3), values.number_text(0.5)
        ('3', '0.500000')
    """
    return real_text(number) if isinstance(number, float) else str(int(number))


def real_text(value: float) -> str:
    """Return *value* as C's `%f` writes it; a NaN with a sign bit is `-nan`.

    Examples:
        >>> from btcore import values
        >>> values.real_text(0.5), values.real_text(float("nan"))
        ('0.500000', 'nan')
    """
    if value != value and math.copysign(1.0, value) < 0:
        return "-nan"
    return f"{value:f}"


class VectorType(ValueType):
    """A list of values of one type, separated by `;` in text.

    Attributes:
        item: The type of the elements.

    Examples:
        >>> from btcore import values
        >>> numbers = values.VectorType(values.INT)
        >>> numbers.from_text("1;2;3")
        [1, 2, 3]
    """

    def __init__(self, item: ValueType) -> None:
        super().__init__(f"std::vector<{item.name}>", list)
        self.item = item

    def from_text(self, text: str, format: int = 4) -> list[object]:
        """Return the items of `a;b;c`, or in format 4 of `json:[…]`. Raise ConversionError."""
        if format == 3 and self.item is INT:
            return [lenient_int(part) for part in split_items(text)]
        if format == 3 and self.item is DOUBLE:
            return [lenient_float(part) for part in split_items(text)]
        if format != 3 and text.startswith("json:"):
            return [self._from_json(value) for value in json_items(text[5:])]
        return [self.item.from_text(part, format) for part in split_items(text)]

    def to_text(self, value: object) -> str:
        """Return `json:[…]` for int, double, bool and string, else the items separated by `;`."""
        items = self.cast(value)
        if self.item in (INT, DOUBLE, BOOL, STRING):
            import json

            return "json:" + json.dumps(items, separators=(",", ":"), ensure_ascii=False)
        return ";".join([self.item.to_text(value) for value in items])

    def accepts(self, value: object) -> bool:
        """Return whether *value* is a list, and all its items are of the item type."""
        return isinstance(value, list) and self._accepts_all(value)

    def cast(self, value: object) -> list[object]:
        """Return the list itself if all its items are of the item type, else a list of converted items."""
        if not isinstance(value, (list, tuple)):
            raise mismatch(value, self)
        if isinstance(value, list) and self._accepts_all(value):
            return value
        return [self.item.adapt(element) for element in value]

    def adapt(self, value: object) -> list[object]:
        """Return a list of the item type, as `cast` does. Raise ConversionError."""
        return self.cast(value)

    def _accepts_all(self, items: list[object]) -> bool:
        item = self.item
        return all(item.accepts(value) for value in items)

    def _from_json(self, value: object) -> object:
        item = self.item
        if isinstance(value, bool):
            # BehaviorTree.CPP converts a JSON bool to int, but to no other type of number.
            if item is BOOL:
                return value
            if item is INT:
                return int(value)
        elif isinstance(value, str):
            if item is STRING:
                return value
        elif isinstance(value, (int, float)):
            if isinstance(item, RealType):
                return to_single_precision(float(value)) if item.is_single else float(value)
            if isinstance(item, IntegerType):
                return wrap_signed(int(value), item.high.bit_length() + (1 if item.low < 0 else 0))
        raise ConversionError(f"{value!r} in a JSON array is not a valid {item.name}")


def split_items(text: str) -> list[str]:
    """Return the items of *text*, separated by `;`. A final `;` is ignored, and "" has no items."""
    return text.removesuffix(";").split(";") if text else []


class PortDirection(IntEnum):
    """The direction of a port. The numbers are those of BehaviorTree.CPP."""

    INPUT = 0
    OUTPUT = 1
    INOUT = 2


_DIRECTION_NAMES: Final = ("Input", "Output", "InOut")
_NODE_TYPE_NAMES: Final = ("Undefined", "Action", "Condition", "Control", "Decorator", "SubTree")


class ConvertibleType(ValueType):
    """The type of a user's class or enum, with the converters from and to text that the user registered."""

    def __init__(
        self,
        python_type: type,
        name: str,
        from_text: Callable[[str], object] | None = None,
        to_text: Callable[[Any], str] | None = None,
        converts: bool = True,
    ) -> None:
        super().__init__(name, python_type, converts=converts)
        self._from_text = from_text
        self._to_text = to_text

    @property
    def has_converters(self) -> bool:
        """Whether a converter from text is registered."""
        return self._from_text is not None

    def set_converters(
        self, from_text: Callable[[str], object] | None, to_text: Callable[[Any], str] | None
    ) -> None:
        """Replace the converters; None = no converter."""
        self._from_text = from_text
        self._to_text = to_text


class EnumType(ConvertibleType):
    """The type of a Python Enum. A text may be a registered name, or the name or number of a member.

    *names* are the registered enum names with their numbers. If the user registered a converter from text, it
    replaces the members' names: it is called for a text that is neither a registered name nor a member's
    number.

    Args:
        from_text: The converter that replaces the names of the members, if any.
        to_text: The converter to text, if any.

    Examples:
        >>> from enum import Enum
        >>> from btcore import values
        >>> class Color(Enum):
        ...     RED = 1
        ...     GREEN = 2
        >>> color = values.EnumType(Color, "Color")
        >>> color.from_text("GREEN"), color.from_text("1"), color.to_text(Color.RED)
        (<Color.GREEN: 2>, <Color.RED: 1>, 'RED')
    """

    def __init__(
        self,
        python_type: type[Enum],
        name: str,
        names: Mapping[str, int] | None = None,
        from_text: Callable[[str], object] | None = None,
        to_text: Callable[[Any], str] | None = None,
    ) -> None:
        super().__init__(python_type, name, from_text, to_text, converts=False)
        self._names: Mapping[str, int] = {} if names is None else names
        self._members: dict[str, Enum] = dict(python_type.__members__)
        self._by_number: dict[int, Enum] = {
            int(member.value): member for member in python_type if isinstance(member.value, int)
        }

    @property
    def members(self) -> list[Enum]:
        """The members of the enum, in the order of their definition."""
        return list(dict.fromkeys(self._members.values()))

    def from_text(self, text: str, format: int = 4) -> Enum:
        """Return the member with the name or the number *text*. Raise ConversionError."""
        # The names that scripts use have precedence, as in BehaviorTree.CPP.
        registered = self._names.get(text)
        if registered is not None and registered in self._by_number:
            return self._by_number[registered]
        member = self._members.get(text)
        if member is not None and self._from_text is None:
            return member
        try:
            number = leading_int(text, MIN_INT64, MAX_INT64)
        except ConversionError:
            number = -1
        # The whole text must be the number: "7x" and "07" are not accepted.
        if str(number) == text and number in self._by_number:
            return self._by_number[number]
        if self._from_text is not None:
            return self._converted(text, self._from_text)
        names = join_names(self._members, "or", most=len(self._members))
        raise ConversionError(f"'{text}' is not a member of {self.name}; use {names}")

    def _converted(self, text: str, converter: Callable[[str], object]) -> Enum:
        try:
            member = converter(text)
        except ConversionError:
            raise
        except Exception as error:
            wrapped = ConversionError(f"'{text}' is not a valid {self.name}: {error}")
            # Code compiled by mypyc does not set __cause__ by `raise … from`.
            wrapped.__cause__ = error
            raise wrapped from error
        if isinstance(member, Enum) and isinstance(member, self.python_type):
            return member
        raise ConversionError(f"the converter of {self.name} returned {member!r} for '{text}', not a member")

    def to_text(self, value: object) -> str:
        """Return the member's name, or the result of the converter."""
        member = self.cast(value)
        return member.name if self._to_text is None else self._to_text(member)

    def cast(self, value: object) -> Enum:
        """Return the member for *value*: a member, its number or its text. Raise ConversionError."""
        if isinstance(value, Enum) and isinstance(value, self.python_type):
            return value
        if isinstance(value, str):
            return self.from_text(value)
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        member = self._by_number.get(as_int(number, -(2**31), 2**31 - 1, self.name))
        if member is None:
            raise mismatch(value, self)
        return member


class StatusType(EnumType):
    """The status of a node; its text is the upper-case name. Format 3 does not have SKIPPED."""

    def from_text(self, text: str, format: int = 4) -> Enum:
        """Return the status with the name *text*. Raise ConversionError."""
        status = self._members.get(text)
        if status is None or (format == 3 and text == "SKIPPED"):
            names = join_names((name for name in self._members if format != 3 or name != "SKIPPED"), "or")
            raise ConversionError(f"'{text}' is not a status; use {names}")
        return status


class DirectionType(EnumType):
    """The direction of a port; its text is `Input` or `INPUT` etc. Format 3 reads other text as InOut."""

    def from_text(self, text: str, format: int = 4) -> Enum:
        """Return the direction with the name *text*. Raise ConversionError."""
        for member, name in zip(PortDirection, _DIRECTION_NAMES, strict=True):
            if text == name or text == name.upper():
                return member
        if format == 3:
            return PortDirection.INOUT
        raise ConversionError(f"'{text}' is not a port direction; use Input, Output or InOut")

    def to_text(self, value: object) -> str:
        """Return `Input`, `Output` or `InOut`."""
        return _DIRECTION_NAMES[int(self.cast(value).value)]


class NodeTypeType(EnumType):
    """The type of a node; its text is `Action`, `SubTree` etc. Other text is read as UNDEFINED."""

    def from_text(self, text: str, format: int = 4) -> Enum:
        """Return the node type with the name *text*. Format 3 also reads `SubTreePlus`."""
        if format == 3 and text == "SubTreePlus":
            return NodeType.SUBTREE
        for member, name in zip(NodeType, _NODE_TYPE_NAMES, strict=True):
            if text == name:
                return member
        return NodeType.UNDEFINED

    def to_text(self, value: object) -> str:
        """Return `Action`, `SubTree` etc."""
        return _NODE_TYPE_NAMES[int(self.cast(value).value)]


class UserType(ConvertibleType):
    """The type of a user's class. A dataclass without converters has the text form `json:{…}`."""

    def is_related(self, other: ValueType) -> bool:
        """Return whether *other* is the type of a base class or of a derived class."""
        if not isinstance(other, UserType):
            return False
        mine, its = self.python_type, other.python_type
        try:
            return issubclass(mine, its) or issubclass(its, mine)
        except TypeError:
            return False  # a Protocol that issubclass() does not support

    def from_text(self, text: str, format: int = 4) -> object:
        """Return the dataclass that `json:{…}` describes, else the result of the converter.

        Raises:
            ConversionError: There is no converter, or it raised an exception, or the JSON is invalid.
        """
        if format != 3 and text.startswith("json:") and is_dataclass(self.python_type):
            return self._from_json(text[5:])
        if self._from_text is None:
            return super().from_text(text, format)
        try:
            return self._from_text(text)
        except Exception as error:
            raise ConversionError(f"'{text}' is not a valid {self.name}: {error}") from error

    def to_text(self, value: object) -> str:
        """Return the result of the converter; without a converter, a dataclass as `json:{…}`."""
        if self._to_text is not None:
            return self._to_text(value)
        if is_dataclass(value) and not isinstance(value, type):
            try:
                import json

                values = {field.name: getattr(value, field.name) for field in fields(value)}
                return "json:" + json.dumps({"__type": type(value).__qualname__} | values, ensure_ascii=False)
            except TypeError:
                pass  # a field is not JSON data
        return super().to_text(value)

    def _from_json(self, text: str) -> object:
        record = read_json(text)
        if not isinstance(record, dict):
            raise ConversionError(f"'json:{text}' is not a JSON object")
        values = {str(key): value for key, value in record.items() if key != "__type"}
        try:
            return self.python_type(**values)
        except Exception as error:
            raise ConversionError(f"'json:{text}' is not a valid {self.name}: {error}") from error


ANY: Final = AnyType("BT::AnyTypeAllowed", False)
ANY_VALUE: Final = AnyType("BT::Any", True)
STRING: Final = StringType("std::string", str)
BOOL: Final = BoolType("bool", bool)
INT: Final = IntegerType("int", -(2**31), 2**31 - 1)
INT8: Final = IntegerType("signed char", -(2**7), 2**7 - 1)
INT16: Final = IntegerType("short", -(2**15), 2**15 - 1)
INT64: Final = IntegerType("long", MIN_INT64, MAX_INT64)
UINT: Final = IntegerType("unsigned int", 0, 2**32 - 1)
UINT8: Final = IntegerType("unsigned char", 0, 2**8 - 1)
UINT16: Final = IntegerType("unsigned short", 0, 2**16 - 1)
UINT64: Final = IntegerType("unsigned long", 0, MAX_UINT64)
FLOAT: Final = RealType("float", True)
DOUBLE: Final = RealType("double", False)
NODE_STATUS: Final = StatusType(Status, "BT::NodeStatus")
PORT_DIRECTION: Final = DirectionType(PortDirection, "BT::PortDirection")
NODE_TYPE: Final = NodeTypeType(NodeType, "BT::NodeType")
VECTOR_INT: Final = VectorType(INT)
VECTOR_DOUBLE: Final = VectorType(DOUBLE)
VECTOR_BOOL: Final = VectorType(BOOL)
VECTOR_STRING: Final = VectorType(STRING)


def literals_of(value_type: ValueType) -> list[str]:
    """Return the texts of all values of an enum or a Boolean; no texts for other types."""
    if isinstance(value_type, EnumType):
        return [value_type.to_text(member) for member in value_type.members]
    return ["true", "false"] if value_type is BOOL else []


BUILTIN_TYPES: Final[tuple[ValueType, ...]] = (
    ANY, ANY_VALUE, STRING, BOOL, INT, INT8, INT16, INT64, UINT, UINT8, UINT16, UINT64, FLOAT, DOUBLE,
    NODE_STATUS, NODE_TYPE, PORT_DIRECTION, VECTOR_INT, VECTOR_DOUBLE, VECTOR_BOOL, VECTOR_STRING,
)  # fmt: skip
