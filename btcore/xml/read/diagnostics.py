"""Collecting every fault of a document, so that all are told at once."""

from btcore.diagnostic_codes import UNKNOWN_NODE
from btcore.errors import (
    Diagnostic,
    PortError,
    TreeError,
    UnknownNodeError,
    XmlSyntaxError,
)


class DiagnosticCollector:
    """The diagnostics found so far: *errors* refuse the tree, *warnings* don't."""

    def __init__(self) -> None:
        self.errors: list[Diagnostic] = []
        self.warnings: list[Diagnostic] = []
        self._noted: set[Diagnostic] = set()

    def add(self, diagnostic: Diagnostic) -> None:
        """Note *diagnostic*, unless it was noted already."""
        if diagnostic not in self._noted:
            self._noted.add(diagnostic)
            (self.errors if diagnostic.is_error else self.warnings).append(diagnostic)

    def raise_errors(self) -> None:
        """Raise all errors as one TreeError, or as a subclass if they are all of its sort."""
        if self.errors:
            raise make_tree_error(self.errors)


def make_tree_error(errors: list[Diagnostic]) -> TreeError:
    """The exception for *errors*, in the order of the documents."""
    ordered = sort_diagnostics(errors)
    if all(one.code.startswith("E0") for one in ordered):
        return XmlSyntaxError(ordered)
    if all(one.code == UNKNOWN_NODE for one in ordered):
        return UnknownNodeError(ordered)
    if all(one.code.startswith("E2") for one in ordered):
        return PortError(ordered)
    return TreeError(ordered)


def sort_diagnostics(diagnostics: list[Diagnostic]) -> list[Diagnostic]:
    """*diagnostics* in the order of the text, file by file."""
    files = list(dict.fromkeys(one.file for one in diagnostics))
    return sorted(diagnostics, key=lambda one: (files.index(one.file), one.line, one.column))
