"""Parse texts and files into documents, and read the documents that belong to a tree.

Invalid XML is reported with file, line and column. A `<!DOCTYPE …>` with content is an error.
The first stage of loading, `read`, adds the documents that `<include path="…" ros_pkg="…"/>` names.
"""

import os
import posixpath
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from btcore.diagnostic_codes import (
    DOCUMENT_TOO_LARGE,
    DOCUMENT_TYPE,
    EMPTY_DOCUMENT,
    IGNORED_PACKAGE,
    INCLUDE_FAILED,
    NOT_UTF8,
    NOT_XML,
    UNREADABLE_FILE,
    DiagnosticCode,
)
from btcore.diagnostics import Diagnostic
from btcore.errors import TreeError, XmlSyntaxError
from btcore.fixes import SetValue
from btcore.input_files import read_error, read_file, real_path
from btcore.suggestions import similar_file, suggestion
from btcore.xml.read.document import CollectedDiagnostics, DiagnosticCollector, Document
from btcore.xml.read.element import EXAMPLE, Element, encoded, parse_with_expat

PackageResolver = Callable[[str], "str | Path | None"]
"""A function that returns the share directory of the ROS package with a given name, or None."""

MAX_INCLUDED_FILES: Final = 1_000
"""Maximum number of files that a document includes, directly or indirectly."""
MAX_INCLUDE_DEPTH: Final = 100
"""Maximum number of files between the main file and an included file."""
MAX_ELEMENTS: Final = 500_000
"""Maximum number of elements of a document."""
MAX_ATTRIBUTES: Final = 5_000_000
"""Maximum number of attributes of a document."""

_ROOT_TAG: Final = re.compile(rb"<root\b", re.IGNORECASE)
# Expat replaces line breaks and tabs in values by spaces; tinyxml2 keeps them. The pattern may also match
# outside of a tag, which costs time only.
_BREAK_IN_VALUE: Final = re.compile(r"""=\s*+(?:"[^"\n\r\t]*+|'[^'\n\r\t]*+)[\n\r\t]""")
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
    plain = None if _BREAK_IN_VALUE.search(text) else parse_with_expat(encoded(text))
    if plain is not None:
        return Document(plain, text, file, confined=confined)
    from btcore.xml.read.tinyxml2_parser import parse_as_tinyxml2

    root, warnings = parse_as_tinyxml2(text, file)
    return Document(root, text, file, warnings, confined=confined)


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
        raise TreeError([_unreadable(Path(path), error)]) from None
    if included_by is not None and _ROOT_TAG.search(data) is None:
        # Messages quote the text. A file that a stranger includes may contain anything, such as passwords.
        raise TreeError([Diagnostic(UNREADABLE_FILE, "not an XML document of trees", name)])
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
    from btcore.xml.read.positions import LineIndex

    return XmlSyntaxError([LineIndex(text).span(offset, width).diagnostic(code, message, file, hint)])


# --- the documents of a tree


class Sources(NamedTuple):
    """The documents of a tree.

    Attributes:
        documents: The shared and the included documents, each before the document that includes it; the
            main document is the last. So a tree of the including document comes after included trees with
            the same ID.
        shared_documents: Those of the documents whose trees a later tree with the same ID replaces.
        diagnostics: What was found while they were read.
    """

    documents: tuple[Document, ...]
    shared_documents: tuple[Document, ...]
    diagnostics: CollectedDiagnostics

    @property
    def main_document(self) -> Document:
        """The document whose main tree is loaded."""
        return self.documents[-1]


def read(
    document: Document, shared_documents: Iterable[Document] = (), packages: PackageResolver | None = None
) -> Sources:
    """Read the documents that *document* and *shared_documents* include, directly or indirectly.

    A file that is included several times is read once.

    Args:
        shared_documents: Further documents, whose trees *document* may call without an include, such as those
            of a registry.
        packages: Finds the share directory of a ROS package.
    """
    shared_documents = tuple(shared_documents)
    reader = _Reader(packages)
    if document.file:
        reader.seen.add(real_path(document.file))
    for shared in shared_documents:
        # The same file may be shared and the document itself, or an include of an earlier document.
        if shared is not document and not (shared.file and real_path(shared.file) in reader.seen):
            reader.add(shared)
    reader.add(document)
    for read_document in reader.documents:
        for warning in read_document.warnings:
            reader.collector.add(warning)
    return Sources(tuple(reader.documents), shared_documents, reader.collector.diagnostics)


