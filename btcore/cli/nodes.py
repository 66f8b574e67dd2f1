"""``btcore nodes``: the palette, as a table or as a TreeNodesModel for Groot."""

import json
from collections.abc import Sequence
from typing import Final

import click
from rich import box
from rich.table import Table
from rich.text import Text

from btcore.blackboard.ports import Direction, Port
from btcore.cli import node_libraries, terminal
from btcore.registry.manifest import Manifest
from btcore.status import NodeType
from btcore.suggestions import join_names, nearest_name
from btcore.values import DOUBLE
from btcore.xml.models.tree_nodes_model import write_models

_ORDER: Final = (
    NodeType.CONTROL,
    NodeType.DECORATOR,
    NodeType.CONDITION,
    NodeType.ACTION,
    NodeType.SUBTREE,
)
_ARROW: Final = {Direction.IN: "→", Direction.OUT: "←", Direction.INOUT: "↔"}


@click.command(short_help="List the nodes that trees may use.")
@click.argument("ids", nargs=-1, metavar="[ID]…")
@node_libraries.plugin_option
@click.option(
    "--format",
    "format_",
    type=click.Choice(["3", "4"]),
    default="4",
    show_default=True,
    help="Of which XML format.",
)
@click.option("--xml", "as_xml", is_flag=True, help="Print a TreeNodesModel, which Groot imports.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def nodes(ids: Sequence[str], plugins: Sequence[str], format_: str, as_xml: bool, as_json: bool) -> None:
    """List the palette: what is built in, installed, or brought by --plugin. IDs narrow it down."""
    palette = node_libraries.load_libraries(plugins).nodes.manifests_of(4 if format_ == "4" else 3)
    if unknown := [one for one in ids if one not in palette]:
        meant = nearest_name(unknown[0], palette)
        hint = f"Did you mean '{meant}'?" if meant else "Without an ID, all are listed."
        raise click.UsageError(f"there is no node {join_names(unknown)}. {hint}")
    chosen = [palette[one] for one in ids] if ids else list(palette.values())
    if as_xml:
        click.echo(write_models(chosen, int(format_)), nl=False)
    elif as_json:
        click.echo(json.dumps({one.id: _as_data(one) for one in chosen}, ensure_ascii=False, indent=2))
    else:
        _print(chosen)


def _print(chosen: Sequence[Manifest]) -> None:
    """The palette as a table, a section a family; ports stand below what the node does."""
    several = len({one.distribution for one in chosen}) > 1
    table = Table(box=box.SIMPLE_HEAD, padding=(0, 1), show_edge=False)
    table.add_column("node", no_wrap=True)
    table.add_column("what it does, and its ports", ratio=1)
    if several:
        table.add_column("from", style="dim", no_wrap=True)
    for kind in _ORDER:
        family = sorted((one for one in chosen if one.type is kind), key=lambda one: one.id)
        for number, one in enumerate(family):
            name = Text(
                terminal.node_symbol(one.cls.node_symbol, kind) + " ", style=terminal.KIND_STYLE[kind]
            )
            name.append(one.id, style="bold")
            about = Text(_first_paragraph(one.description))
            if one.ports:
                about.append("\n" if about else "")
                about.append_text(Text("   ").join(_port(port) for port in one.ports.values()))
            origin = [one.distribution] if several else []
            table.add_row(name, about, *origin, end_section=number == len(family) - 1)
    terminal.stdout_console().print(table)


def _port(port: Port) -> Text:
    """A port: direction, name, type, default; its parts stay on one line."""
    text = Text.assemble((_ARROW[port.direction] + "\u00a0", "dim"), (port.name, "yellow"))
    text.append(f"\u00a0{_short(port.type.name)}".replace(" ", "\u00a0"), style="dim")
    if port.default is not None:
        default = port.default
        if default and port.type is DOUBLE:
            default = f"{float(default):g}"
        text.append(f"\u00a0=\u00a0{default or '””'}", style="cyan")
    return text


def _short(type_name: str) -> str:
    """A C++ type name without what people don't say."""
    return type_name.replace("BT::", "").replace("std::", "")


def _first_paragraph(description: str) -> str:
    """The first paragraph of *description*, on one line."""
    return " ".join(description.strip().split("\n\n")[0].split())


def _as_data(one: Manifest) -> dict[str, object]:
    """A manifest as plain data."""
    return {
        "type": one.type.name,
        "ports": {
            port.name: {
                "direction": port.direction.value,
                "type": port.type.name,
                "default": port.default,
                "description": port.description,
            }
            for port in one.ports.values()
        },
        "description": one.description,
        "distribution": one.distribution,
    }
