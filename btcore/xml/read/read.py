"""Read the documents of a tree: the first stage of loading.

`<include path="…" ros_pkg="…"/>` names the documents that are read with a document.
"""

from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, NamedTuple

from btcore.diagnostic_codes import IGNORED_PACKAGE, INCLUDE_FAILED, UNREADABLE_FILE
from btcore.errors import XmlSyntaxError
from btcore.input_files import real_path
from btcore.xml.read.diagnostics import DiagnosticCollector, Diagnostics
from btcore.xml.read.document import Document, parse_file
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
        documents: The libraries and the included documents, each before the document that includes it; the
            main document is the last. So a tree of the including document comes after included trees with
            the same ID.
        libraries: Those of the documents whose trees a later tree with the same ID replaces.
        diagnostics: What was found while they were read.
    """

    documents: tuple[Document, ...]
    libraries: tuple[Document, ...]
    diagnostics: Diagnostics

    @property
    def main(self) -> Document:
        """The document that includes the others."""
        return self.documents[-1]


def read(
    document: Document, libraries: Iterable[Document] = (), packages: PackageResolver | None = None
) -> Sources:
    """Read the documents that *document* and *libraries* include, directly or indirectly.

    A file that is included several times is read once.

    Args:
        libraries: Further documents, whose trees *document* may call without an include, such as those of a
            registry.
        packages: Finds the share directory of a ROS package.
    """
    found = DiagnosticCollector()
    libraries = tuple(libraries)
    documents: list[Document] = []
    main = real_path(document.file) if document.file else None
    seen: set[Path] = set() if main is None else {main}
    for library in libraries:
        # The same file may be a library and the document itself, or an include of an earlier library.
        if library is not document and not (library.file and real_path(library.file) in seen):
            _gather(library, found, packages, documents, seen, [])
    _gather(document, found, packages, documents, seen, [])
    for each in documents:
        for warning in each.warnings:
            found.add(warning)
    return Sources(tuple(documents), libraries, found.collected())


def _gather(
    document: Document,
    diagnostics: DiagnosticCollector,
    packages: PackageResolver | None,
    documents: list[Document],
    seen: set[Path],
    chain: list[Path],
) -> None:
    # The chain of includes, from the outermost file to this file.
    files = [*chain, real_path(document.file)] if document.file else chain
    seen.update(files)
    for element in document.root.iterchildren("include"):
        path = _path_of(document, element, diagnostics, packages)
        if path is None:
            continue
        resolved = real_path(path)
        if document.confined_to is not None and not resolved.is_relative_to(document.confined_to):
            message = "the included file is outside of the folder of the main file"
            hint = "for trees that you trust, omit --confined (in Python: confined=False)"
            diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "path", hint=hint))
        elif len(chain) > MAX_INCLUDE_DEPTH:
            message = f"includes are nested more than {MAX_INCLUDE_DEPTH} deep"
            diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "path"))
        elif len(seen) >= MAX_INCLUDED_FILES:
            message = f"the document includes more than {MAX_INCLUDED_FILES:,} files"
            diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "path"))
            break
        elif resolved in files:
            cycle = files[files.index(resolved) :]
            names = " → ".join(file.name for file in [*cycle, resolved])
            diagnostics.add(
                document.diagnostic(INCLUDE_FAILED, f"the files include each other: {names}", element, "path")
            )
        elif resolved not in seen:
            try:
                included = parse_file(path, included=True, unsaved=document.unsaved)
            except XmlSyntaxError as error:
                _add_errors(error, document, element, diagnostics)
                seen.add(resolved)  # its errors are reported once
            else:
                included.confined_to = document.confined_to
                _gather(included, diagnostics, packages, documents, seen, files)
    documents.append(document)


def _add_errors(
    error: XmlSyntaxError, document: Document, element: Element, diagnostics: DiagnosticCollector
) -> None:
    for cause in error.diagnostics:
        if cause.code != UNREADABLE_FILE:
            diagnostics.add(cause)
            continue
        message = f"the included file '{cause.file}': {cause.message}"
        diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "path", hint=cause.hint))


def _path_of(
    document: Document, element: Element, diagnostics: DiagnosticCollector, packages: PackageResolver | None
) -> Path | None:
    written = element.get("path")
    if not written:
        hint = 'write <include path="other.xml"/>'
        diagnostics.add(document.diagnostic(INCLUDE_FAILED, "missing path in <include>", element, hint=hint))
        return None
    path = Path(written)
    package = element.get("ros_pkg")
    if package is None:
        return path if path.is_absolute() else document.folder / path
    if path.is_absolute():
        message = f"ros_pkg '{package}' is ignored because the path is absolute"
        diagnostics.add(document.diagnostic(IGNORED_PACKAGE, message, element, "ros_pkg"))
        return path
    folder = packages(package) if packages is not None else None
    if folder is None:
        message = f"unknown ROS package '{package}'"
        hint = (
            "pass a package resolver, a function that returns the share directory of a package"
            if packages is None
            else "the package resolver does not know it"
        )
        diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "ros_pkg", hint=hint))
        return None
    return Path(folder) / path
