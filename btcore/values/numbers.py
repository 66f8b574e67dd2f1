"""Numbers in text, by the rules of format 3 and format 4 of BehaviorTree.CPP.

Format 4 follows C++'s `std::from_chars`, in every locale. It reads the number at the start of a text
(`42abc` is 42, `3.7` is the int 3). The number may begin with a minus sign, but not with a space or a
plus sign. Format 3 follows C's `strtol` and `strtod`, which also accept leading spaces, a plus sign and
hexadecimal reals.
"""

import math
import re
import struct
from typing import Final

from btcore.errors import ConversionError
from btcore.json_text import MAX_DEPTH, load_json, too_deep_at

MIN_INT64: Final = -(2**63)
MAX_INT64: Final = 2**63 - 1
MAX_UINT64: Final = 2**64 - 1

_INTEGER = re.compile(r"-?[0-9]+")
_UNSIGNED = re.compile(r"[0-9]+")
_REAL = re.compile(
    r"-?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?|[nN][aA][nN])"
)
# For format 3 only. Compiled on first use; the re module keeps the result.
_C_INTEGER: Final = r"[ \t\n\v\f\r]*([+-]?[0-9]+)"
_C_REAL: Final = (
    r"[ \t\n\v\f\r]*([+-]?(?:0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?"
    r"|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?|[nN][aA][nN]))"
)
_DIGITS_OF_64_BITS: Final = 20


def leading_int(text: str, low: int, high: int, unsigned: bool = False) -> int:
    """Return the integer at the start of *text*.

    Args:
        unsigned: Whether a minus sign is an error, even before a zero.
    """
    match = (_UNSIGNED if unsigned else _INTEGER).match(text)
    return _integer(text, None if match is None else match.group(), low, high)


def leading_float(text: str, single: bool = False) -> float:
    """Return the real number at the start of *text*, in double or in *single* precision."""
    match = _REAL.match(text)
    if match is None:
        raise ConversionError(f"'{text}' is not a number")
    return _finite(match.group(), text, single)


def whole_float(text: str) -> float | None:
    """Return the double that the whole of *text* represents, or None."""
    if _REAL.fullmatch(text) is None:
        return None
    try:
        return _finite(text, text, False)
    except ConversionError:
        return None


def whole_int(text: str) -> int | None:
    """Return the 64-bit integer that the whole of *text* represents, or None."""
    if _INTEGER.fullmatch(text) is None:
        return None
    value = _bounded(text)
    return value if MIN_INT64 <= value <= MAX_INT64 else None


def c_int(text: str, low: int, high: int) -> int:
    """Return the result of C's `strtol` for *text* (format 3)."""
    match = re.match(_C_INTEGER, text)
    return _integer(text, None if match is None else match.group(1), low, high)


def c_unsigned(text: str, bits: int) -> int:
    """Return the result of C's `strtoul` for *text*, cut to *bits* bits (format 3).

    A negative number wraps around: `-1` becomes the maximum.
    """
    value = c_int(text, -MAX_UINT64, MAX_UINT64)
    return value % (1 << 64) % (1 << bits)


def c_float(text: str, single: bool = False) -> float:
    """Return the result of C's `strtod`, or of `strtof` if *single*, for *text* (format 3)."""
    match = re.match(_C_REAL, text)
    if match is None:
        raise ConversionError(f"'{text}' is not a number")
    number = match.group(1)
    if "x" in number or "X" in number:
        try:
            value = float.fromhex(number)
        except OverflowError:
            raise ConversionError(f"'{text}' is out of range") from None
        return _rounded(value, text) if single else value
    return _finite(number, text, single)


def lenient_int(text: str) -> int:
    """Return *text* as an item of format 3's `vector<int>`: invalid text is 0; numbers wrap at 32 bits."""
    match = re.match(_C_INTEGER, text)
    if match is None:
        return 0
    # strtol() saturates at 64 bits; BehaviorTree.CPP 3 then casts the result to int.
    value = max(MIN_INT64, min(MAX_INT64, _bounded(match.group(1))))
    return wrap_signed(value, 32)


