"""Edits of a text: replaced ranges."""

from collections.abc import Iterable
from typing import Final, NamedTuple

from btcore.errors import BtcoreError

# XML parsers other than tinyxml2 read line breaks and tabs in values as spaces.
_ESCAPES: Final = {"&": "&amp;", "<": "&lt;", "\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}


class EditError(BtcoreError):
    """An operation cannot be applied to a document; the message is the reason."""


class Edit(NamedTuple):
    """The characters from *start* to *end* of a text are replaced by *text*."""

    start: int
    end: int
    text: str


def apply_edits(text: str, edits: Iterable[Edit]) -> str:
    """Return *text* after all *edits*, whose offsets count in *text*.

    Insertions at the same place keep their order. An edit that begins inside another edit is ignored.
    """
    pieces: list[str] = []
    done = 0
    # The sort is stable: insertions at the same place keep their order.
    for start, end, replacement in sorted(edits, key=lambda edit: edit[:2]):
        if start >= done:
            pieces += (text[done:start], replacement)
            done = end
    return "".join([*pieces, text[done:]])


def escape_value(text: str, quote: str = '"') -> str:
    """Return *text* as it is written in an attribute's value between *quote* characters."""
    escapes = {**_ESCAPES, quote: "&quot;" if quote == '"' else "&apos;"}
    return "".join(escapes.get(character, character) for character in text)
