"""The edits that undo edits."""

from collections.abc import Iterable

from btcore.xml.edit.editor import Edit


def invert_edits(text: str, edits: Iterable[Edit]) -> list[Edit]:
    """Return the edits of the result of `apply_edits` that restore *text*.

    Args:
        text: The text before *edits*.
        edits: Edits that do not overlap.
    """
    inverse: list[Edit] = []
    shift = 0
    for start, end, replacement in sorted(edits, key=lambda edit: edit[:2]):
        new_start = start + shift
        inverse.append(Edit(new_start, new_start + len(replacement), text[start:end]))
        shift += len(replacement) - (end - start)
    return inverse
