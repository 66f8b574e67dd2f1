"""Where something stands in a document: looked up only when a message needs it."""

import re
from typing import Final, Literal, NamedTuple

from btcore.xml.read.element import Element
from btcore.xml.read.tinyxml2_compat import REFERENCE, find_attribute, iter_start_tags, value_span

ElementPart = Literal["tag", "name", "value"]
_LINE: Final = re.compile(r"[^\r\n]*")


class SourceSpan(NamedTuple):
    """A stretch of a document: *line* and *column* (characters) from 1, its *width*, and its line's text."""

    line: int
    column: int
    width: int
    source: str


def span_at(text: str, offset: int, width: int = 1, lines: dict[int, str] | None = None) -> SourceSpan:
    """The place of the *width* characters of *text* from *offset* on.

    *lines* keeps the lines that were met before, by their start: a line may be long, and met often.
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
    count = text.count("\n", start, end)
    if "\r" in text:
        count += text.count("\r", start, end) - text.count("\r\n", start, end)
    return count


def _character(text: str, start: int, end: int, number: int) -> int:
    """Where the character *number*, from 1, of the value written in *start* … *end* stands."""
    at = start
    for _ in range(number - 1):
        reference = REFERENCE.match(text, at, end)
        at = reference.end() if reference is not None else at + 1
    return min(at, max(start, end - 1))


class SourceMap:
    """The places of one document's elements.

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
        """Which element of the document *element* is, from 0."""
        return self._index[element]

    def line(self, element: Element) -> int:
        """The line in which the start tag of *element* begins."""
        if self._lines is None:
            self._lines = []
            line, done = 1, 0
            for tag in self._tags:
                line += _line_breaks(self._text, tag.start(), done)
                done = tag.start()
                self._lines.append(line)
        return self._lines[self._index[element]]

    def span(
        self, element: Element | int, attribute: str = "", part: ElementPart = "tag", within: int = 0
    ) -> SourceSpan | None:
        """Where *element* (or the element of that index) stands, or an attribute's name or value.

        *within* is the number of a character of the value, from 1, and asks for that one alone.
        """
        index = element if isinstance(element, int) else self._index.get(element, -1)
        if not 0 <= index < len(self._tags):
            return None
        tag = self._tags[index]
        start, end = tag.start(), tag.end(1)
        if self._text[end] == ">":
            end += 1
        found = find_attribute(tag, attribute) if attribute else None
        if found is not None:
            start, end = value_span(found) if part == "value" else found.span(1)
            if within and part == "value":
                start = _character(self._text, start, end, within)
                end = start + 1
            elif start == end:  # an empty value: show its quotes
                start, end = start - 1, end + 1
        return span_at(self._text, start, end - start, self._sources)
