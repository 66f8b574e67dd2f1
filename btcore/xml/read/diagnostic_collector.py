"""The diagnostics that the stages of loading collect about documents."""

from collections import Counter
from collections.abc import Sequence, Sized
from typing import Final, NamedTuple, Unpack

from btcore.diagnostic_codes import DiagnosticCode, DiagnosticKind
from btcore.diagnostics import Diagnostic
from btcore.errors import PortError, TreeError, UnknownNodeError, XmlSyntaxError
from btcore.fixes import Fix
from btcore.xml.read.document import Document, Mark
from btcore.xml.read.element import Element

MAX_COMPARISONS: Final = 50_000
"""Maximum number of comparisons of misspelt names with known names in a stage; each takes about 30 µs."""
MAX_PER_CODE: Final = 50_000
"""Maximum number of diagnostics that are collected with the same code."""

_EXCEPTIONS: Final[dict[DiagnosticKind, type[TreeError]]] = {
    "document error": XmlSyntaxError,
    "unknown node": UnknownNodeError,
    "port error": PortError,
}


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
