"""The inverses of edits, their places after other edits, and the edit between two texts."""

from collections.abc import Iterable, Sequence

from btcore.xml.edit.editor import Edit, EditError


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
        for earlier in ordered:
            if earlier.end <= start and (earlier.start, earlier.end) != (start, end):
                shift += len(earlier.text) - (earlier.end - earlier.start)
            elif earlier.start < end or earlier.start == start:
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


def _ordered(edits: Iterable[Edit]) -> list[Edit]:
    # The sort is stable: insertions at the same place keep their order.
    return sorted(edits, key=lambda edit: edit[:2])
