"""Formatting: one element per line, indented by its depth.

Only the white space between tags and attributes changes. Text, comments and attribute values keep their
white space, and so does a document with missing tags.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

from lsprotocol import types

from btcore.xml.edit.editor import Edit
from btcore.xml.read.scan import Scan, ScannedElement
from btcore_studio.edit.text_edits import difference
from btcore_studio.language.project import Project, SourceDocument


class _Token(NamedTuple):
    """A tag or a comment: its place, its depth, and the element of a tag."""

    start: int
    end: int
    depth: int
    type: str
    element: ScannedElement | None


def format_document(
    project: Project, document: SourceDocument, params: types.DocumentFormattingParams
) -> list[types.TextEdit]:
    """Return the edits that format a document; none if a tag is incomplete or missing.

    Args:
        params: The indentation.
    """
    unit = " " * params.options.tab_size if params.options.insert_spaces else "\t"
    return document.text_edits(formatting_edits(document.scan, unit))


def format_range(
    project: Project, document: SourceDocument, params: types.DocumentRangeFormattingParams
) -> list[types.TextEdit]:
    """Return the edits of `format_document` in a range."""
    document_params = types.DocumentFormattingParams(params.text_document, params.options)
    selected = params.range
    return [
        edit
        for edit in format_document(project, document, document_params)
        if selected.start <= edit.range.end and edit.range.start <= selected.end
    ]


def formatting_edits(scan: Scan, unit: str) -> list[Edit]:
    """Return the edits that format a text; none if a tag is incomplete or missing.

    Args:
        scan: The elements of the text.
        unit: The indentation of a child.
    """
    text = scan.text
    if len(scan.roots) != 1 or not all(_is_whole(text, element) for element in scan.elements):
        return []
    new_line = "\r\n" if "\r\n" in text else "\n"
    edits: list[Edit] = []
    for start, end, replacement in _white_space(scan, unit, new_line):
        gap = text[start:end]
        if gap == replacement:
            continue
        change = difference(gap, replacement)
        if {"\r", "\n"} & {*gap.replace(new_line, "")}:  # an edit must not begin or end in a line break
            change = Edit(0, len(gap), replacement)
        edits.append(Edit(start + change.start, start + change.end, change.text))
    return edits


def _white_space(scan: Scan, unit: str, new_line: str) -> Iterator[tuple[int, int, str]]:
    """Yield the start and the end of each white space that may change, and the wanted white space."""
    text = scan.text
    tokens = _tokens(scan)
    fixed = _fixed_gaps(text, tokens)
    for index, (left, right) in enumerate(pairwise(tokens)):
        if index not in fixed:
            gap = text[left.end : right.start]
            yield left.end, right.start, _gap(gap, left, right, unit, new_line)
    for token in tokens:
        if token.type == "start" and token.element is not None:
            yield from _white_space_in_tag(text, token.element, unit * (token.depth + 2), new_line)
    end = tokens[-1].end
    if not text[end:].strip():
        yield end, len(text), new_line


def _is_whole(text: str, element: ScannedElement) -> bool:
    closed = element.is_empty or (element.end_tag_start >= 0 and text[element.end - 1] == ">")
    return closed and element.is_complete and all(item.is_closed for item in element.attributes)


def _tokens(scan: Scan) -> list[_Token]:
    """Return the tags and comments in the order of the text."""
    parts: list[tuple[int, int, str, ScannedElement | None]] = []
    for element in scan.elements:
        parts.append((element.start, element.start_tag_end, "start", element))
        if not element.is_empty:
            parts.append((element.end_tag_start, element.end, "end", element))
    parts += ((start, end, "comment", None) for start, end in scan.comments)
    tokens: list[_Token] = []
    depth = 0
    for start, end, token_type, owner in sorted(parts, key=lambda item: item[0]):
        depth -= token_type == "end"
        tokens.append(_Token(start, end, depth, token_type, owner))
        depth += token_type == "start" and owner is not None and not owner.is_empty
    return tokens


def _fixed_gaps(text: str, tokens: list[_Token]) -> set[int]:
    """Return the numbers of the gaps in elements that contain text, which keep their white space."""
    fixed: set[int] = set()
    # The gaps that belong to each open element, and whether one of them contains text.
    open_gaps: list[list[int]] = [[]]
    with_text: list[bool] = [False]
    for index, token in enumerate(tokens):
        if token.type == "start" and token.element is not None and not token.element.is_empty:
            open_gaps.append([])
            with_text.append(False)
        elif token.type == "end":
            gaps, has_text = open_gaps.pop(), with_text.pop()
            if has_text:
                fixed.update(gaps)
        if index + 1 < len(tokens):
            open_gaps[-1].append(index)
            with_text[-1] |= bool(text[token.end : tokens[index + 1].start].strip())
    if with_text[0]:
        fixed.update(open_gaps[0])
    return fixed


def _gap(gap: str, left: _Token, right: _Token, unit: str, new_line: str) -> str:
    """Return the white space between two neighbours."""
    if left.type == "start" and right.type == "end" and left.element is right.element:
        return ""
    if right.type == "comment" and "\n" not in gap:
        return " "
    is_blank = gap.count("\n") > 1 and not (
        right.type == "end" or (left.type == "start" and left.depth < right.depth)
    )
    return new_line * (1 + is_blank) + unit * right.depth


def _white_space_in_tag(
    text: str, element: ScannedElement, indent: str, new_line: str
) -> Iterator[tuple[int, int, str]]:
    """Yield the white space in a start tag, as `_white_space` does; line breaks between attributes remain."""
    end = element.tag_end
    for attribute in element.attributes:
        gap = text[end : attribute.start]
        white_space = f"{new_line}{indent}" if "\n" in gap else " "
        if not gap.strip():
            yield end, attribute.start, white_space
        end = attribute.end
    last = element.start_tag_end - (2 if element.is_empty else 1)
    if not text[end:last].strip():
        yield end, last, ""
