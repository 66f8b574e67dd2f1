"""Printing on the terminal. Names come from robots, which may be hostile."""

import click

from btcore.escaping import escape_controls


def print_line(text: str = "", err: bool = False, colour: str | None = None, dim: bool = False) -> None:
    """Print *text* as a single line, with control characters escaped.

    Args:
        text: The line.
        err: Whether to print on stderr instead of stdout.
        colour: The name of a colour; None is the terminal's colour.
        dim: Whether to print in a weaker colour.
    """
    click.secho(escape_controls(text, one_line=True), err=err, fg=colour, dim=dim or None)


def print_message(text: str) -> None:
    """Print *text* to stderr as a message of the monitor, apart from the results of a run."""
    print_line(f"monitor: {text}", err=True)
