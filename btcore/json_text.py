"""Parse JSON from files and options, with a limit on its depth.

A value that is nested thousands of levels deep would exceed the recursion limit of the parser, or of the code
that compares, copies or prints it.
"""

import re
from collections.abc import Callable
from typing import Any, Final

MAX_DEPTH: Final = 100
"""Maximum number of arrays and objects around a value."""

_STRING_OR_BRACKET: Final = re.compile(r'"(?:[^"\\]|\\.)*+"?|[\[\]{}]', re.DOTALL)


def load_json(
    text: str,
    parse_constant: Callable[[str], Any] | None = None,
    parse_float: Callable[[str], Any] | None = None,
) -> Any:
    """Return the value of a JSON text.

    Args:
        parse_constant: Converts `NaN`, `Infinity` and `-Infinity`; default `float`.
        parse_float: Converts reals; default `float`.

    Raises:
        json.JSONDecodeError: The text is not JSON, or is nested too deeply. It is a ValueError.
        ValueError: A converter raised it, or a number has thousands of digits.
    """
    import json  # imported here, because loading a tree rarely needs it

    at = too_deep_at(text)
    if at is not None:
        raise json.JSONDecodeError(f"nested more than {MAX_DEPTH} levels deep", text, at)
    return json.loads(text, parse_constant=parse_constant, parse_float=parse_float)


def too_deep_at(text: str) -> int | None:
    """Return the offset of the first bracket that is nested too deeply, or None."""
    if text.count("[") + text.count("{") <= MAX_DEPTH:
        return None
    depth = 0
    for match in _STRING_OR_BRACKET.finditer(text):
        if match[0] in "[{":
            depth += 1
            if depth > MAX_DEPTH:
                return match.start()
        elif match[0] in "]}":
            depth -= 1
    return None