class _Reader:
    """Reads the files that documents include, each once.

    Attributes:
        documents: The documents, each after those that it includes.
        seen: The files of the documents, and the files that cannot be read.
    """

    def __init__(self, packages: PackageResolver | None) -> None:
        self._packages = packages
        self.collector = DiagnosticCollector()
        self.documents: list[Document] = []
        self.seen: set[Path] = set()

    def add(self, document: Document, including: Sequence[Path] = ()) -> None:
        """Add the documents that *document* includes, then *document*.

        Args:
            including: The files between the main file and *document*, from the main file on.
        """
        files = [*including, real_path(document.file)] if document.file else including
        self.seen.update(files)
        for element in document.root.iterchildren("include"):
            path = self._find(document, element)
            if path is None:
                continue
            resolved = real_path(path)
            message, hint = "", ""
            if document.confined_to is not None and not resolved.is_relative_to(document.confined_to):
                message = "the included file is outside of the folder of the main file"
                hint = "for trees that you trust, omit --confined (in Python: confined=False)"
            elif len(including) > MAX_INCLUDE_DEPTH:
                message = f"includes are nested more than {MAX_INCLUDE_DEPTH} deep"
            elif len(self.seen) >= MAX_INCLUDED_FILES:
                message = f"the document includes more than {MAX_INCLUDED_FILES:,} files"
                self.collector.report(document, INCLUDE_FAILED, message, element, attribute="path")
                break
            elif resolved in files:
                cycle = files[files.index(resolved) :]
                names = " → ".join(file.name for file in [*cycle, resolved])
                message = f"the files include each other: {names}"
            elif resolved not in self.seen:
                try:
                    included = parse_file(path, included_by=document)
                except TreeError as error:
                    self._add_errors(error, document, element)
                    self.seen.add(resolved)  # its errors are reported once
                else:
                    self.add(included, files)
            if message:
                self.collector.report(document, INCLUDE_FAILED, message, element, attribute="path", hint=hint)
        self.documents.append(document)

    def _add_errors(self, error: TreeError, document: Document, element: Element) -> None:
        """Add the errors of the file that *element* includes."""
        for cause in error.diagnostics:
            if cause.code != UNREADABLE_FILE:
                self.collector.add(cause)
                continue
            message = f"the included file '{cause.file}': {cause.message}"
            written = posixpath.dirname((element.get("path") or "").rstrip("/"))
            fixes = [
                SetValue(*(posixpath.join(written, name) for name in fix.values))
                for fix in cause.fixes
                if isinstance(fix, SetValue)
            ]
            self.collector.report(
                document, INCLUDE_FAILED, message, element, attribute="path", hint=cause.hint, fixes=fixes
            )

    def _find(self, document: Document, element: Element) -> Path | None:
        """Return the path of the file that *element* includes, or None after an error."""
        written = element.get("path")
        if not written:
            hint = 'write <include path="other.xml"/>'
            self.collector.report(document, INCLUDE_FAILED, "missing path in <include>", element, hint=hint)
            return None
        path = Path(written)
        package = element.get("ros_pkg")
        if package is None:
            return path if path.is_absolute() else document.folder / path
        if path.is_absolute():
            message = f"ros_pkg '{package}' is ignored because the path is absolute"
            self.collector.report(document, IGNORED_PACKAGE, message, element, attribute="ros_pkg")
            return path
        folder = self._packages(package) if self._packages is not None else None
        if folder is None:
            message = f"unknown ROS package '{package}'"
            hint = (
                "pass a package resolver, a function that returns the share directory of a package"
                if self._packages is None
                else "the package resolver does not know it"
            )
            self.collector.report(document, INCLUDE_FAILED, message, element, attribute="ros_pkg", hint=hint)
            return None
        return Path(folder) / path
