"""Parse with libxml2, and explain its syntax errors in terms that the author of a document understands.

Imported only for documents that need it: lxml takes longer to import than a small tree takes to load.
"""

import re
from typing import Any, Final, NamedTuple

from lxml import etree

from btcore.diagnostic_codes import NOT_XML
from btcore.errors import Diagnostic, XmlSyntaxError
from btcore.xml.read.element import EXAMPLE, Element, encoded
from btcore.xml.read.positions import span_at
from btcore.xml.read.tinyxml2_compat import OPEN_TAG, EscapedText, escape_attribute_values, iter_markup


def parse_leniently(text: str, escaped: EscapedText | None, file: str) -> tuple[Element, EscapedText]:
    """Parse a text that expat does not parse, with its attribute values escaped where necessary.

    Args:
        text: The text as the user wrote it.
        escaped: The text as expat got it, if it was escaped.
        file: Name of the file in messages, or "".

    Returns:
        The outermost element, without lines, and the text that libxml2 parsed.

    Raises:
        XmlSyntaxError: *text* is not valid XML.
    """
    if escaped is None:
        # An unescaped "<" or "&" may be the reason why expat rejected the text.
        escaped = escape_attribute_values(text)
    try:
        return parse_with_libxml2(encoded(escaped.text)), escaped
    except etree.XMLSyntaxError as error:
        raise XmlSyntaxError([_diagnose(error, escaped, text, file)]) from None


def parse_with_libxml2(data: bytes) -> Element:
    """Return the outermost element of *data* (UTF-8), parsed by libxml2, without lines.

    Raises:
        lxml.etree.XMLSyntaxError: *data* is not valid XML.
    """
    top: list[Element] = []
    pending: list[tuple[Any, list[Element]]] = [(parse_lxml_tree(data), top)]
    while pending:
        parsed, siblings = pending.pop()
        element = Element(parsed.tag, dict(parsed.items()), 0)
        siblings.append(element)
        pending += [(child, element.children) for child in parsed.iterchildren("*", reversed=True)]
    return top[0]


def parse_lxml_tree(data: bytes) -> etree._Element:
    """Parse *data* (UTF-8) with libxml2, without document types, custom entities and network access.

    Raises:
        lxml.etree.XMLSyntaxError: *data* is not valid XML.
    """
    # By default libxml2 allows 256 levels counted from <root>. With huge_tree it allows 2,048, so that
    # the limit of the format, which counts from the BehaviorTree, takes effect.
    parser = etree.XMLParser(
        encoding="utf-8",
        resolve_entities=False,
        no_network=True,
        load_dtd=False,
        collect_ids=False,
        huge_tree=True,
    )
    return etree.fromstring(data, parser)


class _Explanation(NamedTuple):
    """A *pattern* that libxml2's error message matches, the *sentence* that btcore reports, and a *hint*.

    *anchor* is the text to underline: its last occurrence before the parser's position. Groups of the
    pattern replace ``{0}`` and ``{1}``.
    """

    pattern: str
    sentence: str
    hint: str = ""
    anchor: str = ""


# The first pattern that matches libxml2's message is used.
_EXPLANATIONS: Final = (
    _Explanation(r"AttValue: \" or ' expected", "an attribute's value must be in quotes"),
    _Explanation(
        r"Attribute (\S+) redefined",
        "the attribute {0} is written twice in one tag",
        "remove one of them",
        "{0}",
    ),
    _Explanation(
        r"Specification mandates value for attribute ([^\s,]+)",
        "the attribute {0} has no value",
        'write {0}="…"',
        "{0}",
    ),
    _Explanation(
        r"Extra content at the end of the document",
        "something follows the end of the document",
        "all trees must be inside one <root>…</root>",
    ),
    _Explanation(r"Start tag expected", "not XML: the document does not begin with a tag", EXAMPLE),
    _Explanation(
        r"Namespace prefix ([^\s,]+) (?:for \S+ )?on ([^\s,]+) is not defined",
        "the prefix {0}: of {1} is not defined",
        "names of nodes and ports have no colon",
        "{0}:",
    ),
    _Explanation(
        r"xmlParseEntityRef: no name|EntityRef: expecting", "unescaped '&' in text", "write &amp;", "&"
    ),
    _Explanation(r"Entity '(.*)' not defined", "the entity &{0}; is not defined", "write &amp;{0};", "&{0}"),
    _Explanation(
        r"StartTag: invalid element name", "'<' without a valid tag", "write &lt; for the character '<'", "<"
    ),
    _Explanation(
        r"invalid xmlChar value (\d+)",
        "&#{0}; is a control character, which is invalid in XML",
        "remove it",
        "&#",
    ),
    _Explanation(
        r"PCDATA invalid Char value|invalid character in attribute value",
        "control character, which is invalid in XML",
        "remove it",
    ),
    _Explanation(r"attributes construct error", "missing space between attributes"),
    _Explanation(r"XML declaration allowed only at the start", "<?xml …?> must be at the start of the file"),
    _Explanation(
        r"Excessive depth in document: (\d+)",
        "elements are nested more than {0} deep",
        "split the tree into subtrees",
    ),
    _Explanation(
        r"Double hyphen within comment|Comment must not contain '--'",
        "-- is not allowed in a comment",
        "",
        "--",
    ),
    _Explanation(r"error parsing attribute name", "invalid attribute name"),
)


