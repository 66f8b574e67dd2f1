"""The operators of scripts, with the typing rules of BehaviorTree.CPP 4.10.

The functions raise ConversionError for invalid operands; the caller adds the position in the script.
"""

import math
from collections.abc import Mapping
from enum import Enum
from typing import Final

from btcore.errors import ConversionError
from btcore.values import STRING, UINT64, ValueType, as_bool, as_double, as_int, number_of
from btcore.values.numbers import MAX_INT64, MAX_UINT64, MIN_INT64, leading_float

_SIGNS: Final[list[str]] = ["+", "-", "*", "/", "..", "&", "|", "^", "&&", "||"]
# Keep this order: a single comparison determines whether an operator is arithmetic, bitwise or logical.
OPERATORS: Final[dict[str, int]] = {sign: number for number, sign in enumerate(_SIGNS)}
_ADD: Final = 0
_SUBTRACT: Final = 1
_MULTIPLY: Final = 2
_DIVIDE: Final = 3
_JOIN: Final = 4
_LAST_BITWISE: Final = 7
_OR: Final = 9

# Two numbers are equal if they differ by at most C's FLT_EPSILON, although they are doubles.
EPSILON: Final = 1.1920928955078125e-07
_TWO_TO_63: Final = 9223372036854775808.0

MAX_TEXT: Final = 1_000_000
"""The maximum length (characters) of a text that a script joins, so that a loop cannot exhaust the memory."""


def operate(operator: int, left: object, right: object) -> object:
    """Return the result of a binary operator; None for `..` with two numbers, as in BehaviorTree.CPP.

    Args:
        operator: The number of the operator in OPERATORS.
    """
    first = number_of(left)
    second = number_of(right)
    if first is not None and second is not None:
        if operator <= _DIVIDE:
            return _calculate(operator, as_double(first), as_double(second))
        # BehaviorTree.CPP converts both to double first, and so raises for large integers with any operator.
        as_double(first)
        as_double(second)
        if operator == _JOIN:
            return None
        if operator <= _LAST_BITWISE:
            return _combine_bits(_SIGNS[operator], first, second)
        # Both operands are converted, so that an invalid second operand always raises.
        truth = _logical_operand(_SIGNS[operator], first)
        other = _logical_operand(_SIGNS[operator], second)
        return 1.0 if ((truth or other) if operator == _OR else (truth and other)) else 0.0
    if operator == _ADD and isinstance(left, str) and isinstance(right, str):
        return join_texts(left, right)
    if operator == _JOIN and (isinstance(left, str) or isinstance(right, str)):
        return join_texts(STRING.cast(left), STRING.cast(right))
    raise _unsupported_error(_SIGNS[operator], left, right)


def join_texts(left: str, right: str) -> str:
    """Return the text *left* followed by *right*. Raise ConversionError if it is too long."""
    length = len(left) + len(right)
    if length > MAX_TEXT:
        raise ConversionError(
            f"the joined text would have {length:,} characters; a script can join at most {MAX_TEXT:,}"
        )
    return left + right


def negate(sign: str, value: object) -> float:
    """Return the result of the prefix operator *sign*, which is `-`, `!` or `~`, for *value*.

    `~` inverts the bits of the integer part, an integer of 64 bits.
    """
    number = number_of(value)
    if number is None:
        raise ConversionError(f"'{sign}' needs a number, not {description(value)}")
    real = as_double(number)
    if sign == "-":
        return -real
    if sign == "!":
        return 1.0 if real == 0.0 else 0.0
    if real > _TWO_TO_63 or real < -_TWO_TO_63:
        raise ConversionError(f"{real!r} is out of range for '~', which needs an integer of 64 bits")
    # C++ leaves the conversion of NaN and 2^63 undefined; common processors return the smallest integer.
    cut = MIN_INT64 if real != real or real == _TWO_TO_63 else int(real)
    return float(~cut)


