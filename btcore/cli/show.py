"""``btcore show``: a tree, drawn in the terminal or as an SVG, and the data that flows in it."""

import json
from collections.abc import Sequence
from pathlib import Path

import click
from rich.text import Text
from rich.tree import Tree as Drawing

from btcore.cli import (
    files,
    node_libraries,
    node_models,
    terminal,
    trees,
)
from btcore.cli.dataflow_table import print_data
from btcore.status import NodeType
from btcore.xml.lint.data_flow import dataflow_to_dicts, trace_dataflow
from btcore.xml.plan.document_checks import analyse_document
from btcore.xml.read.document import parse_file
from btcore.xml.render.svg import diagram_to_svg
from btcore.xml.render.tree_drawing import DiagramNode, diagram_of_document


@click.command(short_help="Draw a tree, or list its data.")
@click.argument("source", metavar="TREE")
@click.option("--tree", metavar="ID", help="Which of the file's trees; default: its main one.")
@node_libraries.plugin_option
@node_models.model_option
@click.option("--ports/--no-ports", default=True, help="Whether ports and scripts are shown.")
@click.option(
    "--svg",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Draw it into an SVG file instead.",
)
@click.option(
    "--data", "as_table", is_flag=True, help="Who writes and who reads each blackboard entry, instead."
)
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object (a list for --data).")
def show(
    source: str,
    tree: str | None,
    plugins: Sequence[str],
    models: Sequence[Path],
    ports: bool,
    svg: Path | None,
    as_table: bool,
    as_json: bool,
) -> None:
    """Draw TREE, a file or the name of a tree that comes with btcore, with its subtrees in place."""
    if svg is not None and (as_table or as_json):
        other = "--data" if as_table else "--json"
        raise click.UsageError(f"--svg and {other} are two answers: ask for one.")
    path = trees.find(source)
    found = node_libraries.load_libraries(plugins)
    with found.annotate_errors():
        document = parse_file(path)
        node_models.add_node_models(found.nodes, models, [document])
        examined = analyse_document(document, found.nodes, tree)
        examined.diagnostics.raise_errors()
    main, format = examined.main, examined.planner.dialect.format
    assert main is not None, "a document without a main tree has errors"
    if as_table:
        rows = trace_dataflow(examined, found.nodes)
        if as_json:
            _print_json(dataflow_to_dicts(rows))
        else:
            print_data(rows)
        return
    root = diagram_of_document(examined)
    if svg is not None:
        files.write(svg, diagram_to_svg(root, main.id, format).encode())
    elif as_json:
        _print_json(_as_data(root))
    else:
        head = Text.assemble((main.id, "bold"), (f"  {path}  format {format}", "dim"))
        drawing = Drawing(head, guide_style="dim")
        _draw(root, drawing, ports)
        terminal.stdout_console().print(drawing)


def _print_json(data: object) -> None:
    click.echo(json.dumps(data, ensure_ascii=False, indent=2))


def _draw(node: DiagramNode, above: Drawing, ports: bool) -> None:
    """Add *node*, and what is below, to the drawing."""
    sign = terminal.node_symbol(node.symbol, node.type)
    line = Text(f"{sign} ", style=terminal.KIND_STYLE.get(node.type, ""))
    line.append(node.name, style="bold" if node.type is not NodeType.ACTION else "")
    if node.name != node.id:
        line.append(f"  {node.id}", style=terminal.KIND_STYLE.get(node.type, ""))
    line.append(f"  {node.uid}", style="dim")
    if ports:
        for key, text, _ in node.ports:
            pointer = text.strip().startswith("{")
            line.append(f"  {key}=", style="dim")
            line.append(text, style="yellow" if pointer else "italic")
        for key, text in node.scripts.items():
            line.append(f"  {key}=", style="dim")
            line.append(text, style="magenta")
    branch = above.add(line)
    for child in node.children:
        _draw(child, branch, ports)


def _as_data(node: DiagramNode) -> dict[str, object]:
    """A node as plain data."""
    return {
        "uid": node.uid,
        "id": node.id,
        "name": node.name,
        "type": node.type.name,
        "ports": {name: text for name, text, _ in node.ports},
        "scripts": dict(node.scripts),
        "children": [_as_data(child) for child in node.children],
    }
