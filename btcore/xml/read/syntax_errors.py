"""What is wrong with a document that is not XML, said in the words of its author."""

import re
from typing import Final, NamedTuple

from lxml import etree

from btcore.diagnostic_codes import NOT_XML
from btcore.errors import Diagnostic
from btcore.xml.read.positions import span_at
from btcore.xml.read.tinyxml2_compat import OPEN_TAG, EscapedText, iter_markup

EXAMPLE: Final = 'a tree looks like: <root BTCPP_format="4"><BehaviorTree ID="Main">…</BehaviorTree></root>'


class _Saying(NamedTuple):
    """What libxml2 says (a pattern), the same as a sentence, and what to do about it.

    *anchor* is what the complaint is about, found backwards from where the parser stood.
    """

    pattern: str
    sentence: str
    hint: str = ""
    anchor: str = ""


_SAYINGS: Final = (
    _Saying(r"AttValue: \" or ' expected", "an attribute's value must stand in quotes"),
    _Saying(
        r"Attribute (\S+) redefined",
        "the attribute {0} is written twice in one tag",
        "remove one of them",
        "{0}",
    ),
    _Saying(
        r"Specification mandates value for attribute ([^\s,]+)",
        "the attribute {0} has no value",
        'write {0}="…"',
        "{0}",
    ),
    _Saying(
        r"Extra content at the end of the document",
        "something follows the end of the document",
        "all trees stand inside one <root>…</root>",
    ),
    _Saying(
        r"Start tag expected",
        "this is not XML: it does not begin with a tag",
        EXAMPLE,
    ),
    _Saying(
        r"Namespace prefix ([^\s,]+) (?:for \S+ )?on ([^\s,]+) is not defined",
        "the prefix {0}: of {1} is not defined",
        "names of nodes and ports have no colon",
        "{0}:",
    ),
    _Saying(r"xmlParseEntityRef: no name|EntityRef: expecting", "a bare '&' in text", "write &amp;", "&"),
    _Saying(r"Entity '(.*)' not defined", "the entity &{0}; is not defined", "write &amp;{0};", "&{0}"),
    _Saying(r"StartTag: invalid element name", "a '<' that begins no tag", "write &lt; for a bare '<'", "<"),
    _Saying(
        r"invalid xmlChar value (\d+)", "&#{0}; is a control character, which XML forbids", "remove it", "&#"
    ),
    _Saying(
        r"PCDATA invalid Char value|invalid character in attribute value",
        "a control character, which XML forbids",
        "remove it",
    ),
    _Saying(r"attributes construct error", "spaces must part the attributes"),
    _Saying(r"XML declaration allowed only at the start", "<?xml …?> must be the very first of the file"),
    _Saying(
        r"Excessive depth in document: (\d+)",
        "elements are nested more than {0} deep",
        "split the tree into subtrees",
    ),
    _Saying(
        r"Double hyphen within comment|Comment must not contain '--'",
        "'--' stands inside a comment",
        "",
        "--",
    ),
    _Saying(r"error parsing attribute name", "this is no name of an attribute"),
)


def diagnose_xml_error(error: etree.XMLSyntaxError, lenient: EscapedText, text: str, file: str) -> Diagnostic:
    """The diagnostic for *text*, which the parser refused with *error*."""
    found = _unbalanced(text)
    if found is not None:
        offset, width, message, hint = found
        place = span_at(text, offset, width)
        return Diagnostic(NOT_XML, message, file, place.line, place.column, hint, place.source, place.width)
    line, column = error.position
    at = lenient.to_original(_offset(lenient.text, line or 1, column or 1))
    message, hint, anchor = _sentence(str(error.msg))
    if "<" not in text and text.strip().lower().endswith((".xml", ".btproj")):
        hint = "if that is the path of a file, read it with btcore.load(path)"
    found_at = text.rfind(anchor, 0, at + 1) if anchor else -1
    place = span_at(text, found_at, len(anchor)) if found_at >= 0 else span_at(text, at)
    return Diagnostic(NOT_XML, message, file, place.line, place.column, hint, place.source, place.width)


def _offset(text: str, line: int, column: int) -> int:
    at = 0
    for _ in range(line - 1):
        following = text.find("\n", at) + 1
        if not following:
            break
        at = following
    return max(0, min(at + column - 1, len(text) - 1))


def _sentence(message: str) -> tuple[str, str, str]:
    for saying in _SAYINGS:
        found = re.search(saying.pattern, message)
        if found is not None:
            words = [word or "" for word in found.groups()]
            return saying.sentence.format(*words), saying.hint.format(*words), saying.anchor.format(*words)
    bare = re.sub(r",? line \d+, column \d+.*", "", message)
    return f"this is not well-formed XML: {bare[:1].lower()}{bare[1:]}", "", ""


def _unbalanced(text: str) -> tuple[int, int, str, str] | None:
    """The first tag that has no partner: offset, width, what is wrong, and what to do."""
    open_tags: list[tuple[str, int]] = []
    for at, tag in iter_markup(text):
        if tag is not None:
            if not tag[2].endswith("/") and not tag[0].endswith("/>"):
                open_tags.append((tag[1], at))
            continue
        if text.startswith("<!", at):
            if text.startswith("<!--", at):
                return at, 4, "a comment that does not end", "it ends with -->"
            continue
        if not text.startswith("</", at):
            return _broken_tag(text, at)
        end = text.find(">", at)
        if end < 0:
            return at, len(text) - at, "an end tag that does not end", "it ends with >"
        name = text[at + 2 : end].strip()
        width = end + 1 - at
        if not open_tags:
            return at, width, f"</{name}> closes nothing", "remove it, or write its start tag"
        opened, opened_at = open_tags.pop()
        if opened != name:
            place = span_at(text, opened_at)
            message = f"</{name}> stands where <{opened}> is to be closed"
            return at, width, message, f"<{opened}> was opened in line {place.line}, column {place.column}"
    if open_tags:
        name, at = open_tags[-1]
        return at, len(name) + 1, f"<{name}> is never closed", f"write </{name}>, or <{name} … />"
    return None


def _broken_tag(text: str, at: int) -> tuple[int, int, str, str] | None:
    """A ``<`` that begins no whole tag; None where the parser's own words are better."""
    name = OPEN_TAG.match(text, at)
    if name is None:
        return None
    width = len(name[0])
    rest = text[at + width :]
    following = re.search(r"<", re.sub(r"\"[^\"]*\"|'[^']*'", lambda one: "x" * len(one[0]), rest))
    inside = rest[: following.start()] if following else rest
    quotes = re.sub(r"\"[^\"]*\"|'[^']*'", "", inside)
    if '"' in quotes or "'" in quotes:
        return at, width, f"in {name[0]} …> a quote is opened and not closed", ""
    return at, width, f"the tag {name[0]} …> is not finished", "it ends with > or />"