def _diagnose(error: etree.XMLSyntaxError, escaped: EscapedText, text: str, file: str) -> Diagnostic:
    """Return the diagnostic for a text that libxml2 rejected.

    Args:
        error: The error of libxml2.
        escaped: The text that libxml2 parsed.
        text: The text as the user wrote it.
        file: Name of the file in messages, or "".
    """
    unbalanced = _unbalanced(text)
    if unbalanced is not None:
        offset, width, message, hint = unbalanced
        return span_at(text, offset, width).diagnostic(NOT_XML, message, file, hint)
    line, column = error.position
    at = escaped.to_original(_offset(escaped.text, line or 1, column or 1))
    message, hint, anchor = _sentence(str(error.msg))
    if "<" not in text and text.strip().lower().endswith((".xml", ".btproj")):
        hint = "if it is the path of a file, use btcore.load(path)"
    anchor_at = text.rfind(anchor, 0, at + 1) if anchor else -1
    place = span_at(text, anchor_at, len(anchor)) if anchor_at >= 0 else span_at(text, at)
    return place.diagnostic(NOT_XML, message, file, hint)


def _offset(text: str, line: int, column: int) -> int:
    at = 0
    for _ in range(line - 1):
        following = text.find("\n", at) + 1
        if not following:
            break
        at = following
    return max(0, min(at + column - 1, len(text) - 1))


def _sentence(message: str) -> tuple[str, str, str]:
    for known in _EXPLANATIONS:
        match = re.search(known.pattern, message)
        if match is not None:
            words = [word or "" for word in match.groups()]
            return known.sentence.format(*words), known.hint.format(*words), known.anchor.format(*words)
    bare = re.sub(r",? line \d+, column \d+.*", "", message)
    return f"invalid XML: {bare[:1].lower()}{bare[1:]}", "", ""


def _unbalanced(text: str) -> tuple[int, int, str, str] | None:
    """Return the first unbalanced tag as (offset, width, message, hint), or None."""
    open_tags: list[tuple[str, int]] = []
    for at, tag in iter_markup(text):
        if tag is not None:
            if not tag[2].endswith("/") and not tag[0].endswith("/>"):
                open_tags.append((tag[1], at))
            continue
        if text.startswith("<!", at):
            if text.startswith("<!--", at):
                return at, 4, "the comment is not closed", "close it with -->"
            continue
        if not text.startswith("</", at):
            return _broken_tag(text, at)
        end = text.find(">", at)
        if end < 0:
            return at, len(text) - at, "the end tag is not closed", "close it with >"
        name = text[at + 2 : end].strip()
        width = end + 1 - at
        if not open_tags:
            return at, width, f"</{name}> has no start tag", "remove it, or write its start tag"
        opened, opened_at = open_tags.pop()
        if opened != name:
            place = span_at(text, opened_at)
            message = f"expected </{opened}>, but found </{name}>"
            return at, width, message, f"<{opened}> was opened in line {place.line}, column {place.column}"
    if open_tags:
        name, at = open_tags[-1]
        return at, len(name) + 1, f"<{name}> is never closed", f"write </{name}>, or <{name} … />"
    return None


def _broken_tag(text: str, at: int) -> tuple[int, int, str, str] | None:
    """Return the error for a ``<`` without a complete tag; None if libxml2's message is better."""
    name = OPEN_TAG.match(text, at)
    if name is None:
        return None
    width = len(name[0])
    # Quoted values are blanked out, because they may contain "<".
    rest = text[at + width :]
    following = re.search(r"<", re.sub(r"\"[^\"]*\"|'[^']*'", lambda match: "x" * len(match[0]), rest))
    inside = rest[: following.start()] if following else rest
    quotes = re.sub(r"\"[^\"]*\"|'[^']*'", "", inside)
    if '"' in quotes or "'" in quotes:
        return at, width, f"missing closing quote in the tag {name[0]} …>", ""
    return at, width, f"the tag {name[0]} …> is not closed", "close it with > or />"
