"""Shell completion of the arguments of commands: trees, IDs of trees and IDs of nodes."""

from pathlib import Path

import click
from click.shell_completion import CompletionItem

from btcore import bundled_trees
from btcore.errors import BtcoreError


def complete_tree(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the bundled trees and the XML files that begin with *incomplete*."""
    names = [name for name in bundled_trees.names() if name.startswith(incomplete)]
    if not names:
        return [CompletionItem(incomplete, type="file")]
    files = sorted(str(path) for path in Path().glob("*.xml") if path.name.startswith(incomplete))
    return [CompletionItem(name) for name in [*files, *names]]


def complete_tree_id(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the IDs of the trees in the file that the command line names."""
    from btcore.xml.read.read import parse_file

    # click does not assign the arguments when the last word is an option that lacks its value.
    source = ctx.params.get("source") or next(iter(ctx.args), "")
    try:
        root = parse_file(bundled_trees.find(source)).root
    except (BtcoreError, FileNotFoundError):
        return []
    ids = [tree.get("ID") or "" for tree in root.iterchildren("BehaviorTree")]
    return [CompletionItem(tree_id) for tree_id in ids if tree_id.startswith(incomplete)]


def complete_node_id(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[CompletionItem]:
    """Return the IDs of the built-in and installed nodes."""
    from btcore.cli.node_libraries import load_libraries

    ids = load_libraries(()).nodes.manifests_of(4)
    return [CompletionItem(node_id) for node_id in ids if node_id.startswith(incomplete)]
