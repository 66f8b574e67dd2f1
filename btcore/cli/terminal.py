"""Printing on the terminal: styles of statuses and nodes, diagnostics, errors and warnings."""

import os
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from itertools import accumulate
from typing import Final

import click
from rich import box
from rich.console import Console, ConsoleOptions, RenderableType
from rich.segment import Segment
from rich.style import Style, StyleType
from rich.table import Table
from rich.text import Span, Text

from btcore.diagnostics import Diagnostic, DiagnosticPart, diagnostic_parts, shown_diagnostics
from btcore.errors import BtcoreError, TreeError
from btcore.escaping import escape_controls, escape_xml, to_json
from btcore.status import NodeType, Status
from btcore.tree.drawing import node_sign, status_label


class _EscapingConsole(Console):
    """A console that escapes the control characters in all texts, tables and lines of progress.

    Links are written only to a terminal, and not if the environment variable NO_COLOR is set.
    """

    def render(self, renderable: RenderableType, options: ConsoleOptions | None = None) -> Iterable[Segment]:
        if isinstance(renderable, Text):
            renderable = _escape(renderable)  # before its lines are wrapped
        has_links = self.file.isatty() and not self.no_color
        for segment in super().render(renderable, options):
            if segment.control:
                yield segment
            else:
                style = segment.style
                if style is not None and style.link and not has_links:
                    style = style.update_link(None)
                yield Segment(escape_controls(segment.text), style)


class _EscapingTable(Table):
    """A table that escapes the control characters in its cells before it measures them."""

    def add_row(
        self, *cells: RenderableType | None, style: StyleType | None = None, end_section: bool = False
    ) -> None:
        # rich would read markup in a cell of type str: "[red]" in a name.
        texts = [Text(cell) if isinstance(cell, str) else cell for cell in cells]
        escaped = [_escape(cell) if isinstance(cell, Text) else cell for cell in texts]
        super().add_row(*escaped, style=style, end_section=end_section)


def _escape(text: Text) -> Text:
    """Return *text* with its control characters escaped, and with the same styles."""
    plain = escape_controls(text.plain)
    if plain == text.plain:
        return text
    # The offset of each character after the escaping.
    offsets = [0, *accumulate(len(escape_controls(character)) for character in text.plain)]
    escaped = text.blank_copy(plain)
    escaped.spans = [Span(offsets[span.start], offsets[span.end], span.style) for span in text.spans]
    return escaped


def stdout_console() -> Console:
    """Return the console for results, on stdout."""
    return _create_console(stderr=False)


def stderr_console() -> Console:
    """Return the console for progress and errors, on stderr."""
    return _create_console(stderr=True)


def print_json(data: object, indent: int | None = None) -> None:
    """Print *data* as JSON on stdout.

    Args:
        data: The data.
        indent: The number of spaces for each level; None prints a single line.

    Examples:
        >>> from btcore.program_runner import print_json
        >>> print_json({"ticks": 3})
        {"ticks": 3}
    """
    is_limited = not (sys.stdout.encoding or "utf-8").lower().startswith("utf")
    click.echo(to_json(data, indent, ensure_ascii=is_limited))


def print_xml(document: str | bytes) -> None:
    """Print an XML document on stdout: on a terminal with escaped control characters, otherwise in UTF-8."""
    if sys.stdout.isatty():
        click.echo(escape_xml(document if isinstance(document, str) else document.decode()), nl=False)
    else:
        # Bytes, because Windows would translate the line ends of a text, and write it in another encoding.
        click.echo(document.encode() if isinstance(document, str) else document, nl=False)


