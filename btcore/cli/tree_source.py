"""The source of a tree: the options that select it, and its file."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final, Literal

import click

from btcore import bundled_trees
from btcore.cli.node_libraries import LibraryOptions, NodeLibraries
from btcore.errors import BtcoreError, TreeError
from btcore.input_files import read_error, read_stream
from btcore.options import option
from btcore.registry.registry import Registry
from btcore.xml.define import define
from btcore.xml.plan.plan import Plans, plan
from btcore.xml.read.document import Document
from btcore.xml.read.read import parse_bytes, parse_file, parse_text

if TYPE_CHECKING:
    from click.shell_completion import CompletionItem

STDIN: Final = Path("-")
"""Stands for the standard input in place of the path of a file."""


def complete_tree(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> "list[CompletionItem]":
    """Return the bundled trees and the XML files that begin with *incomplete*."""
    from click.shell_completion import CompletionItem

    names = [name for name in bundled_trees.names() if name.startswith(incomplete)]
    if not names:
        return [CompletionItem(incomplete, type="file")]
    files = sorted(str(path) for path in Path().glob("*.xml") if path.name.startswith(incomplete))
    return [CompletionItem(name) for name in [*files, *names]]


def complete_tree_id(ctx: click.Context, parameter: click.Parameter, incomplete: str) -> list[str]:
    """Return the IDs of the trees in the file that the command line names."""
    # click does not assign the arguments when the last word is an option that lacks its value.
    source = ctx.params.get("source") or next(iter(ctx.args), "")
    try:
        root = parse_file(bundled_trees.find(source)).root
    except BtcoreError:
        return []
    ids = [tree.get("ID") or "" for tree in root.iterchildren("BehaviorTree")]
    return [tree_id for tree_id in ids if tree_id.startswith(incomplete)]


class TreeOptions(LibraryOptions):
    """The options that select a tree of a file, and the nodes that are available to it."""

    tree: (
        Annotated[
            str,
            option(
                "Use this tree of the file instead of its main tree.", metavar="ID", complete=complete_tree_id
            ),
        ]
        | None
    ) = None
    format: (
        Annotated[
            Literal[3, 4],
            option("The XML format. By default the file's BTCPP_format attribute; 3 without the attribute."),
        ]
        | None
    ) = None
    confined: Annotated[
        bool,
        option("Reject included files outside of the folder of the tree's file; for trees from strangers."),
    ] = False


given_keys = click.option(
    "--given",
    multiple=True,
    metavar="KEY",
    help="Assume that the program sets the blackboard key KEY before the first tick. Repeatable.",
)


def find_source(name: str) -> Path:
    """Return the file for *name* as `bundled_trees.find` does, or `STDIN` for `-`.

    Raises:
        BtcoreError: There is no such file or tree; the message suggests the nearest name.
    """
    return STDIN if name == str(STDIN) else bundled_trees.find(name)


def parse_source(path: Path, confined: bool) -> Document:
    """Read and parse a tree.

    Args:
        path: The file, or `STDIN`.
        confined: Whether includes from outside of the file's folder, or of the working directory, are errors.
    """
    if path != STDIN:
        return parse_file(path, confined=confined)
    try:
        data = read_stream(sys.stdin.buffer, "stdin")
    except OSError as error:
        raise BtcoreError(f"stdin can't be read: {read_error(error)}") from None
    return parse_bytes(data, "<stdin>", confined=confined)


class TreeReader:
    """Reads and checks the file of the tree that a command was given.

    Attributes:
        path: The XML file, or `STDIN`.
        options: The options that select the tree.
        libraries: The available nodes; by default those that *options* name, as far as the tree needs them.
        adapt_registry: Returns the nodes for the tree, made of the available nodes; None = no change.
    """

    def __init__(
        self,
        path: Path,
        options: TreeOptions,
        libraries: NodeLibraries | None = None,
        adapt_registry: Callable[[Registry], Registry] | None = None,
    ) -> None:
        self.path = path
        self.options = options
        self.libraries = libraries or NodeLibraries(
            options.plugins, options.models, options.confined, btcore_on_demand=True
        )
        self.adapt_registry = adapt_registry

    @property
    def name(self) -> str:
        """The name of the file without its suffix, and the ID of the tree unless it is the main tree."""
        name = "stdin" if self.path == STDIN else self.path.stem
        return name if self.options.tree is None else f"{name}:{self.options.tree}"

    def read_plans(self, text: str | None = None) -> Plans:
        """Read and check the file, and return the plans of its tree, which have no errors.

        Args:
            text: The text of another program in place of the file's. It includes only files of the folder.
        """
        try:
            if text is None:
                document = parse_source(self.path, self.options.confined)
            else:
                document = parse_text(text, "" if self.path == STDIN else str(self.path), confined=True)
            sources, nodes = self.libraries.read(document)
            if self.adapt_registry is not None:
                nodes = self.adapt_registry(nodes)
            plans = plan(define(sources, self.options.tree, self.options.format), nodes)
            plans.diagnostics.raise_errors()
        except TreeError as error:
            # An unknown node may belong to an installed library that cannot be imported.
            for note in self.libraries.missing_library_notes(error.diagnostics):
                error.add_note(note)
            raise
        return plans
