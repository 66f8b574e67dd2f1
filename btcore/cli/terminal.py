"""How things look in a terminal: statuses, node kinds, diagnostics."""

import os
from collections.abc import Iterable
from typing import Final

import click
from rich.console import Console
from rich.text import Text

from btcore.errors import (
    BtcoreError,
    Diagnostic,
    TreeError,
    excerpt,
)
from btcore.nodes.builtin_nodes import BUILTIN_NODES
from btcore.status import NodeType, Status

STATUS_STYLE: Final = {
    Status.IDLE: "dim",
    Status.RUNNING: "bold yellow",
    Status.SUCCESS: "bold green",
    Status.FAILURE: "bold red",
    Status.SKIPPED: "cyan",
}
STATUS_SIGN: Final = {
    Status.IDLE: "○",
    Status.RUNNING: "▶",
    Status.SUCCESS: "✔",
    Status.FAILURE: "✘",
    Status.SKIPPED: "↷",
}
KIND_STYLE: Final = {
    NodeType.ACTION: "green",
    NodeType.CONDITION: "cyan",
    NodeType.CONTROL: "bold blue",
    NodeType.DECORATOR: "magenta",
    NodeType.SUBTREE: "bold yellow",
}
_KIND_SIGN: Final = {
    NodeType.ACTION: "▪",
    NodeType.CONDITION: "◦",
    NodeType.CONTROL: "●",
    NodeType.DECORATOR: "◇",
    NodeType.SUBTREE: "▣",
}


def stdout_console() -> Console:
    """The console for what was asked for: stdout. In a pipe or a file, lines may be long."""
    console = Console(highlight=False)
    if not console.is_terminal and "COLUMNS" not in os.environ:
        console.width = 140
    return console


def stderr_console() -> Console:
    """The console for progress and mistakes: stderr."""
    return Console(stderr=True, highlight=False)


def node_symbol(symbol: str, kind: NodeType) -> str:
    """The sign for a node: that of its class's *symbol*, else that of its *kind*."""
    return symbol[:1] or _KIND_SIGN.get(kind, "▪")


def recorded_symbol(node_id: str, kind: NodeType) -> str:
    """The sign for a node of a log, which knows the ID and the kind alone."""
    cls = BUILTIN_NODES[4].get(node_id) or BUILTIN_NODES[3].get(node_id)
    return node_symbol("" if cls is None else cls.node_symbol, kind)


def format_status(value: Status) -> Text:
    """A status as sign and word, in its colour."""
    return Text(f"{STATUS_SIGN[value]} {value.name}", style=STATUS_STYLE[value])


def format_diagnostic(one: Diagnostic) -> Text:
    """A diagnostic as people read it: place, code, sentence, the line with carets, the hint."""
    colour = "red" if one.is_error else "yellow"
    text = Text()
    text.append(f"{one.where}: ", style="bold")
    text.append(f"{one.code} ", style=f"bold {colour}")
    text.append(one.message)
    if one.source and one.line:
        for line in excerpt(one.source, one.line, one.column, one.width).split("\n"):
            carets = not line.strip(" |^") and "^" in line
            text.append("\n")
            text.append(line, style=f"bold {colour}" if carets else "dim")
    if one.hint:
        text.append("\n      " + one.hint, style="italic")
    return text


def print_diagnostics(found: Iterable[Diagnostic]) -> None:
    """Print diagnostics on stderr, an empty line between them."""
    console = stderr_console()
    for number, one in enumerate(found):
        if number:
            console.print()
        console.print(format_diagnostic(one), soft_wrap=True)


def print_error(message: str) -> None:
    """Print one sentence as an error, on stderr."""
    stderr_console().print(Text.assemble(("error: ", "bold red"), message), soft_wrap=True)


def print_warning(message: str) -> None:
    """Print one sentence as a warning, on stderr."""
    stderr_console().print(Text.assemble(("warning: ", "bold yellow"), message), soft_wrap=True)


def print_labelled(word: str, rest: str) -> None:
    """Print that something happened, on stderr."""
    stderr_console().print(Text.assemble((word, "bold"), " ", rest), soft_wrap=True)


def print_notes(sentences: Iterable[str]) -> None:
    """Print what may help besides, on stderr."""
    for sentence in sentences:
        stderr_console().print(Text.assemble(("note: ", "bold"), sentence), soft_wrap=True)


def print_btcore_error(found: BtcoreError) -> None:
    """Print what is wrong with a user's things, and the notes added to it, on stderr."""
    if isinstance(found, TreeError):
        print_diagnostics(found.diagnostics)
    else:
        print_error(str(found))
    print_notes(getattr(found, "__notes__", ()))


def print_click_error(exception: click.ClickException) -> None:
    """Print what a user did wrong on the command line, and where the options are explained."""
    message = exception.format_message()
    print_error(message[:1].lower() + message[1:])
    context = getattr(exception, "ctx", None)
    if isinstance(exception, click.UsageError) and context is not None:
        stderr_console().print(f"       '{context.command_path} --help' lists what it takes.", style="dim")
