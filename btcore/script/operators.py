"""The operators of scripts, with the typing rules of BehaviorTree.CPP 4.10.

All of them raise ConversionError, whose sentence the caller puts at its place in the script.
"""

import math
from collections.abc import Mapping
from enum import Enum
from typing import Final

from btcore.errors import ConversionError
from btcore.values import UINT64, ValueType, as_bool, as_double, as_int, number_of, number_text
from btcore.values.numbers import MAX_INT64, MAX_UINT64, MIN_INT64, leading_float

# Ordered so that one comparison finds what two floats may do without a check.
OPERATORS: Final[dict[str, int]] = {
    "+": 0,
    "-": 1,
    "*": 2,
    "/": 3,
    "..": 4,
    "&": 5,
    "|": 6,
    "^": 7,
    "&&": 8,
    "||": 9,
}
_SIGNS: Final[list[str]] = list(OPERATORS)
_ADD: Final = 0
_SUBTRACT: Final = 1
_MULTIPLY: Final = 2
_DIVIDE: Final = 3
_JOIN: Final = 4
_LAST_BITWISE: Final = 7
_OR: Final = 9

# Two numbers are equal when they differ by no more than C's FLT_EPSILON.
EPSILON: Final = 1.1920928955078125e-07
_TWO_TO_63: Final = 9223372036854775808.0


def operate(operator: int, left: object, right: object) -> object:
    """*left* and *right* under an operator of OPERATORS; None for two numbers joined by ``..``."""
    if left is None:
        raise _no_value("before", _SIGNS[operator])
    if right is None:
        raise _no_value("after", _SIGNS[operator])
    first = number_of(left)
    second = number_of(right)
    if first is not None and second is not None:
        if operator <= _DIVIDE:
            return _arithmetic(operator, as_double(first), as_double(second))
        # The original converts to double before it looks at the operator.
        as_double(first)
        as_double(second)
        if operator == _JOIN:
            return None
        if operator <= _LAST_BITWISE:
            return _bitwise(_SIGNS[operator], first, second)
        one = _truth(_SIGNS[operator], first)
        other = _truth(_SIGNS[operator], second)
        return 1.0 if ((one or other) if operator == _OR else (one and other)) else 0.0
    if operator == _ADD and isinstance(left, str) and isinstance(right, str):
        return left + right
    if operator == _JOIN and (isinstance(left, str) or isinstance(right, str)):
        return _joined(left, first) + _joined(right, second)
    raise ConversionError(f"'{_SIGNS[operator]}' can't be done with {_kind(left)} and {_kind(right)}")


def negated(sign: str, value: object) -> float:
    """*value* after the prefix *sign*: ``-``, ``~`` (which first cuts to 64 bits) or ``!``."""
    number = number_of(value)
    if number is None:
        raise ConversionError(f"'{sign}' needs a number, and not {_kind(value)}")
    real = as_double(number)
    if sign == "-":
        return -real
    if sign == "!":
        return 1.0 if real == 0.0 else 0.0
    if real > _TWO_TO_63 or real < -_TWO_TO_63:
        raise ConversionError(f"{real!r} is out of range for '~': it needs an integer of 64 bits")
    # As the usual processors convert what no 64-bit integer is equal to.
    cut = MIN_INT64 if real != real or real == _TWO_TO_63 else int(real)
    return float(~cut)


def compare(operator: str, left: object, right: object, enums: Mapping[str, int]) -> bool:
    """Whether ``left operator right`` holds; a text beside a number is read as one."""
    if left is None:
        raise _no_value("before", operator)
    if right is None:
        raise _no_value("after", operator)
    if isinstance(left, str) and isinstance(right, str):
        return _text_compare(operator, left, right)
    first = number_of(left)
    second = number_of(right)
    if first is None:
        if not isinstance(left, str) or second is None:
            raise ConversionError(f"{_kind(left)} can't be compared with {_kind(right)}")
        one = readable_number(left, enums)
        other = as_double(second)
    elif second is None:
        if not isinstance(right, str):
            raise ConversionError(f"{_kind(left)} can't be compared with {_kind(right)}")
        one = as_double(first)
        other = readable_number(right, enums)
    else:
        one = as_double(first)
        other = as_double(second)
    if operator == "==":
        return abs(one - other) <= EPSILON
    if operator == "!=":
        return not abs(one - other) <= EPSILON
    # In the original's sense, which a NaN makes a difference to.
    if operator == "<":
        return not one >= other
    if operator == ">":
        return not one <= other
    if operator == "<=":
        return not one > other
    return not one < other


