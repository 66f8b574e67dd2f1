"""The places of edits after other edits, successive edits, and the edits between two texts."""

import re
from collections.abc import Iterable, Sequence
from difflib import SequenceMatcher
from typing import Final

from btcore.xml.edit.editor import Edit, EditError

_LINE: Final = re.compile(r"[^\r\n]*(?:\r\n?|\n)|[^\r\n]+")
_MAX_COMPARED_LINES: Final = 4_000
"""Maximum number of lines that are compared one by one. In a longer change, all lines are replaced."""


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


def compose_edits(first: Iterable[Edit], second: Iterable[Edit]) -> list[Edit]:
    """Return edits with the result of *first* and then *second*.

    Args:
        first: Edits that do not overlap.
        second: Edits of the text after *first*, which do not overlap.
    """
    # The parts of the text between both that an edit made or changes, by their start: edits of the first
    # kind have their place in the original text.
    parts: list[tuple[int, int, Edit, bool]] = []
    shift = 0
    for edit in _ordered(first):
        start = edit.start + shift
        parts.append((start, start + len(edit.text), edit, True))
        shift += len(edit.text) - (edit.end - edit.start)
    parts += [(edit.start, edit.end, edit, False) for edit in _ordered(second)]
    parts.sort(key=lambda part: part[:2])
    composed: list[Edit] = []
    group: list[tuple[int, int, Edit, bool]] = []
    shift = 0
    for part in parts:
        if group and part[0] > max(end for _, end, _, _ in group):
            shift = _join(group, shift, composed)
            group = []
        group.append(part)
    if group:
        _join(group, shift, composed)
    return composed


def _join(group: Sequence[tuple[int, int, Edit, bool]], shift: int, composed: list[Edit]) -> int:
    """Add the edit of adjacent parts to *composed*. Return the shift of the text after them.

    Args:
        group: The parts; together they cover their range without a gap.
        shift: How far *first* shifts the text before them.
    """
    start, end = min(part[0] for part in group), max(part[1] for part in group)
    made = [part for part in group if part[3]]
    texts: list[str] = []
    at = start
    for changed_start, changed_end, edit, _ in [part for part in group if not part[3]]:
        texts += (_made_text(made, at, changed_start), edit.text)
        at = max(at, changed_end)
    texts.append(_made_text(made, at, end))
    after = shift + sum(len(edit.text) - (edit.end - edit.start) for _, _, edit, _ in made)
    composed.append(Edit(start - shift, end - after, "".join(texts)))
    return after


def _made_text(made: Iterable[tuple[int, int, Edit, bool]], start: int, end: int) -> str:
    """Return the text from *start* to *end*, which edits have made."""
    return "".join(edit.text[max(0, start - at) : max(0, end - at)] for at, _, edit, _ in made)


def offset_after(edits: Iterable[Edit], offset: int) -> int:
    """Return the offset of a character that *edits* keep in the text after them.

    The character follows what is inserted at its place.
    """
    return offset + sum(len(edit.text) - (edit.end - edit.start) for edit in edits if edit.end <= offset)


def difference(before: str, after: str) -> Edit:
    """Return the edit of *before* that makes it *after*, and keeps what both begin and end with."""
    most = min(len(before), len(after))
    start = next((index for index in range(most) if before[index] != after[index]), most)
    rest = most - start
    end = next((index for index in range(rest) if before[-1 - index] != after[-1 - index]), rest)
    return Edit(start, len(before) - end, after[start : len(after) - end])


def line_edits(before: str, after: str) -> list[Edit]:
    """Return edits of *before* that make it *after*, and keep the lines that both have."""
    changed = difference(before, after)
    start = _line_start(before, changed.start)
    # The rest of a line that begins with the change is the same in both.
    rest = _LINE.match(before, changed.end)
    end = rest.end() if rest is not None else len(before)
    old, new = before[start:end], after[start : len(after) - (len(before) - end)]
    old_lines, new_lines = _LINE.findall(old), _LINE.findall(new)
    if max(len(old_lines), len(new_lines)) > _MAX_COMPARED_LINES:
        return [Edit(start, end, new)]
    offsets = [start]
    for line in old_lines:
        offsets.append(offsets[-1] + len(line))
    return [
        Edit(offsets[first], offsets[last], "".join(new_lines[new_first:new_last]))
        for kind, first, last, new_first, new_last in SequenceMatcher(
            None, old_lines, new_lines
        ).get_opcodes()
        if kind != "equal"
    ]


def merge_edits(base: str, disk: str, text: str) -> list[Edit] | None:
    """Return the edits of *text* that add the changes between *base* and *disk*.

    Returns:
        None if both have changed the same lines.
    """
    own = line_edits(base, text)
    theirs = [edit for edit in line_edits(base, disk) if edit not in own]
    try:
        return rebase_edits(theirs, own)
    except EditError:
        return None


def smallest_edit(text: str, edit: Edit) -> Edit:
    """Return *edit* of *text* without what it replaces by the same."""
    inner = difference(text[edit.start : edit.end], edit.text)
    return Edit(edit.start + inner.start, edit.start + inner.end, inner.text)


def _line_start(text: str, offset: int) -> int:
    """Return where the line of *offset* starts."""
    start = max(text.rfind("\n", 0, offset), text.rfind("\r", 0, offset)) + 1
    return _line_start(text, start - 1) if start and text[start - 1 : start + 1] == "\r\n" else start


def _ordered(edits: Iterable[Edit]) -> list[Edit]:
    # The sort is stable: insertions at the same place keep their order.
    return sorted(edits, key=lambda edit: edit[:2])
