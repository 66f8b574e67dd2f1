"""`btcore show`: draw a tree in the terminal, as SVG or as PNG, or list its data flow."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click
from rich.text import Text

from btcore.cli import files, terminal
from btcore.cli.tree_source import TreeOptions, TreeReader, complete_tree, find_source
from btcore.field_options import pass_options
from btcore.tree.drawing import Fragment, draw_branches, is_ascii_only, node_label
from btcore_drawing.data_flow import DataflowAccess, DataflowRow, trace_dataflow
from btcore_drawing.diagram import DiagramNode, diagram_of_document
from btcore_drawing.svg import MAX_SIDE, diagram_to_svg, svg_to_png


@click.command()
@click.argument("source", metavar="TREE", shell_complete=complete_tree)
@pass_options(TreeOptions, "options")
@click.option("--ports/--no-ports", default=True, help="Show or hide ports and scripts.")
@click.option("--svg", type=files.OUTPUT_FILE, metavar="FILE", help="Write the drawing to an SVG file.")
@click.option(
    "--png",
    type=files.OUTPUT_FILE,
    metavar="FILE",
    help=f"Write the drawing to a PNG file, at most {MAX_SIDE} pixels wide and high.",
)
@click.option(
    "--data", "list_keys", is_flag=True, help="List the nodes that write and read each blackboard entry."
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object; with --data a JSON list.")
def show(
    source: str,
    options: TreeOptions,
    ports: bool,
    svg: Path | None,
    png: Path | None,
    list_keys: bool,
    as_json: bool,
) -> None:
    """Draw TREE with its subtrees in the terminal.

    TREE is an XML file, - for stdin, or the name of a tree that is bundled with btcore.
    """
    picture_option = "--svg" if svg is not None else "--png" if png is not None else None
    if picture_option is not None and (list_keys or as_json):
        option = "--data" if list_keys else "--json"
        raise click.UsageError(f"{picture_option} and {option} cannot be used together.")
    path = find_source(source)
    plans = TreeReader(path, options).read_plans()
    main, format = plans.main_tree, plans.format
    assert main is not None, "a document without a main tree has errors"
    if list_keys:
        rows = trace_dataflow(plans)
        if as_json:
            terminal.print_json([asdict(row) for row in rows], indent=2)
        else:
            _print_data(rows)
        return
    root = diagram_of_document(plans)
    if picture_option is not None:
        drawing = diagram_to_svg(root, main.id, format)
        if svg is not None:
            files.write(svg, drawing.encode())
        if png is not None:
            files.write(png, svg_to_png(drawing))
    elif as_json:
        terminal.print_json(_to_json_data(root), indent=2)
    else:
        console = terminal.stdout_console()
        ascii = is_ascii_only(console.file)
        head = [(main.id, "bold"), (f"  {path}  format {format}", "dim")]
        lines = draw_branches(
            root, lambda node: node.children, lambda node: _format_label(node, ports, ascii), head, ascii
        )
        for line in lines:
            console.print(Text.assemble(*line), soft_wrap=True)


def _format_label(node: DiagramNode, ports: bool, ascii: bool) -> list[Fragment]:
    line = [*node_label(node.name, node.id, node.symbol, node.type, ascii), (f"  {node.uid}", "dim")]
    if ports:
        for key, text, _ in node.ports:
            pointer = text.strip().startswith("{")
            line += [(f"  {key}=", "dim"), (text, "yellow" if pointer else "italic")]
        for key, text in node.conditions.items():
            line += [(f"  {key}=", "dim"), (text, "magenta")]
    return line


def _to_json_data(node: DiagramNode) -> dict[str, object]:
    """Return a node and its descendants as JSON data."""
    return {
        "uid": node.uid,
        "id": node.id,
        "name": node.name,
        "type": node.type.name,
        "ports": {name: text for name, text, _ in node.ports},
        "scripts": dict(node.conditions),
        "children": [_to_json_data(child) for child in node.children],
    }


def _print_data(rows: Sequence[DataflowRow]) -> None:
    table = terminal.new_table()
    table.add_column("entry", no_wrap=True)
    table.add_column("type", style="dim")
    table.add_column("written by")
    table.add_column("read by")
    for number, row in enumerate(rows):
        name = Text.assemble((f"{row.scope}/" if row.scope else "", "dim"), (row.key, "bold yellow"))
        last = number + 1 == len(rows) or rows[number + 1].scope != row.scope
        accesses = _format_accesses(row.writers, row), _format_accesses(row.readers, row)
        table.add_row(name, row.type, *accesses, end_section=last)
    terminal.stdout_console().print(table if rows else Text("no node uses the blackboard", style="dim"))


def _format_accesses(accesses: Sequence[DataflowAccess], row: DataflowRow) -> Text:
    """Return a line for each access, with the key that the node uses if it differs from the entry's key."""
    if not accesses:
        return Text("—", style="dim")
    lines = []
    for access in accesses:
        line = Text(access.node)
        line.append(f" {access.attribute}", style="dim")
        if access.key.lstrip("@") != row.key:
            line.append(f" as {access.key}", style="yellow")
        lines.append(line)
    return Text("\n").join(lines)
