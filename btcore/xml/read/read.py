"""Read the documents that belong to a tree: the first stage of loading.

`<include path="…" ros_pkg="…"/>` names the documents that are read with a document.
"""

import posixpath
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Final, NamedTuple

from btcore.diagnostic_codes import IGNORED_PACKAGE, INCLUDE_FAILED, UNREADABLE_FILE
from btcore.diagnostics import Hint
from btcore.errors import XmlSyntaxError
from btcore.fixes import SetValue
from btcore.input_files import real_path
from btcore.xml.read.document import DiagnosticCollector, Diagnostics, Document, parse_file
from btcore.xml.read.element import Element

PackageResolver = Callable[[str], "str | Path | None"]
"""A function that returns the share directory of the ROS package with a given name, or None."""

MAX_INCLUDED_FILES: Final = 1_000
"""Maximum number of files that a document includes, directly or indirectly."""
MAX_INCLUDE_DEPTH: Final = 100
"""Maximum number of files between the main file and an included file."""


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
    diagnostics: Diagnostics

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
                except XmlSyntaxError as error:
                    self._add_errors(error, document, element)
                    self.seen.add(resolved)  # its errors are reported once
                else:
                    self.add(included, files)
            if message:
                self.collector.report(
                    document, INCLUDE_FAILED, message, element, attribute="path", hint=Hint(hint)
                )
        self.documents.append(document)

    def _add_errors(self, error: XmlSyntaxError, document: Document, element: Element) -> None:
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
            hint = Hint(cause.hint, tuple(fixes))
            self.collector.report(document, INCLUDE_FAILED, message, element, attribute="path", hint=hint)

    def _find(self, document: Document, element: Element) -> Path | None:
        """Return the path of the file that *element* includes, or None after an error."""
        written = element.get("path")
        if not written:
            hint = 'write <include path="other.xml"/>'
            self.collector.report(
                document, INCLUDE_FAILED, "missing path in <include>", element, hint=Hint(hint)
            )
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
            self.collector.report(
                document, INCLUDE_FAILED, message, element, attribute="ros_pkg", hint=Hint(hint)
            )
            return None
        return Path(folder) / path
