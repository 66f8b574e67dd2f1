"""Parse documents by the rules of tinyxml2, the parser of BehaviorTree.CPP, if expat cannot: see element.py.

tinyxml2 accepts more than XML allows. Whatever other XML tools reject causes a warning.
"""

import re
import sys
from typing import Final, NoReturn

from btcore.diagnostic_codes import BARE_MARKUP, LENIENT_XML, NOT_XML, DiagnosticCode
from btcore.diagnostics import Diagnostic
from btcore.errors import XmlSyntaxError
from btcore.fixes import CloseTag, Escape, Fix, ReplaceText, SetAttributes, WriteEndTag
from btcore.xml.read.element import EXAMPLE, MAX_LEVELS, Element
from btcore.xml.read.positions import LineIndex
from btcore.xml.read.tinyxml2_compat import (
    BARE_MARKUP_CHARACTER,
    OPEN_TAG,
    REFERENCE,
    SPACE,
    START_TAG,
    decode,
)

_NAME: Final = r"[A-Za-z_:\x80-\U0010ffff][A-Za-z0-9_:.\-\x80-\U0010ffff]*+"
_GAP: Final = re.compile(SPACE)
_TAG: Final = re.compile(rf"<{SPACE}(/?)({_NAME})")
_ATTRIBUTE: Final = re.compile(rf"({_NAME}){SPACE}(?:(=){SPACE}(?:\"([^\"]*)\"|'([^']*)')?)?")
# Characters that XML does not allow, written as such or as a reference.
_CONTROL: Final = re.compile(r"[\x01-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")
_NUMBER: Final = re.compile(r"&#(?:x([0-9a-fA-F]{0,20})|([0-9]{0,20}));")  # as in REFERENCE
_BARE_AMPERSAND: Final = re.compile(rf"(?!{REFERENCE})&")
_DECLARED: Final = re.compile(rf"xmlns:({_NAME}){SPACE}=")

MAX_WARNINGS: Final = 50_000
"""Maximum number of warnings about one document."""


def _rewrite(before: str, after: str) -> tuple[Fix, ...]:
    """Return the fix that replaces the marked text *before*. Only a text in one line is marked as a whole."""
    return () if "\n" in before or "\r" in before else (ReplaceText(after, is_safe=True),)


def parse_as_tinyxml2(text: str, file: str) -> tuple[Element, list[Diagnostic]]:
    """Parse a text.

    Args:
        file: Name of the file in messages, or "".

    Returns:
        The first outermost element, and a warning for whatever other XML tools reject.
    """
    return _Parser(text, file).parse()


