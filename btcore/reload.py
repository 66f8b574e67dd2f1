"""Watches the XML, and swaps the tree between two ticks. The blackboard stays."""

from collections.abc import Sequence
from pathlib import Path

from btcore.errors import BtcoreError
from btcore.registry import Registry
from btcore.tree import Tree
from btcore.xml.build import Maker
from btcore.xml.check import Examined, examine
from btcore.xml.faults import Faults
from btcore.xml.includes import PackageResolver, with_includes
from btcore.xml.source import read_file


class Watch:
    """Tells whether the file *path*, or one that it includes, was saved since the last look."""

    def __init__(self, path: Path, packages: PackageResolver | None = None) -> None:
        self.path = path
        self.packages = packages
        self._files = self._all_files()
        self._stamps = _stamps(self._files)

    def saved(self) -> bool:
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
            documents = with_includes(read_file(self.path), Faults(), self.packages)
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


def successor(
    tree: Tree, examined: Examined, resources: Sequence[object] = (), nodes: Registry | None = None
) -> Tree:
    """The tree of an *examined* document, on the blackboard and the clock of *tree*, which isn't touched.

    *nodes* are what the document was examined with; default those of *tree*. Halt *tree* before the new
    one is ticked. Raises TreeError when the document is broken; the blackboard is then as it was.
    """
    board = tree.blackboard
    before = set(board.local())
    try:
        examined.faults.raise_errors()
        return Maker(examined, nodes or tree.registry, board, resources, tree.clock).tree()
    except BtcoreError:
        for key in [key for key in board.local() if key not in before]:
            board.unset(key)
        raise


def reloaded(
    tree: Tree, path: Path, resources: Sequence[object] = (), packages: PackageResolver | None = None
) -> Tree:
    """A new tree from *path* in place of *tree*, which is halted: same blackboard, clock and nodes.

    Raises TreeError when the file is broken; then *tree* was not touched and goes on.
    """
    examined = examine(read_file(path), tree.registry, tree.id, packages=packages)
    made = successor(tree, examined, resources)
    tree.halt()
    return made
