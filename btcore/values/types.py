"""The types of ports and entries: each knows its name in C++, its texts, and what may become it.

The rules are BehaviorTree.CPP 4.10's: ``from_text`` is its ``convertFromString``, ``cast`` its
``Any::cast`` (a stored value is read as a type), ``adapt`` the check of ``Blackboard::set`` (a value
is written to an entry of a type).
"""

import math
from collections.abc import Callable
from enum import Enum
from typing import Any, Final

from mypy_extensions import mypyc_attr

from btcore.errors import ConversionError, RegistrationError
from btcore.values.numbers import (
    MAX_INT64,
    MAX_UINT64,
    MIN_INT64,
    c_float,
    c_int,
    c_unsigned,
    leading_float,
    leading_int,
    to_single_precision,
)

# The largest integer for which it and its neighbours are doubles (2^53 - 1).
MAX_EXACT: Final = 2**53 - 1
# What most numbers are below; they take the short way.
_SMALL: Final = 2**31
_NEAR: Final = 2.0**31


@mypyc_attr(allow_interpreted_subclasses=True)
class ValueType:
    """The type of a port or of an entry. Derive from it for one that no class stands for (a list of yours).

    *name* is what C++ calls it, on the wire and in models; *strong* is False for the types that
    take any value; *python_type* is the class of its values; *converts* tells whether a text is
    converted when it is written to such an entry, and checked when the tree is made (enums are
    looked up only when they are read).
    """

    name: str
    strong: bool
    converts: bool
    python_type: type

    def __init__(self, name: str, python_type: type, strong: bool = True, converts: bool = True) -> None:
        self.name = name
        self.python_type = python_type
        self.strong = strong
        self.converts = converts

    def from_text(self, text: str, format: int = 4) -> object:
        """The value that *text* stands for by the rules of *format* (3 or 4). Raises ConversionError."""
        raise ConversionError(
            f"'{text}' can't become a {self.name}: the type has no text form; "
            f"give it one with add_type({self.python_type.__name__}, from_text=…)"
        )

    def to_text(self, value: object) -> str:
        """*value* as text; for most types one that from_text reads back. Raises ConversionError."""
        raise ConversionError(f"a {self.name} has no text form; give it one with add_type(…, to_text=…)")

    @property
    def has_converters(self) -> bool:
        """Whether a user has given it converters."""
        return False

    def set_converters(
        self, from_text: Callable[[str], object] | None, to_text: Callable[[Any], str] | None
    ) -> None:
        """Convert by these from now on. Raises RegistrationError for a type that has its own rules."""
        raise RegistrationError(f"{self.python_type.__qualname__} has a text form already")

    def accepts(self, value: object) -> bool:
        """Whether *value* is of this very type."""
        return isinstance(value, self.python_type)

    def cast(self, value: object) -> object:
        """The stored *value* read as this type, if nothing is lost. Raises ConversionError."""
        if isinstance(value, self.python_type):
            return value
        raise mismatch(value, self)

    def adapt(self, value: object) -> object:
        """*value*, not a text, as it is written to an entry of this type. Raises ConversionError."""
        if self.accepts(value):
            return value
        raise mismatch(value, self)

    def same(self, other: "ValueType") -> bool:
        """Whether both are one type."""
        return self is other or (self.name == other.name and self.python_type is other.python_type)

    def __repr__(self) -> str:
        return f"<type {self.name}>"


def empty_entry_error() -> ConversionError:
    """What reading an entry that was never written raises."""
    return ConversionError("there is no value: the entry was never written")


def mismatch(value: object, wanted: ValueType) -> ConversionError:
    """What a *value* raises that can't become what is *wanted*."""
    if value is None:
        return empty_entry_error()
    return ConversionError(f"{value!r} is no {wanted.name}")


def number_of(value: object) -> int | float | None:
    """The number that *value* counts as (a bool and an enum member as an int), or None."""
    if isinstance(value, (int, float)):
        return value
    if isinstance(value, Enum) and isinstance(value.value, int):
        return int(value.value)
    return None


def quick_double(value: object) -> float:
    """*value* as a double, if it is a float or a small integer; else NaN, which tells nothing."""
    if isinstance(value, float):
        return value
    if isinstance(value, int) and -_SMALL < value < _SMALL:
        return float(value)
    return math.nan


def as_double(number: int | float) -> float:
    """*number* as a double, exactly. Raises ConversionError for an integer of more than 53 bits."""
    if isinstance(number, float):
        return number
    if -MAX_EXACT <= number <= MAX_EXACT:
        return float(number)
    raise ConversionError(f"{number} is too large an integer to become a double exactly")


def as_bool(number: int | float) -> bool:
    """*number* as a bool: of integers only 0 and 1, of reals any that is not negative."""
    if isinstance(number, float):
        if number < 0.0:
            raise ConversionError(f"{number!r} is negative and is no bool")
        return number != 0.0
    if number == 0 or number == 1:
        return number == 1
    raise ConversionError(f"{number} is no bool: of the integers only 0 and 1 are")


