"""Positions of the parts of a text in JSON, for error messages."""

import json
import re
from collections.abc import Sequence
from typing import Final

_SPACE: Final = re.compile(r"[ \t\r\n]*")
_DECODER: Final = json.JSONDecoder()


def find_part(text: str, start: int, path: Sequence[str | int], is_name: bool = False) -> tuple[int, int]:
    """Return the position of a part of a value.

    Args:
        text: A text that contains valid JSON from *start* on.
        start: The index at which the JSON begins.
        path: The names of members and the indices of items that lead to the part.
        is_name: Whether to return the position of the name at the end of *path*, and not of the value.

    Returns:
        (index, number of characters). If there is no such part, the position of the last part of *path* that
        exists.

    Examples:
        >>> from btcore_ros2.json_positions import find_part
        >>> text = '{"pose": {"x": 1.5}}'
        >>> at, width = find_part(text, 0, ["pose", "x"])
        >>> text[at : at + width]
        '1.5'
    """
    at = _skip_space(text, start)
    for index, part in enumerate(path):
        name, value = _find_child(text, at, part)
        if value is None:
            break
        if is_name and index == len(path) - 1 and name is not None:
            return name, _end(text, name) - name
        at = value
    return at, _end(text, at) - at


def _find_child(text: str, at: int, part: str | int) -> tuple[int | None, int | None]:
    """Return the indices of the name and the value of a member, or (None, index) of an item."""
    opening = text[at : at + 1]
    if (opening, type(part)) not in (("{", str), ("[", int)):
        return None, None
    found: tuple[int | None, int | None] = (None, None)
    at = _skip_space(text, at + 1)
    number = 0
    while text[at] not in "}]":
        name = None
        key: str | int = number
        if opening == "{":
            name = at
            key, at = _DECODER.raw_decode(text, at)
            at = _skip_space(text, _skip_space(text, at) + 1)  # after the colon
        if key == part:
            found = name, at  # the last of several members with the same name counts
        at = _skip_space(text, _end(text, at))
        if text[at] == ",":
            at = _skip_space(text, at + 1)
        number += 1
    return found


def _end(text: str, at: int) -> int:
    return _DECODER.raw_decode(text, at)[1]


def _skip_space(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    return at if match is None else match.end()
