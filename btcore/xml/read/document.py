"""Parse texts and files into documents, and collect the diagnostics about documents.

Invalid XML is reported with file, line and column. A `<!DOCTYPE …>` with content is an error.
"""

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence, Sized
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple

from btcore.diagnostic_codes import (
    DOCUMENT_TOO_LARGE,
    DOCUMENT_TYPE,
    EMPTY_DOCUMENT,
    NOT_UTF8,
    NOT_XML,
    UNREADABLE_FILE,
    DiagnosticCode,
    Kind,
)
from btcore.diagnostics import NO_HINT, Diagnostic, Hint
from btcore.errors import PortError, TreeError, UnknownNodeError, XmlSyntaxError
from btcore.fixes import SetValue
from btcore.input_files import read_error, read_file, real_path
from btcore.suggestions import similar_file, suggestion
from btcore.xml.read.element import EXAMPLE, Element, ElementPart, encoded, parse_with_expat

if TYPE_CHECKING:
    # Imported where they are used: a correct document with one-line tags needs none of them.
    from btcore.xml.read.positions import SourceMap
    from btcore.xml.read.tinyxml2_parser import Finding

MAX_COMPARISONS: Final = 50_000
"""Maximum number of comparisons of misspelt names with known names; each takes about 30 µs."""
MAX_PER_CODE: Final = 50_000
"""Maximum number of diagnostics that are collected with the same code."""

_EXCEPTIONS: Final[dict[Kind, type[TreeError]]] = {
    "document error": XmlSyntaxError,
    "unknown node": UnknownNodeError,
    "port error": PortError,
}


class Document:
    """One XML document.

    Attributes:
        root: The outermost element.
        text: The text as the user wrote it.
        file: Name of the file in messages, or "".
        knows_lines: Whether every element has its line number.
        max_depth: Maximum depth of elements below a `<BehaviorTree>`.
        confined_to: The folder that must contain all included files; None means that any file is allowed.
        unsaved: Texts that replace the content of included files, by their `real_path`.
    """

    max_depth: int = 256  # as in BehaviorTree.CPP
    unsaved: Mapping[Path, str] = MappingProxyType({})

    def __init__(
        self,
        root: Element,
        text: str,
        file: str,
        findings: "Sequence[Finding]" = (),
        knows_lines: bool = False,
        confined: bool = False,
    ) -> None:
        self.root = root
        self.text = text
        self.file = file
        self._findings = findings
        self._source_map: SourceMap | None = None
        self.knows_lines = knows_lines
        self.confined_to = real_path(self.folder) if confined else None

    @property
    def folder(self) -> Path:
        """The folder that paths of includes are relative to.

        It is the folder of the file, or the current folder if the document is not from a file.
        """
        return Path(self.file).parent if self.file else Path()

    @property
    def source_map(self) -> "SourceMap":
        """The positions of the elements, computed on first use."""
        if self._source_map is None:
            from btcore.xml.read.positions import SourceMap

            self._source_map = SourceMap(self.text, self.root)
        return self._source_map

    def line(self, element: Element) -> int:
        """Return the line (from 1) in which *element* begins."""
        return element.line if self.knows_lines else self.source_map.line(element)

    def text_in(self, element: Element) -> str:
        """Return the text in *element* up to its first child."""
        return self.source_map.text_in(element)

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        *,
        attribute: str = "",
        hint: Hint = NO_HINT,
        part: ElementPart = "value",
        within: int = 0,
    ) -> Diagnostic:
        """Return a diagnostic about an element or one of its attributes.

        Args:
            attribute: Name of the attribute; "" means the element itself.
            hint: How to fix the problem.
            part: Whether the diagnostic points to the attribute's name or to its value.
            within: Number of a character in the value, from 1; 0 means the whole value.
        """
        place = self.source_map.span(element, attribute, part, within)
        return place.diagnostic(code, message, self.file, hint)

    @property
    def warnings(self) -> list[Diagnostic]:
        """A warning for everything that BehaviorTree.CPP accepts, but other XML tools reject."""
        if not self._findings:
            return []
        from btcore.xml.read.positions import LineIndex

        lines = LineIndex(self.text)
        return [
            lines.span(offset, width).diagnostic(code, message, self.file, hint)
            for offset, width, code, message, hint in self._findings
        ]