class _Parser:
    def __init__(self, text: str, file: str) -> None:
        self._text = text
        self._file = file
        self._lines = LineIndex(text)
        self._warnings: list[Diagnostic] = []
        self._root: Element | None = None
        # The open elements with the offsets of their start tags.
        self._open: list[tuple[Element, int]] = []
        self._declarations_allowed = True
        self._prefixes = {"xml", "xmlns", *_DECLARED.findall(text)}

    def parse(self) -> tuple[Element, list[Diagnostic]]:
        text = self._text
        at: int | None = 0
        while at is not None:
            # White space before the first declaration is skipped, but other XML tools reject it.
            start = _GAP.match(text, at).end()  # type: ignore[union-attr]
            if start == len(text):
                break
            at = self._read_markup(start) if text[start] == "<" else self._read_text(start)
        if self._open:
            element, start = self._open[-1]
            hint = f"write </{element.tag}>, or <{element.tag} … />"
            message = f"<{element.tag}> is never closed"
            fix = WriteEndTag(element.tag)
            raise self._error(start, len(element.tag) + 1, message, hint, fix)
        if self._root is None:
            raise self._error(0, 1, "not XML: the document has no element", EXAMPLE)
        for control in _CONTROL.finditer(text):
            message = f"U+{ord(control[0]):04X} is a control character, which is invalid in XML"
            self._warn(control.start(), 1, message, "remove it")
        return self._root, self._warnings

    def _error(self, at: int, width: int, message: str, hint: str = "", *fixes: Fix) -> XmlSyntaxError:
        place = self._lines.span(at, width)
        return XmlSyntaxError([place.diagnostic(NOT_XML, message, self._file, hint, fixes)])

    def _warn(
        self, at: int, width: int, message: str, hint: str, *fixes: Fix, code: DiagnosticCode = LENIENT_XML
    ) -> None:
        if len(self._warnings) < MAX_WARNINGS:
            place = self._lines.span(at, width)
            hint = f"other XML tools reject it; {hint}"
            self._warnings.append(place.diagnostic(code, message, self._file, hint, fixes))

    def _read_markup(self, at: int) -> int | None:
        """Read the markup at *at*, and return the offset of its end; None if the rest is ignored."""
        text = self._text
        if text.startswith("<?", at):
            return self._read_declaration(at)
        self._declarations_allowed = False
        if text.startswith("<!--", at):
            end = text.find("-->", at + 4)
            if end < 0:
                raise self._error(at, 4, "the comment is not closed", "close it with -->")
            hyphens = text.find("--", at + 4, end + 1)
            if hyphens >= 0:
                hint = "write a single hyphen, or several separated by spaces"
                self._warn(hyphens, 2, "'--' inside a comment", hint)
            return end + 3
        for opening, closing in ("<![CDATA[", "]]>"), ("<!", ">"):
            if text.startswith(opening, at):
                end = text.find(closing, at + len(opening))
                if end < 0:
                    message = f"the {opening} is not closed"
                    raise self._error(at, len(opening), message, f"close it with {closing}")
                # A document type that only names the root element is valid before the root.
                misplaced = opening == "<!" or not self._open
                if misplaced and (self._root is not None or not text.startswith("<!DOCTYPE", at)):
                    message = f"{opening}…{closing} is ignored here"
                    self._warn(at, len(opening), message, "remove it")
                return end + len(closing)
        return self._read_tag(at)

    def _read_declaration(self, at: int) -> int:
        text = self._text
        end = text.find("?>", at + 2)
        if end < 0:
            raise self._error(at, 2, "the <? is not closed", "close it with ?>")
        if not self._declarations_allowed:
            message = "<?…?> is allowed only before everything else"
            raise self._error(at, end + 2 - at, message, "remove it, or move it to the start of the document")
        is_declaration = re.match(r"<\?xml\s", text[at : at + 6]) is not None
        if is_declaration and at > 0:
            self._warn(at, 5, "<?xml …?> is not at the very start of the document", "remove it")
        return end + 2

    def _read_text(self, at: int) -> int:
        self._declarations_allowed = False
        text = self._text
        end = text.find("<", at)
        if not self._open:
            if end < 0 and self._root is None:
                hint = EXAMPLE
                if text.strip().lower().endswith((".xml", ".btproj")):
                    hint = "if it is the path of a file, use btcore.load(path)"
                raise self._error(at, 1, "not XML: the document does not begin with a tag", hint)
            if end < 0:
                hint = "all trees must be inside one <root>…</root>"
                raise self._error(at, 1, "something follows the end of the document", hint)
            shown = text[at:end].rstrip()
            self._warn(
                at, len(shown), "the text outside of the root is ignored", "remove it, or make it a comment"
            )
            return end
        if end < 0:
            return len(text)
        bare = _BARE_AMPERSAND.search(text, at, end)
        if bare is not None:
            fix = ReplaceText("&amp;", is_safe=True)
            self._warn(bare.start(), 1, "unescaped '&' in text", "write &amp;", fix)
        closing = text.find("]]>", at, end)
        if closing >= 0:
            fix = ReplaceText("]]&gt;", is_safe=True)
            self._warn(closing, 3, "']]>' in text", "write ]]&gt;", fix)
        self._check_characters(at, end)
        return end

    def _read_tag(self, at: int) -> int | None:
        text = self._text
        tag = _TAG.match(text, at)
        if tag is None:
            raise self._error(at, 1, "'<' without a valid tag", "write &lt; for the character '<'")
        attributes, end = self._read_attributes(tag)
        is_empty = text[end] == "/"
        after = end + 1 + is_empty
        if tag[1]:
            return self._close(tag, after) if not is_empty else self._refuse_tag(at, end)
        self._check_name(tag, 2)
        if tag.start(2) > at + 1:
            fix = _rewrite(tag[0], f"<{tag[2]}")
            self._warn(at, tag.end() - at, "white space between '<' and the name", f"write <{tag[2]}", *fix)
        element = Element(tag[2], attributes, self._lines.line(at))
        if self._open:
            self._open[-1][0].children.append(element)
        elif self._root is None:
            self._root = element
        else:
            hint = "put all trees into one <root>…</root>"
            self._warn(at, tag.end() - at, f"the second outermost element <{tag[2]}> is ignored", hint)
        if not is_empty:
            self._open.append((element, at))
            if len(self._open) > MAX_LEVELS:
                message = f"elements are nested more than {MAX_LEVELS} deep"
                raise self._error(at, tag.end() - at, message, "split the tree into subtrees")
        return after

    def _close(self, tag: re.Match[str], after: int) -> int | None:
        """Close the innermost element; return *after*, or None at an end tag that ends the document."""
        at, name = tag.start(), tag[2]
        if not self._open:
            if self._root is None:
                raise self._error(
                    at, after - at, f"</{name}> has no start tag", "remove it, or write its start tag"
                )
            message = f"</{name}> has no start tag: the rest of the document is ignored"
            self._warn(at, after - at, message, "remove it, or write its start tag")
            return None
        element, start = self._open.pop()
        if element.tag != name:
            line, column = self._lines.place(start)
            hint = f"<{element.tag}> was opened in line {line}, column {column}"
            message = f"expected </{element.tag}>, but found </{name}>"
            raise self._error(at, after - at, message, hint, WriteEndTag(element.tag))
        if tag.group().rstrip(name) != "</" or self._text[tag.end() : after].strip() != ">":
            fix = _rewrite(self._text[at:after], f"</{name}>")
            self._warn(at, after - at, "the end tag is more than a name", f"write </{name}>", *fix)
        return after

    def _read_attributes(self, tag: re.Match[str]) -> tuple[dict[str, str], int]:
        text, after_name = self._text, tag.end()
        attributes: dict[str, str] = {}
        while True:
            at = _GAP.match(text, after_name).end()  # type: ignore[union-attr]
            if text.startswith((">", "/>"), at):
                return attributes, at
            match = _ATTRIBUTE.match(text, at)
            if match is None or match.lastindex is None or match.lastindex < 3:
                self._refuse_tag(tag.start(), at)
            name = match[1]
            if name in attributes:
                message = f"the attribute {name} is written twice in one tag"
                raise self._error(at, len(name), message, "remove one of them")
            if at == after_name:
                message = f"missing white space before the attribute {name}"
                fix = ReplaceText(f" {name}", is_safe=True)
                self._warn(at, len(name), message, f"write a space before {name}", fix)
            self._check_name(match, 1)
            attributes[name] = self._value(match)
            after_name = match.end()

    def _refuse_tag(self, at: int, error_at: int) -> NoReturn:
        text = self._text
        opening = OPEN_TAG.match(text, at)
        if START_TAG.match(text, at) is None and opening is not None:
            self._refuse_unclosed_tag(opening)
        tag = _TAG.match(text, at)
        if tag is not None and tag[1] and text[error_at : error_at + 1] in ("", "<"):
            message = f"the tag </{tag[2]} is not closed"
            raise self._error(at, tag.end() - at, message, f"write </{tag[2]}>", CloseTag())
        attribute = _ATTRIBUTE.match(text, error_at)
        if attribute is None:
            raise self._error(error_at, 1, "invalid attribute name")
        if attribute[2] is None:
            name = attribute[1]
            message = f"the attribute {name} has no value"
            fix = SetAttributes({name: f"{{{name}}}"})
            raise self._error(error_at, len(name), message, f'write {name}="…"', fix)
        raise self._error(attribute.end(), 1, "an attribute's value must be in quotes")

    def _refuse_unclosed_tag(self, opening: re.Match[str]) -> NoReturn:
        at, width = opening.start(), len(opening[0])
        # Quoted values are blanked out, because they may contain "<".
        rest = re.sub(r"\"[^\"]*\"|'[^']*'", lambda match: "x" * len(match[0]), self._text[opening.end() :])
        inside = rest.partition("<")[0]
        if '"' in inside or "'" in inside:
            raise self._error(at, width, f"missing closing quote in the tag {opening[0]} …>")
        message = f"the tag {opening[0]} …> is not closed"
        raise self._error(at, width, message, "close it with > or />", CloseTag())

    def _check_name(self, match: re.Match[str], group: int) -> None:
        prefix, colon, _ = match[group].partition(":")
        if colon and prefix not in self._prefixes:
            message = f"the prefix {prefix}: of {match[group]} is not defined"
            self._warn(match.start(group), len(prefix) + 1, message, "names of nodes and ports have no colon")

    def _value(self, attribute: re.Match[str]) -> str:
        text = self._text
        group = 4 if attribute[3] is None else 3
        start, end = attribute.span(group)
        bare = BARE_MARKUP_CHARACTER.search(text, start, end)
        if bare is not None:
            escaped = BARE_MARKUP_CHARACTER.sub(
                lambda match: "&lt;" if match[0] == "<" else "&amp;", attribute[group]
            )
            message = f"unescaped '{bare[0]}' in an attribute value is read as text"
            written = f"{text[attribute.start() : start]}{escaped}{text[end]}"
            fix = Escape(is_safe=True)
            self._warn(bare.start(), 1, message, f"write {written}", fix, code=BARE_MARKUP)
        self._check_characters(start, end)
        return decode(attribute[group])

    def _check_characters(self, start: int, end: int) -> None:
        for reference in _NUMBER.finditer(self._text, start, end):
            code = int(reference[1], 16) if reference[1] else int(reference[2] or "0")
            if code == 0 or 0xD800 <= code <= 0xDFFF:
                message = f"{reference[0]} is not a character"
                raise self._error(reference.start(), len(reference[0]), message, "remove it")
            if code > sys.maxunicode:
                message = f"{reference[0]} is not a character, and is read as text"
                self._warn(reference.start(), len(reference[0]), message, "remove it")
            elif _CONTROL.match(chr(code)):
                message = f"{reference[0]} is a control character, which is invalid in XML"
                self._warn(reference.start(), len(reference[0]), message, "remove it")
