"""Edits of a text: replaced ranges, their inverses, and their places after other edits."""

from collections.abc import Iterable, Sequence
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
    for start, end, replacement in _ordered(edits):
        if start >= done:
            pieces += (text[done:start], replacement)
            done = end
    return "".join([*pieces, text[done:]])


def edited_part(text: str, start: int, end: int, edits: Iterable[Edit]) -> str:
    """Return the part of *text* from *start* to *end* after *edits* inside of it."""
    shifted = (Edit(edit.start - start, edit.end - start, edit.text) for edit in edits)
    return apply_edits(text[start:end], shifted)


def invert_edits(text: str, edits: Iterable[Edit]) -> list[Edit]:
    """Return the edits of the result of `apply_edits` that restore *text*.

    Args:
        text: The text before *edits*.
        edits: Edits that do not overlap.
    """
    inverse: list[Edit] = []
    shift = 0
    for start, end, replacement in _ordered(edits):
        new_start = start + shift
        inverse.append(Edit(new_start, new_start + len(replacement), text[start:end]))
        shift += len(replacement) - (end - start)
    return inverse


def rebase_edits(edits: Iterable[Edit], others: Sequence[Edit]) -> list[Edit]:
    """Return *edits* as edits of the text after *others*; both are edits of the same text.

    Raises:
        EditError: The edits change what *others* have changed.
    """
    rebased: list[Edit] = []
    ordered = _ordered(others)
    for start, end, replacement in edits:
        shift = 0
        for other in ordered:
            if other.end <= start and (other.start, other.end) != (start, end):
                shift += len(other.text) - (other.end - other.start)
            elif other.start < end or other.start == start:
                raise EditError("the text was changed at the same place")
        rebased.append(Edit(start + shift, end + shift, replacement))
    return rebased


def difference(before: str, after: str) -> Edit:
    """Return the edit of *before* that makes it *after*, and keeps what both begin and end with."""
    most = min(len(before), len(after))
    start = next((index for index in range(most) if before[index] != after[index]), most)
    rest = most - start
    end = next((index for index in range(rest) if before[-1 - index] != after[-1 - index]), rest)
    return Edit(start, len(before) - end, after[start : len(after) - end])


def escape_value(text: str, quote: str = '"') -> str:
    """Return *text* as it is written in an attribute's value between *quote* characters."""
    escapes = {**_ESCAPES, quote: "&quot;" if quote == '"' else "&apos;"}
    return "".join(escapes.get(character, character) for character in text)


def _ordered(edits: Iterable[Edit]) -> list[Edit]:
    # The sort is stable: insertions at the same place keep their order.
    return sorted(edits, key=lambda edit: edit[:2])
