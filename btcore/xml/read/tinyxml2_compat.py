"""XML read as tinyxml2 reads it, where BehaviorTree.CPP's users rely on that.

tinyxml2 takes a bare ``<`` or ``&`` in an attribute value as text, and keeps the line breaks
and tabs of a value. An XML parser refuses the first and turns the second into spaces. So such
characters are escaped before the parser sees them, and it is remembered where, because places
in messages are those of the text as the user wrote it.
"""

import re
from bisect import bisect_right
from collections.abc import Iterator
from typing import Final, NamedTuple

# Names as tinyxml2 takes them: whatever is not punctuation of a tag.
_NAME: Final = r"[^\s<>/!?=\"'&]+"
START_TAG: Final = re.compile(rf"<({_NAME})((?:[^\"'<>]|\"[^\"]*\"|'[^']*')*+)>")
OPEN_TAG: Final = re.compile(rf"<{_NAME}")
ATTRIBUTE: Final = re.compile(rf"({_NAME})\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")

_REFERENCE: Final = r"&(?:lt|gt|amp|quot|apos|#[0-9]{1,7}|#x[0-9a-fA-F]{1,6});"
REFERENCE: Final = re.compile(_REFERENCE + r"|\r\n")
_NEEDS_ESCAPE: Final = re.compile(rf"<|(?!{_REFERENCE})&|\r\n|[\n\r\t]")
_ESCAPED: Final = {"<": "&lt;", "&": "&amp;", "\n": "&#10;", "\r": "&#10;", "\r\n": "&#10;", "\t": "&#9;"}
_LINE_BREAK_IN_VALUE: Final = re.compile(r"""=\s*+(?:"[^"\n\r\t]*+[\n\r\t]|')""")
# What stands between `<` and its end is never a tag: comments, character data, instructions.
_OPAQUE: Final = (("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"))


class EscapedCharacter(NamedTuple):
    """One character (or line break) at *offset* of the original text, and what it became."""

    offset: int
    original: str
    written: str


class EscapedText(NamedTuple):
    """A text that an XML parser accepts, and how it came from the original."""

    text: str
    escapes: tuple[EscapedCharacter, ...]

    def to_original(self, offset: int) -> int:
        """The offset in the original text of *offset* in :attr:`text`."""
        starts: list[int] = []
        grown: list[int] = []
        growth = 0
        for one in self.escapes:
            starts.append(one.offset + growth)
            growth += len(one.written) - len(one.original)
            grown.append(growth)
        index = bisect_right(starts, offset) - 1
        if index < 0:
            return offset
        one = self.escapes[index]
        return max(one.offset, offset - grown[index])


def iter_markup(text: str) -> Iterator[tuple[int, re.Match[str] | None]]:
    """Every start tag, end tag and declaration of *text*: its offset, and the match of a start tag.

    Ends with the first ``<`` after which *text* is not well-formed enough to tell what is a tag.
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
    """The start tags of *text*, in document order: group 1 is the name, group 2 the attributes."""
    return (tag for _, tag in iter_markup(text) if tag is not None)


def iter_attribute_values(tag: re.Match[str]) -> Iterator[tuple[str, int, int]]:
    """The attributes of a start tag: name, and where its value starts and ends in the text."""
    for attribute in ATTRIBUTE.finditer(tag.string, *tag.span(2)):
        yield attribute[1], *value_span(attribute)


def find_attribute(tag: re.Match[str], name: str) -> re.Match[str] | None:
    """Return the match of :data:`ATTRIBUTE` for the attribute *name* of a start tag, if there is one."""
    found = ATTRIBUTE.finditer(tag.string, *tag.span(2))
    return next((attribute for attribute in found if attribute[1] == name), None)


def value_span(attribute: re.Match[str]) -> tuple[int, int]:
    """Return the start and the end of an attribute's value, without the quotes."""
    return attribute.span(2 if attribute[2] is not None else 3)


def has_one_line_tags(text: str) -> bool:
    """Whether surely no tag holds a line break or a tab, be it in a value (cheap; errs towards False)."""
    if any(odd in text for odd in "\t\r'") or ("!" in text and "<!" in text):
        return False
    # Single characters are found far faster than two, so the rare one of "<?" narrows the search.
    if text.rfind("<?", 0, text.rfind("?") + 1) > 0:
        return False
    # Every line break follows a ">", and no ">" is anything but the end of a tag.
    return text.count("\n") == text.count(">\n") and text.count("<") == text.count(">")


def may_keep_line_breaks(text: str) -> bool:
    """Whether an attribute value may hold a line break or tab (cheap; errs towards True)."""
    return _LINE_BREAK_IN_VALUE.search(text) is not None


def escape_attribute_values(text: str) -> EscapedText:
    """*text* with what an XML parser would refuse or alter in attribute values escaped."""
    escapes: list[EscapedCharacter] = []
    pieces: list[str] = []
    done = 0
    for tag in iter_start_tags(text):
        if _NEEDS_ESCAPE.search(tag[2]) is None:
            continue
        for _, start, end in iter_attribute_values(tag):
            for found in _NEEDS_ESCAPE.finditer(text, start, end):
                written = _ESCAPED[found[0]]
                escapes.append(EscapedCharacter(found.start(), found[0], written))
                pieces += (text[done : found.start()], written)
                done = found.end()
    pieces.append(text[done:])
    return EscapedText("".join(pieces), tuple(escapes))
