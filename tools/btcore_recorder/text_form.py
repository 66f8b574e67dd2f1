"""The text form of a recording, `.btrec.txt`: a line for each input, in the order of the run.

A line is a word and its values as a JSON array, as `btcore_recorder.lines` describes them; the text of a
document follows as lines that begin with `|`. The last value of `head`, `end` and `state_end` is a CRC-32 of
the lines since the previous one and of the other values, so that damage is found; in a hand-written file it
may be null.
"""

import json
import zlib
from collections.abc import Iterable, Sequence
from typing import Any, Final

from btcore_recorder.lines import END_WORDS, DamageError, ResultTexts, WrittenLine, encode_text, load_data

MAGIC: Final = b"btrec "
_json: Final = json.JSONEncoder(ensure_ascii=False, separators=(", ", ":"), allow_nan=False).encode


class TextEncoder:
    """Converts lines to text."""

    def __init__(self) -> None:
        self._data = bytearray()
        self._unchecked: list[str] = []  # the lines since the last CRC
        self._results = ResultTexts(_text, "")

    def add(self, lines: Iterable[WrittenLine], time: int = 0) -> None:
        """Add lines; *time* (ns since 1970) is not a part of the text."""
        for line in lines:
            if isinstance(line, tuple):
                self._unchecked.append(self._results.get(line))
                continue
            word, *values = line
            if word == "document":
                file, text, is_shared = values
                self._unchecked.append(f"document {_json([file, is_shared])}\n")
                self._unchecked += [f"|{each}\n" for each in text.split("\n")]
            elif word in END_WORDS:
                checked = encode_text("".join(self._unchecked))
                crc = zlib.crc32(_json(values).encode(), zlib.crc32(checked))
                self._data += checked + f"{word} {_json([*values, crc])}\n".encode()
                self._unchecked.clear()
            else:
                self._unchecked.append(_text(line))

    def take(self) -> bytes:
        """Return the text since the last call."""
        data = bytes(self._data)
        self._data.clear()
        return data

    def take_end(self) -> bytes:
        """Return the text since the last call, and the end of the file."""
        return self.take()


def _text(line: Sequence[Any]) -> str:
    return f"{line[0]} {_json(line[1:])}\n"


class TextLines:
    """The lines of a file in the text form; a `LineSource`."""

    def __init__(self, data: bytes) -> None:
        self._lines = data.split(b"\n")
        self._number = 0  # of the line, from 1
        self._crc = 0

    @property
    def place(self) -> str:
        """The number of the last line."""
        return f"line {self._number}"

    def next(self) -> tuple[str, list[Any]] | None:
        """Return the word and the values of the next line, or None at the end of the file.

        Raises:
            DamageError: The line is truncated or damaged.
        """
        if self._number >= len(self._lines) - 1:
            if self._lines[-1]:
                self._number = len(self._lines)
                raise DamageError("the file is truncated within this line")
            return None
        line = self._take()
        word, _, data = line.partition(b" ")
        try:
            values = load_data(data.decode("utf-8"))
        except (ValueError, RecursionError):
            raise DamageError("this is not a line of a recording") from None
        if not isinstance(values, list):
            raise DamageError("the values are not a list")
        name = word.decode("ascii", "replace")
        if name in END_WORDS and values:
            self._check_crc(values.pop(), values)
        else:
            self._add_crc(line)
        if name == "document" and len(values) == 2:
            values.insert(1, self._document())
        return name, values

    def _take(self) -> bytes:
        line = self._lines[self._number]
        self._number += 1
        return line

    def _document(self) -> str:
        lines = []
        while self._number < len(self._lines) and self._lines[self._number].startswith(b"|"):
            line = self._take()
            self._add_crc(line)
            lines.append(line[1:])
        try:
            return b"\n".join(lines).decode("utf-8", "surrogatepass")
        except UnicodeDecodeError:
            raise DamageError("the document is not UTF-8") from None

    def _add_crc(self, line: bytes) -> None:
        self._crc = zlib.crc32(line + b"\n", self._crc)

    def _check_crc(self, crc: object, values: list[Any]) -> None:
        expected, self._crc = zlib.crc32(_json(values).encode(), self._crc), 0
        if crc is not None and crc != expected:
            raise DamageError("the lines before it were changed: their checksum differs")
