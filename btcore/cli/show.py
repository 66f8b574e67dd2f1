"""``btcore show``: draw a tree in the terminal or as SVG, or list its data flow."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

import click
from rich.text import Text
from rich.tree import Tree as Drawing

from btcore.cli import files, node_libraries, node_models, terminal, trees
from btcore.cli.dataflow_table import print_data
from btcore.status import NodeType
from btcore.xml.lint.data_flow import trace_dataflow
from btcore.xml.plan.document_checks import analyse_document
from btcore.xml.read.document import parse_file
from btcore.xml.render.svg import diagram_to_svg
from btcore.xml.render.tree_drawing import DiagramNode, diagram_of_document


@click.command(short_help="Draw a tree, or list its data flow.")
@click.argument("source", metavar="TREE")
@trees.tree_option
@node_libraries.plugin_option
@node_models.model_option
@click.option("--ports/--no-ports", default=True, help="Show or hide ports and scripts.")
@click.option(
    "--svg",
    type=click.Path(dir_okay=False, path_type=Path),
    metavar="FILE",
    help="Write the drawing to an SVG file.",
)
@click.option(
    "--data", "as_table", is_flag=True, help="List the nodes that write and read each blackboard entry."
)
@click.option("--json", "as_json", is_flag=True, help="Print a JSON object; with --data a JSON list.")
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
    """Draw TREE with its subtrees in the terminal.

    TREE is an XML file, or the name of a tree that is bundled with btcore.
    """
    if svg is not None and (as_table or as_json):
        other = "--data" if as_table else "--json"
        raise click.UsageError(f"--svg and {other} cannot be used together.")
    path = trees.find(source)
    libraries = node_libraries.load_libraries(plugins)
    with libraries.annotate_errors():
        document = parse_file(path)
        node_models.add_node_models(libraries.nodes, models, [document])
        examined = analyse_document(document, libraries.nodes, tree)
        examined.diagnostics.raise_errors()
    main, format = examined.main, examined.planner.dialect.format
    assert main is not None, "a document without a main tree has errors"
    if as_table:
        rows = trace_dataflow(examined, libraries.nodes)
        if as_json:
            _print_json([asdict(row) for row in rows])
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
    """Add *node* and its descendants to the branch *above* of the drawing."""
    symbol = terminal.node_symbol(node.symbol, node.type)
    line = Text(f"{symbol} ", style=terminal.KIND_STYLE.get(node.type, ""))
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
    """Return a node and its descendants as JSON data."""
    return {
        "uid": node.uid,
        "id": node.id,
        "name": node.name,
        "type": node.type.name,
        "ports": {name: text for name, text, _ in node.ports},
        "scripts": dict(node.scripts),
        "children": [_as_data(child) for child in node.children],
    }
