"""Errors and warnings as `btcore validate` finds them, with the ranges of the protocol."""

from collections.abc import Callable, Collection, Iterable, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec

from btcore.diagnostics import Diagnostic, shown_diagnostics
from btcore.errors import TreeError
from btcore.lint.validate import validate_document
from btcore.registry.registry import Registry
from btcore.xml.edit.editor import Edit
from btcore.xml.edit.quick_fixes import FixMaker, QuickFix
from btcore.xml.read.document import Document
from btcore_studio.language.studio_protocol import Problem, ProblemData

if TYPE_CHECKING:
    from lsprotocol import types

SOURCE: Final = "btcore"


class Report(NamedTuple):
    """An error or a warning about a file.

    Attributes:
        file: The file; "" = a document without a file.
        line: The line, from 0.
        start: The start in the line, in UTF-16 code units.
        end: The end in the line, in UTF-16 code units.
        code: The diagnostic code; "" = the import of a node library failed.
        is_error: Whether the tree cannot be loaded, or not be ticked.
        message: What is wrong.
        hint: How to correct the problem, or "".
        url: The documentation of the code, or "".
        outer_key: See `Diagnostic.outer_key`.
        attributes: See `Diagnostic.attributes`.
        characters: See `Diagnostic.characters`.
        fixes: The fixes, with offsets in the text of the file.
    """

    file: str
    line: int
    start: int
    end: int
    code: str
    is_error: bool
    message: str
    hint: str = ""
    url: str = ""
    outer_key: str = ""
    attributes: tuple[str, ...] = ()
    characters: tuple[int, int] = (0, 0)
    fixes: tuple[QuickFix, ...] = ()

    @property
    def range(self) -> "types.Range":
        """The place in the file."""
        # The import would take a third of the time in which the worker process starts.
        from lsprotocol import types

        return types.Range(types.Position(self.line, self.start), types.Position(self.line, self.end))

    def diagnostic(self) -> "types.Diagnostic":
        """Return the diagnostic of the protocol."""
        from lsprotocol import types

        problem = self.problem()
        return types.Diagnostic(
            self.range,
            problem.message,
            types.DiagnosticSeverity(problem.severity),
            self.code or None,
            types.CodeDescription(self.url) if self.url else None,
            SOURCE,
            data=msgspec.to_builtins(problem.data),
        )

    def problem(self) -> Problem:
        """Return what the protocol has beside the place and the code."""
        message = self.message + (f"\n{self.hint}" if self.hint else "")
        return Problem(1 if self.is_error else 2, message, ProblemData(self.attributes, self.characters))


def report_from_data(data: Sequence[Any]) -> Report:
    """Return the report that a list of JSON contains."""
    report = Report(*data)
    fixes = tuple(
        QuickFix(title, tuple(Edit(*edit) for edit in edits), is_safe)
        for title, edits, is_safe in report.fixes
    )
    start, end = report.characters
    return report._replace(attributes=tuple(report.attributes), characters=(start, end), fixes=fixes)


def check(
    parse: Callable[[], Document],
    nodes_for: Callable[[Document], Registry],
    given: Collection[str] = (),
    text_of: Callable[[str], str] | None = None,
) -> list[Report]:
    """Return the errors of a document and its includes, then the warnings, as `btcore validate` shows them.

    Args:
        parse: Parses the document; may raise TreeError.
        nodes_for: Returns the available nodes for a document.
        given: Keys that the main tree's blackboard holds before the first tick.
        text_of: Returns the text of a file that was read, or with "" of the document without a file; None =
            fixes are not needed.
    """
    try:
        document = parse()
        diagnostics = validate_document(document, nodes=nodes_for(document), given=given)
    except TreeError as error:
        diagnostics = list(error.diagnostics)
    errors = [item for item in diagnostics if item.is_error]
    warnings = [item for item in diagnostics if not item.is_error]
    shown, _ = shown_diagnostics([*errors, *warnings])
    makers: dict[str, FixMaker] = {}
    reports: list[Report] = []
    for item in shown:
        fixes: list[QuickFix] = []
        if item.fixes and text_of is not None:
            if item.file not in makers:
                makers[item.file] = FixMaker(text_of(item.file))
            fixes = makers[item.file].fixes_of(item)
        reports.append(report_of(item, fixes))
    return reports


def report_of(item: Diagnostic, fixes: Iterable[QuickFix] = ()) -> Report:
    """Return the report of a diagnostic, with *fixes*."""
    column = max(0, item.column - 1)
    before, marked = item.source[:column], item.source[column : column + item.width]
    # Without a column, the whole line is marked.
    if not item.column:
        before, marked = "", item.source
    start = _units(before)
    end = start + max(1, _units(marked)) if item.line else start
    place = (item.file, max(0, item.line - 1), start, end)
    return Report(
        *place,
        str(item.code),
        item.is_error,
        item.message,
        item.hint,
        item.code.url,
        item.outer_key,
        item.attributes,
        item.characters,
        tuple(fixes),
    )


def _units(text: str) -> int:
    """Return the number of UTF-16 code units of *text*."""
    return len(text) if text.isascii() else len(text) + sum(character > "\uffff" for character in text)


def merge(reports: Iterable[Sequence[Report]]) -> list[Report]:
    """Return the reports of one file from several checks, each once: errors first, then sorted by place."""
    merged = list(dict.fromkeys(report for reports_of_check in reports for report in reports_of_check))
    return sorted(merged, key=lambda report: (not report.is_error, report.line, report.start))
