"""Printing on the terminal. Names come from robots, which may be hostile."""

import click

from btcore.escaping import escape_controls


def print_line(text: str = "", err: bool = False) -> None:
    """Print *text* as a single line, with control characters escaped.

    Args:
        err: Whether to print on stderr instead of stdout.
    """
    click.echo(escape_controls(text, one_line=True), err=err)


def print_message(text: str) -> None:
    """Print *text* to stderr as a message of the monitor, apart from the results of a run."""
    print_line(f"monitor: {text}", err=True)
