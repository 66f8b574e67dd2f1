"""``btcore show``: a tree, drawn in the terminal."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field

import click
from rich.text import Text
from rich.tree import Tree as Drawing

from btcore.cli import library, paint, trees
from btcore.status import NodeType
from btcore.xml.check import examine
from btcore.xml.plan import NodePlan, Planner
from btcore.xml.source import read_file


@dataclass(slots=True)
class Shown:
    """One node as it is drawn: *uid* as a run numbers it, *ports* and *scripts* as they are written."""

    uid: int
    id: str
    name: str
    type: NodeType
    ports: dict[str, str]
    scripts: dict[str, str]
    children: list["Shown"] = field(default_factory=list)


@click.command(short_help="Draw a tree in the terminal.")
@click.argument("source", metavar="TREE")
@click.option("--tree", metavar="ID", help="Which of the file's trees; default: its main one.")
@library.plugin_option
@click.option("--ports/--no-ports", default=True, help="Whether ports and scripts are shown.")
@click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
def show(source: str, tree: str | None, plugins: Sequence[str], ports: bool, as_json: bool) -> None:
    """Draw TREE, a file or the name of a tree that comes with btcore, with its subtrees in place."""
    path = trees.find(source)
    found = library.library(plugins)
    with found.explaining():
        planner, main, faults = examine(read_file(path), found.nodes, tree)
        faults.raise_errors()
    assert main is not None, "a document without a main tree has errors"
    root = Numbering(planner).of_tree(main.id)
    if as_json:
        click.echo(json.dumps(_as_data(root), ensure_ascii=False, indent=2))
        return
    head = Text.assemble((main.id, "bold"), (f"  {path}  format {planner.dialect.format}", "dim"))
    drawing = Drawing(head, guide_style="dim")
    _draw(root, drawing, ports)
    paint.output().print(drawing)


class Numbering:
    """Unfolds a checked tree into its nodes, numbered as in a run of it: depth first, from 1."""

    def __init__(self, planner: Planner) -> None:
        self._planner = planner
        self._uid = 0

    def of_tree(self, id: str) -> Shown:
        """The root of the tree *id*, with all that is below."""
        root = self._planner.plan(self._planner.forest.by_id[id]).root
        assert root is not None, "the tree has been checked"
        return self._of(root)

    def _of(self, plan: NodePlan) -> Shown:
        self._uid += 1
        call = plan.call
        ports = {port.name: text for port, text, written in plan.ports if written}
        if call is not None:
            name = plan.name or call.tree
            shown = Shown(self._uid, plan.id, name, NodeType.SUBTREE, dict(call.written), plan.scripts)
            shown.children.append(self.of_tree(call.tree))
            return shown
        kind = plan.manifest.type if plan.manifest is not None else NodeType.UNDEFINED
        shown = Shown(self._uid, plan.id, plan.name or plan.id, kind, ports, plan.scripts)
        shown.children += [self._of(child) for child in plan.children]
        return shown


def _draw(node: Shown, above: Drawing, ports: bool) -> None:
    """Add *node*, and what is below, to the drawing."""
    line = Text(paint.sign(node.id, node.type) + " ", style=paint.KIND_STYLE.get(node.type, ""))
    line.append(node.name, style="bold" if node.type is not NodeType.ACTION else "")
    if node.name != node.id:
        line.append(f"  {node.id}", style=paint.KIND_STYLE.get(node.type, ""))
    line.append(f"  {node.uid}", style="dim")
    if ports:
        for key, text in node.ports.items():
            pointer = text.strip().startswith("{")
            line.append(f"  {key}=", style="dim")
            line.append(text, style="yellow" if pointer else "italic")
        for key, text in node.scripts.items():
            line.append(f"  {key}=", style="dim")
            line.append(text, style="magenta")
    branch = above.add(line)
    for child in node.children:
        _draw(child, branch, ports)


def _as_data(node: Shown) -> dict[str, object]:
    """A node as plain data."""
    return {
        "uid": node.uid,
        "id": node.id,
        "name": node.name,
        "type": node.type.name,
        "ports": node.ports,
        "scripts": node.scripts,
        "children": [_as_data(child) for child in node.children],
    }
