"""Convert between offsets of a text and the positions of the Language Server Protocol."""

import re
from bisect import bisect_left, bisect_right
from typing import Final

from lsprotocol.types import Position, Range

_LINE_BREAK: Final = re.compile(r"\r\n?|\n")
# A character outside of the Basic Multilingual Plane has two UTF-16 code units.
_TWO_UNITS: Final = re.compile("[\U00010000-\U0010ffff]")


class TextPositions:
    """The lines of *text*, to convert offsets to positions and back in logarithmic time.

    An offset counts the characters of the text from 0. A position has a line from 0 and a character, which
    counts UTF-16 code units from the start of the line. Lines end with LF, CR LF or CR.
    """

    def __init__(self, text: str) -> None:
        self.text = text
        breaks = [match.span() for match in _LINE_BREAK.finditer(text)]
        self._starts = [0, *(end for _, end in breaks)]
        self._ends = [*(start for start, _ in breaks), len(text)]
        self._wide = [] if text.isascii() else [match.start() for match in _TWO_UNITS.finditer(text)]
        # The same characters, counted in UTF-16 code units.
        self._wide_units = [offset + index for index, offset in enumerate(self._wide)]

    def line(self, offset: int) -> int:
        """Return the number of the line, from 0, that contains the character at *offset*."""
        return bisect_right(self._starts, offset) - 1

    def line_start(self, line: int) -> int:
        """Return the offset of the start of a line, counted from 0. The text must have the line."""
        return self._starts[line]

    def position(self, offset: int) -> Position:
        """Return the position of an offset.

        An offset outside of the text or inside a line break means the nearest position before it.
        """
        return Position(*self.place(offset))

    def place(self, offset: int) -> tuple[int, int]:
        """Return the line and the character of the position of an offset."""
        offset = max(0, offset)
        line = bisect_right(self._starts, offset) - 1
        start, end = self._starts[line], self._ends[line]
        offset = min(offset, end)
        return line, self._units(offset) - self._units(start) if self._wide else offset - start

    def range(self, start: int, end: int) -> Range:
        """Return the range between two offsets."""
        return Range(self.position(start), self.position(end))

    def offset(self, position: Position) -> int:
        """Return the offset of a position.

        A position after the end of its line means the end of the line, and a position after the last line
        means the end of the text. A position between the two code units of a character means its start.
        """
        return self.offset_at(position.line, position.character)

    def offset_at(self, line: int, character: int) -> int:
        """Return the offset of the position with this line and character, as `offset` does."""
        if line >= len(self._starts):
            return len(self.text)
        if line < 0:
            return 0
        units = self._units(self._starts[line]) + max(0, character)
        return min(units - bisect_left(self._wide_units, units), self._ends[line])

    def _units(self, offset: int) -> int:
        return offset + bisect_left(self._wide, offset) if self._wide else offset
