"""How tinyxml2, the parser of BehaviorTree.CPP, reads tags, references and line breaks."""

import re
import sys
from typing import Final

# More than tinyxml2 accepts in names, so that tags with a wrong name are found for messages, too.
_NAME: Final = r"[^\s<>/!?=\"'&]+"
START_TAG: Final = re.compile(rf"<\s*({_NAME})((?:[^\"'<>]|\"[^\"]*\"|'[^']*')*+)>")
OPEN_TAG: Final = re.compile(rf"<\s*{_NAME}")

REFERENCE: Final = r"&(?:lt|gt|amp|quot|apos|#[0-9]{0,20}|#x[0-9a-fA-F]{0,20});"
"""The pattern of a reference that tinyxml2 replaces by a character. It reads other references as text.

Without digits, `&#;` is `&#0;`.
"""
BARE_MARKUP_CHARACTER: Final = re.compile(rf"<|(?!{REFERENCE})&")
"""The pattern of a character in a value that XML requires to be written as a reference."""
SPACE: Final = r"[ \t\n\r\v\f]*+"
"""The pattern of white space between the parts of a tag."""
WRITTEN_CHARACTER: Final = re.compile(rf"{REFERENCE}|\r\n?|\n\r?")
"""The pattern of what is written with several characters, but is one character of the value.

tinyxml2 reads each line break as one line feed.
"""
_NAMED: Final = {"&lt;": "<", "&gt;": ">", "&amp;": "&", "&quot;": '"', "&apos;": "'"}


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
