"""The options that select a tree and its XML format, and finding the file of a TREE argument."""

from pathlib import Path

import click

from btcore import bundled_trees

tree_option = click.option("--tree", metavar="ID", help="Use this tree of the file instead of its main tree.")
format_option = click.option(
    "--format",
    type=click.Choice(["3", "4"]),
    callback=lambda ctx, option, value: None if value is None else int(value),
    help="The XML format. By default the file's BTCPP_format attribute; 3 without the attribute.",
)


def find(name: str) -> Path:
    """Return the file for *name*, which is the path of a file or the name of a bundled tree.

    Raises:
        click.UsageError: There is no such file or tree; the message suggests the nearest name.
    """
    try:
        return bundled_trees.find(name)
    except FileNotFoundError as error:
        raise click.UsageError(str(error)) from error
