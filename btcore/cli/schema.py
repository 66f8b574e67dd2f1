"""`btcore schema`: print an XML schema (XSD) of the available nodes, for editors."""

from collections.abc import Sequence
from pathlib import Path

import click

from btcore.cli import node_libraries, terminal
from btcore.cli.tree_source import format_option
from btcore.xml.schema import write_schema


@click.command(short_help="Print an XML schema (XSD) for XML editors.")
@node_libraries.library_options
@format_option("The XML format that the schema describes.", default="4")
def schema(plugins: Sequence[str], models: Sequence[Path], format: int) -> None:
    """Print an XML schema (XSD) of trees and all available nodes.

    The schema covers nodes that are built-in, installed, or loaded by --plugin or --model. XML editors use it
    to complete tags and attributes, and to show their documentation.
    """
    nodes = node_libraries.load_libraries(plugins, models).nodes
    terminal.print_xml(write_schema(nodes, format))
