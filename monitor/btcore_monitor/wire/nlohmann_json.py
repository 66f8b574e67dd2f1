"""Read JSON with `json`, but with the error messages of the nlohmann library.

A C++ publisher sends the text of the library's exception in its error reply. Clients may show or compare it.
"""

import json
import re
from typing import Any, Final, TypeVar

from btcore_monitor.wire.errors import ProtocolError

_LITERALS: Final = ("true", "false", "null")
_LOOSE: Final = re.compile(r"[A-Za-z_]+")

T = TypeVar("T", bool, str)


class JsonError(ProtocolError):
    """Invalid JSON in a request. The message is the same as from a C++ publisher."""


def _refuse(name: str) -> Any:
    # The json module accepts NaN and Infinity by default; JSON has no such values.
    raise ValueError(name)


def read_json(body: bytes) -> Any:
    """Return the value of the JSON text *body*.

    Raises:
        JsonError: *body* is not JSON.
    """
    text = body.decode("utf-8", "replace")
    try:
        return json.loads(text, parse_constant=_refuse)
    except json.JSONDecodeError as error:
        raise _syntax(text, error.pos) from None
    except (ValueError, RecursionError):
        # NaN, Infinity, a number of thousands of digits, or brackets that are nested too deeply
        raise _syntax(text, len(text) - len(text.lstrip())) from None


def _syntax(text: str, at: int) -> JsonError:
    """Return the error for a syntax error at character *at*."""
    if not text:
        return JsonError(
            "[json.exception.parse_error.101] parse error at line 1, column 1: attempting to parse an empty "
            "input; check that your input string or stream contains the expected JSON"
        )
    reason, end = "unexpected end of input", at
    # The library reads a literal letter by letter, and stops at the first wrong letter.
    word = _LOOSE.match(text, at)
    if word is not None:
        end = at + _misread(word[0])
        reason = f"invalid literal; last read: '{text[at:end]}'"
    elif at < len(text):
        end = at + 1
        reason = f"unexpected '{text[at]}'; last read: '{text[at]}'"
    line = text.count("\n", 0, end) + 1
    column = max(end - (text.rfind("\n", 0, end) + 1), 1)
    return JsonError(
        f"[json.exception.parse_error.101] parse error at line {line}, column {column}: "
        f"syntax error while parsing value - {reason}"
    )


def _misread(word: str) -> int:
    """Return how many letters of *word* the library reads before it rejects the word as a literal."""
    literal = next((literal for literal in _LITERALS if literal[0] == word[0]), "")
    for count, letter in enumerate(word, start=1):
        if count > len(literal) or literal[count - 1] != letter:
            return count
    return len(word)


def _type_name(value: Any) -> str:
    if value is None:
        return "null"
    if isinstance(value, bool):
        return "boolean"
    if isinstance(value, int | float):
        return "number"
    if isinstance(value, str):
        return "string"
    return "array" if isinstance(value, list) else "object"


def require_member(value: Any, key: str) -> Any:
    """Return the member *key* of the JSON object *value*.

    Raises:
        JsonError: *value* is not an object, or has no such member.
    """
    if not isinstance(value, dict):
        raise JsonError(f"[json.exception.type_error.304] cannot use at() with {_type_name(value)}")
    if key not in value:
        raise JsonError(f"[json.exception.out_of_range.403] key '{key}' not found")
    return value[key]


def require_number(value: Any) -> int:
    """Return *value* as an integer, without its fraction.

    A bool is accepted, because nlohmann converts it to a number.

    Raises:
        JsonError: *value* is not a finite number.
    """
    if not isinstance(value, int | float) or value != value or value in (float("inf"), float("-inf")):
        raise JsonError(f"[json.exception.type_error.302] type must be number, but is {_type_name(value)}")
    return int(value)


def require_type(value: Any, expected_type: type[T]) -> T:
    """Return *value* after checking that it is an instance of *expected_type* (bool or str).

    Raises:
        JsonError: *value* has another type.
    """
    if not isinstance(value, expected_type):
        expected = "boolean" if expected_type is bool else "string"
        raise JsonError(
            f"[json.exception.type_error.302] type must be {expected}, but is {_type_name(value)}"
        )
    return value
