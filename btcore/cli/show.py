"""``btcore show``: a tree, drawn in the terminal or as an SVG, and the data that flows in it."""

import json
from collections.abc import Sequence
from pathlib import Path

import click
from rich.text import Text
from rich.tree import Tree as Drawing

from btcore.cli import files, library, paint, palettes, trees
from btcore.cli.data import print_data
from btcore.status import NodeType
from btcore.xml.check import examine
from btcore.xml.dataflow import as_data, data_rows
from btcore.xml.drawing.picture import sketch_to_svg
from btcore.xml.drawing.sketch import Sketch, sketch_of_document
from btcore.xml.source import read_file


@click.command(short_help="Draw a tree, or list its data.")
@click.argument("source", metavar="TREE")
@click.option("--tree", metavar="ID", help="Which of the file's trees; default: its main one.")
@library.plugin_option
@palettes.model_option
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
    found = library.library(plugins)
    with found.explaining():
        document = read_file(path)
        palettes.add_palettes(found.nodes, models, [document])
        examined = examine(document, found.nodes, tree)
        examined.faults.raise_errors()
    main, format = examined.main, examined.planner.dialect.format
    assert main is not None, "a document without a main tree has errors"
    if as_table:
        rows = data_rows(examined, found.nodes)
        if as_json:
            _print_json(as_data(rows))
        else:
            print_data(rows)
        return
    root = sketch_of_document(examined)
    if svg is not None:
        files.write(svg, sketch_to_svg(root, main.id, format).encode())
    elif as_json:
        _print_json(_as_data(root))
    else:
        head = Text.assemble((main.id, "bold"), (f"  {path}  format {format}", "dim"))
        drawing = Drawing(head, guide_style="dim")
        _draw(root, drawing, ports)
        paint.output().print(drawing)


def _print_json(data: object) -> None:
    click.echo(json.dumps(data, ensure_ascii=False, indent=2))


def _draw(node: Sketch, above: Drawing, ports: bool) -> None:
    """Add *node*, and what is below, to the drawing."""
    line = Text(paint.sign(node.id, node.type) + " ", style=paint.KIND_STYLE.get(node.type, ""))
    line.append(node.name, style="bold" if node.type is not NodeType.ACTION else "")
    if node.name != node.id:
        line.append(f"  {node.id}", style=paint.KIND_STYLE.get(node.type, ""))
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


def _as_data(node: Sketch) -> dict[str, object]:
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
