"""Shorten results for agents: an agent reads a part of a large result, and is informed of the rest."""

import json
from typing import Any, Final

MAX_RESULT: Final = 60_000
"""The maximum length of a result (characters of JSON)."""

_ITEMS: Final = (1000, 300, 100, 30, 10, 3)
_TEXT: Final = (4000, 4000, 2000, 1000, 500, 200)


def to_bounded_json(data: object) -> str:
    """Return *data* as JSON of at most `MAX_RESULT` characters.

    Of long lists, objects and texts the first items are kept, and the number of the others is added.

    Args:
        data: JSON data.
    """
    text = _dump(data)
    for items, length in zip(_ITEMS, _TEXT, strict=True):
        if len(text) <= MAX_RESULT:
            return text
        text = _dump(_shortened(data, items, length))
    return text if len(text) <= MAX_RESULT else _dump({"omitted": "the result is too large"})


def shorten_text(text: str, length: int) -> str:
    """Return the beginning of *text*, and the number of characters that follow if there are any."""
    return text if len(text) <= length else f"{text[:length]}… ({len(text) - length:,} more characters)"


def _dump(data: object) -> str:
    return json.dumps(data, ensure_ascii=False, separators=(",", ":"))


def _shortened(data: Any, items: int, length: int) -> Any:
    if isinstance(data, str):
        return shorten_text(data, length)
    if isinstance(data, list):
        first = [_shortened(item, items, length) for item in data[:items]]
        return [*first, f"… ({len(data) - items:,} more)"] if len(data) > items else first
    if isinstance(data, dict):
        pairs = list(data.items())
        kept = {shorten_text(key, length): _shortened(value, items, length) for key, value in pairs[:items]}
        return kept | {"…": f"{len(pairs) - items:,} more"} if len(pairs) > items else kept
    return data
