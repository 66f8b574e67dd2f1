"""Documents that name others by ``<include path="…" ros_pkg="…"/>``."""

from collections.abc import Callable
from pathlib import Path

from btcore.diagnostic_codes import IGNORED_PACKAGE, INCLUDE_FAILED, UNREADABLE_FILE
from btcore.errors import XmlSyntaxError
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document, parse_file
from btcore.xml.read.element import Element

PackageResolver = Callable[[str], "str | Path | None"]
"""From the name of a ROS package to the directory that its files are shared in; None if unknown."""


def resolve_includes(
    document: Document, diagnostics: DiagnosticCollector, packages: PackageResolver | None = None
) -> list[Document]:
    """The documents that *document* includes, however indirectly, and *document* itself, last.

    Included documents come before the one that names them, so that of two trees of one ID the
    including document's is the later one. A file that is named twice is read once.
    """
    found: list[Document] = []
    seen: set[Path] = set()
    _gather(document, diagnostics, packages, found, seen, [])
    return found


def _gather(
    document: Document,
    diagnostics: DiagnosticCollector,
    packages: PackageResolver | None,
    found: list[Document],
    seen: set[Path],
    chain: list[Path],
) -> None:
    own = [Path(document.file).resolve()] if document.file else []
    seen.update(own)
    for element in document.root.iterchildren("include"):
        path = _path_of(document, element, diagnostics, packages)
        if path is None:
            continue
        resolved = path.resolve()
        if resolved in [*chain, *own]:
            circle = [*chain, *own][[*chain, *own].index(resolved) :]
            names = " → ".join(one.name for one in [*circle, resolved])
            diagnostics.add(
                document.diagnostic(INCLUDE_FAILED, f"the files include each other: {names}", element, "path")
            )
        elif resolved not in seen:
            try:
                included = parse_file(path)
            except XmlSyntaxError as error:
                _tell(error, document, element, diagnostics)
                seen.add(resolved)
            else:
                _gather(included, diagnostics, packages, found, seen, [*chain, *own])
    found.append(document)


def _tell(
    error: XmlSyntaxError, document: Document, element: Element, diagnostics: DiagnosticCollector
) -> None:
    for one in error.diagnostics:
        if one.code != UNREADABLE_FILE:
            diagnostics.add(one)
            continue
        message = f"the included file '{one.file}': {one.message}"
        diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "path", hint=one.hint))


def _path_of(
    document: Document, element: Element, diagnostics: DiagnosticCollector, packages: PackageResolver | None
) -> Path | None:
    written = element.get("path")
    if not written:
        hint = 'write <include path="other.xml"/>'
        diagnostics.add(document.diagnostic(INCLUDE_FAILED, "<include> names no file", element, hint=hint))
        return None
    path = Path(written)
    package = element.get("ros_pkg")
    if package is None:
        return path if path.is_absolute() else document.folder / path
    if path.is_absolute():
        message = f"ros_pkg '{package}' is ignored, as the path is absolute"
        diagnostics.add(document.diagnostic(IGNORED_PACKAGE, message, element, "ros_pkg"))
        return path
    folder = packages(package) if packages is not None else None
    if folder is None:
        message = f"the ROS package '{package}' is not known"
        hint = (
            "no resolver of packages was given: pass one, from a package's name to its share directory"
            if packages is None
            else "the resolver of packages does not know it"
        )
        diagnostics.add(document.diagnostic(INCLUDE_FAILED, message, element, "ros_pkg", hint=hint))
        return None
    return Path(folder) / path
