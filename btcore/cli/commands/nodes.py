"""`btcore nodes`: list the available nodes as a table, as JSON, or as a TreeNodesModel for Groot."""

from collections.abc import Sequence
from typing import Final

import click
from rich.style import Style
from rich.text import Text

from btcore.blackboard.ports import Direction, Port
from btcore.cli import terminal
from btcore.cli.node_libraries import AllNodesOptions, NodeLibraries, complete_node_id
from btcore.documentation_site import node_url
from btcore.field_options import pass_options
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.suggestions import did_you_mean, join_names
from btcore.values import DOUBLE
from btcore.xml.models.tree_nodes_model import write_models

_ORDER: Final = (NodeType.CONTROL, NodeType.DECORATOR, NodeType.CONDITION, NodeType.ACTION, NodeType.SUBTREE)
_ARROW: Final = {Direction.IN: "→", Direction.OUT: "←", Direction.INOUT: "↔"}


@click.command()
@click.argument("ids", nargs=-1, metavar="[ID]…", shell_complete=complete_node_id)
@pass_options(AllNodesOptions, "options")
@click.option("--xml", "as_xml", is_flag=True, help="Print a TreeNodesModel, which Groot can import.")
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object.")
def nodes(ids: Sequence[str], options: AllNodesOptions, as_xml: bool, as_json: bool) -> None:
    """List the nodes that trees can use: built-in, installed, and loaded by --plugin or --model.

    With IDs, list only these nodes.
    """
    palette = NodeLibraries(options.plugins, options.models).nodes.manifests_of(options.format)
    if unknown := [node_id for node_id in ids if node_id not in palette]:
        hint = did_you_mean(unknown[0], palette) or "; without an ID, all nodes are listed"
        raise click.UsageError(f"unknown node {join_names(unknown)}{hint}")
    manifests = [palette[node_id] for node_id in ids] if ids else list(palette.values())
    if as_xml:
        terminal.print_xml(write_models(manifests, options.format))
    elif as_json:
        data = {manifest.id: _to_json_data(manifest) for manifest in manifests}
        terminal.print_json(data, indent=2)
    else:
        _print(manifests)


def _print(manifests: Sequence[Manifest]) -> None:
    several = len({manifest.library for manifest in manifests}) > 1
    table = terminal.new_table()
    table.add_column("node", no_wrap=True)
    table.add_column("description and ports", ratio=1)
    if several:
        table.add_column("from", style="dim", no_wrap=True)
    for kind in _ORDER:
        section = sorted((item for item in manifests if item.type is kind), key=lambda item: item.id)
        for number, manifest in enumerate(section):
            name = terminal.node_symbol(manifest.spec.symbol, kind)
            url = node_url(manifest.id, manifest.library)
            name.append(manifest.id, style=Style(bold=True, link=url))
            first_paragraph = manifest.description.strip().split("\n\n")[0]
            about = Text(" ".join(first_paragraph.split()))
            if manifest.ports:
                about.append("\n" if about else "")
                about.append_text(Text("   ").join(_format_port(port) for port in manifest.ports.values()))
            origin = [manifest.library] if several else []
            table.add_row(name, about, *origin, end_section=number == len(section) - 1)
    terminal.stdout_console().print(table)


def _format_port(port: Port) -> Text:
    # With normal spaces the terminal would break a port between its name and its type.
    text = Text.assemble((_ARROW[port.direction] + "\u00a0", "dim"), (port.name, "yellow"))
    type_name = port.type.name.replace("BT::", "").replace("std::", "").replace(" ", "\u00a0")
    text.append(f"\u00a0{type_name}", style="dim")
    if port.default is not None:
        default = port.default
        if default and port.type is DOUBLE:
            default = f"{float(default):g}"
        text.append(f"\u00a0=\u00a0{default or '””'}", style="cyan")
    return text


def _to_json_data(manifest: Manifest) -> dict[str, object]:
    return {
        "type": manifest.type.name,
        "ports": {
            port.name: {
                "direction": port.direction.value,
                "type": port.type.name,
                "default": port.default,
                "description": port.description,
            }
            for port in manifest.ports.values()
        },
        "description": manifest.description,
        "metadata": manifest.metadata,
        "library": manifest.library,
        "url": node_url(manifest.id, manifest.library),
    }
