"""Read the documents that belong to a tree: the first stage of loading.

`<include path="…" ros_pkg="…"/>` names the documents that are read with a document.
"""

import posixpath
from collections.abc import Callable, Iterable
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
    collector = DiagnosticCollector()
    shared_documents = tuple(shared_documents)
    documents: list[Document] = []
    main = real_path(document.file) if document.file else None
    seen: set[Path] = set() if main is None else {main}
    for shared in shared_documents:
        # The same file may be shared and the document itself, or an include of an earlier document.
        if shared is not document and not (shared.file and real_path(shared.file) in seen):
            _add_with_includes(shared, collector, packages, documents, seen, [])
    _add_with_includes(document, collector, packages, documents, seen, [])
    for read_document in documents:
        for warning in read_document.warnings:
            collector.add(warning)
    return Sources(tuple(documents), shared_documents, collector.diagnostics)


def _add_with_includes(
    document: Document,
    collector: DiagnosticCollector,
    packages: PackageResolver | None,
    documents: list[Document],
    seen: set[Path],
    chain: list[Path],
) -> None:
    # The chain of includes, from the outermost file to this file.
    files = [*chain, real_path(document.file)] if document.file else chain
    seen.update(files)
    for element in document.root.iterchildren("include"):
        path = _include_path(document, element, collector, packages)
        if path is None:
            continue
        resolved = real_path(path)
        if document.confined_to is not None and not resolved.is_relative_to(document.confined_to):
            message = "the included file is outside of the folder of the main file"
            hint = "for trees that you trust, omit --confined (in Python: confined=False)"
            collector.report(document, INCLUDE_FAILED, message, element, "path", hint=hint)
        elif len(chain) > MAX_INCLUDE_DEPTH:
            message = f"includes are nested more than {MAX_INCLUDE_DEPTH} deep"
            collector.report(document, INCLUDE_FAILED, message, element, "path")
        elif len(seen) >= MAX_INCLUDED_FILES:
            message = f"the document includes more than {MAX_INCLUDED_FILES:,} files"
            collector.report(document, INCLUDE_FAILED, message, element, "path")
            break
        elif resolved in files:
            cycle = files[files.index(resolved) :]
            names = " → ".join(file.name for file in [*cycle, resolved])
            collector.report(
                document, INCLUDE_FAILED, f"the files include each other: {names}", element, "path"
            )
        elif resolved not in seen:
            try:
                included = parse_file(path, included_by=document)
            except XmlSyntaxError as error:
                _add_errors(error, document, element, collector)
                seen.add(resolved)  # its errors are reported once
            else:
                _add_with_includes(included, collector, packages, documents, seen, files)
    documents.append(document)


def _add_errors(
    error: XmlSyntaxError, document: Document, element: Element, collector: DiagnosticCollector
) -> None:
    for cause in error.diagnostics:
        if cause.code != UNREADABLE_FILE:
            collector.add(cause)
            continue
        message = f"the included file '{cause.file}': {cause.message}"
        written = posixpath.dirname((element.get("path") or "").rstrip("/"))
        fixes = [
            SetValue(*(posixpath.join(written, name) for name in fix.values))
            for fix in cause.fixes
            if isinstance(fix, SetValue)
        ]
        hint = Hint(cause.hint, tuple(fixes))
        collector.report(document, INCLUDE_FAILED, message, element, "path", hint=hint)


def _include_path(
    document: Document, element: Element, collector: DiagnosticCollector, packages: PackageResolver | None
) -> Path | None:
    written = element.get("path")
    if not written:
        hint = 'write <include path="other.xml"/>'
        collector.report(document, INCLUDE_FAILED, "missing path in <include>", element, hint=hint)
        return None
    path = Path(written)
    package = element.get("ros_pkg")
    if package is None:
        return path if path.is_absolute() else document.folder / path
    if path.is_absolute():
        message = f"ros_pkg '{package}' is ignored because the path is absolute"
        collector.report(document, IGNORED_PACKAGE, message, element, "ros_pkg")
        return path
    folder = packages(package) if packages is not None else None
    if folder is None:
        message = f"unknown ROS package '{package}'"
        hint = (
            "pass a package resolver, a function that returns the share directory of a package"
            if packages is None
            else "the package resolver does not know it"
        )
        collector.report(document, INCLUDE_FAILED, message, element, "ros_pkg", hint=hint)
        return None
    return Path(folder) / path