def compare(operator: str, left: object, right: object, enums: Mapping[str, int]) -> bool:
    """Return whether `left operator right` is true. A text compared with a number is read as a number."""
    first = None if isinstance(left, str) else number_of(left)
    second = None if isinstance(right, str) else number_of(right)
    if isinstance(left, str) and isinstance(right, str):
        if operator == "==":
            return left == right
        # Two numbers in the same order as the texts.
        a = 0.0 if left == right else -1.0 if left < right else 1.0
        b = 0.0
    elif first is not None and second is not None:
        a = as_double(first)
        b = as_double(second)
    elif isinstance(left, str) and second is not None:
        a = number_of_text(left, enums)
        b = as_double(second)
    elif isinstance(right, str) and first is not None:
        a = as_double(first)
        b = number_of_text(right, enums)
    else:
        raise _unsupported_error(operator, left, right)
    if operator == "==":
        return abs(a - b) <= EPSILON
    if operator == "!=":
        return not abs(a - b) <= EPSILON
    # Negated, as in BehaviorTree.CPP: with a NaN, all of these comparisons are true.
    if operator == "<":
        return not a >= b
    if operator == ">":
        return not a <= b
    if operator == "<=":
        return not a > b
    return not a < b


def number_of_text(text: str, enums: Mapping[str, int]) -> float:
    """Return the number of *text*: `true`, `false`, an enum name, or digits. Raise ConversionError."""
    if text == "true":
        return 1.0
    if text == "false":
        return 0.0
    number = enums.get(text)
    if number is not None:
        return float(number)
    return leading_float(text)


def assigned_value(value: object, old: object, declared: ValueType) -> object:
    """Return *value* converted to the type of *old*, the present value of an entry of the type *declared*."""
    if isinstance(value, str) and isinstance(old, str):
        return value
    number = number_of(value)
    stored = number_of(old)
    if number is not None and stored is not None:
        if isinstance(stored, float):
            return as_double(number)
        if declared is UINT64 or stored > MAX_INT64:
            return as_int(number, 0, MAX_UINT64, "uint64_t")
        whole = as_int(number, MIN_INT64, MAX_INT64, "int64_t")
        if isinstance(old, bool) and 0 <= whole <= 1:
            return bool(whole)
        if isinstance(old, Enum):
            return next((member for member in old.__class__ if member.value == whole), whole)
        return whole
    if number is None and stored is None and type(value) is type(old):
        return value
    raise ConversionError(f"{description(value)} cannot replace {description(old)}")


def compound_assigned_value(operator: str, old: object, value: object, declared: ValueType) -> object:
    """Return the result of `+=`, `-=`, `*=` or `/=` for an entry with the value *old*."""
    number = number_of(value)
    stored = number_of(old)
    if number is not None and stored is not None:
        result = _calculate(OPERATORS[operator[0]], as_double(stored), as_double(number))
        return assigned_value(result, old, declared)
    if isinstance(old, str) and isinstance(value, str) and operator == "+=":
        return join_texts(old, value)
    raise _unsupported_error(operator, old, value)


def _calculate(operator: int, left: float, right: float) -> float:
    if operator == _ADD:
        return left + right
    if operator == _SUBTRACT:
        return left - right
    if operator == _MULTIPLY:
        return left * right
    if right != 0.0:
        return left / right
    # IEEE 754's division by zero, for which Python raises.
    if left == 0.0 or left != left:
        return -math.nan
    return math.copysign(math.inf, left) * math.copysign(1.0, right)


def _combine_bits(sign: str, left: int | float, right: int | float) -> float:
    try:
        a = as_int(left, MIN_INT64, MAX_INT64)
        b = as_int(right, MIN_INT64, MAX_INT64)
    except ConversionError as error:
        raise ConversionError(f"'{sign}' needs integers: {error}") from None
    if sign == "&":
        return float(a & b)
    return float(a | b) if sign == "|" else float(a ^ b)


def _logical_operand(sign: str, number: int | float) -> bool:
    try:
        return as_bool(number)
    except ConversionError as error:
        raise ConversionError(f"'{sign}' needs bools: {error}") from None


def _unsupported_error(operator: str, left: object, right: object) -> ConversionError:
    if left is None or right is None:
        side = "before" if left is None else "after"
        return ConversionError(f"the operand {side} '{operator}' has no value: the entry was never written")
    return ConversionError(f"'{operator}' does not support {description(left)} and {description(right)}")


def description(value: object) -> str:
    """Return a description of *value* for messages."""
    if value is None:
        return "an entry without a value"
    if isinstance(value, str):
        return f"the text '{value}'"
    if number_of(value) is not None:
        return f"the number {value!r}"
    return f"a {type(value).__name__}"
