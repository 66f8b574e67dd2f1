"""Escape the characters that change a terminal instead of being shown.

Names of nodes, keys and robots come from files and from other machines. Control characters in them could
change a terminal's title or colours, or overwrite lines, and bidirectional controls could reorder a line.
"""

import re
from typing import Final

# C1 and DEL, the separators of lines and paragraphs, Unicode's Bidi_Control, and halves of surrogate pairs,
# which no encoding can write.
_LATER: Final = "\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff"
_IN_LINE: Final = f"[\\x00-\\x1f{_LATER}]"
_IN_TEXT: Final = f"[\\x00-\\x08\\x0b-\\x1f{_LATER}]"
# json.dumps escapes C0 itself. In XML, C0 and surrogates are invalid.
_EXCEPT_C0: Final = f"[{_LATER}]"
_IN_XML: Final = str.maketrans({"&": "&amp;", "<": "&lt;", ">": "&gt;"})


def escape_controls(text: str, one_line: bool = False) -> str:
    r"""Return *text* with each control character replaced by its escape sequence in Python, such as `\x1b`.

    Args:
        text: The text.
        one_line: Whether to replace line breaks and tabs, too.

    Examples:
        >>> from btcore.escaping import escape_controls
        >>> print(escape_controls(f"red: {chr(27)}[31m"))
        red: \x1b[31m
    """
    # Nearly every text is printable. The re module compiles a pattern when it is first used.
    return text if text.isprintable() else re.sub(_IN_LINE if one_line else _IN_TEXT, _escape, text)


def to_json(data: object, indent: int | None = None, ensure_ascii: bool = False) -> str:
    """Return *data* as JSON for a terminal: control characters are escaped.

    Args:
        data: The JSON data.
        indent: The number of spaces per level; None writes a single line.
        ensure_ascii: Whether to escape all other characters beyond ASCII, too.

    Examples:
        >>> from btcore.escaping import to_json
        >>> print(to_json({"name": f"{chr(27)}[31m"}))
        {"name": "\\u001b[31m"}
    """
    import json  # not at the start of every program

    text = json.dumps(data, ensure_ascii=ensure_ascii, indent=indent)
    return re.sub(_EXCEPT_C0, lambda match: f"\\u{ord(match[0]):04x}", text)


def escape_xml(text: str) -> str:
    """Return the XML document *text* with each control character replaced by a character reference.

    Examples:
        >>> from btcore.escaping import escape_xml
        >>> escape_xml(f'<Sequence name="{chr(155)}"/>')
        '<Sequence name="&#x9b;"/>'
    """
    return re.sub(_EXCEPT_C0, lambda match: f"&#x{ord(match[0]):x};", text)


def escape_text(text: str) -> str:
    """Return *text* as it is written between two tags of XML.

    `xml.sax.saxutils.escape` does the same, but imports modules for the network.

    Examples:
        >>> from btcore.escaping import escape_text
        >>> escape_text("a < b & c")
        'a &lt; b &amp; c'
    """
    return text.translate(_IN_XML)


def _escape(match: re.Match[str]) -> str:
    code = ord(match[0])
    return f"\\x{code:02x}" if code < 0x100 else f"\\u{code:04x}"