def lenient_float(text: str) -> float:
    """Return *text* as an item of format 3's `vector<double>`: invalid text is 0."""
    match = re.match(_C_REAL, text)
    if match is None:
        return 0.0
    number = match.group(1)
    if "x" not in number and "X" not in number:
        return float(number)
    try:
        return float.fromhex(number)
    except OverflowError:
        return -math.inf if number.startswith("-") else math.inf


def wrap_signed(value: int, bits: int) -> int:
    """Return *value* cut to a signed integer of *bits* bits, as by a cast in C."""
    half = 1 << (bits - 1)
    return (value + half) % (1 << bits) - half


def to_single_precision(value: float) -> float:
    """Return *value* rounded to single precision; infinity if it is too large."""
    try:
        rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return rounded


def json_items(text: str) -> list[object]:
    """Return the items of the JSON array *text*, without the prefix `json:`. Raise ConversionError."""
    value = read_json(text)
    if not isinstance(value, list):
        raise ConversionError(f"'json:{text}' is not a JSON array")
    return value


def read_json(text: str) -> object:
    """Return the value of the JSON *text*."""
    if too_deep_at(text) is not None:
        raise ConversionError(f"the JSON is nested more than {MAX_DEPTH} levels deep")
    try:
        # parse_constant is called for NaN and Infinity, which are not JSON.
        value: object = load_json(text, parse_constant=_refuse, parse_float=_json_float)
    except ValueError:
        raise ConversionError(f"'json:{text}' is not JSON") from None
    return value


def _refuse(number: str) -> float:
    raise ValueError(number)


def _json_float(text: str) -> float:
    value = float(text)
    return _refuse(text) if math.isinf(value) else value


def _integer(text: str, digits: str | None, low: int, high: int) -> int:
    if digits is None:
        raise ConversionError(f"'{text}' is not an integer")
    value = _bounded(digits)
    if value < low or value > high:
        raise ConversionError(f"'{text}' is out of range: {low} to {high}")
    return value


def _bounded(digits: str) -> int:
    """Return the integer with the sign and digits *digits*; ±2^70 for an integer of more than 20 digits.

    All callers treat integers beyond 64 bits alike. Python's int() raises for thousands of digits, and takes
    quadratic time.
    """
    if len(digits) < _DIGITS_OF_64_BITS:
        return int(digits)
    sign = digits[:1] if digits[:1] in ("-", "+") else ""
    magnitude = digits[len(sign) :].lstrip("0") or "0"
    if len(magnitude) > _DIGITS_OF_64_BITS:
        return -(2**70) if sign == "-" else 2**70
    return int(sign + magnitude)


def _finite(number: str, text: str, as_single: bool) -> float:
    value = float(number)
    if value != value or number.lstrip("+-")[0] in "iI":
        return value
    # If a digit before the exponent is not 0, the number is not zero but too close to zero for a double.
    if math.isinf(value) or (value == 0.0 and re.match("[^eE]*[1-9]", number)):
        raise ConversionError(f"'{text}' is out of range for a double")
    if not as_single:
        return value
    rounded = _rounded(value, text)
    neighbour = value + (value - rounded)
    if neighbour != rounded and to_single_precision(neighbour) == neighbour:
        # The double lies exactly between two floats. The exact value of the digits determines the nearest.
        from fractions import Fraction

        exact = Fraction(number)
        if exact != Fraction(value):
            upper, lower = max(rounded, neighbour), min(rounded, neighbour)
            return upper if exact > Fraction(value) else lower
    return rounded


def _rounded(value: float, text: str) -> float:
    rounded = to_single_precision(value)
    if math.isinf(rounded) or (rounded == 0.0 and value != 0.0):
        raise ConversionError(f"'{text}' is out of range for a float")
    return rounded