class Diagnostics(NamedTuple):
    """What a stage of loading and the stages before it have found.

    Attributes:
        errors: The diagnostics that prevent loading the tree.
        warnings: The other diagnostics.
        comparisons_left: How many comparisons with known names are left, to suggest similar names in hints.
    """

    errors: tuple[Diagnostic, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()
    comparisons_left: int = MAX_COMPARISONS

    def raise_errors(self) -> None:
        """Raise a single exception with all errors, if there are any.

        Raises:
            TreeError: There are errors. If all of them are of the same kind, it is the subclass
                XmlSyntaxError, UnknownNodeError or PortError.
        """
        if self.errors:
            kinds = {error.code.kind for error in self.errors}
            exception = _EXCEPTIONS.get(kinds.pop(), TreeError) if len(kinds) == 1 else TreeError
            raise exception(sort_diagnostics(self.errors))


class DiagnosticCollector:
    """Collects the diagnostics of a stage, after those of the earlier stages, *before*.

    Attributes:
        errors: The errors so far.
        warnings: The warnings so far.
    """

    def __init__(self, before: Diagnostics | None = None) -> None:
        self.errors: list[Diagnostic] = []
        self.warnings: list[Diagnostic] = []
        self._comparisons_left = MAX_COMPARISONS
        self._added: set[object] = set()
        self._counts: Counter[str] = Counter()
        if before is not None:
            self._comparisons_left = before.comparisons_left
            for diagnostic in (*before.errors, *before.warnings):
                self.add(diagnostic)

    def report(
        self,
        document: Document,
        code: DiagnosticCode,
        message: str,
        element: Element,
        *,
        attribute: str = "",
        hint: Hint = NO_HINT,
        part: ElementPart = "value",
        within: int = 0,
        width: int = 1,
    ) -> None:
        """Add a diagnostic about an element of *document*; see `Document.diagnostic`.

        Args:
            width: The number of characters to mark from *within* on.
        """
        diagnostic = document.diagnostic(
            code, message, element, attribute=attribute, hint=hint, part=part, within=within
        )
        self.add(diagnostic._replace(width=width) if width > diagnostic.width else diagnostic)

    def add(self, diagnostic: Diagnostic) -> None:
        """Add *diagnostic*, unless it was added before, or MAX_PER_CODE diagnostics with its code were.

        Of several warnings with the same code and place, the first is kept: a tree that is called twice is
        checked twice.
        """
        code, _, file, line, column, *_ = diagnostic
        key = diagnostic if diagnostic.is_error else (code, file, line, column)
        if not self.is_full(code) and key not in self._added:
            self._counts[code] += 1
            self._added.add(key)
            (self.errors if diagnostic.is_error else self.warnings).append(diagnostic)

    def is_full(self, code: DiagnosticCode) -> bool:
        """Return whether no further diagnostics with *code* are collected."""
        return self._counts[code] >= MAX_PER_CODE

    def take_comparisons(self, names: Sized) -> bool:
        """Reserve the comparisons to search *names* for a similar name; return whether enough are left.

        After MAX_COMPARISONS comparisons the result is False: of thousands of mistakes, only the first get
        hints.
        """
        if len(names) > self._comparisons_left:
            return False
        self._comparisons_left -= len(names)
        return True

    @property
    def diagnostics(self) -> Diagnostics:
        """All diagnostics so far."""
        return Diagnostics(tuple(self.errors), tuple(self.warnings), self._comparisons_left)


def sort_diagnostics(diagnostics: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Return *diagnostics* grouped by file, and sorted by line and column within each file."""
    files: dict[str, int] = {}
    for item in diagnostics:
        files.setdefault(item.file, len(files))
    return sorted(diagnostics, key=lambda item: (files[item.file], item.line, item.column))


# --- parsing

MAX_ELEMENTS: Final = 500_000
"""Maximum number of elements of a document."""
MAX_ATTRIBUTES: Final = 5_000_000
"""Maximum number of attributes of a document."""

_ROOT_TAG: Final = re.compile(rb"<root\b", re.IGNORECASE)
_BYTE_ORDER_MARKS: Final = (
    (b"\xff\xfe\x00\x00", "UTF-32"),
    (b"\x00\x00\xfe\xff", "UTF-32"),
    (b"\xff\xfe", "UTF-16"),
    (b"\xfe\xff", "UTF-16"),
)


def parse_text(text: str, file: str = "", *, confined: bool = False) -> Document:
    """Parse a text.

    Args:
        file: Name of the file in messages, or "".
        confined: Whether includes from outside of the file's folder, or of the working directory, are errors.
    """
    # The text is decoded already, so a byte order mark and the declared encoding are ignored.
    text = text.removeprefix("\ufeff")
    if not text or text.isspace():
        raise XmlSyntaxError([Diagnostic(EMPTY_DOCUMENT, "the document is empty", file, hint=EXAMPLE)])
    # Every element needs a "<" besides the "</" of its end tag, and every attribute a "=".
    if text.count("<") - text.count("</") > MAX_ELEMENTS or text.count("=") > MAX_ATTRIBUTES:
        message = f"the document has more than {MAX_ELEMENTS:,} elements or {MAX_ATTRIBUTES:,} attributes"
        raise XmlSyntaxError([Diagnostic(DOCUMENT_TOO_LARGE, message, file)])
    if "!" in text and "<!DOCTYPE" in text:
        _refuse_document_type(text, file)
    zero = text.find("\0")
    if zero >= 0:
        raise _syntax_error(NOT_XML, "invalid XML: the text contains a NUL character", text, zero, file)
    # Escaping is slow, so it is skipped if certainly no value contains a line break or a tab.
    escaped = text
    if not _has_one_line_tags(text):
        from btcore.xml.read.tinyxml2_compat import escape_line_breaks, may_keep_line_breaks

        if may_keep_line_breaks(text):
            escaped = escape_line_breaks(text)
    plain = parse_with_expat(encoded(escaped))
    if plain is not None:
        return Document(plain, text, file, knows_lines=escaped is text, confined=confined)
    from btcore.xml.read.tinyxml2_parser import parse_as_tinyxml2

    root, findings = parse_as_tinyxml2(text, file)
    return Document(root, text, file, findings, confined=confined)


def _has_one_line_tags(text: str) -> bool:
    """Return True only if no tag contains a line break or a tab. May return False for such a text, too."""
    if any(odd in text for odd in "\t\r'") or ("!" in text and "<!" in text):
        return False
    # Searching for one character is much faster than for two, so the rare "?" narrows the search.
    if text.rfind("<?", 0, text.rfind("?") + 1) > 0:
        return False
    # With these counts, every line break follows a ">", and every ">" ends a tag.
    return text.count("\n") == text.count(">\n") and text.count("<") == text.count(">")


def parse_file(
    path: str | os.PathLike[str],
    *,
    confined: bool = False,
    included_by: Document | None = None,
    unsaved: Mapping[Path, str] | None = None,
) -> Document:
    """Read and parse the file *path*.

    Args:
        confined: As in `parse_text`.
        included_by: The document that includes the file; the same restriction and unsaved texts apply. The
            error for a file that does not contain a `<root>` does not quote the file.
        unsaved: Texts that replace the content of the file and of included files, by their `real_path`.
    """
    name = os.fspath(path)
    unsaved = unsaved if included_by is None else included_by.unsaved
    text = unsaved.get(real_path(path)) if unsaved else None
    try:
        data = read_file(path) if text is None else encoded(text)
    except OSError as error:
        raise XmlSyntaxError([_unreadable(Path(path), error)]) from None
    if included_by is not None and _ROOT_TAG.search(data) is None:
        # Messages quote the text. A file that a stranger includes may contain anything, such as passwords.
        raise XmlSyntaxError([Diagnostic(UNREADABLE_FILE, "not an XML document of trees", name)])
    document = parse_bytes(data, name, confined=confined)
    if unsaved:
        document.unsaved = unsaved
    if included_by is not None:
        document.confined_to = included_by.confined_to
    return document


def parse_bytes(data: bytes, file: str, *, confined: bool = False) -> Document:
    """Parse the content of a file.

    Args:
        file: Name of the file in messages.
        confined: As in `parse_text`.
    """
    return parse_text(_decoded(data, file), file, confined=confined)


def _unreadable(path: Path, error: OSError) -> Diagnostic:
    hint = ""
    files: list[str] = []
    if str(path).lstrip().startswith("<"):
        message = "expected the path of a file, but got XML text"
        return Diagnostic(UNREADABLE_FILE, message, hint="to load a text, use btcore.loads(text)")
    if path.is_dir():
        message = "is a folder, not a file"
        names = sorted(file.name for file in path.glob("*.xml"))[:5]
        if names:
            hint = suggestion("a file in it: " + ", ".join(names))
            files = [f"{path.name}/{name}" for name in names]
    elif isinstance(error, FileNotFoundError):
        message = "no such file"
        near = similar_file(path, ".xml")
        if near is not None:
            hint = suggestion(near)
            files = [Path(near).name]
    else:
        message = f"can't be read: {read_error(error)}"
    # An include of the file names one of these files instead.
    fixes = tuple(SetValue(name) for name in files)
    return Diagnostic(UNREADABLE_FILE, message, os.fspath(path), hint=hint, fixes=fixes)


def _decoded(data: bytes, file: str) -> str:
    for mark, encoding in _BYTE_ORDER_MARKS:
        if data.startswith(mark):
            message = f"the file is encoded as {encoding}, not as UTF-8"
            raise XmlSyntaxError([Diagnostic(NOT_UTF8, message, file, hint="save it as UTF-8")])
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        before = data[: error.start].decode("utf-8")
        # Decode the rest with replacement characters, to show the line in the message.
        text = before + data[error.start :].decode("utf-8", "replace")
        message = f"the byte 0x{data[error.start]:02X} is not valid UTF-8"
        raise _syntax_error(NOT_UTF8, message, text, len(before), file, "save the file as UTF-8") from None


def _refuse_document_type(text: str, file: str) -> None:
    """Raise XmlSyntaxError for a document type that defines or fetches something; a bare name is allowed."""
    from btcore.xml.read.scan import scan

    for at, end in scan(text).opaque:
        if text.startswith("<!DOCTYPE", at):
            inside = text[at + len("<!DOCTYPE") : end].removesuffix(">").split()
            if len(inside) > 1 or "[" in "".join(inside):
                message = "a document type that defines or fetches something is not supported"
                hint = "trees need no <!DOCTYPE …>: remove it, and replace its entities by their text"
                raise _syntax_error(DOCUMENT_TYPE, message, text, at, file, hint, len("<!DOCTYPE"))


def _syntax_error(
    code: DiagnosticCode, message: str, text: str, offset: int, file: str, hint: str = "", width: int = 1
) -> XmlSyntaxError:
    from btcore.xml.read.positions import span_at

    return XmlSyntaxError([span_at(text, offset, width).diagnostic(code, message, file, Hint(hint))])
