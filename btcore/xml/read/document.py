"""Documents: from a file or a text to elements, with the place of each in the text.

A document type with content is refused, and what is not XML with file, line and column.
"""

import os
from pathlib import Path
from typing import Final

from lxml import etree

from btcore.diagnostic_codes import (
    BARE_MARKUP,
    DOCUMENT_TYPE,
    EMPTY_DOCUMENT,
    NOT_UTF8,
    NOT_XML,
    UNREADABLE_FILE,
    DiagnosticCode,
)
from btcore.errors import Diagnostic, XmlSyntaxError
from btcore.suggestions import nearest_name
from btcore.xml.read.element import (
    Element,
    parse_lxml_tree,
    parse_with_expat,
    parse_with_libxml2,
)
from btcore.xml.read.positions import (
    ElementPart,
    SourceMap,
    SourceSpan,
    span_at,
)
from btcore.xml.read.syntax_errors import EXAMPLE, diagnose_xml_error
from btcore.xml.read.tinyxml2_compat import (
    EscapedText,
    escape_attribute_values,
    has_one_line_tags,
    iter_markup,
    may_keep_line_breaks,
)

_BYTE_ORDER_MARKS: Final = (
    (b"\xff\xfe\x00\x00", "UTF-32"),
    (b"\x00\x00\xfe\xff", "UTF-32"),
    (b"\xff\xfe", "UTF-16"),
    (b"\xfe\xff", "UTF-16"),
)


class Document:
    """One XML document: *root* is its element tree, *text* what the user wrote, *file* its name.

    *warnings* tells what was read leniently, *knows_lines* whether every element has its line in *text*;
    *max_depth* is how deep its elements may nest (None: as deep as its format allows).
    """

    max_depth: int | None = None

    def __init__(
        self, root: Element, lenient: EscapedText, text: str, file: str, knows_lines: bool = False
    ) -> None:
        self.root = root
        self.text = text
        self.file = file
        self._lenient = lenient
        self._places: SourceMap | None = None
        self.knows_lines = knows_lines
        self._parsed: list[etree._Element] = []

    @property
    def folder(self) -> Path:
        """Where its includes are looked for: the folder of its file, else the current one."""
        return Path(self.file).parent if self.file else Path()

    @property
    def source_map(self) -> SourceMap:
        """Where its elements stand; made when it is asked for the first time."""
        if self._places is None:
            self._places = SourceMap(self.text, self.root)
        return self._places

    def line(self, element: Element) -> int:
        """The line in which *element* begins."""
        return element.line if self.knows_lines else self.source_map.line(element)

    def text_in(self, element: Element) -> str:
        """The text in *element*, up to its first child. Few need it, so it is read when it is asked for."""
        if not self._parsed:
            self._parsed = list(parse_lxml_tree(_encoded(self._lenient.text)).iter("*"))
        return self._parsed[self.source_map.index(element)].text or ""

    def span(
        self, element: Element | int, attribute: str = "", part: ElementPart = "value", within: int = 0
    ) -> SourceSpan | None:
        """Where *element* (itself, or its index in the document) stands, or one of its attributes.

        *within* asks for one character of the attribute's value, by its number from 1.
        """
        return self.source_map.span(element, attribute, part, within)

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element | int,
        attribute: str = "",
        part: ElementPart = "value",
        hint: str = "",
        within: int = 0,
    ) -> Diagnostic:
        """A diagnostic about *element*, or about one of its attributes (see :meth:`span`)."""
        place = self.span(element, attribute, part, within)
        if place is None:
            return Diagnostic(code, message, self.file, hint=hint)
        return Diagnostic(code, message, self.file, place.line, place.column, hint, place.source, place.width)

    @property
    def warnings(self) -> list[Diagnostic]:
        """One for every attribute value with a bare ``<`` or ``&`` in it."""
        found: list[Diagnostic] = []
        end = 0
        for one in self._lenient.escapes:
            if one.original not in "<&" or one.offset < end:
                continue
            value, end = self._escaped_value(one.offset)
            place = span_at(self.text, one.offset)
            message = f"a bare '{one.original}' in an attribute value is read as text"
            hint = f"other XML tools refuse it; write {value}"
            found.append(
                Diagnostic(BARE_MARKUP, message, self.file, place.line, place.column, hint, place.source)
            )
        return found

    def _escaped_value(self, offset: int) -> tuple[str, int]:
        """The attribute around *offset* as it should be written, and where it ends."""
        text = self.text
        quote_at = max(text.rfind('="', 0, offset), text.rfind("='", 0, offset)) + 1
        start = max(text.rfind(gap, 0, quote_at) for gap in " \t\r\n<") + 1
        end = text.find(text[quote_at], offset) + 1
        pieces: list[str] = []
        for one in self._lenient.escapes:
            if start <= one.offset < end and one.original in "<&":
                pieces += (text[start : one.offset], one.written)
                start = one.offset + 1
        return "".join((*pieces, text[start:end])), end


