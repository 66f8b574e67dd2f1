"""The source of a run's tree: its file, read at the start and, with ``--watch``, after each save."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

from btcore.cli import node_models
from btcore.cli.node_libraries import NodeLibraries
from btcore.cli.tick_loop import POLL_INTERVAL_S
from btcore.loading.hot_reload import FileWatcher
from btcore.registry.registry import Registry
from btcore.xml.plan.document_checks import DocumentAnalysis, analyse_document
from btcore.xml.read.document import parse_file


class CheckedSource(NamedTuple):
    """The analysis of a document without errors, and the registry that it was analysed with."""

    examined: DocumentAnalysis
    nodes: Registry


class TreeSource:
    """The file of a tree, and how to read it.

    Args:
        path: The XML file.
        tree: The ID of the tree; None for the file's main tree.
        libraries: The available nodes.
        models: Files with a TreeNodesModel, whose nodes have no code.
        format: The XML format (3 or 4); None for the file's own.
    """

    def __init__(
        self,
        path: Path,
        tree: str | None,
        libraries: NodeLibraries,
        models: Sequence[Path],
        format: int | None = None,
    ) -> None:
        self.path = path
        self.tree = tree
        self.format = format
        self.libraries = libraries
        self.without_code = bool(models)
        node_models.add_node_models(libraries.nodes, models)

    def read(self) -> CheckedSource:
        """Read and check the file.

        Raises:
            TreeError: The file has an error.
        """
        with self.libraries.annotate_errors():
            document = parse_file(self.path)
            nodes = self.libraries.nodes
            if self.without_code:
                # A copy, since the saved file may declare other ports for the same explicit tag.
                nodes = nodes.copy()
                node_models.add_document_nodes(nodes, [document])
            examined = analyse_document(document, nodes, self.tree, self.format)
            examined.diagnostics.raise_errors()
        return CheckedSource(examined, nodes)


class SaveWatcher:
    """Detects that a tree's file, or a file that it includes, was saved.

    Calling it is cheap: it looks at the files only once every `POLL_INTERVAL_S` seconds.
    """

    def __init__(self, path: Path) -> None:
        self._watch = FileWatcher(path)
        self._next = time.monotonic() + POLL_INTERVAL_S
        self._written = False

    def __call__(self) -> bool:
        """Return True once after each save, when the file did not change between two looks.

        Waiting for a second look avoids reading a file that an editor is still writing.
        """
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + POLL_INTERVAL_S
        before, self._written = self._written, self._watch.has_changed()
        return before and not self._written