def _create_console(stderr: bool) -> Console:
    console = _EscapingConsole(stderr=stderr, highlight=False, emoji=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = 140  # in a pipe or a file rich would assume 80, which is too narrow for the tables
    return console


def new_table() -> Table:
    """Return an empty table in the style of all commands."""
    return _EscapingTable(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)


def node_symbol(symbol: str, kind: NodeType) -> Text:
    """Return the character for a node in drawings and a space, in the style of the node's type.

    Text that is appended has this style by default.

    Args:
        symbol: The symbol that the node's class declares, or "". Only its first character is used.
        kind: The node type, whose symbol is used by default.
    """
    sign, style = node_sign(symbol, kind)
    return Text(f"{sign} ", style=style)


def format_status(value: Status | None) -> Text:
    """Return the symbol and the name of a status, in its colour; None: a leaf raised an exception."""
    return Text("✘ RAISED", style="bold red") if value is None else Text(*status_label(value))


def format_diagnostic(diagnostic: Diagnostic) -> Text:
    """Return the place, code and message of a diagnostic, its source line with carets, and its hint.

    The code links to its description in the documentation.
    """
    colour = "red" if diagnostic.is_error else "yellow"
    styles: dict[DiagnosticPart, Style | str] = {
        "place": "bold",
        "code": Style(bold=True, color=colour, link=diagnostic.code.url),
        "message": "",
        "line": "dim",
        "carets": f"bold {colour}",
        "hint": "italic",
    }
    return Text.assemble(*((text, styles[part]) for part, text in diagnostic_parts(diagnostic)))


def print_diagnostics(diagnostics: Iterable[Diagnostic], console: Console | None = None) -> None:
    """Print diagnostics (on stderr by default), separated by empty lines: 100 of each file, and a count."""
    console = console or stderr_console()
    shown, more = shown_diagnostics(diagnostics)
    for number, diagnostic in enumerate(shown):
        if number:
            console.print()
        console.print(format_diagnostic(diagnostic), soft_wrap=True)
    for sentence in more:
        console.print(Text(f"\n{sentence}", style="bold"), soft_wrap=True)


def print_error(message: str, console: Console | None = None) -> None:
    """Print an error on stderr, or on *console*."""
    (console or stderr_console()).print(Text.assemble(("error: ", "bold red"), message), soft_wrap=True)


_collected_warnings: Final[list[list[str]]] = []
"""The lists of all contexts of `collect_warnings`, to which `print_warning` adds each warning."""


def print_warning(message: str, console: Console | None = None) -> None:
    """Print a warning on stderr, or on *console*."""
    for warnings in _collected_warnings:
        warnings.append(message)
    (console or stderr_console()).print(Text.assemble(("warning: ", "bold yellow"), message), soft_wrap=True)


@contextmanager
def collect_warnings() -> Iterator[list[str]]:
    """Return a context with a list, to which all warnings are added that are printed by any thread."""
    warnings: list[str] = []
    _collected_warnings.append(warnings)
    try:
        yield warnings
    finally:
        _collected_warnings.remove(warnings)


def print_labelled(word: str, rest: str) -> None:
    """Print *rest* after the bold *word*, on stderr."""
    stderr_console().print(Text.assemble((word, "bold"), " ", rest), soft_wrap=True)


def print_notes(notes: Iterable[str]) -> None:
    """Print notes on stderr, which follow an error or a warning."""
    for note in notes:
        stderr_console().print(Text.assemble(("note: ", "bold"), note), soft_wrap=True)


def print_btcore_error(error: BtcoreError) -> None:
    """Print *error*, or all its diagnostics, and its notes on stderr."""
    if isinstance(error, TreeError):
        print_diagnostics(error.diagnostics)
    else:
        print_error(str(error))
    print_notes(getattr(error, "__notes__", ()))


_CLICK_STARTS: Final = (
    "Argument ",
    "Could not ",
    "Got unexpected ",
    "Invalid value",
    "Missing ",
    "No such ",
    "Option ",
)
"""How click's own messages begin. All other messages begin as they should, for example with a node's name."""


def print_click_error(exception: click.ClickException) -> None:
    """Print an error of the command line on stderr, with a reference to the command's help."""
    message = exception.format_message()
    if message.startswith(_CLICK_STARTS):
        message = message[:1].lower() + message[1:]
    print_error(message)
    context = getattr(exception, "ctx", None)
    if isinstance(exception, click.MissingParameter) and context is not None and context.params.get("tree"):
        print_notes(["--tree takes the ID of a tree in a file; the file is an argument of its own"])
    if isinstance(exception, click.UsageError) and context is not None:
        stderr_console().print(f"       Try '{context.command_path} --help' for help.", style="dim")