def readable_number(text: str, enums: Mapping[str, int]) -> float:
    """The number that *text* stands for: true and false, an enum's name, or digits."""
    if text == "true":
        return 1.0
    if text == "false":
        return 0.0
    number = enums.get(text)
    if number is not None:
        return float(number)
    return leading_float(text)


def assigned_value(value: object, old: object, kind: ValueType) -> object:
    """*value* as it replaces *old* in an entry declared as *kind*: the stored kind of number stays."""
    if isinstance(value, str) and isinstance(old, str):
        return value
    number = number_of(value)
    stored = number_of(old)
    if number is not None and stored is not None:
        if isinstance(stored, float):
            return as_double(number)
        if kind is UINT64 or stored > MAX_INT64:
            return as_int(number, 0, MAX_UINT64, "uint64_t")
        whole = as_int(number, MIN_INT64, MAX_INT64, "int64_t")
        if isinstance(old, bool) and 0 <= whole <= 1:
            return bool(whole)
        return _member(old, whole) if isinstance(old, Enum) else whole
    if number is None and stored is None and type(value) is type(old):
        return value
    raise ConversionError(f"{_kind(value)} can't become {_kind(old)}")


def compound_assigned_value(operator: str, old: object, value: object, kind: ValueType) -> object:
    """What ``+=``, ``-=``, ``*=`` and ``/=`` leave in an entry that holds *old*."""
    if old is None:
        raise _no_value("before", operator)
    number = number_of(value)
    if number is not None:
        stored = number_of(old)
        if stored is None:
            raise ConversionError(f"'{operator}' needs an entry with a number, and not {_kind(old)}")
        result = _arithmetic(OPERATORS[operator[0]], as_double(stored), as_double(number))
        return assigned_value(result, old, kind)
    if isinstance(old, str) and isinstance(value, str) and operator == "+=":
        return old + value
    raise ConversionError(f"'{operator}' can't be done with {_kind(old)} and {_kind(value)}")


def _arithmetic(operator: int, left: float, right: float) -> float:
    if operator == _ADD:
        return left + right
    if operator == _SUBTRACT:
        return left - right
    if operator == _MULTIPLY:
        return left * right
    if right != 0.0:
        return left / right
    # Division by zero is IEEE 754's, where Python raises.
    if left == 0.0 or left != left:
        return -math.nan
    return math.copysign(math.inf, left) * math.copysign(1.0, right)


def _bitwise(sign: str, left: int | float, right: int | float) -> float:
    try:
        one = as_int(left, MIN_INT64, MAX_INT64)
        other = as_int(right, MIN_INT64, MAX_INT64)
    except ConversionError as fault:
        raise ConversionError(f"'{sign}' needs integers: {fault}") from None
    if sign == "&":
        return float(one & other)
    return float(one | other) if sign == "|" else float(one ^ other)


def _truth(sign: str, number: int | float) -> bool:
    try:
        return as_bool(number)
    except ConversionError as fault:
        raise ConversionError(f"'{sign}' needs bools: {fault}") from None


def _text_compare(operator: str, left: str, right: str) -> bool:
    if operator == "==":
        return left == right
    if operator == "!=":
        return left != right
    if operator == "<":
        return left < right
    if operator == ">":
        return left > right
    return left <= right if operator == "<=" else left >= right


def _joined(value: object, number: int | float | None) -> str:
    if number is not None:
        return number_text(number)
    if isinstance(value, str):
        return value
    raise ConversionError(f"'..' can't join {_kind(value)}")


def _member(old: Enum, number: int) -> object:
    """The member of *old*'s enum that stands for *number*, or the number where there is none."""
    for member in old.__class__:
        if member.value == number:
            return member
    return number


def _no_value(side: str, operator: str) -> ConversionError:
    return ConversionError(f"what stands {side} '{operator}' has no value: the entry was never written")


def _kind(value: object) -> str:
    """What *value* is, in a reader's words."""
    if value is None:
        return "an entry without a value"
    if isinstance(value, str):
        return f"the text '{value}'"
    if number_of(value) is not None:
        return f"the number {value!r}"
    return f"a {type(value).__name__}"
