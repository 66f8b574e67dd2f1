"""Printing on terminals that lack characters: similar characters replace them."""

import codecs
import io
import sys
from typing import Final

_REPLACE: Final = "btcore.similar"
"""The name of the error handler that replaces characters for `make_encodable`."""
_SIMILAR: Final = {
    char: similar
    for similar, chars in {
        ">": "→▶▸",
        "<": "←↩◇",
        "=": "↔⇉⇄",
        "|": "↓",
        "@": "↻↺◷",
        "~": "↷",
        "#": "▣■□",
        "-": "▪–—−",
        "o": "◦○",
        "*": "●",
        "+": "✔✓⊤⋔⎇",
        "x": "✘✗⊥×",
        "!": "¬",
        ".": "·",
        "...": "…",
        ">=": "≥",
        "<=": "≤",
        " ": "\xa0",
        '"': "«»”″",
        "S": "§",
        "u": "µ",
    }.items()
    for char in chars
}
"""Replacements for the characters that btcore itself prints."""


def make_encodable() -> None:
    """Let stdout and stderr accept every character, also on a terminal that is limited to ASCII.

    Characters that the encoding lacks are replaced by similar characters, or else by escapes as in JSON.
    """
    codecs.register_error(_REPLACE, _replace)
    codecs.register(lambda name: _ASCII if name == _ASCII.name else None)
    for stream in (sys.stdout, sys.stderr):
        # Another error handler was chosen by the user, with PYTHONIOENCODING.
        if isinstance(stream, io.TextIOWrapper) and stream.errors in ("strict", "backslashreplace"):
            is_ascii = codecs.lookup(stream.encoding).name == "ascii"
            stream.reconfigure(encoding=_ASCII.name if is_ascii else None, errors=_REPLACE)


class _AsciiEncoder(codecs.IncrementalEncoder):
    def encode(self, text: str, final: bool = False) -> bytes:
        return codecs.ascii_encode(text, self.errors)[0]


# click writes UTF-8 to a stream whose encoding is called "ascii", as if the encoding was set by mistake.
_ASCII: Final = codecs.CodecInfo(
    codecs.ascii_encode,
    codecs.ascii_decode,
    incrementalencoder=_AsciiEncoder,
    incrementaldecoder=codecs.getincrementaldecoder("ascii"),
    name="btcore_ascii",
)


def _replace(error: UnicodeError) -> tuple[str, int]:
    if not isinstance(error, UnicodeEncodeError):
        raise error
    import json  # rarely needed

    text = error.object[error.start : error.end]
    return "".join(_SIMILAR.get(char) or json.dumps(char)[1:-1] for char in text), error.end
