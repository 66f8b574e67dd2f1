"""Numbers in text, read the way the two generations of BehaviorTree.CPP read them.

Format 4 reads the leading part of a text (``42abc`` is 42, ``3.7`` is the int 3), allows a minus
sign but neither spaces nor a plus sign before it, and doesn't depend on the locale: the rules of
C++'s ``std::from_chars``. Format 3 reads by C's ``strtol`` and ``strtod``, which skip spaces, take
a plus sign, and know hexadecimal reals.
"""

import math
import re
import struct
from typing import Final

from btcore.errors import ConversionError

MIN_INT64: Final = -(2**63)
MAX_INT64: Final = 2**63 - 1
MAX_UINT64: Final = 2**64 - 1

_INTEGER = re.compile(r"-?[0-9]+")
_UNSIGNED = re.compile(r"[0-9]+")
_REAL = re.compile(
    r"-?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?|[nN][aA][nN])"
)
# For format 3 only. Compiled on first use; the re module keeps the result.
_C_INTEGER: Final = r"[ \t\n\v\f\r]*([+-]?)([0-9]+)"
_C_REAL: Final = (
    r"[ \t\n\v\f\r]*([+-]?(?:0[xX](?:[0-9a-fA-F]+\.?[0-9a-fA-F]*|\.[0-9a-fA-F]+)(?:[pP][+-]?[0-9]+)?"
    r"|(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[iI][nN][fF](?:[iI][nN][iI][tT][yY])?|[nN][aA][nN]))"
)
_DIGITS_OF_64_BITS: Final = 20


def leading_int(text: str, low: int, high: int, unsigned: bool = False) -> int:
    """The integer that *text* starts with, if it lies in *low* … *high*.

    *unsigned* refuses a minus sign, even before a zero. Raises ConversionError.
    """
    found = (_UNSIGNED if unsigned else _INTEGER).match(text)
    if found is None:
        raise ConversionError(f"'{text}' is no integer")
    value = _bounded(found.group())
    if value < low or value > high:
        raise ConversionError(f"'{text}' is out of range: {low} to {high} fit")
    return value


def leading_float(text: str, single: bool = False) -> float:
    """The real number that *text* starts with, in double or in *single* precision.

    Raises ConversionError where there is none, and where it is too large, or too close to zero,
    for the precision.
    """
    found = _REAL.match(text)
    if found is None:
        raise ConversionError(f"'{text}' is no number")
    return _finite(found.group(), text, single)


def whole_float(text: str) -> float | None:
    """The number that *text* is from its first character to its last, or None."""
    found = _REAL.fullmatch(text)
    if found is None:
        return None
    try:
        return _finite(text, text, False)
    except ConversionError:
        return None


def whole_int(text: str) -> int | None:
    """The 64-bit integer that *text* is from its first character to its last, or None."""
    if _INTEGER.fullmatch(text) is None:
        return None
    value = _bounded(text)
    return value if MIN_INT64 <= value <= MAX_INT64 else None


def c_int(text: str, low: int, high: int) -> int:
    """The integer that C's ``strtol`` finds in *text*, if it lies in *low* … *high* (format 3)."""
    found = re.match(_C_INTEGER, text)
    if found is None:
        raise ConversionError(f"'{text}' is no integer")
    value = _bounded(found.group(1) + found.group(2))
    if value < low or value > high:
        raise ConversionError(f"'{text}' is out of range: {low} to {high} fit")
    return value


def c_unsigned(text: str, bits: int) -> int:
    """What C's ``strtoul`` makes of *text*, cut to *bits* (format 3): ``-1`` is the largest number."""
    value = c_int(text, -MAX_UINT64, MAX_UINT64)
    return value % (1 << 64) % (1 << bits)


def c_float(text: str, single: bool = False) -> float:
    """The real number that C's ``strtod`` (or ``strtof``) finds in *text* (format 3)."""
    found = re.match(_C_REAL, text)
    if found is None:
        raise ConversionError(f"'{text}' is no number")
    number = found.group(1)
    if "x" in number or "X" in number:
        try:
            value = float.fromhex(number)
        except OverflowError:
            raise ConversionError(f"'{text}' is out of range") from None
        return _rounded(value, text) if single else value
    return _finite(number, text, single)


def lenient_int(text: str) -> int:
    """An item of format 3's ``vector<int>``: no number is 0, and what is too large wraps to 32 bits."""
    found = re.match(_C_INTEGER, text)
    if found is None:
        return 0
    value = max(MIN_INT64, min(MAX_INT64, _bounded(found.group(1) + found.group(2))))
    return wrap_signed(value, 32)


def lenient_float(text: str) -> float:
    """An item of format 3's ``vector<double>``: no number is 0."""
    found = re.match(_C_REAL, text)
    if found is None:
        return 0.0
    number = found.group(1)
    if "x" not in number and "X" not in number:
        return float(number)
    try:
        return float.fromhex(number)
    except OverflowError:
        return -math.inf if number.startswith("-") else math.inf


def wrap_signed(value: int, bits: int) -> int:
    """*value* cut to a signed integer of *bits*, as a C cast does."""
    half = 1 << (bits - 1)
    return (value + half) % (1 << bits) - half


def to_single_precision(value: float) -> float:
    """*value* rounded to single precision; infinite where it is too large."""
    try:
        rounded: float = struct.unpack("<f", struct.pack("<f", value))[0]
    except OverflowError:
        return math.copysign(math.inf, value)
    return rounded


def json_items(text: str) -> list[object]:
    """The array that the JSON *text* (without its ``json:``) holds. Raises ConversionError."""
    value = read_json(text)
    if not isinstance(value, list):
        raise ConversionError(f"'json:{text}' is no JSON array")
    return value


def read_json(text: str) -> object:
    """The value of the JSON *text*, strictly: no NaN, no number beyond a double. Raises ConversionError."""
    import json

    try:
        value: object = json.loads(text, parse_constant=_refuse_constant, parse_float=_json_float)
    except (ValueError, RecursionError):
        raise ConversionError(f"'json:{text}' is not JSON") from None
    return value


def _refuse_constant(name: str) -> float:
    raise ValueError(name)


def _json_float(text: str) -> float:
    value = float(text)
    if math.isinf(value):
        raise ValueError(text)
    return value


def _bounded(digits: str) -> int:
    """The integer of a sign and digits; one of more than 64 bits only has to stay beyond them."""
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
    if math.isinf(value) or (value == 0.0 and _nonzero(number)):
        raise ConversionError(f"'{text}' is out of range for a double")
    if not as_single:
        return value
    rounded = _rounded(value, text)
    neighbour = _halfway_partner(value, rounded)
    if neighbour is not None:
        # The double lies exactly between two floats: the digits that it lost decide.
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


def _halfway_partner(value: float, rounded: float) -> float | None:
    """The other float that *value* is as close to as to *rounded*, if there is one."""
    gap = value - rounded
    if gap == 0.0:
        return None
    other = value + gap
    return other if to_single_precision(other) == other else None


def _nonzero(number: str) -> bool:
    mantissa = re.split("[eE]", number, maxsplit=1)[0]
    return any(digit in "123456789" for digit in mantissa)
