"""Collect the diagnostics of a document, so that all errors are reported at once."""

from collections import Counter
from collections.abc import Sequence, Sized
from typing import Final, NamedTuple

from btcore.diagnostic_codes import DiagnosticCode, Kind
from btcore.diagnostics import Diagnostic
from btcore.errors import PortError, TreeError, UnknownNodeError, XmlSyntaxError

MAX_COMPARISONS: Final = 50_000
"""Maximum number of comparisons of misspelt names with known names; each takes about 30 µs."""

MAX_PER_CODE: Final = 50_000
"""Maximum number of diagnostics that are collected with the same code."""

_EXCEPTIONS: Final[dict[Kind, type[TreeError]]] = {
    "document error": XmlSyntaxError,
    "unknown node": UnknownNodeError,
    "port error": PortError,
}


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
        self._added: set[Diagnostic] = set()
        self._counts: Counter[str] = Counter()
        if before is not None:
            self._comparisons_left = before.comparisons_left
            for diagnostic in (*before.errors, *before.warnings):
                self.add(diagnostic)

    def add(self, diagnostic: Diagnostic) -> None:
        """Add *diagnostic*, unless an equal diagnostic, or MAX_PER_CODE with its code, were added before."""
        if not self.is_full(diagnostic.code) and diagnostic not in self._added:
            self._counts[diagnostic.code] += 1
            self._added.add(diagnostic)
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
