"""The options and arguments that name a tree."""

from pathlib import Path

import click

from btcore import bundled_trees

tree_option = click.option("--tree", metavar="ID", help="Which of the file's trees; default: its main one.")
format_option = click.option(
    "--format",
    type=click.Choice(["3", "4"]),
    callback=lambda ctx, option, value: None if value is None else int(value),
    help="The format of the XML; default: what its BTCPP_format says, without one 3.",
)


def find(name: str) -> Path:
    """Return the file that *name* means: a file's path, or the name of a bundled tree.

    Raises:
        click.UsageError: There is neither; the message has the nearest name.
    """
    try:
        return bundled_trees.find(name)
    except FileNotFoundError as error:
        raise click.UsageError(str(error)) from error