def parse_text(text: str, file: str = "") -> Document:
    """Parse *text*; *file* is what messages call it. Raises XmlSyntaxError."""
    # A byte order mark, and the declaration's encoding, are of no use once the text is a text.
    text = text.removeprefix("\ufeff")
    if not text or text.isspace():
        raise XmlSyntaxError([Diagnostic(EMPTY_DOCUMENT, "the document is empty", file, hint=EXAMPLE)])
    if "!" in text and "<!DOCTYPE" in text:
        _refuse_document_type(text, file)
    zero = text.find("\0")
    if zero >= 0:
        raise _syntax_error(NOT_XML, "a NUL character; this is not an XML document", text, zero, file)
    is_kept = has_one_line_tags(text) or not may_keep_line_breaks(text)
    lenient = EscapedText(text, ()) if is_kept else escape_attribute_values(text)
    plain = parse_with_expat(_encoded(lenient.text))
    if plain is not None:
        return Document(plain, lenient, text, file, knows_lines=not lenient.escapes)
    try:
        root = parse_with_libxml2(_encoded(lenient.text))
    except etree.XMLSyntaxError as error:
        if not lenient.escapes:
            lenient = escape_attribute_values(text)
        if not lenient.escapes:
            raise XmlSyntaxError([diagnose_xml_error(error, lenient, text, file)]) from None
        try:
            root = parse_with_libxml2(_encoded(lenient.text))
        except etree.XMLSyntaxError as second:
            raise XmlSyntaxError([diagnose_xml_error(second, lenient, text, file)]) from None
    return Document(root, lenient, text, file)


def parse_file(path: str | os.PathLike[str]) -> Document:
    """Read and parse the file *path*. Raises XmlSyntaxError, also when it can't be read."""
    name = os.fspath(path)
    try:
        data = Path(path).read_bytes()
    except OSError as error:
        raise XmlSyntaxError([_unreadable(Path(path), error)]) from None
    return parse_text(_decoded(data, name), name)


def _encoded(text: str) -> bytes:
    # A lone surrogate has no UTF-8 form; it becomes '?', in a document that was no text anyway.
    return text.encode("utf-8", "replace")


def _unreadable(path: Path, error: OSError) -> Diagnostic:
    hint = ""
    if str(path).lstrip().startswith("<"):
        message = "the path of a file is wanted, and this is XML"
        return Diagnostic(UNREADABLE_FILE, message, hint="btcore.loads(text) reads a text")
    if path.is_dir():
        message = "is a folder, not a file"
        inside = sorted(found.name for found in path.glob("*.xml"))[:5]
        if inside:
            hint = "did you mean one of the files in it: " + ", ".join(inside) + "?"
    elif isinstance(error, FileNotFoundError):
        message = "no such file"
        near = nearest_name(path.name, [found.name for found in path.parent.glob("*.xml")])
        if near is not None:
            hint = f"did you mean {path.with_name(near)}?"
    else:
        message = f"can't be read: {(error.strerror or str(error)).lower()}"
    return Diagnostic(UNREADABLE_FILE, message, os.fspath(path), hint=hint)


def _decoded(data: bytes, file: str) -> str:
    for mark, encoding in _BYTE_ORDER_MARKS:
        if data.startswith(mark):
            message = f"the file is {encoding}; trees are read as UTF-8"
            raise XmlSyntaxError([Diagnostic(NOT_UTF8, message, file, hint="save it as UTF-8")])
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        # The rest is shown as far as it can be.
        text = before + data[error.start :].decode("utf-8", "replace")
        message = f"the byte 0x{data[error.start]:02X} is not UTF-8"
        raise _syntax_error(NOT_UTF8, message, text, len(before), file, "save the file as UTF-8") from None


def _refuse_document_type(text: str, file: str) -> None:
    """Refuse a document type that could define or fetch something; a bare name does no harm."""
    for at, tag in iter_markup(text):
        if tag is None and text.startswith("<!DOCTYPE", at):
            inside = text[at + len("<!DOCTYPE") : text.find(">", at)].split()
            if len(inside) > 1 or "[" in "".join(inside):
                message = "a document type that defines or fetches something is refused"
                hint = "trees need no <!DOCTYPE …>: remove it, and write its entities out"
                raise _syntax_error(DOCUMENT_TYPE, message, text, at, file, hint, len("<!DOCTYPE"))


def _syntax_error(
    code: DiagnosticCode, message: str, text: str, offset: int, file: str, hint: str = "", width: int = 1
) -> XmlSyntaxError:
    place = span_at(text, offset, width)
    return XmlSyntaxError(
        [Diagnostic(code, message, file, place.line, place.column, hint, place.source, place.width)]
    )
