"""Find tags and attributes in a text, and make expat read values as tinyxml2 of BehaviorTree.CPP does.

tinyxml2 keeps line breaks and tabs in an attribute value. A standard XML parser replaces them by spaces.
Therefore these characters are written as references before expat parses a text. Texts that expat
rejects or may parse differently are parsed by tinyxml2_parser.py.
"""

import re
import sys
from collections.abc import Iterator
from typing import Final

# More than tinyxml2 accepts in names, so that tags with a wrong name are found for messages, too.
_NAME: Final = r"[^\s<>/!?=\"'&]+"
START_TAG: Final = re.compile(rf"<\s*({_NAME})((?:[^\"'<>]|\"[^\"]*\"|'[^']*')*+)>")
OPEN_TAG: Final = re.compile(rf"<\s*{_NAME}")
_ATTRIBUTE: Final = re.compile(rf"{_NAME}\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")

REFERENCE: Final = r"&(?:lt|gt|amp|quot|apos|#[0-9]{0,20}|#x[0-9a-fA-F]{0,20});"
"""The pattern of a reference that tinyxml2 replaces by a character. It reads other references as text.

Without digits, `&#;` is `&#0;`.
"""
BARE_MARKUP_CHARACTER: Final = re.compile(rf"<|(?!{REFERENCE})&")
"""The pattern of a character in a value that XML requires to be written as a reference."""
SPACE: Final = r"[ \t\n\r\v\f]*+"
"""The pattern of white space between the parts of a tag."""
# tinyxml2 reads each of these as one line feed.
_LINE_BREAK: Final = r"\r\n?|\n\r?"
WRITTEN_CHARACTER: Final = re.compile(rf"{REFERENCE}|{_LINE_BREAK}")
"""The pattern of what is written with several characters, but is one character of the value."""
_LOST_BY_EXPAT: Final = re.compile(rf"{_LINE_BREAK}|\t")
_LINE_BREAK_IN_VALUE: Final = re.compile(r"""=\s*+(?:"[^"\n\r\t]*+[\n\r\t]|')""")
_NAMED: Final = {"&lt;": "<", "&gt;": ">", "&amp;": "&", "&quot;": '"', "&apos;": "'"}
OPAQUE: Final = (("<!--", "-->"), ("<![CDATA[", "]]>"), ("<?", "?>"))
"""How comments, character data and processing instructions, which contain no tags, begin and end."""


def _iter_start_tags(text: str) -> Iterator[re.Match[str]]:
    """Yield the start tags of a correct text: group 1 is the name, group 2 the attributes."""
    at = text.find("<")
    while at >= 0:
        tag = START_TAG.match(text, at)
        if tag is not None:
            yield tag
            at = text.find("<", tag.end())
            continue
        closing = next((closing for opening, closing in OPAQUE if text.startswith(opening, at)), ">")
        end = text.find(closing, at)
        at = text.find("<", end) if end >= 0 else -1


def escape_line_breaks(text: str) -> str:
    """Return *text* with references for the line breaks and tabs in attribute values; expat keeps these."""
    if _LINE_BREAK_IN_VALUE.search(text) is None:  # certainly no value contains a line break or a tab
        return text
    pieces: list[str] = []
    done = 0
    for tag in _iter_start_tags(text):
        if _LOST_BY_EXPAT.search(tag[2]) is None:
            continue
        for attribute in _ATTRIBUTE.finditer(text, *tag.span(2)):
            for match in _LOST_BY_EXPAT.finditer(text, *attribute.span(1 if attribute[2] is None else 2)):
                pieces += (text[done : match.start()], "&#9;" if match[0] == "\t" else "&#10;")
                done = match.end()
    return "".join((*pieces, text[done:])) if pieces else text


def decode(written: str) -> str:
    """Return the value for the text *written* between quotes or tags."""
    # Most texts contain nothing to replace. These searches are much faster than the pattern.
    if "&" not in written and "\n" not in written and "\r" not in written:
        return written
    return WRITTEN_CHARACTER.sub(_decode_match, written)


def _decode_match(match: re.Match[str]) -> str:
    reference = match[0]
    if reference[0] != "&":
        return "\n"
    if reference[1] != "#":
        return _NAMED[reference]
    code = int(f"0{reference[3:-1]}", 16) if reference[2] == "x" else int(f"0{reference[2:-1]}")
    return chr(code) if code <= sys.maxunicode else reference
