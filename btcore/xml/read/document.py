"""A document, and the diagnostics that the stages of loading collect about documents."""

from collections import Counter
from collections.abc import Mapping, Sequence, Sized
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Final, NamedTuple, TypedDict, Unpack

from btcore.diagnostic_codes import DiagnosticCode, DiagnosticKind
from btcore.diagnostics import Diagnostic
from btcore.errors import PortError, TreeError, UnknownNodeError, XmlSyntaxError
from btcore.fixes import Fix
from btcore.input_files import real_path
from btcore.xml.read.element import Element, ElementPart

if TYPE_CHECKING:
    # Imported where it is used: most correct documents do not need it.
    from btcore.xml.read.positions import SourceMap

MAX_COMPARISONS: Final = 50_000
"""Maximum number of comparisons of misspelt names with known names in a stage; each takes about 30 µs."""
MAX_PER_CODE: Final = 50_000
"""Maximum number of diagnostics that are collected with the same code."""

_EXCEPTIONS: Final[dict[DiagnosticKind, type[TreeError]]] = {
    "document error": XmlSyntaxError,
    "unknown node": UnknownNodeError,
    "port error": PortError,
}


class Mark(TypedDict, total=False):
    """What a diagnostic marks: the element itself, or with *attribute* one of its attributes.

    Attributes:
        attribute: Name of the attribute; "" means the element itself.
        part: Whether to mark the attribute's name or its value (default).
        column: Number of a character in the value, from 1; 0 means the whole value.
        width: The number of characters to mark from *column* on; default 1.
    """

    attribute: str
    part: ElementPart
    column: int
    width: int


class Document:
    """One XML document.

    Attributes:
        root: The outermost element.
        text: The text as the user wrote it.
        file: Name of the file in messages, or "".
        warnings: A warning for everything that BehaviorTree.CPP accepts, but other XML tools reject.
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
        warnings: Sequence[Diagnostic] = (),
        confined: bool = False,
        source_map: "SourceMap | None" = None,
    ) -> None:
        self.root = root
        self.text = text
        self.file = file
        self.warnings = list(warnings)
        self._source_map = source_map
        self.confined_to = real_path(self.folder) if confined else None

    @property
    def folder(self) -> Path:
        """The folder that paths of includes are relative to.

        It is the folder of the file, or the current folder if the document is not from a file.
        """
        return Path(self.file).parent if self.file else Path()

    @property
    def source_map(self) -> "SourceMap":
        """The positions of the elements, computed on first use, unless the document was created with them."""
        if self._source_map is None:
            from btcore.xml.read.positions import SourceMap

            self._source_map = SourceMap(self.text, self.root)
        return self._source_map

    def line(self, element: Element) -> int:
        """Return the line (from 1) in which *element* begins."""
        return element.line or self.source_map.line(element)

    def diagnostic(
        self,
        code: DiagnosticCode,
        message: str,
        element: Element,
        hint: str = "",
        fixes: Sequence[Fix] = (),
        **mark: Unpack[Mark],
    ) -> Diagnostic:
        """Return a diagnostic about an element or one of its attributes; see `Diagnostic` and `Mark`."""
        span = self.source_map.span(element, **mark)
        start = mark.get("column", 0) - 1
        characters = (start, start + mark.get("width", 1)) if start >= 0 else (0, 0)
        attribute = mark.get("attribute", "")
        return span.diagnostic(code, message, self.file, hint, fixes, attribute, characters)


class CollectedDiagnostics(NamedTuple):
    """What a stage of loading and the stages before it have found.

    Attributes:
        errors: The diagnostics that prevent loading the tree.
        warnings: The other diagnostics.
    """

    errors: tuple[Diagnostic, ...] = ()
    warnings: tuple[Diagnostic, ...] = ()

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
    """Collects the diagnostics of a stage, after those of the earlier stages.

    Args:
        before: What the earlier stages have found.
        max_comparisons: The maximum number of comparisons for suggestions of similar names in hints.

    Attributes:
        errors: The errors so far.
        warnings: The warnings so far.
    """

    def __init__(
        self, before: CollectedDiagnostics | None = None, max_comparisons: int = MAX_COMPARISONS
    ) -> None:
        self.errors: list[Diagnostic] = []
        self.warnings: list[Diagnostic] = []
        self._comparisons_left = max_comparisons
        self._added: set[object] = set()
        self._counts: Counter[str] = Counter()
        if before is not None:
            for diagnostic in (*before.errors, *before.warnings):
                self.add(diagnostic)

    def report(
        self,
        document: Document,
        code: DiagnosticCode,
        message: str,
        element: Element,
        hint: str = "",
        fixes: Sequence[Fix] = (),
        **mark: Unpack[Mark],
    ) -> None:
        """Add a diagnostic about an element of *document*; see `Document.diagnostic`."""
        self.add(document.diagnostic(code, message, element, hint, fixes, **mark))

    def add(self, diagnostic: Diagnostic) -> None:
        """Add *diagnostic*, unless it was added before, or MAX_PER_CODE diagnostics with its code were.

        Of several warnings with the same code and place, the first is kept: a tree that is called twice is
        checked twice.
        """
        place = (diagnostic.code, diagnostic.file, diagnostic.line, diagnostic.column)
        key = diagnostic if diagnostic.is_error else place
        if not self.is_full(diagnostic.code) and key not in self._added:
            self._counts[diagnostic.code] += 1
            self._added.add(key)
            (self.errors if diagnostic.is_error else self.warnings).append(diagnostic)

    def is_full(self, code: DiagnosticCode) -> bool:
        """Return whether no further diagnostics with *code* are collected."""
        return self._counts[code] >= MAX_PER_CODE

    def take_comparisons(self, names: Sized) -> bool:
        """Reserve the comparisons to search *names* for a similar name; return whether enough are left.

        After `max_comparisons` the result is False: of thousands of mistakes, only the first get hints.
        """
        if len(names) > self._comparisons_left:
            return False
        self._comparisons_left -= len(names)
        return True

    @property
    def diagnostics(self) -> CollectedDiagnostics:
        """All diagnostics so far."""
        return CollectedDiagnostics(tuple(self.errors), tuple(self.warnings))


def sort_diagnostics(diagnostics: Sequence[Diagnostic]) -> list[Diagnostic]:
    """Return *diagnostics* grouped by file, and sorted by line and column within each file."""
    files: dict[str, int] = {}
    for item in diagnostics:
        files.setdefault(item.file, len(files))
    return sorted(diagnostics, key=lambda item: (files[item.file], item.line, item.column))
