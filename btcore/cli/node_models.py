"""``--model FILE``: nodes that are declared by a TreeNodesModel and have no code."""

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
    help="Load node declarations from a TreeNodesModel file, such as Groot exports: these nodes need no "
    "code. Repeatable.",
)


def add_node_models(nodes: Registry, models: Sequence[Path], documents: Iterable[Document] = ()) -> None:
    """Add nodes that have no code to a registry.

    Without *models* nothing is added, so that unknown nodes remain errors.

    Args:
        nodes: The registry.
        models: Files with a TreeNodesModel.
        documents: Documents whose explicit tags, such as ``<Action ID="Move"/>``, declare further nodes;
            the documents that they include count as well.

    Raises:
        TreeError: A model is invalid.
    """
    for model in models:
        add_models(nodes, model)
    if models:
        add_document_nodes(nodes, documents)


def add_document_nodes(nodes: Registry, documents: Iterable[Document]) -> None:
    """Add the unknown nodes in explicit tags of *documents*, and of the documents that they include."""
    diagnostics = DiagnosticCollector()  # dropped: failing includes are reported when the tree is checked
    add_explicit_nodes(
        nodes, [included for document in documents for included in resolve_includes(document, diagnostics)]
    )
