"""How a run makes its tree: once, or whenever its file is saved."""

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
    """A document without errors, and the nodes that it was examined with."""

    examined: DocumentAnalysis
    nodes: Registry


class TreeSource:
    """The file *path*, which of its trees, and the nodes for it: those *found*, and those of *models*.

    *format* (3 or 4) overrides what the file says.
    """

    def __init__(
        self,
        path: Path,
        tree: str | None,
        found: NodeLibraries,
        models: Sequence[Path],
        format: int | None = None,
    ) -> None:
        self.path = path
        self.tree = tree
        self.format = format
        self.found = found
        self.without_code = bool(models)
        node_models.add_node_models(found.nodes, models)

    def read(self) -> CheckedSource:
        """The file as it is now. Raises TreeError."""
        with self.found.annotate_errors():
            document = parse_file(self.path)
            nodes = self.found.nodes
            if self.without_code:
                # A saved file may give the ports of an explicit tag anew.
                nodes = nodes.copy()
                node_models.add_document_nodes(nodes, [document])
            examined = analyse_document(document, nodes, self.tree, self.format)
            examined.diagnostics.raise_errors()
        return CheckedSource(examined, nodes)


class SaveWatcher:
    """Tells that a tree's file, or one that it includes, was saved. To be asked often: it looks rarely."""

    def __init__(self, path: Path) -> None:
        self._watch = FileWatcher(path)
        self._next = time.monotonic() + POLL_INTERVAL_S
        self._written = False

    def __call__(self) -> bool:
        """Whether there is something new, once, as soon as a look finds the writing over."""
        now = time.monotonic()
        if now < self._next:
            return False
        self._next = now + POLL_INTERVAL_S
        before, self._written = self._written, self._watch.has_changed()
        return before and not self._written