def as_int(number: int | float, low: int, high: int, name: str = "int64_t") -> int:
    """*number* as an integer in *low* … *high*, exactly. Raises ConversionError."""
    if isinstance(number, float):
        if -_NEAR < number < _NEAR:
            value = int(number)
            if float(value) == number and low <= value <= high:
                return value
        # The limits as doubles: that of 64 bits rounds up to a value that no longer fits.
        if number != number or not (float(low) <= number <= float(high)) or number != math.floor(number):
            raise ConversionError(f"{number!r} is no {name}")
        value = int(number)
    else:
        value = int(number)
    if value < low or value > high:
        raise ConversionError(f"{value} is out of range for {name}: {low} to {high} fit")
    return value


class IntegerType(ValueType):
    """The integers of one width, *low* to *high*."""

    low: int
    high: int

    def __init__(self, name: str, low: int, high: int) -> None:
        super().__init__(name, int)
        self.low = low
        self.high = high

    def from_text(self, text: str, format: int = 4) -> int:
        """The integer that *text* starts with (``3.7`` is 3). Raises ConversionError."""
        if format == 3:
            if self.low == 0:
                return c_unsigned(text, self.high.bit_length())
            return c_int(text, self.low, self.high)
        return leading_int(text, self.low, self.high, self.high == MAX_UINT64)

    def to_text(self, value: object) -> str:
        """Decimal digits."""
        return str(self.cast(value))

    def accepts(self, value: object) -> bool:
        """Whether *value* is an int that fits."""
        return type(value) is int and self.low <= value <= self.high

    def cast(self, value: object) -> int:
        """A number that fits exactly, or a text that starts with one."""
        if isinstance(value, str):
            return leading_int(value, self.low, self.high, self.low == 0)
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        return as_int(number, self.low, self.high, self.name)

    def adapt(self, value: object) -> int:
        """A number that fits exactly."""
        if isinstance(value, (int, float)):
            return as_int(value, self.low, self.high, self.name)
        raise mismatch(value, self)


class RealType(ValueType):
    """Floating point numbers; *is_single* for C++'s float, to which what is written is rounded."""

    is_single: bool

    def __init__(self, name: str, is_single: bool) -> None:
        super().__init__(name, float)
        self.is_single = is_single

    def from_text(self, text: str, format: int = 4) -> float:
        """The number that *text* starts with. Raises ConversionError."""
        if format == 3:
            return c_float(text, self.is_single)
        return leading_float(text, self.is_single)

    def to_text(self, value: object) -> str:
        """Six decimals, as C's ``%f``."""
        return real_text(self.cast(value))

    def accepts(self, value: object) -> bool:
        """Whether *value* is a float."""
        return isinstance(value, float)

    def cast(self, value: object) -> float:
        """A number, or a text that starts with one; an integer only if it is exact."""
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
        """A number; an integer only if it is exact."""
        if isinstance(value, (int, float)):
            return self.cast(value)
        raise mismatch(value, self)


class BoolType(ValueType):
    """True and false."""

    def from_text(self, text: str, format: int = 4) -> bool:
        """``0 1 true TRUE True false FALSE False``, and nothing else. Raises ConversionError."""
        if text in ("1", "true", "TRUE", "True"):
            return True
        if text in ("0", "false", "FALSE", "False"):
            return False
        raise ConversionError(f"'{text}' is no bool: true, false, 1 and 0 are")

    def to_text(self, value: object) -> str:
        """``true`` or ``false``."""
        return "true" if self.cast(value) else "false"

    def cast(self, value: object) -> bool:
        """A bool, or a number that counts as one; never a text."""
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        return as_bool(number)


class StringType(ValueType):
    """Text."""

    def from_text(self, text: str, format: int = 4) -> str:
        """The text itself."""
        return text

    def to_text(self, value: object) -> str:
        """The text itself."""
        return self.cast(value)

    def cast(self, value: object) -> str:
        """A text, or a number's text: ``%d`` for integers, ``%f`` for reals."""
        if isinstance(value, str):
            return value
        number = number_of(value)
        if number is None:
            raise mismatch(value, self)
        return number_text(number)


class AnyType(ValueType):
    """A type that takes any value: of a port declared without one, or of ``BT::Any``."""

    def __init__(self, name: str, converts: bool) -> None:
        super().__init__(name, object, strong=False, converts=converts)

    def from_text(self, text: str, format: int = 4) -> object:
        """The text itself."""
        return text

    def accepts(self, value: object) -> bool:
        """Always."""
        return True

    def cast(self, value: object) -> object:
        """The value as it is."""
        if value is None:
            raise empty_entry_error()
        return value


def number_text(number: int | float) -> str:
    """*number* as the engine writes it: ``%d`` or ``%f``."""
    return real_text(number) if isinstance(number, float) else str(int(number))


def real_text(value: float) -> str:
    """*value* as C's ``%f`` writes it, with the sign of a NaN."""
    if value != value and math.copysign(1.0, value) < 0:
        return "-nan"
    return f"{value:f}"


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
