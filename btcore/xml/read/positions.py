"""Positions in a document, computed only when a message needs them."""

import re
from typing import Final, NamedTuple

from btcore.diagnostic_codes import DiagnosticCode
from btcore.errors import Diagnostic
from btcore.xml.read.element import Element, ElementPart
from btcore.xml.read.tinyxml2_compat import (
    WRITTEN_CHARACTER,
    decode,
    find_attribute,
    iter_start_tags,
    value_span,
)

_LINE: Final = re.compile(r"[^\r\n]*")
_TEXT_OR_CDATA: Final = re.compile(r"<!\[CDATA\[(.*?)\]\]>|([^<]++)", re.DOTALL)


class SourceSpan(NamedTuple):
    """A range in a line: *line* and *column* from 1, *width* in characters, and *source*, the line's text."""

    line: int
    column: int
    width: int
    source: str

    def diagnostic(self, code: DiagnosticCode, message: str, file: str, hint: str = "") -> Diagnostic:
        """Return a diagnostic about this range of *file*.

        Args:
            code: The diagnostic code.
            message: What is wrong.
            file: Name of the file in messages, or "".
            hint: How to fix the problem, or "".
        """
        return Diagnostic(code, message, file, self.line, self.column, hint, self.source, self.width)


def span_at(text: str, offset: int, width: int = 1, lines: dict[int, str] | None = None) -> SourceSpan:
    """Return the position of a range of *text*.

    Args:
        text: The whole text.
        offset: Offset of the first character, from 0.
        width: Number of characters; the range ends at the end of the line at the latest.
        lines: A cache of lines by the offset of their start. It avoids copies of very long lines.
    """
    start = max(text.rfind("\n", 0, offset), text.rfind("\r", 0, offset)) + 1
    line = _line_breaks(text, offset) + 1
    source = None if lines is None else lines.get(start)
    if source is None:
        source = _LINE.match(text, start)[0]  # type: ignore[index]
        if lines is not None:
            lines[start] = source
    end = start + len(source)
    return SourceSpan(line, offset - start + 1, max(1, min(width, end - offset)), source)


def _line_breaks(text: str, end: int, start: int = 0) -> int:
    # "\r\n" is one line break.
    count = text.count("\n", start, end)
    if "\r" in text:
        count += text.count("\r", start, end) - text.count("\r\n", start, end)
    return count


def _character(text: str, start: int, end: int, number: int) -> int:
    """Return the offset of character *number* (from 1) of the escaped value from *start* to *end*."""
    at = start
    # A reference such as &amp;, and a line break of two characters, is one character of the value.
    for _ in range(number - 1):
        reference = WRITTEN_CHARACTER.match(text, at, end)
        at = reference.end() if reference is not None else at + 1
    return min(at, max(start, end - 1))


class SourceMap:
    """The positions of a document's elements.

    The parser's tree and the user's text hold the same elements in the same order, so the n-th
    element is the n-th start tag, however the tag is written.
    """

    def __init__(self, text: str, root: Element) -> None:
        self._text = text
        self._tags = list(iter_start_tags(text))
        self._elements = list(root.iter())
        self._lines: list[int] | None = None
        self._sources: dict[int, str] = {}
        self._index = {element: index for index, element in enumerate(self._elements)}

    def index(self, element: Element) -> int:
        """Return the index of *element* in document order, from 0."""
        return self._index[element]

    def line(self, element: Element) -> int:
        """Return the line in which the start tag of *element* begins, from 1."""
        if self._lines is None:
            self._lines = []
            line, done = 1, 0
            for tag in self._tags:
                line += _line_breaks(self._text, tag.start(), done)
                done = tag.start()
                self._lines.append(line)
        return self._lines[self._index[element]]

    def text_in(self, element: Element) -> str:
        """Return the text between the start tag of *element* and the next tag."""
        tag = self._tags[self._index[element]]
        pieces: list[str] = []
        at = tag.end()
        while not tag[0].endswith("/>") and (match := _TEXT_OR_CDATA.match(self._text, at)) is not None:
            pieces.append(decode(match[2]) if match[1] is None else match[1])
            at = match.end()
        return "".join(pieces)

    def span(
        self, element: Element, attribute: str = "", part: ElementPart = "value", within: int = 0
    ) -> SourceSpan | None:
        """Return the position of an element or of one of its attributes, or None if it is unknown.

        Args:
            element: The element.
            attribute: Name of the attribute; "" means the element itself.
            part: Whether to return the position of the attribute's name or value.
            within: Number of a character in the value, from 1; 0 means the whole value.
        """
        index = self._index[element]
        if index >= len(self._tags):
            return None
        tag = self._tags[index]
        start, end = tag.start(), tag.end(1)
        if self._text[end] == ">":
            end += 1
        match = find_attribute(tag, attribute) if attribute else None
        if match is not None:
            start, end = value_span(match) if part == "value" else match.span(1)
            if within and part == "value":
                start = _character(self._text, start, end, within)
                end = start + 1
            elif start == end:  # an empty value: show its quotes
                start, end = start - 1, end + 1
        return span_at(self._text, start, end - start, self._sources)
