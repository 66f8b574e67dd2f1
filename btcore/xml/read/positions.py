"""Positions in a document, computed only when a message needs them."""

import re
from bisect import bisect_right
from collections.abc import Sequence
from typing import Final, NamedTuple

from btcore.diagnostic_codes import DiagnosticCode
from btcore.diagnostics import Diagnostic
from btcore.fixes import Fix, SetAttributes
from btcore.xml.read.element import Element, ElementPart
from btcore.xml.read.scan import Scan, ScannedAttribute, ScannedElement, scan, value_offsets
from btcore.xml.read.tinyxml2_compat import decode

_LINE: Final = re.compile(r"[^\r\n]*")
_LINE_BREAK: Final = re.compile(r"\r\n?|\n")
_TEXT_OR_CDATA: Final = re.compile(r"<!\[CDATA\[(.*?)\]\]>|([^<]++)", re.DOTALL)


class SourceSpan(NamedTuple):
    """A range in a line: *line* and *column* from 1, *width* in characters, and *source*, the line's text."""

    line: int
    column: int
    width: int
    source: str

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        file: str,
        hint: str = "",
        fixes: Sequence[Fix] = (),
        attribute: str = "",
        characters: tuple[int, int] = (0, 0),
    ) -> Diagnostic:
        """Return a diagnostic about this range, which marks *attribute*, if given; see `Diagnostic`."""
        line, column, width, source = self
        # Without a marked attribute, the problem is about those that are missing.
        missing = (name for fix in fixes if isinstance(fix, SetAttributes) for name, _ in fix.values)
        attributes = (attribute,) if attribute else tuple(dict.fromkeys(missing))
        return Diagnostic(
            code,
            message,
            file,
            line,
            column,
            hint,
            source,
            width,
            tuple(fixes),
            attributes=attributes,
            characters=characters,
        )


class LineIndex:
    """The offsets at which the lines of *text* begin. Every lookup takes the same short time."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._starts = [0, *(match.end() for match in _LINE_BREAK.finditer(text))]
        self._lines: dict[int, str] = {}  # a cache that avoids copies of very long lines

    def line(self, offset: int) -> int:
        """Return the number of the line, from 1, that contains the character at *offset*."""
        return bisect_right(self._starts, offset)

    def place(self, offset: int) -> tuple[int, int]:
        """Return the line and the column, both from 1, of the character at *offset*."""
        line = self.line(offset)
        return line, offset - self._starts[line - 1] + 1

    def offset(self, line: int, column: int) -> int:
        """Return the offset of a character; *line* and *column* count from 1. The text must have the line."""
        return self._starts[line - 1] + column - 1

    def span(self, offset: int, width: int = 1) -> SourceSpan:
        """Return the position of a range of the text.

        Args:
            offset: Offset of the first character, from 0.
            width: Number of characters; the range ends at the end of the line at the latest.
        """
        line = self.line(offset)
        start = self._starts[line - 1]
        source = self._lines.get(line)
        if source is None:
            source = self._lines[line] = _LINE.match(self._text, start)[0]  # type: ignore[index]
        end = start + len(source)
        return SourceSpan(line, offset - start + 1, max(1, min(width, end - offset)), source)


class SourceMap:
    """The positions of a document's elements.

    The parser's tree and the user's text hold the same elements in the same order, so the n-th
    element is the n-th start tag, however the tag is written.

    Args:
        root: The outermost element.
        scanned: The scan of the text, if *root* was made from it.
    """

    def __init__(self, text: str, root: Element, scanned: Scan | None = None) -> None:
        self.scan = scan(text, is_parsed=True) if scanned is None else scanned
        self._text = text
        self._line_index = LineIndex(text)
        self._index = {element: index for index, element in enumerate(root.iter())}
        # The offsets of the characters of values, by the start of the value.
        self._characters: dict[int, list[int]] = {}

    def scanned(self, element: Element) -> ScannedElement:
        """Return *element* with the offsets of its tags and attributes."""
        return self.scan.elements[self._index[element]]

    def index(self, element: Element) -> int:
        """Return the index of *element* in document order, from 0."""
        return self._index[element]

    def line(self, element: Element) -> int:
        """Return the line in which the start tag of *element* begins, from 1."""
        return self._line_index.line(self.scanned(element).start)

    def text_in(self, element: Element) -> str:
        """Return the text between the start tag of *element* and the next tag."""
        scanned = self.scanned(element)
        pieces: list[str] = []
        at = scanned.start_tag_end
        while not scanned.is_empty and (match := _TEXT_OR_CDATA.match(self._text, at)) is not None:
            pieces.append(decode(match[2]) if match[1] is None else match[1])
            at = match.end()
        return "".join(pieces)

    def span(
        self,
        element: Element,
        attribute: str = "",
        part: ElementPart = "value",
        column: int = 0,
        width: int = 1,
    ) -> SourceSpan:
        """Return the position of an element or of one of its attributes: see `Mark` in document.py."""
        scanned = self.scanned(element)
        start, end = scanned.start, scanned.tag_end
        if self._text.startswith(">", end):
            end += 1
        attribute_place = scanned.attribute(attribute) if attribute else None
        if attribute_place is not None and part == "name":
            start, end = attribute_place.start, attribute_place.name_end
        elif attribute_place is not None:
            start, end = attribute_place.value_start, attribute_place.value_end
            if column:
                start, end = self._characters_of(attribute_place, column, width)
            elif start == end:  # an empty value: show its quotes
                start, end = start - 1, end + 1
        return self._line_index.span(start, end - start)

    def _characters_of(self, attribute: ScannedAttribute, column: int, width: int) -> tuple[int, int]:
        """Return the offsets of the start and the end of *width* characters of a value, from *column* on."""
        offsets = self._characters.get(attribute.start)
        if offsets is None:
            offsets = self._characters[attribute.start] = value_offsets(self._text, attribute)
        last = len(offsets) - 1  # the end of the value
        first = max(0, min(column, last) - 1)
        return offsets[first], offsets[min(first + width, last)]
