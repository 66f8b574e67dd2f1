"""``btcore schema``: print an XML schema (XSD) of the available nodes, for editors."""

from collections.abc import Sequence
from pathlib import Path

import click

from btcore.cli import node_libraries, node_models
from btcore.xml.schema import write_schema


@click.command(short_help="Print an XML schema (XSD) for XML editors.")
@node_libraries.plugin_option
@node_models.model_option
@click.option(
    "--format",
    "format_",
    type=click.Choice(["3", "4"]),
    default="4",
    show_default=True,
    help="The XML format that the schema describes.",
)
def schema(plugins: Sequence[str], models: Sequence[Path], format_: str) -> None:
    """Print an XML schema (XSD) of trees and all available nodes.

    The schema covers nodes that are built-in, installed, or loaded by --plugin or --model. XML editors use it
    to complete tags and attributes, and to show their documentation.
    """
    nodes = node_libraries.load_libraries(plugins).nodes
    node_models.add_node_models(nodes, models)
    click.echo(write_schema(nodes, int(format_)), nl=False)
