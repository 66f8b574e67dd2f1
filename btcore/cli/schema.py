"""``btcore schema``: an XSD of the palette, for editors."""

from collections.abc import Sequence
from pathlib import Path

import click

from btcore.cli import node_libraries, node_models
from btcore.xml.schema import write_schema


@click.command(short_help="Print an XML schema of the nodes, for editors.")
@node_libraries.plugin_option
@node_models.model_option
@click.option(
    "--format",
    "format_",
    type=click.Choice(["3", "4"]),
    default="4",
    show_default=True,
    help="Of which XML format.",
)
def schema(plugins: Sequence[str], models: Sequence[Path], format_: str) -> None:
    """Print an XSD of everything that trees may hold: built in, installed, or brought by --plugin.

    An editor that is told of it completes tags and ports, and shows what they mean.
    """
    nodes = node_libraries.load_libraries(plugins).nodes
    node_models.add_node_models(nodes, models)
    click.echo(write_schema(nodes, int(format_)), nl=False)
