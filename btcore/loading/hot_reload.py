"""Watches the XML, and swaps the tree between two ticks. The blackboard stays."""

from collections.abc import Sequence
from pathlib import Path

from btcore.errors import BtcoreError
from btcore.registry.registry import Registry
from btcore.tree.tree import Tree
from btcore.xml.build import TreeInstantiator
from btcore.xml.plan.document_checks import DocumentAnalysis, analyse_document
from btcore.xml.read.diagnostics import DiagnosticCollector
from btcore.xml.read.document import parse_file
from btcore.xml.read.includes import PackageResolver, resolve_includes


class FileWatcher:
    """Tells whether the file *path*, or one that it includes, was saved since the last look."""

    def __init__(self, path: Path, packages: PackageResolver | None = None) -> None:
        self.path = path
        self.packages = packages
        self._files = self._all_files()
        self._stamps = _stamps(self._files)

    def has_changed(self) -> bool:
        """Whether one of the files is another than at the last look. While one is gone, none is."""
        now = _stamps(self._files)
        if now is None or now == self._stamps:
            return False
        # What is included may have changed with it.
        self._files = self._all_files()
        self._stamps = _stamps(self._files)
        return True

    def _all_files(self) -> set[Path]:
        try:
            documents = resolve_includes(parse_file(self.path), DiagnosticCollector(), self.packages)
        except BtcoreError:
            return {self.path}
        return {self.path, *(Path(one.file) for one in documents if one.file)}


def _stamps(files: set[Path]) -> dict[Path, tuple[int, int]] | None:
    """When each file was written, and its size; None while one is gone."""
    try:
        found = {path: path.stat() for path in files}
    except OSError:
        return None
    return {path: (one.st_mtime_ns, one.st_size) for path, one in found.items()}


def rebuild_tree(
    tree: Tree, examined: DocumentAnalysis, resources: Sequence[object] = (), nodes: Registry | None = None
) -> Tree:
    """The tree of an *examined* document, on the blackboard and the clock of *tree*, which isn't touched.

    *nodes* are what the document was examined with; default those of *tree*. Halt *tree* before the new
    one is ticked. Raises TreeError when the document is broken; the blackboard is then as it was.
    """
    board = tree.blackboard
    before = set(board.local_entries())
    try:
        examined.diagnostics.raise_errors()
        return TreeInstantiator(examined, nodes or tree.registry, board, resources, tree.clock).instantiate()
    except BtcoreError:
        for key in [key for key in board.local_entries() if key not in before]:
            board.unset(key)
        raise


def reload_tree(
    tree: Tree, path: Path, resources: Sequence[object] = (), packages: PackageResolver | None = None
) -> Tree:
    """A new tree from *path* in place of *tree*, which is halted: same blackboard, clock and nodes.

    Raises TreeError when the file is broken; then *tree* was not touched and goes on.
    """
    examined = analyse_document(parse_file(path), tree.registry, tree.id, packages=packages)
    made = rebuild_tree(tree, examined, resources)
    tree.halt()
    return made
