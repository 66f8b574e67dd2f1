"""Make XML parsers read attribute values as tinyxml2, the parser of BehaviorTree.CPP, does.

tinyxml2 reads an unescaped ``<`` or ``&`` in an attribute value as text, and keeps line breaks and tabs
in a value. A standard XML parser rejects an unescaped ``<`` or ``&``, and replaces line breaks and tabs by
spaces. Therefore these characters are escaped before parsing. The offsets of the escapes are kept, because
positions in messages refer to the text as the user wrote it.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator
from typing import Final, NamedTuple

# tinyxml2 accepts any characters in names, except for the punctuation of a tag.
_NAME: Final = r"[^\s<>/!?=\"'&]+"
START_TAG: Final = re.compile(rf"<({_NAME})((?:[^\"'<>]|\"[^\"]*\"|'[^']*')*+)>")
OPEN_TAG: Final = re.compile(rf"<{_NAME}")
ATTRIBUTE: Final = re.compile(rf"({_NAME})\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")

_REFERENCE: Final = r"&(?:lt|gt|amp|quot|apos|#[0-9]{1,7}|#x[0-9a-fA-F]{1,6});"
REFERENCE: Final = re.compile(_REFERENCE + r"|\r\n")
_NEEDS_ESCAPE: Final = re.compile(rf"<|(?!{_REFERENCE})&|\r\n|[\n\r\t]")
_ESCAPED: Final = {"<": "&lt;", "&": "&amp;", "\n": "&#10;", "\r": "&#10;", "\r\n": "&#10;", "\t": "&#9;"}
_LINE_BREAK_IN_VALUE: Final = re.compile(r"""=\s*+(?:"[^"\n\r\t]*+[\n\r\t]|')""")
# Comments, character data and processing instructions contain no tags.
_OPAQUE: Final = (("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"))


class EscapedCharacter(NamedTuple):
    """A character or line break *original* at *offset* in the text, and the escape *written* in its place."""

    offset: int
    original: str
    written: str


class EscapedText(NamedTuple):
    """A text that an XML parser accepts, and the characters that were escaped in it."""

    text: str
    escapes: tuple[EscapedCharacter, ...]

    def to_original(self, offset: int) -> int:
        """Return the offset in the original text that corresponds to *offset* in :attr:`text`."""
        starts: list[int] = []
        grown: list[int] = []
        growth = 0
        for escape in self.escapes:
            starts.append(escape.offset + growth)
            growth += len(escape.written) - len(escape.original)
            grown.append(growth)
        index = bisect_right(starts, offset) - 1
        if index < 0:
            return offset
        return max(self.escapes[index].offset, offset - grown[index])


def iter_markup(text: str) -> Iterator[tuple[int, re.Match[str] | None]]:
    """Yield (offset, match) of every start tag, end tag and declaration; only start tags have a match.

    Stops at the first ``<`` after which *text* is too malformed to recognise tags.
    """
    at = text.find("<")
    while at >= 0:
        for opening, closing in _OPAQUE:
            if text.startswith(opening, at):
                end = text.find(closing, at + len(opening))
                if end < 0:
                    yield at, None
                    return
                end += len(closing)
                break
        else:
            tag = START_TAG.match(text, at)
            yield at, tag
            if tag is not None:
                end = tag.end()
            elif text.startswith(("</", "<!"), at):
                end = text.find(">", at) + 1
                if not end:
                    return
            else:
                return
        at = text.find("<", end)


def iter_start_tags(text: str) -> Iterator[re.Match[str]]:
    """Return the start tags of *text* in document order: group 1 is the name, group 2 the attributes."""
    return (tag for _, tag in iter_markup(text) if tag is not None)


def iter_attribute_values(tag: re.Match[str]) -> Iterator[tuple[str, int, int]]:
    """Yield the attributes of a start tag, as (name, start of the value, end of the value)."""
    for attribute in ATTRIBUTE.finditer(tag.string, *tag.span(2)):
        yield attribute[1], *value_span(attribute)


def find_attribute(tag: re.Match[str], name: str) -> re.Match[str] | None:
    """Return the match of :data:`ATTRIBUTE` for the attribute *name* of a start tag, or None."""
    attributes = ATTRIBUTE.finditer(tag.string, *tag.span(2))
    return next((attribute for attribute in attributes if attribute[1] == name), None)


def value_span(attribute: re.Match[str]) -> tuple[int, int]:
    """Return the start and the end of an attribute's value, without the quotes."""
    return attribute.span(2 if attribute[2] is not None else 3)


def may_keep_line_breaks(text: str) -> bool:
    """Return False only if no attribute value contains a line break or a tab. May return True then, too."""
    return _LINE_BREAK_IN_VALUE.search(text) is not None


def escape_attribute_values(text: str) -> EscapedText:
    """Escape the characters in attribute values that an XML parser would reject or change."""
    escapes: list[EscapedCharacter] = []
    pieces: list[str] = []
    done = 0
    for tag in iter_start_tags(text):
        if _NEEDS_ESCAPE.search(tag[2]) is None:
            continue
        for _, start, end in iter_attribute_values(tag):
            for match in _NEEDS_ESCAPE.finditer(text, start, end):
                written = _ESCAPED[match[0]]
                escapes.append(EscapedCharacter(match.start(), match[0], written))
                pieces += (text[done : match.start()], written)
                done = match.end()
    pieces.append(text[done:])
    return EscapedText("".join(pieces), tuple(escapes))
