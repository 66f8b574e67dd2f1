"""``--model FILE``: nodes that a command knows from a TreeNodesModel alone."""

from collections.abc import Iterable, Sequence
from pathlib import Path

import click

from btcore.registry.registry import Registry
from btcore.xml.models.model_file import add_explicit_nodes, add_models
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import Document
from btcore.xml.read.includes import resolve_includes

model_option = click.option(
    "--model",
    "models",
    multiple=True,
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="A TreeNodesModel, say, Groot's: its nodes are known without code; may be given several times.",
)


def add_node_models(nodes: Registry, models: Sequence[Path], documents: Iterable[Document] = ()) -> None:
    """Add the nodes of *models*, and those that explicit tags name in *documents* and what they include.

    Without *models* nothing is added: an unknown node is a mistake then. Raises TreeError.
    """
    for model in models:
        add_models(nodes, model)
    if models:
        add_document_nodes(nodes, documents)


def add_document_nodes(nodes: Registry, documents: Iterable[Document]) -> None:
    """Add the unknown nodes that explicit tags name in *documents* and in what they include."""
    # What can't be included is told when the tree is checked.
    add_explicit_nodes(
        nodes, [one for document in documents for one in resolve_includes(document, DiagnosticCollector())]
    )
